"""State of a robot that stands still: its weight, and backlash on the side that it presses to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cell.arrays import Array
from cell.descriptions import Robot
from cell.geometry import BAR_ROWS, Geometry, robot_geometry
from cell.robot_angles import by_axis
from ident.corrections.base import Correction, State, backlash_transition
from ident.loads.gear_loads import MassModel, link_masses, no_loads, own_weight

# [N m] load under which backlash counts in the middle (notes/identification sec. 1, metric)
UNDECIDED, UNDECIDED_WRIST = 3.0, 0.15


def backlash_flanks(load: Array) -> Array:
    """(J, N) flank, -1, 0 or 1, on which gears at rest lie under a load (J, N) [N m].

    0 where the load hardly decides.
    """
    undecided = by_axis(len(load), main=UNDECIDED, wrist=UNDECIDED_WRIST)
    return np.where(np.abs(load) < undecided[:, None], 0.0, np.sign(load))


def angles_at_rest(
    robot: Robot, corrections: Sequence[Correction], values: Array, q: Array
) -> Array:
    """(N, J) [rad] actual joint angles at logged ones q (N, J) [rad], links without a load.

    values : (C,) of all coefficients, correction after correction, each of a gear.
    """
    moved = np.zeros((robot.joints, len(q)))
    pairs = regressors_at_rest(robot, corrections, q)
    for value, (channel, regressor) in zip(values, pairs, strict=True):
        moved[channel] += value * regressor
    return np.asarray(q + moved.T @ robot.gear_to_joint)


def regressors_at_rest(
    robot: Robot, corrections: Sequence[Correction], q: Array
) -> list[tuple[int, Array]]:
    """Gear, from 0, and regressor (N,) of every coefficient at q (N, J) [rad].

    By the nominal robot, whose links alone load its gears.
    """
    loaded = any(correction.slopes is not None for correction in corrections)
    masses = link_masses(robot) if loaded else None
    width = backlash_transition(robot)
    state = state_at_rest(masses, robot_geometry(robot), q, robot.joint_to_gear, width)
    pairs = [
        (coefficient.channel, regressor)
        for correction in corrections
        for coefficient, regressor in zip(
            correction.coefficients, correction.regressors(state), strict=True
        )
    ]
    return [(channel, regressor) for channel, regressor in pairs if isinstance(channel, int)]


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
        flanks=backlash_flanks(weight.gear),
    )
