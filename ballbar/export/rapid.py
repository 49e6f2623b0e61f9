"""The identified robot for an ABB controller: motor offsets and the corrected DH table as RAPID data, with instructions.

RAPID's `num` holds seven digits, so everything is `dnum`; lengths in mm and angles in degrees, as RAPID has them.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ballbar.export.result import Result, notes
from ballbar.export.rows import standard_rows
from ballbar.export.tables import number
from cell.arrays import Array
from cell.robot_angles import joints_to_motors

_HOW = (
    "HOW TO USE",
    "1. motor_offset_rad: what the calibration adds to each motor's angle so that joint offsets rtheta are right. Save the",
    "   present calibration offsets first. Change all six, since the wrist's motors turn each other's axes, and look at the axis",
    "   angles that the controller shows while the robot stands still: they must change by axis_change_deg. If they change the",
    "   other way, the sign convention of your controller is the opposite: take the negative.",
    "2. dh_*: the whole geometry, for your own kinematics; a controller without absolute accuracy cannot take it. dh_theta_deg goes",
    "   with the motors' present offsets. Or correct the programmed targets off line with `ballbar correct`.",
    "3. Do one or the other: targets from `ballbar correct` hold for a controller whose offsets are as they were when recorded.",
    "   After step 1 record and identify again before correcting targets.",
)


def motor_offsets(result: Result) -> Array:
    """(6,) [rad] at the motors: what the identified joint offsets add to what the motors show."""
    geometry, nominal = result.calibration.geometry.robot, result.calibration.nominal.robot
    return joints_to_motors(result.cell.robot, geometry.theta - nominal.theta)


def rapid_module(result: Result) -> str:
    """A RAPID module of constants."""
    rows = standard_rows(result.chain)
    robot = result.cell.robot
    axis_change = (
        result.chain.theta - result.calibration.nominal.robot.theta
    ) @ robot.joint_to_axis
    data = {
        "motor_offset_rad": motor_offsets(result),
        "axis_change_deg": np.degrees(axis_change),
        "dh_a_mm": rows.a * 1e3,
        "dh_d_mm": rows.d * 1e3,
        "dh_alpha_deg": np.degrees(rows.alpha),
        "dh_theta_deg": np.degrees(rows.theta),
    }
    sigmas = {
        "sigma_a_mm": ("a", 1e3),
        "sigma_d_mm": ("d", 1e3),
        "sigma_alpha_deg": ("alpha", np.degrees(1.0)),
    }
    sigmas["sigma_theta_deg"] = ("theta", np.degrees(1.0))
    said = [
        *_HOW,
        "Standard DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha); sigma -1: not identified, nominal.",
        "Then the tool turns about its y by dh_tool_beta_deg.",
    ]
    lines = [
        f"MODULE {_short(result.name)}_identified",
        *(f"  ! {line}" for line in [*said, *notes(result)]),
    ]
    lines += [f"  CONST dnum {name}{{6}} := [{_listed(values)}];" for name, values in data.items()]
    lines.append(f"  CONST dnum dh_tool_beta_deg := {number(np.degrees(rows.tool_beta))};")
    lines += [
        f"  CONST dnum {name}{{6}} := [{_listed(_sigma(result, kind, unit))}];"
        for name, (kind, unit) in sigmas.items()
    ]
    return "".join(f"{line}\n" for line in [*lines, "ENDMODULE"])


def _sigma(result: Result, kind: str, unit: float) -> list[float]:
    entries = (result.calibration.file.parameters[f"r{kind}{i + 1}"] for i in range(6))
    return [-1.0 if entry.sigma is None else entry.sigma * float(unit) for entry in entries]


def _short(name: str) -> str:
    """RAPID names have at most 32 characters and begin with a letter."""
    return ("r" if not name[:1].isalpha() else "") + name[:20]


def _listed(values: Iterable[float]) -> str:
    return ", ".join(number(v) for v in values)
