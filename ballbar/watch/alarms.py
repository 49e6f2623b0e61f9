"""Alarms of a growing recording: findings of the reader, and what the latest rows show.

Other modules decide what is wrong: in the file `acquisition`, from the start
`ballbar.ident.causes`, from some row on `ballbar.ident.prediction`. Here an alarm gets its name,
and the time when it was raised.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from ballbar.acquisition.dwells import find_dwells
from ballbar.acquisition.report import ImportReport
from ballbar.cell.clock import Clock
from ballbar.cell.foreign_text import printable
from ballbar.cell.number_text import significant_text
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.step_faults import step_faults_in_logs
from ballbar.ident.recording_fit import Logs
from ballbar.watch.state import Alarm

# Kinds of findings that call for a hand at the machine. Late rows, outliers and a torn last line do
# not.
FINDINGS = (
    "frozen channel",
    "stale process data",
    "frequency error",
    "amplitude error",
    "invalid process data",
    "counter jumped",
    "counter preset",
    "counter reset",
    "angles jump",
    "clock set back",
    "logger restarted",
    "pause or clock jump",
    "header again",
    "axis beyond its limits",
    "lost messages",
)
SEEN_TWICE = 2  # updates in which a finding stands; the last row of a file may be misjudged once
SILENT = 5.0  # [s] without new rows; writers keep some seconds back
STANDS = 5.0  # [s] for which a robot may stand after it has moved; a dwell takes 2 to 4
LOOK = 8.0  # [s] of the robot's log that show whether it stands
NEW, SAME = 8.0, 0.5  # [s] before the end of the fit before; between one step's times in two fits
MOVED = 0.1  # [rad] by which a joint has moved before
FEWEST = 50  # rows that show whether the robot stands


class FindingAlarms:
    """Alarms of findings of the reader, each once it was there in two updates."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], int] = {}

    def alarms(self, report: ImportReport, seconds: float) -> list[Alarm]:
        """The findings that are alarms; seconds : [s] of the recording."""
        entries = [f for f in report.findings if f.kind in FINDINGS]
        keys = {(f.file, f.kind) for f in entries}
        self._seen = {key: self._seen.get(key, 0) + 1 for key in keys}
        alarms = []
        for entry in entries:
            if self._seen[entry.file, entry.kind] >= SEEN_TWICE:
                place = f"{entry.file}:{entry.lines[0]}" if entry.lines else entry.file
                sentence = printable(f"{place}: {entry.sentence}")
                alarms.append(Alarm(entry.kind, sentence, seconds, entry.file))
        return alarms


class SilenceAlarms:
    """Alarms of files that have not grown for a while."""

    def __init__(self) -> None:
        self._grown: dict[str, tuple[int, float]] = {}  # size, and when it was first seen

    def alarms(self, sizes: Mapping[str, int], now: float, seconds: float) -> list[Alarm]:
        """Files that stay as they are; sizes : bytes by name. now : [s] on any clock."""
        for name, size in sizes.items():
            if self._grown.get(name, (-1, now))[0] != size:
                self._grown[name] = (size, now)
        last = max((since for _, since in self._grown.values()), default=now)
        alarms = []
        for name in sizes:
            since = self._grown[name][1]
            if now - since >= SILENT:
                others = ", while others grow" if last > since + SILENT else ""
                sentence = f"{printable(name)}: no new row for {now - since:.0f} s{others}"
                alarms.append(Alarm("silent", sentence, seconds, name))
        return alarms


def standing(logs: Logs) -> list[Alarm]:
    """Whether the robot stands for longer than in a dwell."""
    robot, seconds = logs.robot, float(logs.robot.t[-1])
    late = np.searchsorted(robot.t, robot.t[-1] - LOOK)
    t, q = robot.t[late:], robot.q[late:]
    if t.size < FEWEST or t[-1] - t[0] < STANDS:
        return []
    intervals = find_dwells(t, q).intervals
    if not intervals.size or intervals[-1, 1] < t.size - 1:
        return []
    stood = float(t[-1] - t[intervals[-1, 0]])
    if stood < STANDS or not (np.abs(robot.q - q[-1]) > MOVED).any():
        return []
    sentence = f"the robot stands for {stood:.0f} s: at the end of its path, or stopped"
    return [Alarm("robot stands", sentence, seconds)]


class StepAlarms:
    """Alarms of steps between two rows, which the fits have taken out of the logs.

    A step is believed where it was new when a fit first showed it, and all that the first fit shows
    are. A fit that takes steps out of rows in which the earlier ones saw none has read the log
    wrongly: noise of few rows.
    """

    def __init__(self) -> None:
        self._known: list[tuple[str, float]] = []  # channel and time [s]
        self._seen = 0.0  # [s] end of the latest fit

    def alarms(self, samples: Samples, clock: Clock, seconds: float) -> list[Alarm]:
        """The steps of a fit; seconds : [s] of the recording."""
        steps = list(_steps(samples, clock))
        end = clock.ballbar_time(samples.robot.end) if samples.has_clock else samples.robot.end
        new_since, self._seen = self._seen - NEW, end
        for channel, time, _ in steps:
            earlier = (then for name, then in self._known if name == channel)
            if time <= new_since and not any(abs(time - then) < SAME for then in earlier):
                return []
        self._known = [(channel, time) for channel, time, _ in steps]
        return [
            Alarm("step", f"{channel} {what} at t = {time:.2f} s", seconds, channel)
            for channel, time, what in steps
        ]


def _steps(samples: Samples, clock: Clock) -> Iterator[tuple[str, float, str]]:
    """Channel, time [s] on the ball-bar's clock and what happened, of each step."""

    def by(size: float) -> str:
        return f"by {significant_text(size * 1e3, sign=True)}"

    for fault in step_faults_in_logs(samples, clock):
        if fault.kind == "clock":
            yield "a clock", fault.time, f"was set {by(fault.size)} ms"
        else:
            yield f"encoder b{fault.joint}", fault.time, f"stepped {by(fault.size)} mrad"
    for step in samples.robot.steps:
        if step.channel is not None:
            time = clock.ballbar_time(step.time) if samples.has_clock else step.time
            channel = f"joint {step.channel + 1} of the robot's log"
            yield channel, time, f"stepped {by(step.size)} mrad"


def since_first(alarms: Iterable[Alarm], before: Iterable[Alarm]) -> tuple[Alarm, ...]:
    """The alarms, each with the time at which it was first raised."""
    raised = {alarm.key: alarm.raised for alarm in before}
    return tuple(replace(a, raised=raised.get(a.key, a.raised)) for a in alarms)
