"""Estimates of a growing recording, as `ballbar watch` states them."""

from __future__ import annotations

from ballbar.sphere_coverage import coverage
from ballbar.watch.state import Estimate
from cell.descriptions import Cell
from cell.geometry import robot_frames
from cell.statistics import rms
from ident.identify import identify_together
from ident.options import FitOptions
from ident.recording_fit import Logs
from ident.result import Identification

COVERED_ROWS = 3000  # of the robot's log, for the share of the sphere


def complete_estimate(cell: Cell, logs: Logs, accuracy: float | None) -> Estimate:
    """The estimate of the model that the data support. Raises StartError as an identification."""
    result = identify_together(cell, [logs], options=FitOptions(accuracy=accuracy))
    return estimate_of(result, logs, seconds_of(logs))


def estimate_of(result: Identification, logs: Logs, until: float) -> Estimate:
    """The estimate that a result of one recording gives, of its rows until a time [s]."""
    (recording,) = result.recordings
    noise = {f"q{k}": float(x) for k, x in enumerate(recording.noise.joint, start=1)}
    noise |= {f"b{j}": float(recording.noise.encoder[j - 1]) for j in recording.encoders}
    if recording.noise.length:
        noise["length"] = recording.noise.length
    clock, step = recording.clock, 1 + logs.robot.t.size // COVERED_ROWS
    tool = robot_frames(recording.geometry, logs.robot.q[::step]).tip.T
    covered = coverage(logs.robot.t[::step], tool, recording.geometry.origin)
    return Estimate(
        until=until,
        model=result.model,
        status=str(result.verdict.status),
        sentence=result.verdict.sentence,
        tcp_sigma=rms(result.robot.tcp_sigma),
        without_scale=rms(result.robot.tcp.without_scale),
        white=result.robot.tcp_white,
        widened=result.robot.tcp_widened,
        acceptable=result.verdict.acceptable,
        clock=None if clock is None else (clock.offset, clock.skew),
        clock_sigma=recording.clock_sigma,
        noise=noise,
        sphere=float(covered.share[-1]),
    )


def seconds_of(logs: Logs) -> float:
    """[s] that both logs hold, each from its first row."""
    instrument = logs.ballbar or logs.length or logs.robot
    return float(min(logs.robot.t[-1], instrument.t[-1]))
