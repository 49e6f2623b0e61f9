"""Predicted gains of what could be done next, against identifications that have it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ballbar.cell.recording import load_recording_file
from ballbar.ident.options import FitOptions
from ballbar.ident.robot.tcp_uncertainty import TcpUncertainty
from ballbar.ident.verdict import Status
from ballbar.identify_settings import IdentifySettings
from ballbar.planning.next_step import PATH, REPEAT, ROD_SIGMA, NextStep, next_steps, predicted
from ballbar.planning.plan import known_path
from ballbar.planning.questions import ENCODERS
from ballbar.report.machine import Steps, advised_steps, diagnosis_section, recorded_passage
from ballbar.result.identify import identify
from ballbar.result.run_data import RunData
from tests.helpers.one_recording import identify as identify_logs
from tests.helpers.simulated_recordings import SCENARIOS, Recorded, record

PATHS = {
    name: known_path(SCENARIOS / "paths" / f"{name}.yaml")[0]
    for name in ("irb2400_a", "irb2400_b", "nj220_a")
}


def complete(recorded: Recorded, **options: object) -> RunData:
    settings = IdentifySettings.model_validate(
        {"model": "complete", "corrections": ["rod_strain"], "samples": 600} | options
    )
    return identify(recorded.folder, options=settings.options).data


def stated(data: RunData) -> TcpUncertainty:
    return data.identification.robot.tcp


@pytest.fixture(scope="module")
def data(recorded: Recorded) -> RunData:
    return complete(recorded)


@pytest.fixture(scope="module")
def steps(data: RunData) -> dict[str, NextStep]:
    return {step.key: step for step in steps_of(data)}


def steps_of(data: RunData) -> list[NextStep]:
    passages = [recorded_passage(fitted) for fitted in data.recordings]
    return next_steps(data.identification.robot, data.identification.fit.excess, passages, PATHS)


@pytest.mark.slow
def test_what_is_predicted_of_the_recording_is_what_identification_states(data: RunData) -> None:
    passages = [recorded_passage(fitted) for fitted in data.recordings]
    present = predicted(data.identification.robot, data.identification.fit.excess, passages)
    assert present.sigma.mean() == pytest.approx(stated(data).sigma.mean(), rel=0.1)
    without = stated(data).without_scale.mean()
    assert present.without_scale.mean() == pytest.approx(without, rel=0.2)


def test_the_prediction_does_not_depend_on_how_many_samples_were_fitted(
    recorded: Recorded, data: RunData
) -> None:
    """It took the motion from the samples: few of them do not say how the robot moved between, so
    the loop was open by 1 rad and the scale seemed to be seen.
    """
    few, many = (
        predicted(
            data.identification.robot,
            data.identification.fit.excess,
            [recorded_passage(fitted) for fitted in run.recordings],
        )
        for run in (complete(recorded, samples=100), data)
    )
    assert few.sigma.mean() == pytest.approx(many.sigma.mean(), rel=0.03)


def test_two_encoders_leave_angles_that_pass_half_a_turn(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Angles without encoder follow from the pose within a turn; smoothed over the jump, the loop
    was open and the scale seemed to be seen.
    """
    two = record(
        tmp_path_factory.mktemp("two") / "recording",
        plant={"kind": "kinematic"},
        encoders={"fitted": [1, 2], "noise_sigma_rad": 1e-5},
    )
    run = identify(two.folder, options=FitOptions(samples=400)).data
    robot, excess = run.identification.robot, run.identification.fit.excess
    present = predicted(robot, excess, [recorded_passage(fitted) for fitted in run.recordings])
    assert present.sigma.mean() == pytest.approx(stated(run).sigma.mean(), rel=0.1)


def test_a_measured_rod_brings_what_was_predicted(
    recorded: Recorded, data: RunData, steps: dict[str, NextStep]
) -> None:
    """The rod of the plant is 0.24 mm off the catalogue's, so it is given the length it has."""
    fitted, cell = data.recordings[0].recording, data.identification.robot.cell
    d = cell.ballbar.d.copy()
    d[2] = recorded.simulation.truth.geometry["bd3"]
    options = FitOptions(
        model="complete", corrections=("rod_strain",), samples=600, rod_sigma=ROD_SIGMA
    )
    known = replace(cell, ballbar=replace(cell.ballbar, d=d))
    result = identify_logs(known, fitted.robot_log, fitted.ballbar_log, options=options)
    measured = result.robot.tcp.sigma.mean()
    assert measured < 0.6 * stated(data).sigma.mean()  # or the test would say nothing
    assert steps["rod_sigma"].predicted.sigma.mean() == pytest.approx(measured, rel=0.1)


def test_with_every_encoder_none_is_missing(steps: dict[str, NextStep]) -> None:
    assert ENCODERS not in steps
    assert set(steps) == {"rod_sigma", REPEAT, PATH}


def test_more_data_never_predict_more_uncertainty(
    data: RunData, steps: dict[str, NextStep]
) -> None:
    passages = [recorded_passage(fitted) for fitted in data.recordings]
    robot, excess = data.identification.robot, data.identification.fit.excess
    present = predicted(robot, excess, passages)
    for step in steps.values():
        assert (step.predicted.sigma <= present.sigma * (1.0 + 1e-9)).all(), step.key
    twice = steps[REPEAT].predicted.without_scale.mean() / present.without_scale.mean()
    assert 0.5**0.5 <= twice <= 1.0  # white noise at best; priors do not repeat


def test_steps_stand_in_order_and_the_path_is_of_this_robot(data: RunData) -> None:
    every = steps_of(data)
    sizes = [float(step.predicted.sigma.mean()) for step in every]
    assert sizes == sorted(sizes)
    (path,) = (step.value for step in every if step.key == PATH)
    assert path.startswith("irb2400")


@pytest.mark.slow  # a recording of its own
def test_a_fifth_encoder_brings_what_was_predicted(
    recorded: Recorded, data: RunData, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The recording that has it is the session's own; the other one is of the same run."""
    encoders = {"fitted": [1, 2, 4, 5], "noise_sigma_rad": 1e-5}
    four = record(tmp_path_factory.mktemp("four") / "recording", encoders=encoders)
    assert set(load_recording_file(four.folder).encoders) == {"b1", "b2", "b4", "b5"}
    fewer = complete(four)
    (step,) = (s for s in steps_of(fewer) if s.key == ENCODERS)
    assert step.value == "b3"
    five = stated(data).without_scale.mean()
    assert step.predicted.without_scale.mean() == pytest.approx(five, rel=0.2)


def test_no_step_is_advised_where_something_is_to_be_repaired_first(data: RunData) -> None:
    steps = advised_steps(data)
    assert steps.rows
    verdict = replace(data.identification.verdict, status=Status.MISFIT)
    bad = replace(data, identification=replace(data.identification, verdict=verdict))
    assert advised_steps(bad) == Steps()
    (without,), (told,) = diagnosis_section(bad, Steps()), diagnosis_section(data, steps)
    assert "What would help most next" not in without.html
    assert told.html.startswith(without.html.rstrip())
