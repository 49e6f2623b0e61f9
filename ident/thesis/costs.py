"""The thesis's four cost functions, eqs. 2.1 to 2.4, and their derivatives.

Two forms of each. `vector`: signed components, ball-bar minus robot, whose squares add up to the
cost. `thesis`: the printed scalar, which Levenberg-Marquardt squares once more. C_l is printed with
a sign and loses nothing; the others are sums of squares already, so the objective is quartic and
its Jacobian `2 sum e de` vanishes at the solution.

    length          C_l       bd3 - |R_P - o|;                 printed |R_P - o|^2 - bd3^2
    position        C_P       B_P - R_P
    position_angles C_Ptheta  B_P - R_P, sin(b4 - b4hat), sin(b5 - b5hat)
    transform       C_T       the 12 elements of B - R

R is the tool frame by the robot, B by the ball-bar, _P its origin; b4, b5 are ball-bar angles with
their zeros, b4hat, b5hat what the ball-bar's inverse kinematics makes of R
(ballbar.ident.thesis.universal_joint). A metre weighs as much as a radian, as printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import cross, screw
from ballbar.cell.geometry import Parameter, parameter_screw
from ballbar.ident.estimator.closure import Closure
from ballbar.ident.thesis.names import ENCODERS_NEEDED, CostName
from ballbar.ident.thesis.universal_joint import universal_joint_angles, universal_joint_columns

Form = Literal["vector", "thesis"]

# a sample, as vector
EQUATIONS: dict[CostName, int] = {"length": 1, "position": 3, "position_angles": 5, "transform": 12}
ROD = "bd3"


@dataclass(frozen=True)
class Cost:
    """One cost function in one form, with E equations a sample: EQUATIONS, or 1 as printed."""

    name: CostName
    form: Form

    def residual(self, closure: Closure) -> Array:
        """(E, N) [m, rad or 1; printed: m^2 and squares of the others]."""
        if self.form == "vector":
            return _components(self.name, closure)
        if self.name == "length":
            rod = _rod(closure)
            return np.asarray((rod * rod).sum(axis=0) - closure.geometry[ROD] ** 2)[None]
        return np.asarray((_components(self.name, closure) ** 2).sum(axis=0))[None]

    def jacobian(self, closure: Closure, parameters: Sequence[Parameter]) -> Array:
        """(P, E, N) derivative of the residual with respect to each parameter, per m or rad."""
        columns = _derivatives(self.name, closure, parameters)
        if self.form == "vector":
            return columns
        if self.name == "length":
            on_rod = np.array([p.name == ROD for p in parameters], dtype=bool)
            size = np.where(
                on_rod[:, None], closure.geometry[ROD], np.linalg.norm(_rod(closure), axis=0)
            )
            return -2.0 * size[:, None, :] * columns
        return np.asarray(2.0 * np.einsum("pen,en->pn", columns, _components(self.name, closure)))[
            :, None
        ]


def cost_named(name: CostName, form: Form) -> Cost:
    """The cost function of that name. Raises ValueError for an unknown name or form."""
    if name not in ENCODERS_NEEDED:
        raise ValueError(f"unknown cost {name!r}; there are {', '.join(ENCODERS_NEEDED)}")
    if form not in ("vector", "thesis"):
        raise ValueError(f"unknown form {form!r}; there are vector and thesis")
    return Cost(name, form)


def _components(name: CostName, closure: Closure) -> Array:
    """(E, N) signed components of one cost."""
    robot, bar = closure.robot, closure.bar
    if name == "length":
        return np.asarray(closure.geometry[ROD] - np.linalg.norm(_rod(closure), axis=0))[None]
    position = bar.tip - robot.tip
    if name == "position":
        return position
    if name == "position_angles":
        return np.concatenate((position, np.sin(universal_joint_angles(closure).error)))
    return np.concatenate(
        (position, bar.x[-1] - robot.x[-1], bar.y[-1] - robot.y[-1], bar.z[-1] - robot.z[-1])
    )


def _derivatives(name: CostName, closure: Closure, parameters: Sequence[Parameter]) -> Array:
    """(P, E, N) derivatives of the signed components."""
    columns = np.zeros((len(parameters), EQUATIONS[name], closure.robot.tip.shape[1]))
    if name == "length":
        _fill_length(columns, closure, parameters)
        return columns
    joint = universal_joint_angles(closure) if name == "position_angles" else None
    robot_axes, bar_axes = (
        np.stack((f.x[-1], f.y[-1], f.z[-1]), axis=1) for f in (closure.robot, closure.bar)
    )
    for column, parameter in zip(columns, parameters, strict=True):
        motion = _relative_motion(closure, parameter)
        column[:3] = motion[:3]
        if joint:
            column[3:] = np.cos(joint.error) * universal_joint_columns(joint, parameter, motion)
        elif name == "transform" and not parameter.is_length:
            _fill_turn(
                column[3:], motion[3:], robot_axes if parameter.side == "robot" else bar_axes
            )
    return columns


def _relative_motion(closure: Closure, parameter: Parameter) -> Array:
    """(6, N) motion of the ball-bar's tool frame against the robot's.

    A turn about a ball-bar joint is taken about the foot of the common normal, so that joints
    through the tip leave it exactly where it is (thesis Table 3.3).
    """
    motion = parameter_screw(closure.geometry, closure.robot, closure.bar, parameter)
    if parameter.side == "robot":
        return np.negative(motion, out=motion)
    if parameter.side == "bar" and parameter.kind == "theta":
        bar, row = closure.bar, parameter.row
        motion[:3] = cross(
            bar.z[row], bar.tip - (bar.origin[row] + closure.geometry.bar.d[row] * bar.z[row])
        )
    return motion


def _rod(closure: Closure) -> Array:
    """(3, N) [m] from the ball-bar's base to the tool by the robot."""
    return closure.robot.tip - closure.geometry.origin[:, None]


def _fill_length(columns: Array, closure: Closure, parameters: Sequence[Parameter]) -> None:
    rod = _rod(closure)
    along = rod / np.linalg.norm(rod, axis=0)
    for column, parameter in zip(columns[:, 0], parameters, strict=True):
        if parameter.side == "robot":
            column[:] = -(along * screw(closure.robot, parameter.kind, parameter.row)[:3]).sum(
                axis=0
            )
        elif parameter.kind == "origin":
            column[:] = along[parameter.row]
        elif parameter.name == ROD:
            column[:] = 1.0


def _fill_turn(column: Array, turn: Array, axes: Array) -> None:
    """Fill column (9, N) with the changes of the x, y and z axis for a rotation.

    turn : (3, N) [rad]. axes : (3, 3, N), component first.
    """
    change = column.reshape(3, 3, -1)  # axis, component
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        change[:, i] = turn[j] * axes[k] - turn[k] * axes[j]
