"""State of a robot without ball-bar: its weight, and backlash on the side that it presses to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.geometry import BAR_ROWS, Geometry, robot_geometry
from ballbar.cell.poses import PoseGroup
from ballbar.cell.robot_angles import by_axis
from ballbar.ident.corrections.base import Channel, Correction, State, backlash_transition
from ballbar.ident.loads.gear_loads import (
    BEARINGS,
    MassModel,
    link_masses,
    mass_model,
    no_loads,
    own_weight,
)

# [N m] load under which backlash counts in the middle (notes/identification sec. 1, metric)
UNDECIDED, UNDECIDED_WRIST = 3.0, 0.15
OPEN = 3.0  # to which factor the friction of a small arm's joints is known


def undecided_loads(joints: int, masses: MassModel | None) -> Array:
    """(J,) [N m] load below which the weight does not tell the flank of a gear's backlash."""
    if masses is None or masses.friction is None:
        return by_axis(joints, main=UNDECIDED, wrist=UNDECIDED_WRIST)
    return masses.friction


def backlash_flanks(load: Array, masses: MassModel | None = None) -> Array:
    """(J, N) flank, -1, 0 or 1, on which gears at rest lie under a load (J, N) [N m].

    0 where the load hardly decides.
    """
    undecided = undecided_loads(len(load), masses)[:, None]
    return np.where(np.abs(load) < undecided, 0.0, np.sign(load))


def undecided_flanks(
    description: Cell | Robot, geometry: Geometry, corrections: Sequence[Correction], q: Array
) -> Array:
    """(J, N) 1 where friction may hold a gear of a small arm on either flank, else 0.

    Arguments as of `regressors_at_rest`.
    """
    masses, geometry, robot = _loaded(description, geometry, corrections)
    if masses is None or masses.friction is None:
        return np.zeros((robot.joints, len(q)))
    return are_undecided(masses, masses.friction, geometry, q).astype(float)


def are_undecided(
    masses: MassModel, friction: Array, geometry: Geometry, q: Array
) -> NDArray[np.bool_]:
    """(J, N) whether friction (J,) [N m] may hold a gear on either flank; q (N, J) [rad]."""
    load = own_weight(masses, geometry, q).gear
    return np.asarray(np.abs(load) < OPEN * friction[:, None])


def regressors_at_rest(
    description: Cell | Robot, geometry: Geometry, corrections: Sequence[Correction], q: Array
) -> Iterator[tuple[Channel, Array]]:
    """Channel and regressor (N,) of every coefficient at logged angles q (N, J) [rad].

    A cell's robot of this geometry carries plate and instrument; a robot alone is loaded by its
    links, as its file places them.
    """
    masses, geometry, robot = _loaded(description, geometry, corrections)
    state = state_at_rest(masses, geometry, q, robot.joint_to_gear, backlash_transition(robot))
    for correction in corrections:
        regressors = correction.regressors(state)
        for coefficient, regressor in zip(correction.coefficients, regressors, strict=True):
            yield coefficient.channel, regressor


def _loaded(
    description: Cell | Robot, geometry: Geometry, corrections: Sequence[Correction]
) -> tuple[MassModel | None, Geometry, Robot]:
    """Masses that load the gears, None where no correction needs them; geometry; and the robot."""
    if isinstance(description, Cell):
        return mass_model(description), geometry, description.robot
    loaded = any(correction.slopes is not None for correction in corrections)
    masses = link_masses(description) if loaded else None
    return masses, robot_geometry(description), description


def state_in_order(
    masses: MassModel | None, geometry: Geometry, q: Array, to_gear: Array, width: Array
) -> State:
    """State at rest at poses one after the other; arguments as of `state_at_rest`.

    Where the load does not decide, friction keeps a gear of a small arm on the flank from which its
    joint came. Of larger ones the play is small, and programs move between the poses of a table.
    """
    state = state_at_rest(masses, geometry, q, to_gear, width)
    if masses is None or masses.friction is None:
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
        flanks=backlash_flanks(weight.gear, masses),
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
