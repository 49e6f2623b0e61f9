"""State of a growing recording: progress, uncertainty, and alarms."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.geometry import robot_frames
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.cell.statistics import rms
from ballbar.ident.estimates import result_at_rest
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification, RecordingEstimate
from ballbar.ident.table_fit import fit_table
from ballbar.recordings.read import poses_of
from ballbar.sphere_coverage import coverage

COVERED_ROWS = 3000  # of the robot's log, for the share of the sphere
# Exponents with which the parts of the data fall while a path covers ever more. A repeated path
# would give 0.5 to the first; the second is that of machines with all errors.
WHITE, WIDENED = 0.8, 2.0


@dataclass(frozen=True)
class Alarm:
    """Something that is wrong with a recording, for as long as it is."""

    kind: str  # a few words that stay the same while the numbers in the sentence change
    sentence: str
    raised: float  # [s] of the recording when it was first seen
    subject: str = ""  # the file or channel, where there may be several of a kind

    @property
    def key(self) -> tuple[str, str]:
        """Kind and subject: the same at every instant while the alarm lasts."""
        return self.kind, self.subject


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Estimate of the robot from a growing recording."""

    until: float  # [s] of the recording that was used
    model: str  # dh or complete; poses of an instrument that follows
    status: str  # word of the verdict
    sentence: str  # of the verdict
    tcp_sigma: float  # [m] stated TCP uncertainty, rms over the accuracy grid, with the scale
    without_scale: float  # [m] the same without the scale
    white: float = 0.0  # [m] part of that which the data would leave were their residuals white
    widened: float = 0.0  # [m] part by which it is more, as they are not
    acceptable: bool
    clock: tuple[float, float] | None = None  # [s] offset, [1] skew; None without encoders
    clock_sigma: tuple[float, float] = (0.0, 0.0)  # [s], [1]
    noise: dict[str, float] = field(
        default_factory=dict
    )  # [rad] of one row, by channel; [m] of a length
    # share of the sphere that the tool has passed, 0 to 1; None where nothing holds it on one
    sphere: float | None = None

    def at_end(self, duration: float, *, scale: float) -> float:
        """[m] TCP uncertainty once a recording has its duration [s], if the fit remains good.

        Predicted part by part. The part of the scale that plate and ball-bar determine stays; of
        the factor by which known lengths that contradict each other widen it, nobody knows whether
        it will be there, and its square root is taken. The parts of priors and masses stay too. The
        part of the data falls as a power of time: slowly that of white noise, fast that which is
        added because residuals are not white, for it is estimated from what single blocks of time
        hold alone, and every lap reduces that (benchmarks.live_identification sound).

        scale : [m] uncertainty of the scale by plate and ball-bar.
        """
        along = float(np.sqrt(max(0.0, self.tcp_sigma**2 - self.without_scale**2)))
        stays = along if along <= scale else np.sqrt(along * scale)
        share = min(1.0, self.until / duration)
        fallen = self.white**2 * (1.0 - share ** (2.0 * WHITE))
        fallen += self.widened**2 * (1.0 - share ** (2.0 * WIDENED))
        return float(np.sqrt(stays**2 + max(0.0, self.without_scale**2 - fallen)))


@dataclass(frozen=True)
class WatchState:
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
        e = self.estimate
        clock = (None, None) if e is None or e.clock is None else e.clock
        return {
            "schema": "ballbar-watch/1",
            "recorded_s": round(self.seconds, 3),
            "rows": self.rows,
            "waiting": self.waiting,
            "alarms": [vars(alarm) for alarm in self.alarms],
            "axes_covered": list(self.axes),
            "sphere_covered": e and e.sphere,
            "model": e and e.model,
            "verdict": e and e.status,
            "identified_until_s": e and e.until,
            "tcp_sigma_m": e and e.tcp_sigma,
            "tcp_sigma_without_scale_m": e and e.without_scale,
            "tcp_sigma_end_m": self.tcp_sigma_end,
            "clock_offset_s": clock[0],
            "clock_skew": clock[1],
            "clock_sigma": e and list(e.clock_sigma),
            "noise": e.noise if e else {},
            "predicted": self.predicted,
            "enough": self.enough,
        }


def axes_covered(robot: Robot, q: Array) -> tuple[float, ...]:
    """Share of each axis's range in the workspace, 0 to 1; q : (N, J) [rad]."""
    axes = joints_to_axes(robot, q[:: 1 + q.shape[0] // 5000])
    span = robot.accuracy_upper - robot.accuracy_lower
    return tuple(np.minimum(1.0, np.ptp(axes, axis=0) / span).tolist())


def complete_estimate(cell: Cell, logs: Logs, accuracy: float | None) -> Estimate:
    """The estimate of the model that the data support. Raises StartError as an identification."""
    result = identify_together(cell, [logs], options=FitOptions(accuracy=accuracy))
    return estimate_of(result, logs, seconds_of(logs))


def followed_estimate(folder: Path, logs: Logs) -> Estimate:
    """The estimate from an instrument that follows the robot, as `ballbar identify` makes it.

    Raises InputError and FailureError as an identification.
    """
    result = result_at_rest(fit_table(poses_of(folder).table))
    return estimate_of(result, logs, seconds_of(logs))


def _noise_by_channel(recording: RecordingEstimate) -> dict[str, float]:
    noise = {f"q{k}": float(x) for k, x in enumerate(recording.noise.joint, start=1)}
    noise |= {f"b{j}": float(recording.noise.encoder[j - 1]) for j in recording.encoders}
    return noise | ({"length": recording.noise.length} if recording.noise.length else {})


def estimate_of(result: Identification, logs: Logs, until: float) -> Estimate:
    """The estimate that a result of one recording gives, of its rows until a time [s]."""
    estimate = Estimate(
        until=until,
        model=result.model,
        status=str(result.verdict.status),
        sentence=result.verdict.sentence,
        tcp_sigma=rms(result.robot.tcp_sigma),
        without_scale=rms(result.robot.tcp.without_scale),
        white=result.robot.tcp_white,
        widened=result.robot.tcp_widened,
        acceptable=result.verdict.acceptable,
    )
    if result.poses is not None:
        ((followed, (offset, skew)),) = result.poses.clocks.values()
        stated = followed.offset, followed.skew
        return replace(estimate, clock=stated, clock_sigma=(offset, skew))
    (recording,) = result.recordings
    clock, step = recording.clock, 1 + logs.robot.t.size // COVERED_ROWS
    tool = robot_frames(recording.geometry, logs.robot.q[::step]).tip.T
    covered = coverage(logs.robot.t[::step], tool, recording.geometry.origin)
    return replace(
        estimate,
        clock=None if clock is None else (clock.offset, clock.skew),
        clock_sigma=recording.clock_sigma,
        noise=_noise_by_channel(recording),
        sphere=float(covered.share[-1]),
    )


def seconds_of(logs: Logs) -> float:
    """[s] that both logs hold, each from its first row."""
    instrument = logs.ballbar or logs.length or logs.tracker or logs.robot
    return float(min(logs.robot.t[-1], instrument.t[-1]))
