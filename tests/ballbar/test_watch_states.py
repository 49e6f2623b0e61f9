"""States of a watched recording: enough, refused, covered, and what is said of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.load import load_robot
from ballbar.ident.prediction import Prediction
from ballbar.watch import alarms
from ballbar.watch import watch as watching
from ballbar.watch.alarms import _steps, since_first
from ballbar.watch.show import _facts, _uncertainty, line
from ballbar.watch.state import Alarm, Estimate, WatchState, axes_covered, seconds_of
from ballbar.watch.watch import (
    CERTAIN,
    COMPLETE_GROWTH,
    PATIENCE,
    SEEN_TWICE,
    SHORTEST,
    YOUNG,
    Watch,
)

ESTIMATE = Estimate(
    until=60.0, model="dh", status="good", sentence="It fits.", tcp_sigma=3e-5, without_scale=2e-5,
    acceptable=True, clock=(0.1, 2e-5), clock_sigma=(1e-6, 1e-8),
    noise={"q1": 2e-5, "length": 4e-6}, sphere=0.456,
)  # fmt: skip


def a_watch(**changes: Any) -> Watch:
    watch = Watch(Path("nowhere"), accuracy=changes.pop("accuracy", None))
    for name, value in changes.items():
        setattr(watch, f"_{name}", value)
    return watch


@pytest.mark.parametrize(
    ("sigma", "acceptable", "accuracy", "reached"),
    [(5e-5, True, 1e-4, True), (5.2e-5, True, 1e-4, False), (5e-5, False, 1e-4, False),
     (5e-5, True, None, False)],
)  # fmt: skip
def test_an_accuracy_is_reached_where_95_percent_of_such_estimates_are_within(
    sigma: float, acceptable: bool, accuracy: float | None, reached: bool
) -> None:
    estimate = replace(ESTIMATE, tcp_sigma=sigma, acceptable=acceptable)
    assert a_watch(accuracy=accuracy)._reached(estimate) == reached


def test_files_that_were_read_are_waited_for_and_then_refused_from_when_it_was_first_so() -> None:
    """Descriptions for six updates, logs for two; what was never read is waited for."""
    fresh = a_watch()
    assert fresh._refused("no such folder.", patience=PATIENCE).waiting == "no such folder."
    assert fresh._unread == 0
    known = WatchState(30.0, {"robot": 1}, "", (Alarm("silent", "s", 20.0),), enough=True)
    patient = a_watch(state=known)
    for update in range(1, PATIENCE):
        state = patient._refused("gone.", patience=PATIENCE)
        assert [a.kind for a in state.alarms] == ["silent"]
        assert not state.enough
        assert patient._unread == update
    state = patient._refused("gone.", patience=PATIENCE)
    assert [(a.kind, a.sentence, a.raised) for a in state.alarms] == [
        ("silent", "s", 20.0), ("refused", "gone.", 30.0),
    ]  # fmt: skip
    state = patient._refused("still gone.", patience=PATIENCE)
    assert [a.kind for a in state.alarms] == ["silent", "refused"]
    quick = a_watch()
    assert quick._refused("torn.", patience=SEEN_TWICE).alarms == ()
    assert [a.kind for a in quick._refused("torn.", patience=SEEN_TWICE).alarms] == ["refused"]


def test_an_alarm_keeps_the_time_at_which_it_was_first_raised() -> None:
    before = [Alarm("step", "old", 10.0, "b2")]
    now = [Alarm("step", "new", 20.0, "b2"), Alarm("step", "other", 20.0, "b4")]
    assert since_first(now, before) == (
        Alarm("step", "new", 10.0, "b2"), Alarm("step", "other", 20.0, "b4"),
    )  # fmt: skip


def test_steps_of_clocks_encoders_and_the_robots_log_are_said_with_their_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On the clock of the ball-bar, which begins 2 s after the robot's."""
    faults = [
        SimpleNamespace(kind="clock", time=4.0, size=-0.0125, joint=0),
        SimpleNamespace(kind="angle", time=5.0, size=0.0031, joint=2),
    ]
    monkeypatch.setattr(alarms, "step_faults_in_logs", lambda *_: faults)
    steps = [SimpleNamespace(channel=None), SimpleNamespace(channel=0, time=9.0, size=2e-3)]
    robot = SimpleNamespace(steps=steps)
    clock = Clock(2.0, 0.0)
    told = list(_steps(cast(Any, SimpleNamespace(robot=robot, has_clock=True)), clock))
    assert told == [
        ("a clock", 4.0, "was set by -12.5 ms"),
        ("encoder b2", 5.0, "stepped by +3.10 mrad"),
        ("joint 1 of the robot's log", 7.0, "stepped by +2.00 mrad"),
    ]
    alone = list(_steps(cast(Any, SimpleNamespace(robot=robot, has_clock=False)), clock))
    assert alone[-1][1] == 9.0


def test_the_range_of_an_axis_is_covered_by_what_it_passed_of_the_workspace() -> None:
    robot = load_robot("irb2400")
    span = robot.accuracy_upper - robot.accuracy_lower
    middle = 0.5 * (robot.accuracy_upper + robot.accuracy_lower)
    share = np.linspace(-0.25, 0.25, 20_000)[:, None]
    axes = middle + share * span * np.array([1.0, 1.0, 1.0, 1.0, 3.0, 0.0])
    covered = axes_covered(robot, axes @ np.asarray(robot.controller_to_joint))
    assert covered == pytest.approx((0.5, 0.5, 0.5, 0.5, 1.0, 0.0), abs=1e-3)


def log(end: float) -> Any:
    return SimpleNamespace(t=np.array([0.0, end]))


def test_a_recording_is_as_long_as_the_shorter_of_both_logs() -> None:
    def seconds(**given: Any) -> float:
        logs = {"ballbar": None, "length": None, "tracker": None, "robot": log(50.0)} | given
        return seconds_of(cast(Any, SimpleNamespace(**logs)))

    assert seconds() == 50.0
    assert seconds(ballbar=log(40.0)) == 40.0
    assert seconds(length=log(60.0)) == 50.0
    assert seconds(tracker=log(30.0)) == 30.0


def data(**changes: Any) -> dict[str, Any]:
    state = WatchState(
        seconds=61.23456, rows={"robot": 5}, waiting="", alarms=(Alarm("slip", "it slips.", 31.0),),
        axes=(0.5, 1.0), estimate=ESTIMATE, predicted=1.234, tcp_sigma_end=2.5e-5, enough=True,
    )  # fmt: skip
    return replace(state, **changes).to_dict()


def test_a_state_is_plain_data_in_si_units() -> None:
    told = data()
    assert told["recorded_s"] == 61.235
    assert told["tcp_sigma_m"] == 3e-5
    assert told["tcp_sigma_without_scale_m"] == 2e-5
    assert told["tcp_sigma_end_m"] == 2.5e-5
    assert (told["clock_offset_s"], told["clock_skew"]) == (0.1, 2e-5)
    assert told["clock_sigma"] == [1e-6, 1e-8]
    assert told["alarms"] == [
        {"kind": "slip", "sentence": "it slips.", "raised": 31.0, "subject": ""}
    ]
    nothing = data(estimate=None)
    assert nothing["tcp_sigma_m"] is None
    assert nothing["clock_offset_s"] is None
    assert nothing["noise"] == {}
    assert data(estimate=replace(ESTIMATE, clock=None))["clock_skew"] is None


def test_facts_of_a_recording_are_in_millimetres_per_cent_and_microradians() -> None:
    facts = _facts(data())
    assert facts == {
        "TCP uncertainty": (
            "0.0300 mm with the scale, 0.0200 mm without, at the end about 0.025 mm (estimate) - "
            "enough"
        ),
        "verdict": "good, model dh",
        "clock": "offset +100.0000 ms (sigma 1.0 us); skew +20.000 ppm (sigma 0.010 ppm)",
        "coverage": "sphere 46 %; axes 50 100 %",
        "noise": "q1 20 urad length 0.0040 mm",
        "latest rows": "1.23 times what the fit of the others explains",
    }
    assert _facts(data(waiting="for logs")) == {"waiting": "for logs"}
    alone = _facts(data(estimate=replace(ESTIMATE, clock=None, sphere=None), predicted=None))
    assert "clock" not in alone
    assert "latest rows" not in alone
    assert alone["coverage"] == "axes 50 100 %"
    followed = data(estimate=replace(ESTIMATE, model="poses"), tcp_sigma_end=None, enough=False)
    assert _uncertainty(followed) == "0.0200 mm, without the scale of the instrument"
    assert line(data()).startswith("61.2 s: TCP uncertainty 0.0300 mm with the scale")
    assert line(data()).endswith("; ALARM slip: it slips.")


def prediction(ratio: float, since: float | None = 50.0) -> Prediction:
    return cast(Prediction, SimpleNamespace(ratio=ratio, since=since, axes=(), channels=()))


@pytest.mark.parametrize(
    ("until", "ratio", "converged", "known"),
    [(YOUNG, 1.9, True, True), (YOUNG - 1.0, 1.0, True, False), (60.0, 2.1, True, False),
     (60.0, 1.0, False, False)],
)  # fmt: skip
def test_logs_are_read_as_before_once_a_fit_of_30_s_was_confirmed(
    until: float, ratio: float, converged: bool, known: bool
) -> None:
    hypothesis = watching.Hypothesis.__new__(watching.Hypothesis)
    chosen = SimpleNamespace(hypothesis=hypothesis)
    start = SimpleNamespace(ambiguous=False, chosen=chosen)
    fitted = SimpleNamespace(fit=SimpleNamespace(converged=converged), start=start, clock="clock")
    watch = a_watch(fitted=fitted, fitted_until=until)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(watching, "replace", lambda given, clock: (given, clock))
        assert watch._known(prediction(ratio)) == ((hypothesis, "clock") if known else None)
        assert watch._known(None) is None
        start.ambiguous = True
        assert watch._known(prediction(ratio)) is None
    assert a_watch()._known(prediction(1.0)) is None


@pytest.mark.parametrize(
    ("ratio", "misfits"), [(CERTAIN + 1.0, [True, True]), (10.0, [False, True])]
)
def test_rows_that_no_fit_explains_are_a_misfit_at_once_or_the_second_time(
    ratio: float, misfits: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching, "_contradiction", lambda _: "it contradicts.")
    before = SimpleNamespace(fit=SimpleNamespace(converged=True, chi2_per_dof=1.0))
    worse = SimpleNamespace(fit=SimpleNamespace(converged=True, chi2_per_dof=3.1))
    monkeypatch.setattr(watching, "fit_recording", lambda *_: worse)
    watch = a_watch(fitted=before, fitted_until=60.0)
    for seconds, expected in zip((62.0, 64.0), misfits, strict=True):
        alarm = watch._disagreement(cast(Any, None), cast(Any, None), seconds, prediction(ratio))
        assert (alarm is not None) == expected
        if alarm:
            assert (alarm.kind, alarm.sentence, alarm.raised) == (
                "misfit",
                "it contradicts.",
                seconds,
            )


@pytest.mark.parametrize(
    ("until", "chi2", "converged", "taken"),
    [
        (60.0, 2.9, True, True),
        (60.0, 3.1, True, False),
        (20.0, 9.0, False, True),
        (60.0, 2.0, False, False),
    ],
)
def test_a_fit_with_the_new_rows_that_leaves_no_more_or_one_of_a_young_start_is_taken(
    until: float, chi2: float, converged: bool, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching, "_contradiction", lambda _: "it contradicts.")
    before = SimpleNamespace(fit=SimpleNamespace(converged=True, chi2_per_dof=0.5))
    fitted = SimpleNamespace(fit=SimpleNamespace(converged=converged, chi2_per_dof=chi2))
    monkeypatch.setattr(watching, "fit_recording", lambda *_: fitted)
    took = list[Any]()
    monkeypatch.setattr(Watch, "_take", lambda *given: took.append(given[2:]))
    watch = a_watch(fitted=before, fitted_until=until)
    alarm = watch._disagreement(cast(Any, None), cast(Any, None), 62.0, prediction(CERTAIN + 1.0))
    assert (alarm is None) == taken
    assert took == ([(fitted, 62.0)] if taken else [])


class Pool:
    """Notes what it is handed."""

    def __init__(self) -> None:
        self.asked = list[Any]()

    def apply_async(self, work: Any, arguments: Any) -> Any:
        self.asked.append((work, arguments))
        return self


def test_the_complete_model_is_asked_where_the_plain_one_is_not_enough_and_ever_later() -> None:
    pool = Pool()
    watch = a_watch(pool=pool, estimate=ESTIMATE, next_complete=45.0)
    watch._ask_complete(cast(Any, "cell"), cast(Any, "logs"), 60.0)
    assert not pool.asked, "the plain model fits"
    watch._estimate = replace(ESTIMATE, acceptable=False)
    watch._ask_complete(cast(Any, "cell"), cast(Any, "logs"), 44.9)
    assert not pool.asked, "too early"
    watch._ask_complete(cast(Any, "cell"), cast(Any, "logs"), 45.0)
    assert pool.asked == [(watching.complete_estimate, ("cell", "logs", None))]
    assert watch._next_complete == pytest.approx(45.0 * COMPLETE_GROWTH)
    watch._ask_complete(cast(Any, "cell"), cast(Any, "logs"), 90.0)
    assert len(pool.asked) == 1, "one at a time"
    watch._complete = None
    watch._estimate = replace(ESTIMATE, model="complete")
    watch._ask_complete(cast(Any, "cell"), cast(Any, "logs"), 90.0)
    assert len(pool.asked) == 2


def test_a_followed_robot_is_identified_from_ten_seconds_on_in_growing_steps() -> None:
    pool = Pool()
    watch = a_watch(pool=pool)
    watch._ask_followed(cast(Any, "logs"), SHORTEST - 0.1)
    assert not pool.asked
    watch._ask_followed(cast(Any, "logs"), SHORTEST)
    assert pool.asked == [(watching.followed_estimate, (Path("nowhere"), "logs"))]
    assert watch._no_fit == "being identified"
    watch._complete = None
    watch._ask_followed(cast(Any, "logs"), SHORTEST * COMPLETE_GROWTH - 0.01)
    assert len(pool.asked) == 1
    watch._ask_followed(cast(Any, "logs"), SHORTEST * COMPLETE_GROWTH)
    assert len(pool.asked) == 2
    ended = a_watch(pool=pool, ended=True)
    ended._ask_followed(cast(Any, "logs"), 60.0)
    assert len(pool.asked) == 2
