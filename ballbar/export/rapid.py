"""The identified robot for an ABB controller: motor offsets and DH table as RAPID data.

RAPID's `num` holds seven digits, so all data are `dnum`; lengths in mm and angles in degrees, as in
RAPID. Instructions for use stand in comments.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ballbar.export.result import Result, notes
from ballbar.export.rows import standard_rows
from ballbar.export.tables import number
from ballbar.units import MM
from cell.arrays import Array
from cell.robot_angles import joints_to_motors

_HOW = (
    "HOW TO USE",
    "1. motor_offset_rad: the change of each motor's angle that corrects the joint offsets rtheta.",
    "   Save the present calibration offsets first. Change them all, since the motors of the wrist",
    "   turn each other's axes, and watch the axis angles that the controller shows",
    "   while the robot does not move: they must change by axis_change_deg. If they change in the",
    "   other direction, your controller has the opposite sign convention: take the negative.",
    "2. dh_*: the whole geometry, for your own kinematics; a controller without absolute accuracy",
    "   cannot take it. dh_theta_deg goes with the present offsets of the motors. Or correct the",
    "   programmed targets off line with `ballbar correct`.",
    "3. Do either step 1 or step 2: targets from `ballbar correct` are for a controller with the",
    "   offsets of the recording. After step 1 record and identify again before you correct any.",
)


def motor_offsets(result: Result) -> Array:
    """(J,) [rad] change of the motors' angles by the identified joint offsets."""
    geometry, nominal = result.calibration.geometry.robot, result.calibration.nominal.robot
    return joints_to_motors(result.cell.robot, geometry.theta - nominal.theta)


def rapid_module(result: Result) -> str:
    """A RAPID module of constants."""
    rows, robot = standard_rows(result.chain), result.cell.robot
    joint_change = result.chain.theta - result.calibration.nominal.robot.theta
    values = {
        "motor_offset_rad": motor_offsets(result),
        "axis_change_deg": np.degrees(joint_change @ robot.joint_to_axis),
        "dh_a_mm": rows.a * MM,
        "dh_d_mm": rows.d * MM,
        "dh_alpha_deg": np.degrees(rows.alpha),
        "dh_theta_deg": np.degrees(rows.theta),
    }
    sigmas = {
        "sigma_a_mm": _sigma(result, "a", MM),
        "sigma_d_mm": _sigma(result, "d", MM),
        "sigma_alpha_deg": _sigma(result, "alpha", np.degrees(1.0)),
        "sigma_theta_deg": _sigma(result, "theta", np.degrees(1.0)),
    }
    comments = [
        *_HOW,
        "Standard DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha).",
        "Then the tool turns about its y by dh_tool_beta_deg. Sigma -1: not identified, nominal.",
        *notes(result),
    ]
    lines = [f"MODULE {_short(result.name)}_identified", *(f"  ! {text}" for text in comments)]
    size = f"{{{robot.joints}}}"
    lines += [f"  CONST dnum {name}{size} := [{_listed(v)}];" for name, v in values.items()]
    lines.append(f"  CONST dnum dh_tool_beta_deg := {number(np.degrees(rows.tool_beta))};")
    lines += [f"  CONST dnum {name}{size} := [{_listed(v)}];" for name, v in sigmas.items()]
    return "".join(f"{line}\n" for line in [*lines, "ENDMODULE"])


def _sigma(result: Result, kind: str, factor: float) -> list[float]:
    """Standard deviations of the rows, times `factor`; -1 where a parameter is nominal."""
    rows = range(1, result.chain.rows + 1)
    entries = (result.calibration.file.parameters[f"r{kind}{i}"] for i in rows)
    return [-1.0 if entry.sigma is None else entry.sigma * float(factor) for entry in entries]


def _short(name: str) -> str:
    """The name cut for RAPID, whose names have at most 32 characters and begin with a letter."""
    return ("r" if not name[:1].isalpha() else "") + name[:20]


def _listed(values: Iterable[float]) -> str:
    return ", ".join(number(v) for v in values)
