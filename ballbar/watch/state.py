"""What is known of a growing recording: progress, uncertainty, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Alarm:
    """Something that is wrong with a recording, for as long as it is."""

    kind: str  # a few words that stay the same while the numbers in the sentence change
    sentence: str
    raised: float  # [s] of the recording when it was first seen
    subject: str = ""  # the file or channel, where there may be several of a kind

    @property
    def key(self) -> tuple[str, str]:
        """What it has in common with itself at another instant."""
        return self.kind, self.subject


@dataclass(frozen=True)
class Estimate:
    """What the growing recording says of the robot."""

    until: float  # [s] of the recording that was used
    model: str  # dh or complete
    status: str  # word of the verdict
    sentence: str  # of the verdict
    tcp_sigma: float  # [m] stated TCP uncertainty, rms over the accuracy grid, with the scale
    without_scale: float  # [m] likewise, without it
    white: float  # [m] part of that which the data would leave were their residuals white
    widened: float  # [m] part by which it is more, as they are not
    acceptable: bool
    clock: tuple[float, float] | None  # [s] offset, [1] skew; None without encoders
    clock_sigma: tuple[float, float]  # [s], [1]
    noise: dict[str, float]  # [rad] of one row, by channel; [m] of a length
    sphere: float  # share of the sphere that the tool has passed, 0 to 1


@dataclass(frozen=True)
class State:
    """A recording at one instant."""

    seconds: float  # that both logs hold
    rows: dict[str, int]  # by source
    waiting: str  # why there is nothing to identify yet; empty once there is
    alarms: tuple[Alarm, ...]
    axes: tuple[float, ...] = ()  # share of each axis's range in the workspace, 0 to 1
    estimate: Estimate | None = None
    predicted: float | None = None  # residual of the latest rows by the earlier ones' fit
    tcp_sigma_end: float | None = None  # [m] where it will be at the end, once the fit is good
    enough: bool = False  # the requested accuracy is reached in 95 %, and later rows agree

    def to_dict(self) -> dict[str, Any]:
        """The state as plain data for JSON, in SI units."""
        known = self.estimate
        return {
            "schema": "ballbar-watch/1",
            "recorded_s": round(self.seconds, 3),
            "rows": self.rows,
            "waiting": self.waiting,
            "alarms": [vars(alarm) for alarm in self.alarms],
            "axes_covered": list(self.axes),
            "sphere_covered": None if known is None else known.sphere,
            "model": None if known is None else known.model,
            "verdict": None if known is None else known.status,
            "identified_until_s": None if known is None else known.until,
            "tcp_sigma_m": None if known is None else known.tcp_sigma,
            "tcp_sigma_without_scale_m": None if known is None else known.without_scale,
            "tcp_sigma_end_m": self.tcp_sigma_end,
            "clock_offset_s": None if known is None or known.clock is None else known.clock[0],
            "clock_skew": None if known is None or known.clock is None else known.clock[1],
            "clock_sigma": None if known is None else list(known.clock_sigma),
            "noise": {} if known is None else known.noise,
            "predicted": self.predicted,
            "enough": self.enough,
        }
