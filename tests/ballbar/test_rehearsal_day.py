"""The steps of a rehearsed day: what each says, states in SI units, and calls met."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.errors import FailureError, InputError
from ballbar.cell.files import write_yaml
from ballbar.cell.load import load_robot
from ballbar.ident.verdict import Status
from ballbar.rehearsal import day, files, live, second_path, targets
from ballbar.rehearsal.day import Day, Rehearsal, Stage
from ballbar.rehearsal.files import OUTPUTS, chain, rehearsal_page
from ballbar.rehearsal.live import LATE, LivePath, as_recorded
from ballbar.rehearsal.targets import HeldTargets
from ballbar.scenario import SHIPPED, load_scenario, scenario_file
from ballbar.sim.live.delivery import Pace
from ballbar.truth.limits import Limit
from ballbar.watch.state import Alarm

SCENARIO = load_scenario("irb2400")


@pytest.fixture
def shown() -> list[Stage]:
    return []


@pytest.fixture
def begun(tmp_path: Path, shown: list[Stage]) -> Day:
    def quiet(_: str) -> None: ...

    command = "ballbar rehearse irb2400"
    file = tmp_path / "scenario.yaml"
    return Day(SCENARIO, file, tmp_path, 10.0, None, command, shown.append, progress=quiet)


def path(**given: Any) -> LivePath:
    return LivePath(Pace(10.0), **given)


def patched(monkeypatch: pytest.MonkeyPatch, name: str, value: Any) -> list[tuple[Any, Any]]:
    """Calls of a function of the day, which returns a value."""
    calls = list[tuple[Any, Any]]()

    def called(*given: Any, **named: Any) -> Any:
        calls.append((given, named))
        return value

    monkeypatch.setattr(day, name, called)
    return calls


def test_stages_are_shown_as_they_are_done_and_their_times_add_up(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun.since = 100.0
    instants = iter([103.0, 108.5])
    monkeypatch.setattr(time, "monotonic", lambda: next(instants))
    begun.done("one", "first", {"a_m": 1.0}, met=True)
    begun.done("two", "second", {}, met=False)
    assert [(s.name, s.took, s.met) for s in shown] == [("one", 3.0, True), ("two", 5.5, False)]
    assert begun.stages == shown
    assert begun.took == 8.5


def test_a_recorded_path_states_what_was_known_while_it_moved_and_at_its_end(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    states = [
        {"recorded_s": 30.0, "tcp_sigma_m": None},
        {"recorded_s": 60.0, "tcp_sigma_m": 5e-5},
        {"recorded_s": 90.0, "tcp_sigma_m": 3e-5},
    ]
    taken = path(seconds=120.4, states=states, last={"tcp_sigma_m": 2e-5})
    calls = patched(monkeypatch, "record_live", taken)
    day._recorded(begun, "path1")
    ((source, _), named) = calls[0]
    assert source == begun.folder / "simulated" / "path1"
    assert named["folder"] == begun.folder / "recordings" / "path1"
    assert (named["fault"], named["identify"], named["speed"]) == (None, True, 10.0)
    (stage,) = shown
    assert stage.name == "record path1"
    assert stage.sentence == (
        "120 s, 0 records lost, stated 0.0300 mm while it moved, 0.0200 mm at its end, no alarm"
    )
    assert stage.met
    assert stage.figures == {
        "seconds": 120.4, "lost": 0, "tcp_sigma_live_m": 3e-5, "tcp_sigma_final_m": 2e-5,
        "alarms": [],
    }  # fmt: skip
    assert begun.paths == {"path1": taken}


def test_lost_records_and_alarms_are_said_and_are_not_as_required(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    alarm = Alarm("misfit", "it does not fit.", 31.7)
    patched(monkeypatch, "record_live", path(alarms={"misfit": alarm}))
    day._recorded(begun, "path2")
    patched(monkeypatch, "record_live", path(lost=2))
    day._recorded(begun, "path2")
    alarmed, lost = shown
    assert alarmed.sentence.endswith(
        "stated no result yet while it moved, no result yet at its end; ALARM misfit at 32 s: it "
        "does not fit."
    )
    assert not alarmed.met
    assert alarmed.figures["alarms"] == [vars(alarm)]
    assert "2 records lost" in lost.sentence
    assert not lost.met


def test_a_fault_is_met_where_an_alarm_names_it_and_the_delay_is_from_where_it_shows(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    alarm = Alarm("step", "b2 stepped.", 64.5)
    noticed = path(fault="slip", began=60.0, shows=62.0, alarms={"step": alarm})
    calls = patched(monkeypatch, "record_live", noticed)
    day._with_fault(begun, "slip")
    assert calls[0][0][0] == begun.folder / "simulated" / "path1"
    assert calls[0][1]["fault"] == "slip"
    patched(monkeypatch, "record_live", replace(noticed, alarms={}))
    day._with_fault(begun, "slip")
    met, missed = shown
    assert met.sentence == (
        "slip from 62 s on: noticed 2.5 s of recording later: step: b2 stepped."
    )
    assert met.met
    assert met.figures == {
        "fault": "slip", "began_s": 60.0, "shows_s": 62.0, "noticed_after_s": 2.5,
        "alarm": {"kind": "step", "sentence": "b2 stepped."},
    }  # fmt: skip
    assert missed.sentence == "slip from 62 s on: not noticed"
    assert not missed.met
    assert missed.figures["noticed_after_s"] is None


def an_error(mean: float, maximum: float, size: float, without: float) -> SimpleNamespace:
    return SimpleNamespace(
        mean=mean, maximum=maximum, error=np.full(4, size), error_without_scale=np.full(4, without)
    )


def test_an_identification_is_said_with_its_stated_and_its_true_error(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Root mean squares of both, with scale and without."""
    verdict = SimpleNamespace(status="good", acceptable=True)
    tcp = SimpleNamespace(without_scale=np.array([1e-5, 7e-5]))
    robot = SimpleNamespace(tcp_sigma=np.array([3e-5, 4e-5]), tcp=tcp)
    data = SimpleNamespace(identification=SimpleNamespace(robot=robot, verdict=verdict))
    calls = patched(monkeypatch, "identified", data)
    patched(monkeypatch, "write_outputs", None)
    comparison = SimpleNamespace(
        tcp=an_error(1e-5, 6e-5, 2e-5, 1.5e-5), tcp_nominal=SimpleNamespace(mean=2e-3)
    )
    patched(monkeypatch, "against_simulation", comparison)
    result, compared = day._identified(begun, "result", ("path1", "path2"), cast(Any, None))
    assert result is data.identification
    assert compared is comparison
    folders = [begun.folder / "recordings" / name for name in ("path1", "path2")]
    assert calls[0][0] == (folders,)
    (stage,) = shown
    assert stage.name == "identify path1 and path2"
    assert stage.sentence == (
        "good, stated 0.0354 mm (0.0500 mm without scale); true error 0.0200 mm rms (0.0150 mm "
        "without scale), largest 0.0600 mm"
    )
    figures: Any = stage.figures
    assert figures["tcp_sigma_m"] == pytest.approx(np.sqrt(12.5) * 1e-5)
    assert figures["tcp_sigma_without_scale_m"] == pytest.approx(5e-5)
    assert figures["true_tcp_error_m"] == pytest.approx(
        {"mean": 1e-5, "rms": 2e-5, "max": 6e-5, "rms_without_scale": 1.5e-5}
    )
    assert figures["nominal_tcp_error_m"] == 2e-3


def planned(monkeypatch: pytest.MonkeyPatch, *, of_logs: bool, feasible: bool = True) -> None:
    stored = SimpleNamespace(calibration=SimpleNamespace(of_logs=of_logs))
    patched(monkeypatch, "load_result", stored)
    predicted = {"by_results_before": 4e-5, "rms_median_robot": 1.5e-5}
    patched(monkeypatch, "plan_second_path", (SCENARIO, predicted, feasible))


def test_the_second_path_is_planned_or_recorded_once_more_where_a_tracker_follows(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    planned(monkeypatch, of_logs=True)
    assert day._planned(begun) is SCENARIO
    planned(monkeypatch, of_logs=True, feasible=False)
    day._planned(begun)
    planned(monkeypatch, of_logs=False)
    again = day._planned(begun)
    assert again.recording == SCENARIO.recording + 1
    kept, violated, repeated = shown
    seat = ", ".join(f"{x:.3f}" for x in SCENARIO.cell.position)
    assert kept.sentence == (
        f"seat ({seat}) m; scale known, 0.0400 mm by the first result, 0.0150 mm predicted with "
        "the path"
    )
    assert (kept.name, kept.met) == ("plan path2", True)
    assert violated.sentence.endswith("; a limit is violated in MuJoCo")
    assert not violated.met
    assert (repeated.name, repeated.met) == ("path2", True)


@pytest.mark.parametrize(("after", "met"), [(2e-5, True), (4e-3, False)])
def test_corrected_targets_are_as_required_where_the_plant_holds_them_better(
    begun: Day, shown: list[Stage], monkeypatch: pytest.MonkeyPatch, after: float, met: bool
) -> None:
    patched(monkeypatch, "load_result", None)
    corrected = SimpleNamespace(position_before=np.array([1e-3, 3e-3]))
    correction = SimpleNamespace(corrected=corrected, included=["compliance"])
    patched(monkeypatch, "correct_targets", correction)
    held = HeldTargets(np.array([2e-3, 4e-3]), np.full(2, after), np.full(2, 0.5 * after))
    patched(monkeypatch, "hold_targets", held)
    assert day._corrected(begun) is held
    expected, held_stage = shown
    assert expected.sentence == (
        "2 targets for geometry, compliance; the result expects 2.00 mm mean, 3.00 mm largest "
        "without it"
    )
    assert expected.figures["expected_before_m"] == {"mean": 2e-3, "max": 3e-3}
    assert held_stage.sentence.startswith("off by 3.00 mm mean, 4.00 mm largest as planned; by ")
    assert held_stage.figures["corrected_targets_m"] == {"mean": after, "max": after}
    assert held_stage.figures["corrected_base_aligned_m"] == {
        "mean": 0.5 * after,
        "max": 0.5 * after,
    }
    assert held_stage.met is met


@pytest.mark.parametrize(
    ("holds", "lost", "met"), [(True, 0, True), (False, 0, False), (True, 1, False)]
)
def test_the_third_path_is_held_out_and_none_of_it_may_be_lost(
    begun: Day,
    shown: list[Stage],
    monkeypatch: pytest.MonkeyPatch,
    holds: bool,
    lost: int,
    met: bool,
) -> None:
    simulated = patched(monkeypatch, "simulate_scenario", None)
    recorded = patched(monkeypatch, "record_live", path(lost=lost))
    outcome = SimpleNamespace(
        holds=holds, sentence="It holds.", figures={"normalised_innovation": 1.1}
    )
    patched(monkeypatch, "verify", outcome)
    accept = SCENARIO.accept.model_copy(update={"held_out_file": "other.yaml"})
    day._verified(replace(begun, scenario=SCENARIO.model_copy(update={"accept": accept})))
    scenario, _, folder = simulated[0][0]
    assert scenario.needed_path.file == "other.yaml"
    assert scenario.recording == SCENARIO.recording + 2
    assert folder == begun.folder / "simulated" / "path3"
    assert recorded[0][1]["identify"] is False
    (stage,) = shown
    assert (stage.name, stage.sentence, stage.met) == ("verify with path3", "It holds.", met)
    assert stage.figures == {"holds": holds, "innovation": 1.1, "lost": lost}


def test_a_day_identifies_the_first_path_alone_and_then_both(
    begun: Day, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fault is recorded before them, and only where one is asked for."""
    said = list[Any]()

    def step(name: str, value: Any = None) -> None:
        def called(_: Day, *given: Any) -> Any:
            said.append((name, *(x for x in given if isinstance(x, (str, tuple)))))
            return value

        monkeypatch.setattr(day, name, called)

    held = HeldTargets(np.full(2, 1e-3), np.full(2, 1e-5), np.full(2, 1e-5))
    nominal = SimpleNamespace(mean=2e-3)
    tcp = SimpleNamespace(mean=1e-5, maximum=2e-5)
    result = SimpleNamespace(
        robot=SimpleNamespace(tcp_sigma=np.full(2, 1e-5)),
        verdict=SimpleNamespace(status=Status.GOOD),
    )
    for name, value in (
        ("_simulated", None), ("_with_fault", None), ("_recorded", None),
        ("_identified", (result, SimpleNamespace(tcp=tcp, tcp_nominal=nominal))),
        ("_planned", SCENARIO), ("_corrected", held), ("_verified", None),
    ):  # fmt: skip
        step(name, value)
    rehearsal = day.rehearse(begun)
    assert said == [
        ("_simulated", "path1"), ("_recorded", "path1"), ("_identified", "result1", ("path1",)),
        ("_planned",), ("_simulated", "path2"), ("_recorded", "path2"),
        ("_identified", "result", ("path1", "path2")), ("_corrected",), ("_verified",),
    ]  # fmt: skip
    assert rehearsal.nominal == 2e-3
    said.clear()
    day.rehearse(replace(begun, fault="slip"))
    assert said[:3] == [("_simulated", "path1"), ("_with_fault", "slip"), ("_recorded", "path1")]


@pytest.mark.parametrize(
    ("stages", "limits", "acceptable"),
    [((True, True), (True,), True), ((True, False), (True,), False), ((True,), (False,), False)],
)
def test_a_day_is_as_required_where_every_step_and_every_limit_is(
    begun: Day, stages: tuple[bool, ...], limits: tuple[bool, ...], acceptable: bool
) -> None:
    for met in stages:
        begun.stages.append(Stage("a", "b", met, 1.0, {}))
    held = HeldTargets(*(np.full(2, 1e-4) for _ in range(3)))
    stated = tuple(Limit("it", 1.0, 2.0, "mm", met) for met in limits)
    assert Rehearsal(begun, stated, 1e-3, held).acceptable == acceptable


HELD = HeldTargets(np.array([2e-3, 4e-3]), np.array([2e-5, 4e-5]), np.full(2, 1e-5))


def a_rehearsal(begun: Day) -> Rehearsal:
    figures = {"tcp_sigma_m": 2.5e-5, "true_tcp_error_m": {"rms": 1.5e-5}}
    for stage in (
        Stage("identify path1", "identified", True, 2.04, figures),
        Stage("plan path2", "planned", True, 3.0, {}),
        Stage("verify with path3", "verified", True, 5.0, {}),
    ):
        begun.stages.append(stage)
    states = [{"recorded_s": t, "tcp_sigma_m": 1e-3 / t} for t in (10.0, 20.0)]
    begun.paths |= {"path1": path(states=states), "path3": path(states=states)}
    return Rehearsal(begun, (), 2.5e-3, HELD)


def test_the_page_says_how_far_targets_are_off_before_and_after(begun: Day) -> None:
    rehearsal = a_rehearsal(begun)
    page = rehearsal_page(rehearsal)
    duration = f"{SCENARIO.needed_path.duration_s:g}"
    assert f"paths of {duration} s at 10 times real time: 10 s in all." in page
    assert (
        "2 targets are off by 3.00 mm on average as planned with the nominal robot, and by 0.0300 "
        "mm after both paths and the correction, 0.0400 mm at most." in page
    )
    assert "As required" in page
    assert "plan/plan.svg" in page
    limit = Limit("TCP error, mean", 0.2, 0.1, "mm", False)
    missed = rehearsal_page(replace(rehearsal, limits=(limit,)))
    assert "Not as required: TCP error, mean" in missed
    begun.stages[1] = Stage("path2", "again", False, 1.0, {})
    begun.fault = "slip"
    again = rehearsal_page(rehearsal)
    assert "Not as required: path2" in again
    assert "plan/plan.svg" not in again
    assert "real time, with the fault slip: 8 s in all" in again


def test_the_key_figures_of_a_day_are_nominal_stated_corrected_and_held_out(begun: Day) -> None:
    tiles = files._tiles(a_rehearsal(begun))
    assert [(t.label, t.value) for t in tiles] == [
        ("Nominal robot", "2.50 mm"), ("Identify path1", "0.0250 mm"),
        ("Corrected targets", "0.0300 mm"), ("Path held out", "holds"),
    ]  # fmt: skip
    assert tiles[1].note == "stated (1 sigma, rms); true error rms 0.0150 mm"
    assert tiles[2].note == "mean in the plant; largest 0.0400 mm"
    begun.stages[-1] = replace(begun.stages[-1], met=False)
    assert files._tiles(Rehearsal(begun, (), 1e-3, HELD))[-1].value == "fails"


def test_curves_are_of_the_paths_that_stated_something_twice(begun: Day) -> None:
    """The third path is not identified while it is recorded."""
    a_rehearsal(begun)
    drawn = files._live(begun)
    assert "path1" in drawn
    assert "path3" not in drawn
    once = [{"recorded_s": 10.0, "tcp_sigma_m": 1e-4}]
    begun.paths["path1"] = path(states=once)
    assert files._live(begun) == ""


def test_the_chain_has_times_to_a_tenth_of_a_second(begun: Day) -> None:
    data: Any = chain(a_rehearsal(begun))
    assert data["wall_time_s"] == 10.0
    assert [stage["wall_time_s"] for stage in data["stages"]] == [2.0, 3.0, 5.0]
    assert data["scenario"] == SCENARIO.name
    assert data["speed"] == 10.0
    assert data["stages"][0]["figures"]["tcp_sigma_m"] == 2.5e-5


def test_a_new_day_takes_the_place_of_the_one_before_as_a_whole(tmp_path: Path) -> None:
    """Outputs that the new day has not are gone; what is no output of a day stays."""
    beside, out = tmp_path / "beside", tmp_path / "out"
    for folder, text in ((beside, "new"), (out, "old")):
        (folder / "result").mkdir(parents=True)
        (folder / "result" / "report.html").write_text(text)
        (folder / "rehearsal.json").write_text(text)
    (out / "plan").mkdir()
    (out / "request.yaml").write_text("old")
    (out / "notes.txt").write_text("mine")
    files._replace_outputs(beside, out)
    assert (out / "result" / "report.html").read_text() == "new"
    assert (out / "rehearsal.json").read_text() == "new"
    assert {entry.name for entry in out.iterdir()} - OUTPUTS == {"notes.txt"}
    assert not (out / "plan").exists()
    assert not (out / "request.yaml").exists()


# --- live


class Beside:
    """A process that has said something so many times."""

    def __init__(self, *latest: Any) -> None:
        self.said, self.updates, self.failure = list(latest), 0, ""

    @property
    def latest(self) -> Any:
        return self.said[-1] if self.said else None


def state(recorded: float, sigma: float | None, *alarms: str) -> dict[str, Any]:
    listed = [{"kind": kind, "sentence": f"{kind}."} for kind in alarms]
    return {"recorded_s": recorded, "tcp_sigma_m": sigma, "alarms": listed}


class Held(Pace):
    """A pace that notes whether it is held back."""

    at, wanted = 0.0, None

    @property
    def delivered(self) -> float:
        return self.at

    def hold_back(self, *, wanted: bool) -> None:
        self.wanted = wanted


def test_an_update_is_taken_in_once_and_an_alarm_keeps_when_it_was_first_shown() -> None:
    beside, pace = Beside(state(10.0, None)), Held(1.0)
    taken = LivePath(pace, began=20.0, beside=cast(Any, beside))
    for delivered, latest in (
        (12.0, None),
        (13.0, None),
        (22.0, state(20.0, 2e-5, "slip")),
        (25.0, state(23.0, 1e-5, "slip", "silent")),
    ):
        pace.at = delivered
        if latest is not None:
            beside.said.append(latest)
        noticed = taken.look()
        assert noticed == (delivered >= 22.0)
    assert len(taken.states) == 3
    assert taken.stated == [(20.0, 2e-5), (23.0, 1e-5)]
    assert {kind: alarm.raised for kind, alarm in taken.alarms.items()} == {
        "slip": 22.0, "silent": 25.0,
    }  # fmt: skip
    assert taken.noticed == Alarm("slip", "slip.", 22.0)


def test_devices_are_held_back_once_an_update_is_late() -> None:
    beside, pace = Beside(state(10.0, None)), Held(1.0)
    taken = LivePath(pace, beside=cast(Any, beside))
    taken.look()
    assert pace.wanted is None, "nothing was delivered yet"
    for delivered, wanted in ((10.0, False), (LATE, False), (LATE + 0.5, True)):
        pace.at = delivered
        taken.look()
        assert pace.wanted is wanted
    beside.said.append(state(30.0, None))
    taken.look()
    assert pace.wanted is False
    alone = Held(1.0)
    alone.at = 100.0
    assert not LivePath(alone).look()
    assert alone.wanted is None


def test_one_waits_for_one_update_or_for_three_after_a_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waits = list[float]()
    taken = LivePath(Pace(1.0))
    monkeypatch.setattr(LivePath, "wait_for_update", lambda _, seconds: waits.append(seconds))
    taken.wait_for_last()
    assert len(waits) == 1
    waits.clear()
    taken.fault = "slip"
    taken.wait_for_last()
    assert len(waits) == 3
    waits.clear()
    taken.began, taken.alarms = 1.0, {"slip": Alarm("slip", "it.", 2.0)}
    taken.wait_for_last()
    assert len(waits) == 1


def test_a_process_that_failed_is_not_waited_for() -> None:
    beside = Beside()
    beside.failure = "exit code 1"
    taken = LivePath(Pace(1.0), beside=cast(Any, beside))
    with pytest.raises(FailureError, match="identification beside the recording: exit code 1"):
        taken.wait_for_update(1.0)
    begun = time.monotonic()
    beside.failure = ""
    taken.wait_for_update(0.06)
    assert 0.05 < time.monotonic() - begun < 5.0
    LivePath(Pace(1.0)).wait_for_update(60.0)  # none beside it


def test_a_part_of_the_cell_that_does_not_come_up_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "BEGINS", 0.01)
    monkeypatch.setattr(live, "LOOK", 0.001)
    with pytest.raises(FailureError, match="the PLC hangs"):
        live._wait(lambda: False, "the PLC hangs")
    answers = iter([False, True])
    live._wait(lambda: next(answers), "it does not")


def test_a_recorder_that_starts_its_own_files_cannot_be_restarted() -> None:
    again = load_scenario("irb2400", overrides=["clocks.restart={at_s: 30}"])
    with pytest.raises(InputError, match=r"clocks\.restart: the recorder starts its own files"):
        as_recorded(again)
    length = as_recorded(load_scenario("ur10e_telescoping"))
    assert length.logs.torque is None
    assert length.logs.robot == load_scenario("ur10e_telescoping").logs.robot


# --- targets and the second path


def test_fifty_targets_are_written_in_degrees_as_the_controller_shows_its_axes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = load_robot("irb2400")
    grid = np.linspace(-0.5, 0.5, 60)[:, None] * np.ones(6)
    monkeypatch.setattr(targets, "accuracy_grid", lambda _: grid)
    monkeypatch.setattr(targets, "correctable", lambda _, q: q)
    monkeypatch.setattr(targets, "correct_file", lambda file, _: file)
    monkeypatch.setattr(targets, "write_corrected", lambda *_: None)
    result = cast(Any, SimpleNamespace(robot=robot))
    assert targets.correct_targets(tmp_path, result) == tmp_path / "targets.csv"
    read = targets.read_targets(tmp_path / "targets.csv", robot).q
    np.testing.assert_allclose(read, grid[:50], atol=1e-12)


def test_held_targets_are_off_from_where_the_nominal_robot_puts_those_that_were_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that is 3 mm off along x and corrected 1 mm along y; the base takes up both."""
    given, corrected = np.zeros((4, 6)), np.ones((4, 6))
    read = {"targets.csv": given, "targets-corrected.csv": corrected}
    monkeypatch.setattr(targets, "read_targets", lambda file, _: SimpleNamespace(q=read[file.name]))
    monkeypatch.setattr(targets, "true_machine", lambda *_, **__: SimpleNamespace(nominal="n"))
    tip = np.random.default_rng(1).normal(size=(3, 4))
    planned = SimpleNamespace(tip=tip)
    monkeypatch.setattr(targets, "robot_frames", lambda _, q: planned if q is given else None)

    def held(_: Any, q: Any) -> SimpleNamespace:
        shift = [3e-3, 0.0, 0.0] if q is given else [0.0, 1e-3, 0.0]
        tool = np.tile(np.eye(4), (4, 1, 1))
        tool[:, :3, 3] = tip.T + shift
        return SimpleNamespace(tool=tool)

    monkeypatch.setattr(targets, "hold_machine", held)

    def distance(frames: Any, pose: Any) -> Any:
        return np.linalg.norm(pose.tool[:, :3, 3] - frames.tip.T, axis=1), None

    monkeypatch.setattr(targets, "pose_distance", distance)
    off = targets.hold_targets(tmp_path, cast(Any, SimpleNamespace(robot=None)), SCENARIO, tmp_path)
    assert off.before == pytest.approx(3e-3)
    assert off.after == pytest.approx(1e-3)
    assert off.aligned == pytest.approx(0.0, abs=1e-12)


def test_the_recording_after_a_plan_is_along_its_path_and_from_its_seat(tmp_path: Path) -> None:
    path = tmp_path / "path.yaml"
    shipped = (SHIPPED / "paths" / "irb2400_a.yaml").read_text()
    path.write_text(f"{shipped}ballbar_position_m: [0.8, 0.1, 0.5]\n")
    following = second_path._along(SCENARIO, path)
    assert following.cell.ballbar_position_m == (0.8, 0.1, 0.5)
    assert following.needed_path.file == str(path)
    assert following.needed_path.duration_s == SCENARIO.needed_path.duration_s
    assert following.recording == SCENARIO.recording + 1


def test_a_second_path_may_move_the_seat_by_15_cm_and_the_rod_may_lean_in_its_cup() -> None:
    data: Any = second_path.request_data(SCENARIO, scenario_file("irb2400").parent)
    region = data["cell"]["ballbar_region_m"]
    assert region["lower"] == pytest.approx(SCENARIO.cell.position - 0.15)
    assert region["upper"] == pytest.approx(SCENARIO.cell.position + 0.15)
    assert data["sensors"] == {"encoders": [1, 2, 3, 4, 5]}
    assert "seat" not in data["cell"]
    length = load_scenario("ur10e_telescoping")
    data = second_path.request_data(length, scenario_file("ur10e_telescoping").parent)
    assert data["cell"]["seat"] == {"axis": [0.0, 0.0, 1.0], "cone_deg": 80.0}
    assert "sensors" not in data


@pytest.mark.parametrize("stopped", [False, True])
def test_the_second_path_is_that_of_a_plan_after_the_first_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: bool
) -> None:
    """Searched for ten seconds; Ctrl-C ends the day, as the plan would keep its best path."""
    asked = list[Any]()

    def make(request: Any, file: Path, options: Any) -> bool:
        asked.append((request.name, file, options))
        shipped = (SHIPPED / "paths" / "irb2400_a.yaml").read_text()
        options.folder.mkdir()
        path = options.folder / "path.yaml"
        path.write_text(f"{shipped}ballbar_position_m: [0.8, 0.1, 0.5]\n")
        planned = {"search": {"stopped": stopped}, "tcp_sigma_m": {"rms_median_robot": 1e-5}}
        write_yaml(options.folder / "plan.yaml", planned)
        return True

    monkeypatch.setattr(second_path, "make_plan", make)
    arguments = SCENARIO, tmp_path, tmp_path / "result1", scenario_file("irb2400").parent
    if stopped:
        with pytest.raises(KeyboardInterrupt):
            second_path.plan_second_path(*arguments)
        return
    scenario, predicted, feasible = second_path.plan_second_path(*arguments)
    assert scenario.cell.ballbar_position_m == (0.8, 0.1, 0.5)
    assert predicted == {"rms_median_robot": 1e-5}
    assert feasible
    ((name, file, options),) = asked
    assert (name, file) == ("path2", tmp_path / "request.yaml")
    assert options.after == [tmp_path / "result1"]
    assert options.seconds == 10.0
    assert options.folder == tmp_path / "plan"
