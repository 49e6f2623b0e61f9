"""Alarms of a growing recording: findings of the reader, and what the latest rows show.

What is wrong is decided elsewhere: in the file by `acquisition`, from the start by `ident.causes`,
from some row on by `ident.prediction`. Here it gets a name, and a clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from acquisition.dwells import find_dwells
from acquisition.report import Finding, ImportReport
from ballbar.watch.state import Alarm
from cell.clock import Clock
from cell.foreign_text import printable
from ident.estimator.samples import Samples
from ident.estimator.step_faults import step_faults_in_logs
from ident.recording_fit import Logs

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
MOVED = 0.1  # [rad] by which a joint has moved before
FEWEST = 50  # rows that show whether the robot stands


class Findings:
    """New findings of the reader, each once it was there in two updates."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], int] = {}

    def alarms(self, report: ImportReport, seconds: float) -> list[Alarm]:
        """The findings that are alarms; seconds : [s] of the recording."""
        entries = [f for f in report.findings if f.kind in FINDINGS]
        keys = {(f.file, f.kind) for f in entries}
        self._seen = {key: self._seen.get(key, 0) + 1 for key in keys}
        sure = [f for f in entries if self._seen[f.file, f.kind] >= SEEN_TWICE]
        return [Alarm(f.kind, _sentence(f), seconds) for f in sure]


def _sentence(entry: Finding) -> str:
    place = f"{entry.file}:{entry.lines[0]}" if entry.lines else entry.file
    return printable(f"{place}: {entry.sentence}")


class Silence:
    """Which files have not grown for a while."""

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
                alarms.append(Alarm("silent", sentence, seconds))
        return alarms


def standing(logs: Logs) -> list[Alarm]:
    """Whether the robot stands for longer than in a dwell."""
    robot, seconds = logs.robot, float(logs.robot.t[-1])
    late = np.searchsorted(robot.t, robot.t[-1] - LOOK)
    t, q = robot.t[late:], robot.q[late:]
    if t.size < FEWEST:
        return []
    intervals = find_dwells(t, q).intervals
    if not intervals.size or intervals[-1, 1] < t.size - 1:
        return []
    stood = float(t[-1] - t[intervals[-1, 0]])
    if stood < STANDS or not (np.abs(robot.q - q[-1]) > MOVED).any():
        return []
    sentence = f"the robot stands for {stood:.0f} s: at the end of its path, or stopped"
    return [Alarm("robot stands", sentence, seconds)]


def steps(samples: Samples, clock: Clock, seconds: float) -> list[Alarm]:
    """Steps between two rows, which a fit has taken out of the logs; seconds : of the recording."""
    alarms = []
    for fault in step_faults_in_logs(samples, clock):
        if fault.kind == "clock":
            what = f"a clock was set by {fault.size * 1e3:+.3g} ms"
        else:
            what = f"encoder b{fault.joint} stepped by {fault.size * 1e3:+.3g} mrad"
        alarms.append(Alarm("step", f"{what} at t = {fault.time:.2f} s", seconds))
    for step in samples.robot.steps:
        if step.channel is not None:
            what = f"joint {step.channel + 1} of the robot's log stepped by {step.size * 1e3:+.3g}"
            alarms.append(Alarm("step", f"{what} mrad at t = {step.time:.2f} s", seconds))
    return alarms


def since_first(alarms: Iterable[Alarm], before: Iterable[Alarm]) -> tuple[Alarm, ...]:
    """The alarms, each with the time at which its kind was first raised."""
    raised = {alarm.kind: alarm.raised for alarm in before}
    return tuple(replace(a, raised=raised.get(a.kind, a.raised)) for a in alarms)
