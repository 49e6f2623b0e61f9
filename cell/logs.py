"""Recordings after reading: angles and loads over time, each log on its own clock.

Acquisition makes these logs and identification takes them. Times are float64 seconds counted from
the first row of their own log; ballbar.cell.clock relates the two clocks.

The logs hold the rows that a fit may use. `segment` numbers the stretches of a log between which
the clock was set, a counter was reset or rows were lost; angles and times continue across them as
far as the log itself can tell. The arrays of a log are write-protected copies of the caller's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array, read_only

# The sources of a recording
SourceName = Literal["robot", "ballbar", "length", "force", "tracker"]


@dataclass(frozen=True, eq=False)
class RobotLog:
    """Robot joint angles, and motor torques where they are logged, on the robot's clock.

    Raises ValueError if shapes do not fit, values are not finite, or times do not increase.
    """

    t: Array  # (N,) [s] from the first row, strictly increasing
    q: Array  # (N, J) [rad] joint angles, DH convention
    torque: Array | None = None  # (N, J) [N m] of the motors, at the gears' outputs
    segment: NDArray[np.uint16] | None = None  # (N,) stretch of one clock; None: a single one
    flags: NDArray[np.uint32] | None = (
        None  # (N,) ballbar.acquisition.flags of the row; None: no remarks
    )

    def __post_init__(self) -> None:
        _protect(self)
        joints = self.q.shape[-1]
        _check("robot log", self, self.q, joints)
        if self.torque is not None:
            _check("robot log, torque", self, self.torque, joints)


@dataclass(frozen=True, eq=False)
class BallBarLog:
    """Ball-bar encoder angles on the ball-bar's clock.

    Raises ValueError as RobotLog does, and if `joints` are not distinct, increasing and in 1..5.
    """

    t: Array  # (N,) [s] from the first row, strictly increasing
    angles: Array  # (N, E) [rad] unwrapped, declared direction applied, offset unknown
    joints: tuple[int, ...]  # (E,) the joint that each column measures, 1..5, increasing
    segment: NDArray[np.uint16] | None = None  # (N,) stretch of one clock and counter reference
    flags: NDArray[np.uint32] | None = (
        None  # (N,) ballbar.acquisition.flags of the row; None: no remarks
    )

    def __post_init__(self) -> None:
        _protect(self)
        _check("ball-bar log", self, self.angles, len(self.joints))
        if list(self.joints) != sorted(set(self.joints)) or not set(self.joints) <= {1, 2, 3, 4, 5}:
            raise ValueError(f"ball-bar log: joints {self.joints} do not increase within 1..5")


@dataclass(frozen=True, eq=False)
class LengthLog:
    """Length of a telescoping ball-bar or a draw-wire on the sensor's clock.

    Raises ValueError as RobotLog does.
    """

    t: Array  # (N,) [s] from the first row, strictly increasing
    length: Array  # (N,) [m] as read: the declared zero included, the sensor's own error not
    segment: NDArray[np.uint16] | None = None  # (N,) stretch of one clock; None: a single one
    flags: NDArray[np.uint32] | None = (
        None  # (N,) ballbar.acquisition.flags of the row; None: no remarks
    )

    def __post_init__(self) -> None:
        _protect(self)
        _check("length log", self, self.length[:, None], 1)


@dataclass(frozen=True, eq=False)
class ForceLog:
    """Force and torque that plate and ball-bar exert on the flange, on the force sensor's clock.

    Raises ValueError as RobotLog does.
    """

    t: Array  # (N,) [s] from the first row, strictly increasing
    wrench: Array  # (N, 6) [N, N m] forces, then torques about the flange's origin; flange frame

    def __post_init__(self) -> None:
        _protect(self)
        _check("force log", self, self.wrench, 6)


@dataclass(frozen=True, eq=False)
class TrackerLog:
    """Points or poses of a target on the tool, on the clock and in the frame of what follows it.

    Raises ValueError as RobotLog does.
    """

    t: Array  # (N,) [s] from the first row, strictly increasing
    values: Array  # (N, M) [m, rad] position, and of a pose a rotation vector; tracker's frame
    sigma: Array  # (N, M) [m, rad] as stated for the tracker
    measured: Literal["point", "pose"] = "point"
    segment: NDArray[np.uint16] | None = None  # (N,) stretch of one clock; None: a single one

    def __post_init__(self) -> None:
        _protect(self)
        _check("tracker log", self, self.values, 3 if self.measured == "point" else 6)

    @property
    def points(self) -> Array:
        """(N, 3) [m] position of the target."""
        return self.values[:, :3]


@dataclass(frozen=True, eq=False)
class ChannelLog:
    """Channels of any one recorder on its clock, each in a unit of its own.

    Raises ValueError as RobotLog does, and if `names` are not one for each channel, all different.
    """

    name: str  # of the log, for messages
    t: Array  # (N,) [s] from the first row, strictly increasing
    values: Array  # (N, C) [unit of each channel]
    names: tuple[str, ...]  # (C,)
    segment: NDArray[np.uint16] | None = None  # (N,) stretch of one clock; None: a single one
    first_ns: int | None = None  # [ns] since 1970 of the first row; None: its clock has no epoch

    def __post_init__(self) -> None:
        _protect(self)
        _check(self.name, self, self.values, len(self.names))
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"{self.name}: channel names {self.names} are not all different")

    def part(self, chosen: Sequence[int]) -> ChannelLog:
        """The log of some of its channels."""
        names = tuple(self.names[k] for k in chosen)
        return replace(self, values=self.values[:, list(chosen)], names=names)


def segment_starts(segment: NDArray[np.uint16] | None) -> tuple[int, ...]:
    """Rows at which a segment other than the first begins; segment : (N,) or None."""
    if segment is None:
        return ()
    return tuple(int(row) for row in np.flatnonzero(np.diff(segment)) + 1)


def _protect(log: Any) -> None:
    """Replace the arrays of a log by write-protected copies."""
    series = ("t", "q", "torque", "angles", "length", "wrench", "values", "sigma")
    dtypes: dict[str, type[np.generic]] = dict.fromkeys(series, np.float64)
    for name, dtype in {**dtypes, "segment": np.uint16, "flags": np.uint32}.items():
        values = getattr(log, name, None)
        if values is not None:
            object.__setattr__(log, name, read_only(values, dtype))


def _check(what: str, log: Any, values: Array, columns: int) -> None:
    """Raises ValueError unless values, times and marks of a log fit each other."""
    t = log.t
    if t.ndim != 1 or values.shape != (t.size, columns):
        raise ValueError(
            f"{what}: times {t.shape} and values {values.shape} do not fit (N,) and (N, {columns})"
        )
    if not (np.isfinite(t).all() and np.isfinite(values).all()):
        raise ValueError(f"{what}: times or values are not finite")
    if t.size > 1 and np.diff(t).min() <= 0.0:
        raise ValueError(f"{what}: times do not increase strictly")
    for mark in (getattr(log, "segment", None), getattr(log, "flags", None)):
        if mark is not None and mark.shape != t.shape:
            raise ValueError(f"{what}: segment or flags {mark.shape} do not fit times {t.shape}")
