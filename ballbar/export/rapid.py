"""The identified robot for an ABB controller: motor offsets and DH table as RAPID data.

RAPID's `num` holds seven digits, so all data are `dnum`; lengths in mm and angles in degrees, as in
RAPID. Instructions for use stand in comments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ballbar.cell.robot_angles import joints_to_motors
from ballbar.export.result import Result, noted_text, number, numbers
from ballbar.export.rows import hayati_rows, parallel_rows
from ballbar.units import MM

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


def rapid_module(result: Result) -> str:
    """A RAPID module of constants."""
    robot = result.robot
    rows = hayati_rows(result.chain, parallel_rows(result.nominal))
    joint_change = result.chain.theta - result.nominal.theta
    values = {
        "motor_offset_rad": joints_to_motors(robot, joint_change),
        "axis_change_deg": np.degrees(joint_change @ robot.joint_to_axis),
        "dh_a_mm": rows.a * MM,
        "dh_d_mm": rows.d * MM,
        "dh_alpha_deg": np.degrees(rows.alpha),
        "dh_theta_deg": np.degrees(rows.theta),
        "dh_beta_deg": np.degrees(rows.beta),
    }
    sigmas = {
        "sigma_a_mm": _sigma(result, "a", MM),
        "sigma_d_mm": _sigma(result, "d", MM),
        "sigma_alpha_deg": _sigma(result, "alpha", np.degrees(1.0)),
        "sigma_theta_deg": _sigma(result, "theta", np.degrees(1.0)),
    }
    comments = [
        *_HOW,
        "DH: T = product over rows of Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta). beta is 0 but",
        "at nearly parallel axes, where it replaces d (Hayati). Then the tool turns about its y",
        "by dh_tool_beta_deg.",
        "Sigma -1: not identified, nominal.",
    ]
    lines = [
        *(_constants(name, axes) for name, axes in values.items()),
        f"  CONST dnum dh_tool_beta_deg := {number(np.degrees(rows.tool_beta))};",
        *(_constants(name, axes) for name, axes in sigmas.items()),
        "ENDMODULE",
    ]
    # RAPID's names have at most 32 characters and begin with a letter
    short = ("" if result.name[:1].isalpha() else "r") + result.name[:20]
    return f"MODULE {short}_identified\n" + noted_text(result, "  !", comments, lines)


def _sigma(result: Result, kind: str, factor: float) -> list[float]:
    """Standard deviations of rows 1 to J, times `factor`; -1 where a parameter is nominal."""
    named = {parameter.name: parameter for parameter in result.parameters}
    rows = range(1, result.robot.joints + 1)
    entries = [result.entry(named[f"r{kind}{i}"]) for i in rows]
    return [-1.0 if entry.sigma is None else entry.sigma * float(factor) for entry in entries]


def _constants(name: str, values: ArrayLike) -> str:
    """A RAPID array of constants, one for each axis."""
    axes = np.asarray(values, dtype=np.float64).tolist()
    return f"  CONST dnum {name}{{{len(axes)}}} := [{numbers(axes, ', ')}];"
