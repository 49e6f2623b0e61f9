"""Kinematic parameters of robot and ball-bar as one vector, with the thesis's names.

`ra1..raJ rd1.. ralpha1.. rtheta1..` are the robot's rows, the tool in the last one, and `rbeta` the
Hayati angles of the rows whose axis is parallel to the next one; `ba1..ba5 bd1.. balpha1..
btheta1..` are the rows of the ball-bar. Its base pose in the robot's base frame is the position `ox
oy oz` and the tilt `otx oty`, a turn about x, then y. Source: thesis secs. 2.1-2.2; names of the
parameters: thesis Tables 3.1-3.4.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ballbar.cell.arrays import Array, read_only
from ballbar.cell.chain import Chain, Frames, forward, screw

if TYPE_CHECKING:
    from ballbar.cell.descriptions import Cell, Robot

BAR_ROWS = 5  # one per joint
ROD_ROW = 2  # of the ball-bar, from 0: its d is the rod's length
PARALLEL = 1e-6  # sine of the nominal twist below which neighbouring axes are parallel
_KINDS = ("a", "d", "alpha", "theta")
_NAME = re.compile(r"([rb])(a|d|alpha|theta|beta)([1-9])|o(t?)([xyz])")


@dataclass(frozen=True)
class Parameter:
    """One kinematic parameter and its place in the mechanism."""

    name: str
    side: str  # "robot", "bar" or "base"
    kind: str  # DH kind, or "origin" / "tilt" of the ball-bar's base
    row: int  # from 0

    @property
    def is_length(self) -> bool:
        return self.kind in ("a", "d", "origin")

    @property
    def unit(self) -> str:
        return "m" if self.is_length else "rad"


def parameter_named(name: str) -> Parameter:
    """The parameter that a name such as `ralpha3` stands for. Raises KeyError for another name."""
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise KeyError(name)
    side, kind, row, tilt, axis = parts.groups()
    if side is None:
        return Parameter(name, "base", "tilt" if tilt else "origin", "xyz".index(axis))
    return Parameter(name, "robot" if side == "r" else "bar", kind, int(row) - 1)


@dataclass(frozen=True)
class ParameterTable:
    """The kinematic parameters of one mechanism in the order of the vector of their values."""

    joints: int  # J, of the robot
    # Rows, from 0, that have a Hayati angle: those whose axis is parallel to the next one, and the
    # last one, whose joint is nearly parallel to b5 across the plate.
    hayati_rows: tuple[int, ...]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(parameter_named(name) for name in self.names)

    @cached_property
    def names(self) -> tuple[str, ...]:
        return (
            *(f"r{kind}{row + 1}" for kind in _KINDS for row in range(self.joints)),
            *self.hayati,
            *(f"b{kind}{row + 1}" for kind in _KINDS for row in range(BAR_ROWS)),
            *("ox", "oy", "oz", "otx", "oty"),
        )

    @cached_property
    def index(self) -> dict[str, int]:
        """Position of each parameter in the vector."""
        return {name: i for i, name in enumerate(self.names)}

    @property
    def robot(self) -> tuple[str, ...]:
        """Names of the robot's rows without the Hayati angles."""
        return self.names[: 4 * self.joints]

    @property
    def hayati(self) -> tuple[str, ...]:
        """Names of the Hayati angles."""
        return tuple(f"rbeta{row + 1}" for row in self.hayati_rows)

    @property
    def plate(self) -> str:
        """The length that holds the offset plate."""
        return f"ra{self.joints}"

    @property
    def gauge(self) -> tuple[str, ...]:
        """Parameters of the robot that do the same as others (thesis Table 3.2).

        The first row's d and theta move the robot as the ball-bar's base pose does, and of parallel
        axes the d of the second does the same as that of the first.
        """
        return ("rd1", "rtheta1", *(f"rd{row + 2}" for row in self.hayati_rows[:-1]))


def parameter_table(robot: Robot) -> ParameterTable:
    """The parameters of a robot that is held by a ball-bar."""
    parallel = np.flatnonzero(np.abs(np.sin(robot.alpha[:-1])) < PARALLEL)
    return ParameterTable(robot.joints, (*parallel.tolist(), robot.joints - 1))


def nominal_chain(robot: Robot) -> Chain:
    """The robot's DH rows as its file has them, up to the bare flange."""
    return Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(robot.joints))


def table_of_names(names: Iterable[str]) -> ParameterTable:
    """The table of the mechanism whose parameters have these names, in any order."""
    of_robot = [p for p in map(parameter_named, names) if p.side == "robot"]
    hayati = sorted(p.row for p in of_robot if p.kind == "beta")
    return ParameterTable(1 + max((p.row for p in of_robot), default=-1), tuple(hayati))


@dataclass(frozen=True, eq=False)
class Geometry:
    """All kinematic parameters of one cell, as the vector `values` in the order of its table."""

    values: Array  # (P,) [m, rad]
    table: ParameterTable

    def __post_init__(self) -> None:
        values, count = read_only(self.values), len(self.table.names)
        if values.shape != (count,):
            raise ValueError(f"geometry: {values.shape} values, expected ({count},)")
        object.__setattr__(self, "values", values)

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.table.index[name]])

    def with_values(self, values: Array) -> Geometry:
        """The same mechanism with other values (P,) [m, rad]."""
        return replace(self, values=values)

    def replaced(self, changes: dict[str, float]) -> Geometry:
        """The geometry with the named parameters changed. Raises KeyError for an unknown name."""
        values = self.values.copy()
        for name, value in changes.items():
            values[self.table.index[name]] = value
        return self.with_values(values)

    @cached_property
    def robot(self) -> Chain:
        n, rows = self.table.joints, list(self.table.hayati_rows)
        beta = np.zeros(n)
        beta[rows] = self.values[4 * n : 4 * n + len(rows)]
        a, d, alpha, theta = self.values[: 4 * n].reshape(4, n)
        return Chain(a, d, alpha, theta, beta)

    @cached_property
    def bar(self) -> Chain:
        start = 4 * self.table.joints + len(self.table.hayati_rows)
        a, d, alpha, theta = self.values[start : start + 4 * BAR_ROWS].reshape(4, BAR_ROWS)
        return Chain(a, d, alpha, theta, np.zeros(BAR_ROWS))

    @property
    def origin(self) -> Array:
        """(3,) [m] position of the ball-bar's base in the robot's base frame."""
        return self.values[-5:-2]

    @property
    def bar_base_rotation(self) -> Array:
        """(3, 3) orientation of the ball-bar's base: Rx(otx) Ry(oty)."""
        (cx, cy), (sx, sy) = np.cos(self.values[-2:]), np.sin(self.values[-2:])
        return np.array([[cy, 0.0, sy], [sx * sy, cx, -sx * cy], [-cx * sy, sx, cx * cy]])


def mirrored(geometry: Geometry, joint: int) -> Geometry:
    """The geometry of the same mechanism whose encoder b2 or b4 counts in the other direction.

    joint : 2 or 4. The directions of b2 and b4 and the configurations of gimbal and universal joint
        are one gauge: readings `(-e_j, e_others)` of the mirrored geometry give the pose that
        `(e_j, e_others)` gave before, exactly, for an imperfect ball-bar too
        (notes/identification, "Signs and configuration").

    Raises ValueError for another joint.
    """
    if joint not in (2, 4):
        raise ValueError(f"joint {joint}: only b2 and b4 have a direction that cannot be observed")
    i, j, k = joint - 1, joint, joint + 1
    changes = {f"b{kind}{joint}": -geometry[f"b{kind}{joint}"] for kind in ("a", "d", "theta")}
    changes |= {
        f"ba{i}": -geometry[f"ba{i}"],
        f"balpha{i}": np.pi - geometry[f"balpha{i}"],
        f"balpha{j}": -np.pi - geometry[f"balpha{j}"],
    }
    changes |= {f"btheta{n}": geometry[f"btheta{n}"] + np.pi for n in (i, k)}
    return geometry.replaced(changes)


def nominal_geometry(cell: Cell, origin: Array) -> Geometry:
    """Catalogue geometry of a cell with the ball-bar at `origin` (3,) [m] and encoder offsets 0.

    The offset plate adds to the last row's a, tool changer and universal joint to its d.
    """
    robot, bar, plate = cell.robot, cell.ballbar, cell.plate
    table = parameter_table(robot)
    a, d = robot.a.copy(), robot.d.copy()
    a[-1] += plate.length
    d[-1] += plate.tool_offset
    arm = (a, d, robot.alpha, robot.theta, np.zeros(len(table.hayati_rows)))
    instrument = (bar.a, bar.d, bar.alpha, bar.theta, origin, np.zeros(2))
    return Geometry(np.concatenate((*arm, *instrument)), table)


def robot_geometry(robot: Robot) -> Geometry:
    """Catalogue geometry of a robot up to its bare flange; that of a ball-bar is zero."""
    return geometry_of_chain(parameter_table(robot), nominal_chain(robot))


def geometry_of_chain(table: ParameterTable, chain: Chain) -> Geometry:
    """The geometry of a robot's rows; that of a ball-bar is zero."""
    values = np.zeros(len(table.names))
    rows = (chain.a, chain.d, chain.alpha, chain.theta, chain.beta[list(table.hayati_rows)])
    of_robot = np.concatenate(rows)
    values[: of_robot.size] = of_robot
    return Geometry(values, table)


def robot_frames(geometry: Geometry, q: Array) -> Frames:
    """Frames of the robot at joint angles q (N, J) [rad]; the last is that of the tool."""
    return forward(geometry.robot, q)


def bar_frames(geometry: Geometry, b: Array) -> Frames:
    """Frames of the ball-bar at encoder angles b (N, 5) [rad]; the last is that of the tool.

    The encoder offsets are part of btheta. Of a telescoping bar b is (N, 6), its last column the
    extension [m] of the rod beyond bd3.
    """
    return forward(
        geometry.bar,
        b[:, :BAR_ROWS],
        base_rotation=geometry.bar_base_rotation,
        base_origin=geometry.origin,
        slide=(ROD_ROW, b[:, BAR_ROWS]) if b.shape[1] > BAR_ROWS else None,
    )


def parameter_screw(
    geometry: Geometry, robot: Frames, bar: Frames, parameter: Parameter, out: Array | None = None
) -> Array:
    """(6, N) motion of the tool frame of robot or ball-bar for a unit change of one parameter.

    Components [m, rad per unit] are those of ballbar.cell.chain.screw. out : (6, N) array to write
    to.
    """
    if parameter.side != "base":
        frames = robot if parameter.side == "robot" else bar
        return screw(frames, parameter.kind, parameter.row, out)
    out = np.empty((6, bar.tip.shape[1])) if out is None else out
    out[:] = 0.0
    if parameter.kind == "origin":
        out[parameter.row] = 1.0
        return out
    axis = np.array([1.0, 0.0, 0.0])
    if parameter.row == 1:
        axis = np.array([0.0, np.cos(geometry["otx"]), np.sin(geometry["otx"])])
    out[:3] = np.cross(axis, (bar.tip - bar.origin[0]).T).T
    out[3:] = axis[:, None]
    return out
