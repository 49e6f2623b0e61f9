"""Events of a recording on the robot's clock: lanes of states, and a table of single events.

Lanes: dwell or motion, configuration, and the rows of each log. A configuration change is where the
robot's wrist or the rod passes a singular pose; a gap is a stretch of a log without rows; outliers
are rows that their neighbours contradict; step faults are those that the identification repaired.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ballbar.acquisition.flags import EXCLUDED
from ballbar.cell.arrays import Array
from ballbar.cell.logs import BallBarLog, RobotLog, segment_starts
from ballbar.cell.neighbours import damaged_bursts
from ballbar.replay.entities import EVENT_LOG, LANES, Branch, at
from ballbar.report.colours import Colour
from ballbar.report.motion import GAP_PERIODS, CellMotion, on_robot_clock
from ballbar.result.run_data import FittedRecording
from ballbar.units import MS

DWELL_SPEED = np.radians(0.05)  # [rad/s] of the fastest joint: shown as a dwell below it
JOIN = 0.5  # [s] outliers closer than that are one event
_SHORTEST = 0.3  # [s] a state is drawn at least so long, to be seen
_CALM, _MARKED = (70, 78, 92), (240, 160, 60)
_PLAIN: Sequence[Colour] = (_CALM, (95, 140, 200), (120, 110, 160), (100, 150, 120))
_LOG_COLOURS: dict[str, Colour] = {
    "rows": _CALM,
    "gap": (225, 87, 76),
    "outlier": _MARKED,
    "restart": (200, 110, 200),
    "ended": (40, 44, 52),
}


@dataclass(frozen=True)
class Remark:
    """One event."""

    t: float  # [s] robot's clock
    level: Literal["INFO", "WARN"]
    sentence: str


@dataclass(frozen=True, eq=False)
class Lane:
    """One quantity with a few states."""

    t: Array  # (K,) [s] robot's clock, when each state begins
    states: Sequence[str]  # (K,)
    colours: dict[str, Colour]


@dataclass(frozen=True, eq=False)
class Events:
    """Everything that happened."""

    lanes: dict[str, Lane]  # by name
    remarks: tuple[Remark, ...]  # in order of time


class _Span(NamedTuple):
    """A stretch of a log that differs from plain rows."""

    begin: float  # [s] robot's clock
    end: float
    state: str
    sentence: str


def recording_events(fitted: FittedRecording, motion: CellMotion) -> Events:
    """The events of a recording."""
    estimate, recording = fitted.estimate, fitted.recording
    speed = np.abs(np.gradient(motion.q, motion.t, axis=0)).max(axis=1)
    moving = np.where(speed < DWELL_SPEED, "dwell", "motion")
    configuration = _lane(motion.t, _configuration(fitted, motion))
    lanes = {"robot": _lane(motion.t, moving, marked="dwell"), "configuration": configuration}
    first, *changes = zip(configuration.t.tolist(), configuration.states, strict=True)
    remarks = [Remark(0.0, "INFO", f"the robot's log begins; configuration {first[1]}")]
    remarks += [Remark(t, "INFO", f"configuration is now {state}") for t, state in changes]
    robot, ballbar = recording.robot_log, recording.ballbar_log
    spans = _log_spans("robot's log", robot, robot.q, robot.t)
    lanes["robot_log"] = _spans_lane(robot.t, spans)
    if ballbar is not None:
        t = on_robot_clock(estimate, ballbar.t)
        encoder_spans = _log_spans("encoders", ballbar, ballbar.angles, t)
        lanes["encoders"] = _spans_lane(t, encoder_spans)
        spans = spans + encoder_spans
    remarks += [Remark(span.begin, "WARN", span.sentence) for span in spans]
    for fault in estimate.step_faults:
        (time,) = on_robot_clock(estimate, np.array([fault.time])).tolist()
        remarks.append(Remark(time, "WARN", fault.sentence))
    return Events(lanes, tuple(sorted(remarks, key=lambda remark: remark.t)))


def _configuration(fitted: FittedRecording, motion: CellMotion) -> NDArray[np.str_]:
    """(N,) sides of their singular poses, wrist q5 = 0 and ball-bar b2, b4 = 0 or half a turn."""
    log, estimate = fitted.recording.ballbar_log, fitted.estimate
    b = motion.b + estimate.geometry.bar.theta
    if log is not None:  # outside its log the ball-bar is drawn in either of its configurations
        ends = on_robot_clock(estimate, log.t[[0, -1]])
        inside = np.flatnonzero((motion.t >= ends[0]) & (motion.t <= ends[1]))
        b = b[np.clip(np.arange(len(b)), inside[0], inside[-1])]
    sides = np.sin(np.stack((motion.q[:, 4], b[:, 1], b[:, 3]))) > 0.0
    signs = np.where(sides, "+", "-")
    return np.array([f"q5 {q5}, b2 {b2}, b4 {b4}" for q5, b2, b4 in signs.T])


def _lane(t: Array, states: NDArray[np.str_], *, marked: str = "") -> Lane:
    """The instants at which a state per row, (N,) at t (N,) [s], changes."""
    begins = np.flatnonzero(np.concatenate(([True], states[1:] != states[:-1])))
    names = [str(state) for state in states[begins]]
    distinct = enumerate(dict.fromkeys(names))
    colours = {s: _MARKED if s == marked else _PLAIN[i % len(_PLAIN)] for i, s in distinct}
    return Lane(t[begins], names, colours)


def _log_spans(name: str, log: RobotLog | BallBarLog, angles: Array, t_robot: Array) -> list[_Span]:
    """Gaps, outliers and new segments of a log; angles : (N, C) [rad], t_robot : (N,) [s]."""
    steps = np.diff(log.t)
    spans = [
        _Span(t_robot[i], t_robot[i + 1], "gap", f"{name}: no rows for {steps[i] * MS:.0f} ms")
        for i in np.flatnonzero(steps > GAP_PERIODS * np.median(steps))
    ]
    excluded = damaged_bursts(log.t, angles).any(axis=1)
    if log.flags is not None:
        excluded |= (log.flags & np.uint32(EXCLUDED)) != 0
    apart = np.flatnonzero(np.diff(t_robot[excluded]) > JOIN) + 1
    for group in filter(len, np.split(t_robot[excluded], apart)):
        count = f"{group.size} row{'s' * (group.size > 1)}"
        sentence = f"{name}: {count} that no motion explains, left out"
        spans.append(_Span(group[0], group[-1], "outlier", sentence))
    spans += [
        _Span(t_robot[i], t_robot[i], "restart", f"{name}: a new segment begins")
        for i in segment_starts(log.segment)
    ]
    return spans


def _spans_lane(t: Array, spans: Sequence[_Span]) -> Lane:
    """`rows` over a log, t (N,) [s], but for the spans, each long enough to be seen."""
    times, states = [float(t[0])], ["rows"]
    for span in sorted(spans, key=lambda span: span.begin):
        if span.begin <= times[-1] and states[-1] == "rows" and len(times) > 1:
            times.pop()  # the span runs into the one before
            states.pop()
        times.append(max(span.begin, times[-1] + 1e-6))
        times.append(max(span.end, span.begin + _SHORTEST, times[-1] + 1e-6))
        states += [span.state, "rows"]
    times.append(max(float(t[-1]), times[-1] + 1e-6))
    states.append("ended")
    return Lane(np.array(times), states, _LOG_COLOURS)


def log_events(stream: Branch, events: Events) -> None:
    """Writes lanes and table."""
    for name, lane in events.lanes.items():
        entity, states = f"{LANES}/{name}", list(lane.colours)
        styles = rr.StateConfiguration(
            values=states, labels=states, colors=list(lane.colours.values())
        )
        stream.log(entity, styles, static=True)
        changes = rr.StateChange.columns(state=list(lane.states))
        stream.send_columns(entity, indexes=at(lane.t), columns=changes)
    remarks = events.remarks
    columns = rr.TextLog.columns(
        text=[remark.sentence for remark in remarks], level=[remark.level for remark in remarks]
    )
    times = np.array([remark.t for remark in remarks])
    stream.send_columns(EVENT_LOG, indexes=at(times), columns=columns)
