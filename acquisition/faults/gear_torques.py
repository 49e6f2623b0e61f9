"""Motor torques of a robot's log at the gears' outputs, where the model has them."""

from __future__ import annotations

import numpy as np

from acquisition.table.table import Table
from cell.arrays import Array
from cell.descriptions import Robot
from cell.dialect import Dialect
from cell.errors import LogError
from cell.robot_angles import gear_to_axis_torques

# Times the arm's own weight at full reach: no motor bears more at its gear's output, one in
# another unit does.
HEAVY = 20.0


def gear_torques(robot: Robot, table: Table, dialect: Dialect) -> Array | None:
    """(N, J) [N m] motor torques at the gears' outputs, positive along the gear's angle.

    None if they are not logged.

    dialect : names their columns, and says whether they are at the motor, positive along its angle,
        or already behind the gear, positive along the controller's axis angle.
    A gear passes power on: what multiplies the angle, transmission[i, i], divides the torque.
    Losses count as friction, and the couplings between the joints come after the gears (thesis App.
    A).
    Raises LogError for torques that no motor of the robot has.
    """
    columns = dialect.torque_columns
    if not columns or columns[0] not in table.columns:
        return None
    logged = np.stack([table.columns[name] for name in columns], axis=1)
    at_motors = dialect.torques_at == "motors"
    if at_motors:
        torque = logged / np.diag(robot.transmission)
    else:
        torque = gear_to_axis_torques(robot, logged)
    heavy = np.abs(torque) > HEAVY * full_weight(robot)
    if heavy.any():
        row, motor = (int(index) for index in np.argwhere(heavy)[0])
        value = f"{logged[row, motor]:.5g} N m"
        if at_motors:
            value += f" at the motor would be {abs(torque[row, motor]):.3g} N m"
        doubt, place = (
            ("At the gear's output, in percent", "at the motor")
            if at_motors
            else ("In percent", "behind the gear")
        )
        raise LogError(
            f"{table.location(row)}: column {columns[motor]}: {value} at the gear's output of axis "
            f"{motor + 1}, more than {HEAVY:g} times the weight of the whole arm stretched out. "
            f"{int(heavy.any(axis=1).sum())} such rows. {doubt}, in N mm? Here are N m {place}. "
            "Convert the log, or name its dialect in recording.yaml."
        )
    return torque


def full_weight(robot: Robot) -> float:
    """[N m] moment of the arm's whole weight at its full reach; inf where it is unknown."""
    if robot.links is None:
        return float("inf")
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    return float(sum(link.mass for link in robot.links[1:]) * np.linalg.norm(robot.gravity) * reach)
