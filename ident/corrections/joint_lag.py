"""Joints are logged with different lags: a controller filters its axes unlike.

A lag that all joints share is the clock's offset, so those of all gears but the first are relative
to it. A filter is not a delay: the second order of its effect is a coefficient of its own, on
every gear.
"""

from __future__ import annotations

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State, remade

JOINT_LAG = "joint_lag"
LAG = 3e-3  # [s] a filter of 50 Hz; assumed
SECOND_ORDER = 5e-5  # [s^2] of two filters of 10 ms; assumed


@remade
def joint_lag(robot: Robot) -> Correction:
    """Lags [s] of gears 2 to J after the first, and second-order terms [s^2] of all gears."""
    joints = robot.joints
    lags = [Coefficient(f"lag{i + 1}", "s", 0.0, LAG, GEAR + i) for i in range(1, joints)]
    seconds = [
        Coefficient(f"lag_order2_{i + 1}", "s^2", 0.0, SECOND_ORDER, GEAR + i)
        for i in range(joints)
    ]

    def regressors(state: State) -> list[Array]:
        return [*state.gear_speed[1:], *state.gear_acceleration]

    return Correction(JOINT_LAG, "lags of single joints", (*lags, *seconds), regressors)
