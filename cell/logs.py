"""What a recording is once it has been read: angles and loads over time, each side on its own clock.

Acquisition makes these, identification takes them, simulation never sees them. Times are float64 seconds counted from the
first row of their own log, so that `t_robot = offset + (1 + skew) * t_bar` defines the clock parameters everywhere.

The logs hold the rows that a fit may use. `segment` counts the stretches of a log between which the clock was set, a counter
reset or rows were lost: angles and times go on across them as well as the log by itself can tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RobotLog:
    """Robot joint angles, and motor torques where they are logged, on the robot's clock."""

    t: NDArray[np.float64]  # (N,) [s] from the first row, strictly increasing
    q: NDArray[np.float64]  # (N, 6) [rad] joint angles, DH convention
    torque: NDArray[np.float64] | None = (
        None  # (N, 6) [N m] of the motors at the gears' outputs, positive along the gear's angle
    )
    segment: NDArray[np.uint16] | None = None  # (N,) stretch of one clock; None for a single one
    flags: NDArray[np.uint32] | None = (
        None  # (N,) row flags (acquisition.flags); None for no remarks
    )

    def __post_init__(self) -> None:
        _check_series("robot log", self.t, self.q, 6)
        _check_marks("robot log", self.t, self.segment, self.flags)
        if self.torque is not None:
            _check_series("robot log, torque", self.t, self.torque, 6)


@dataclass(frozen=True, eq=False)
class BallBarLog:
    """Ball-bar encoder angles on the ball-bar's clock."""

    t: NDArray[np.float64]  # (N,) [s] from the first row, strictly increasing
    angles: NDArray[np.float64]  # (N, E) [rad] unwrapped, declared sign applied, zero unknown
    joints: tuple[int, ...]  # (E,) the joint each column measures, 1..5, increasing
    segment: NDArray[np.uint16] | None = (
        None  # (N,) stretch of one clock and one counter reference; None for a single one
    )
    flags: NDArray[np.uint32] | None = (
        None  # (N,) row flags (acquisition.flags); None for no remarks
    )

    def __post_init__(self) -> None:
        _check_series("ball-bar log", self.t, self.angles, len(self.joints))
        _check_marks("ball-bar log", self.t, self.segment, self.flags)
        if list(self.joints) != sorted(set(self.joints)) or not set(self.joints) <= {1, 2, 3, 4, 5}:
            raise ValueError(
                f"ball-bar log: joints {self.joints} are not distinct, increasing and within 1..5"
            )


@dataclass(frozen=True, eq=False)
class ForceLog:
    """What plate and ball-bar exert on the flange, on the force sensor's clock."""

    t: NDArray[np.float64]  # (N,) [s] from the first row, strictly increasing
    wrench: NDArray[
        np.float64
    ]  # (N, 6) [N, N m] forces x y z, torques x y z about the flange's origin, flange frame

    def __post_init__(self) -> None:
        _check_series("force log", self.t, self.wrench, 6)


def _check_series(
    what: str, t: NDArray[np.float64], values: NDArray[np.float64], columns: int
) -> None:
    if t.ndim != 1 or values.shape != (t.size, columns):
        raise ValueError(
            f"{what}: times {t.shape} and values {values.shape} do not fit (N,) and (N, {columns})"
        )
    if not (np.isfinite(t).all() and np.isfinite(values).all()):
        raise ValueError(f"{what}: times or values are not finite")
    if t.size > 1 and np.diff(t).min() <= 0.0:
        raise ValueError(f"{what}: times do not increase strictly")
    t.flags.writeable = False
    values.flags.writeable = False


def segment_starts(segment: NDArray[np.uint16] | None) -> tuple[int, ...]:
    """Rows at which a segment other than the first begins."""
    return (
        () if segment is None else tuple(int(row) for row in np.flatnonzero(np.diff(segment)) + 1)
    )


def _check_marks(
    what: str, t: NDArray[np.float64], *marks: NDArray[np.uint16] | NDArray[np.uint32] | None
) -> None:
    for one in marks:
        if one is None:
            continue
        if one.shape != t.shape:
            raise ValueError(f"{what}: segment or flags {one.shape} do not fit times {t.shape}")
        one.flags.writeable = False
