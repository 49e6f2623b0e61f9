"""Alarms of a recording that is watched: findings, silence, a robot that stands, steps of logs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.acquisition.report import ImportReport
from ballbar.cell.clock import Clock
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.recording_fit import Logs
from ballbar.ident.signals.steps import LogStep
from ballbar.watch.alarms import FindingAlarms, SilenceAlarms, StepAlarms, standing


def report(*findings: tuple[str, str, tuple[int, ...]]) -> ImportReport:
    entries = [
        SimpleNamespace(file=file, kind=kind, lines=lines, sentence="it shows.")
        for file, kind, lines in findings
    ]
    return cast("ImportReport", SimpleNamespace(findings=entries))


def test_a_finding_is_an_alarm_once_it_stands_in_two_updates_one_after_the_other() -> None:
    watch, frozen = FindingAlarms(), ("a.csv", "frozen channel", (7, 9))
    assert watch.alarms(report(frozen), 1.0) == []
    (alarm,) = watch.alarms(report(frozen), 2.0)
    assert (alarm.kind, alarm.sentence) == ("frozen channel", "a.csv:7: it shows.")
    assert len(watch.alarms(report(frozen), 3.0)) == 1
    assert watch.alarms(report(), 4.0) == []
    assert watch.alarms(report(frozen), 5.0) == []  # it begins again
    assert (
        watch.alarms(report(("b.csv", "frozen channel", ()), frozen), 6.0)[0].sentence[:5]
        == "a.csv"
    )


def test_late_rows_are_no_alarm_and_a_finding_without_line_names_its_file() -> None:
    watch = FindingAlarms()
    for _ in range(2):
        alarms = watch.alarms(
            report(("a.csv", "late rows", (1,)), ("a.csv", "lost messages", ())), 1.0
        )
    assert [alarm.sentence for alarm in alarms] == ["a.csv: it shows."]


def test_a_file_that_does_not_grow_for_five_seconds_is_silent() -> None:
    watch = SilenceAlarms()
    assert watch.alarms({"a": 10, "b": 5}, 100.0, 0.0) == []
    assert watch.alarms({"a": 10, "b": 6}, 104.9, 4.9) == []
    (alarm,) = watch.alarms({"a": 10, "b": 7}, 105.0, 5.0)
    assert alarm.sentence == "a: no new row for 5 s"
    (alarm,) = watch.alarms({"a": 10, "b": 8}, 106.0, 6.0)
    assert alarm.sentence == "a: no new row for 6 s, while others grow"
    assert watch.alarms({"a": 11, "b": 8}, 107.0, 7.0) == []
    both = watch.alarms({"a": 11, "b": 8}, 112.0, 12.0)
    assert [each.sentence for each in both] == ["a: no new row for 5 s", "b: no new row for 6 s"]


def logs(stop: float, moved: float = 1.0, end: float = 30.0) -> Logs:
    """A robot that moves from a quarter of the log on until it stops at `stop` [s]."""
    t = np.arange(0.0, end, 0.01)
    phase = np.minimum(t, stop)
    noise = 1e-7 * np.random.default_rng(1).standard_normal((t.size, 6))
    q = moved * np.column_stack([np.sin(0.8 * phase + k) for k in range(6)]) + noise
    return cast("Logs", SimpleNamespace(robot=SimpleNamespace(t=t, q=q)))


@pytest.mark.parametrize(
    ("stop", "stands"), [(40.0, False), (26.0, False), (24.3, True), (20.0, True)]
)
def test_a_robot_that_stands_for_longer_than_in_a_dwell_is_named(
    stop: float, *, stands: bool
) -> None:
    alarms = standing(logs(stop))
    assert bool(alarms) is stands
    if stands:
        assert alarms[0].sentence.startswith(f"the robot stands for {min(30.0 - stop, 8.0):.0f} s")


def test_a_robot_that_has_not_moved_yet_or_a_log_that_is_short_tells_nothing() -> None:
    assert standing(logs(20.0, moved=0.01)) == []
    assert standing(logs(0.5, end=4.0)) == []


def samples(end: float, *steps: LogStep) -> Samples:
    bar = SimpleNamespace(steps=steps)
    robot = SimpleNamespace(steps=(), end=end)
    return cast(
        "Samples",
        SimpleNamespace(
            robot=robot,
            ballbar=bar,
            has_clock=True,
            measures_length=False,
            encoders=(1, 2, 4, 5),
            directions=np.ones(4),
        ),
    )


def step(time: float, channel: int | None = 1) -> LogStep:
    return LogStep(row=int(100 * time), time=time, channel=channel, size=0.02)


def told(watch: StepAlarms, end: float, *steps: LogStep) -> list[str]:
    return [a.sentence for a in watch.alarms(samples(end, *steps), Clock(0.0, 0.0), end)]


def test_a_step_is_believed_where_it_was_new_when_a_fit_first_showed_it() -> None:
    watch = StepAlarms()
    (first,) = told(watch, 20.0, step(5.0))
    assert first.endswith("at t = 5.00 s")
    assert len(told(watch, 30.0, step(5.3), step(25.0))) == 2
    assert told(watch, 40.0, step(5.3), step(10.0)) == []  # none was there in three fits
    assert len(told(watch, 41.0, step(5.3), step(25.1), step(33.0))) == 3
