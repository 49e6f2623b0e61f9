"""State of a robot without ball-bar: its weight, and backlash on the side that it presses to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.geometry import BAR_ROWS, Geometry, robot_geometry
from ballbar.cell.poses import PoseGroup
from ballbar.cell.robot_angles import by_axis
from ballbar.ident.corrections.base import Channel, Correction, State, backlash_transition
from ballbar.ident.loads.gear_loads import (
    BEARINGS,
    MassModel,
    arm_mass,
    link_masses,
    mass_model,
    no_loads,
    own_weight,
)

# [N m] load under which backlash counts in the middle (notes/identification sec. 1, metric)
UNDECIDED, UNDECIDED_WRIST = 3.0, 0.15


SMALL = 10.0  # [kg] of an arm whose joints have less friction: of like arms as mass^(4/3)


def backlash_flanks(load: Array, mass: float = SMALL) -> Array:
    """(J, N) flank, -1, 0 or 1, on which gears at rest lie under a load (J, N) [N m].

    0 where the load hardly decides. mass : [kg] of the arm without its base.
    """
    undecided = by_axis(len(load), main=UNDECIDED, wrist=UNDECIDED_WRIST)
    undecided = undecided * min(1.0, mass / SMALL) ** (4.0 / 3.0)
    return np.where(np.abs(load) < undecided[:, None], 0.0, np.sign(load))


def regressors_at_rest(
    description: Cell | Robot, geometry: Geometry, corrections: Sequence[Correction], q: Array
) -> Iterator[tuple[Channel, Array]]:
    """Channel and regressor (N,) of every coefficient at logged angles q (N, J) [rad].

    A cell's robot of this geometry carries plate and instrument; a robot alone is loaded by its
    links, as its file places them.
    """
    masses: MassModel | None
    if isinstance(description, Cell):
        robot, masses = description.robot, mass_model(description)
    else:
        robot, geometry = description, robot_geometry(description)
        loaded = any(correction.slopes is not None for correction in corrections)
        masses = link_masses(robot) if loaded else None
    state = state_at_rest(masses, geometry, q, robot.joint_to_gear, backlash_transition(robot))
    for correction in corrections:
        regressors = correction.regressors(state)
        for coefficient, regressor in zip(correction.coefficients, regressors, strict=True):
            yield coefficient.channel, regressor


def state_in_order(
    masses: MassModel | None, geometry: Geometry, q: Array, to_gear: Array, width: Array
) -> State:
    """State at rest at poses one after the other; arguments as of `state_at_rest`.

    Where the load does not decide, friction keeps a gear of a small arm on the flank from which its
    joint came. Of larger ones the play is small, and programs move between the poses of a table.
    """
    state = state_at_rest(masses, geometry, q, to_gear, width)
    if masses is None or arm_mass(masses) >= SMALL:
        return state
    came = np.sign(np.diff(state.gears, axis=1, prepend=state.gears[:, :1]))
    flanks = state.load_sign()
    return replace(state, flanks=np.where(flanks == 0.0, came, flanks))


def state_at_rest(
    masses: MassModel | None, geometry: Geometry, q: Array, to_gear: Array, width: Array
) -> State:
    """State of the robot at rest at logged angles q (N, J) [rad], without ball-bar.

    masses : None where no correction needs loads. to_gear : (J, J), gears = joints @ to_gear.
    width : (J,) [N m] of the transition between the flanks of the backlash.
    """
    gears = (q @ to_gear).T
    still = np.zeros_like(gears)
    weight = no_loads(*gears.shape) if masses is None else own_weight(masses, geometry, q)
    return State(
        t=still[0],
        recording=-1,
        gears=gears,
        bar=np.zeros((BAR_ROWS, len(q))),
        loads=weight,
        tension=still[0],
        width=width,
        gear_speed=still,
        gear_acceleration=still,
        flanks=backlash_flanks(weight.gear, SMALL if masses is None else arm_mass(masses)),
    )


def state_in_motion(
    masses: MassModel | None, geometry: Geometry, group: PoseGroup, to_gear: Array, width: Array
) -> State:
    """State of a robot that moved with nothing attached, at the poses of a group.

    Its gears lie on the flanks that their loads choose. to_gear : (J, J), gears = joints @ to_gear.
    width : (J,) [N m] of the transition between the flanks of the backlash.
    """
    motion, at = group.motion, group.at()
    assert motion is not None  # the caller's condition
    speed, acceleration = motion.arm(at)
    state = state_at_rest(None, geometry, group.q, to_gear, width)
    if (held := motion.carried(at)) is not None:
        gear, bearing = held[: len(to_gear)], held[len(to_gear) :].reshape(BEARINGS, 2, -1)
        state = replace(state, loads=replace(state.loads, gear=gear, bearing=bearing))
    elif masses is not None:
        carried = own_weight(masses, geometry, group.q, speed, acceleration)
        state = replace(state, loads=carried)
    return replace(
        state,
        t=at,
        gear_speed=(motion.speed(at) @ to_gear).T,
        gear_acceleration=(acceleration @ to_gear).T,
        flanks=None,
    )
