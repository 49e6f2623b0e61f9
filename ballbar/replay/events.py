"""What happened when, on the robot's clock: lanes of states (moving, configuration, logs) and a table of single events.

Configuration changes are where the robot's wrist or the rod passes a singular pose; gaps are stretches of a log without rows;
outliers are rows that their neighbours contradict; jumps are what the identifier found and repaired.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from acquisition.flags import EXCLUDED
from ballbar.replay.entities import EVENT_LOG, LANES, Colour, at
from ballbar.replay.motion import GAP_PERIODS, CellMotion, on_robot_clock
from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.logs import segment_starts
from cell.neighbours import damaged_bursts
from ident.identify import Identification

STILL = np.radians(0.05)  # [rad/s] of the fastest joint: below it the robot dwells
JOIN = 0.5  # [s] outliers and gaps closer than that are one remark
_SHORTEST = 0.3  # [s] a lane's state lasts at least so long, to be seen
_CALM, _MARKED, _OTHER = (70, 78, 92), (240, 160, 60), (95, 140, 200)
_LOG_COLOURS: dict[str, Colour] = {
    "rows": _CALM,
    "gap": (225, 87, 76),
    "outlier": _MARKED,
    "restart": (200, 110, 200),
    "ended": (40, 44, 52),
}

Level = Literal["INFO", "WARN"]


@dataclass(frozen=True)
class Remark:
    """One event."""

    t: float  # [s] robot's clock
    level: Level
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


def run_events(data: RunData, motion: CellMotion) -> Events:
    """The events of a run."""
    result, recording = data.identification, data.recording
    lanes = {
        "robot": _lane(
            motion.t, np.where(_speed(motion) < STILL, "still", "moves"), marked="still"
        ),
        "configuration": _lane(motion.t, _configuration(data, motion)),
    }
    turned = lanes["configuration"]
    remarks = [Remark(0.0, "INFO", f"the robot's log begins; configuration {turned.states[0]}")]
    remarks += [
        Remark(float(t), "INFO", f"configuration is now {s}")
        for t, s in zip(turned.t[1:], turned.states[1:], strict=True)
    ]
    robot, ballbar = recording.robot_log, recording.ballbar_log
    lanes["robot_log"] = _log_lane(
        "robot's log", robot.t, robot.t, robot.q, robot.flags, robot.segment, remarks
    )
    if ballbar is not None:
        shown = on_robot_clock(result, ballbar.t)
        lanes["encoders"] = _log_lane(
            "encoders", shown, ballbar.t, ballbar.angles, ballbar.flags, ballbar.segment, remarks
        )
    remarks += _jumps(result)
    return Events(lanes, tuple(sorted(remarks, key=lambda one: one.t)))


def _configuration(data: RunData, motion: CellMotion) -> NDArray[np.str_]:
    """(N,) on which side of their singular poses the robot's wrist (q5 = 0) and the ball-bar (b2, b4 = 0 or half a turn) are."""
    result, log = data.identification, data.recording.ballbar_log
    b = motion.b + result.geometry.bar.theta
    if (
        log is not None
    ):  # before and after its log the ball-bar is drawn in either of its configurations
        ends = on_robot_clock(result, log.t[[0, -1]])
        inside = np.flatnonzero((motion.t >= ends[0]) & (motion.t <= ends[1]))
        b = b[np.clip(np.arange(len(b)), inside[0], inside[-1])]
    sides = np.sin(np.stack((motion.q[:, 4], b[:, 1], b[:, 3]))) > 0.0
    signs = np.where(sides, "+", "-")
    return np.array([f"q5 {q5}, b2 {b2}, b4 {b4}" for q5, b2, b4 in signs.T])


def _speed(motion: CellMotion) -> Array:
    return np.asarray(np.abs(np.gradient(motion.q, motion.t, axis=0)).max(axis=1))


def _lane(t: Array, states: NDArray[np.str_], *, marked: str = "") -> Lane:
    """Where a state per row changes."""
    begins = np.flatnonzero(np.concatenate(([True], states[1:] != states[:-1])))
    names = [str(s) for s in states[begins]]
    distinct = list(dict.fromkeys(names))
    plain = [_CALM, _OTHER, (120, 110, 160), (100, 150, 120)]
    colours = {s: _MARKED if s == marked else plain[i % len(plain)] for i, s in enumerate(distinct)}
    return Lane(t[begins], names, colours)


def _log_lane(
    what: str,
    shown: Array,
    t: Array,
    values: Array,
    flags: NDArray[np.uint32] | None,
    segment: NDArray[np.uint16] | None,
    remarks: list[Remark],
) -> Lane:
    """Gaps, outliers and new segments of one log, also told as remarks; shown : (N,) [s] its rows on the robot's clock."""
    steps = np.diff(t)
    wide = np.flatnonzero(steps > GAP_PERIODS * np.median(steps))
    spans = [
        (
            "gap",
            float(shown[i]),
            float(shown[i + 1]),
            f"{what}: no rows for {steps[i] * 1e3:.0f} ms",
        )
        for i in wide
    ]
    bad = damaged_bursts(t, values).any(axis=1)
    if flags is not None:
        bad |= (flags & np.uint32(EXCLUDED)) != 0
    for group in _groups(shown[bad]):
        count = f"{group.size} row{'s' * (group.size > 1)}"
        spans.append(
            (
                "outlier",
                float(group[0]),
                float(group[-1]),
                f"{what}: {count} that no motion explains, left out",
            )
        )
    spans += [
        ("restart", float(shown[i]), float(shown[i]), f"{what}: a new segment begins")
        for i in segment_starts(segment)
    ]
    remarks += [Remark(begin, "WARN", sentence) for _, begin, _, sentence in spans]
    return _spans_lane(float(shown[0]), float(shown[-1]), spans)


def _groups(t: Array) -> list[Array]:
    """Instants (K,) [s] in order, split where they are far apart."""
    return [group for group in np.split(t, np.flatnonzero(np.diff(t) > JOIN) + 1) if group.size]


def _spans_lane(first: float, last: float, spans: Sequence[tuple[str, float, float, str]]) -> Lane:
    """`rows` but for the spans, each long enough to be seen."""
    times, states = [first], ["rows"]
    for state, begin, end, _ in sorted(spans, key=lambda span: span[1]):
        if (
            begin <= times[-1] and states[-1] == "rows" and len(times) > 1
        ):  # runs into the one before
            times.pop()
            states.pop()
        times += [max(begin, times[-1] + 1e-6), max(end, begin + _SHORTEST, times[-1] + 2e-6)]
        states += [state, "rows"]
    times.append(max(last, times[-1] + 1e-6))
    states.append("ended")
    return Lane(np.array(times), states, _LOG_COLOURS)


def _jumps(result: Identification) -> list[Remark]:
    times = on_robot_clock(result, np.array([event.time for event in result.events]))
    return [
        Remark(float(t), "WARN", event.sentence)
        for t, event in zip(times, result.events, strict=True)
    ]


def log_events(stream: rr.RecordingStream, events: Events) -> None:
    """Writes lanes and table."""
    for name, lane in events.lanes.items():
        entity = f"{LANES}/{name}"
        styles = rr.StateConfiguration(
            values=list(lane.colours), labels=list(lane.colours), colors=list(lane.colours.values())
        )
        stream.log(entity, styles, static=True)
        stream.send_columns(
            entity, indexes=at(lane.t), columns=rr.StateChange.columns(state=list(lane.states))
        )
    columns = rr.TextLog.columns(
        text=[one.sentence for one in events.remarks], level=[one.level for one in events.remarks]
    )
    stream.send_columns(
        EVENT_LOG, indexes=at(np.array([one.t for one in events.remarks])), columns=columns
    )
