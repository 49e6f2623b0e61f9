"""Paths for an instrument that follows a target: predicted by its rows, within the limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.load import load_instrument, load_robot
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.crlb import PathPrediction, predict
from ballbar.planning.evaluation import evaluators
from ballbar.planning.followed_path import RATE, TARGET, followed, predict_followed
from ballbar.planning.plan import PathPlan, assess
from ballbar.planning.request import PlanRequest, load_request
from ballbar.planning.trajectory import Passage
from ballbar.scenario import load_scenario
from ballbar.sim.path_files import load_lissajous
from tests.helpers.command_line import ballbar
from tests.helpers.followed_robot import DH, FollowedRobot, flange

SHIPPED = Path(__file__).parents[2] / "scenarios" / "paths"
REQUEST = {
    "schema": "ballbar-plan/1",
    "name": "followed",
    "cell": {"robot": "ur10e", "instrument": "tracker_point"},
}


def predicted(made: FollowedRobot, seconds: float, **cell: str) -> PathPrediction:
    """The prediction of a motion that nothing of the product has made."""
    request = PlanRequest.model_validate({**REQUEST, "cell": REQUEST["cell"] | cell}, strict=False)
    setup = followed(request, request.cell.instrument)
    assert setup is not None
    t = np.arange(0.0, seconds, 0.1)
    passage = Passage(robot_geometry(load_robot("ur10e")), t, np.zeros((t.size, 5)), made.angles(t))
    return predict_followed(setup, request, passage)


def test_the_clock_is_predicted_to_what_speed_and_noise_allow() -> None:
    """Were all else known, sigma = noise / (rms speed sqrt(rows)); the rest costs some of it."""
    made, seconds = FollowedRobot(seed=3), 60.0
    prediction = predicted(made, seconds)
    t = np.arange(0.0, seconds, 0.01)
    turn, place = flange(DH, np.zeros(6), made.angles(t))
    points = place + turn @ np.array(TARGET)
    speed = float(np.sqrt((np.gradient(points, t, axis=0) ** 2).sum(axis=1).mean()))
    sigma = load_instrument("tracker_point").sigma(points - [3.0, 0.0, 0.5]).mean()
    spacing = seconds / 240.0
    noise = float(np.hypot(sigma / np.sqrt(RATE * spacing), 5e-5))  # and what is unexplained
    least = noise / (speed * np.sqrt(240.0))
    assert least < prediction.sigma["clock followed.offset"] < 4.0 * least


def test_a_longer_path_tells_more_and_a_joint_that_rests_tells_nothing_of_its_zero() -> None:
    made = FollowedRobot(seed=3)
    short, long = predicted(made, 30.0), predicted(made, 90.0)
    assert long.tcp_sigma.mean() < 0.8 * short.tcp_sigma.mean()
    resting = predicted(replace(made, resting=(2,)), 60.0)
    assert resting.sigma["rtheta3"] > 3.0 * long.sigma["rtheta3"]


def test_whole_poses_tell_more_than_points_of_the_same_noise() -> None:
    made = FollowedRobot(seed=3)
    point, pose = (predicted(made, 60.0, instrument=f"tracker_{k}") for k in ("point", "pose"))
    assert pose.tcp_sigma.mean() < point.tcp_sigma.mean()


def test_a_path_for_a_tracker_is_checked_predicted_and_written(tmp_path: Path) -> None:
    request = {
        "schema": "ballbar-plan/1",
        "name": "followed",
        "cell": {"robot": "irb2400", "instrument": "tracker_point", "floor_m": -1.0},
        "timing": {"stops": 0},
        "limits": {"clearance_m": 0.01, "axis_acceleration_deg_per_s2": 100.0},
    }
    (tmp_path / "request.yaml").write_text(yaml.safe_dump(request))
    code, out, err = ballbar(
        "plan", tmp_path / "request.yaml", "--path", SHIPPED / "irb2400_drawwire.yaml",
        "--position=-0.006,-0.575,0.062", "--out", tmp_path / "plan",
    )  # fmt: skip
    assert code == 0, err
    assert "tracked target tracker_point at (-0.006, -0.575, 0.062) m" in out
    assert "rod force" not in out
    assert "length" not in out
    plan = yaml.safe_load((tmp_path / "plan" / "plan.yaml").read_text())
    assert not {"rod_force_N", "length_m"} & set(plan)
    # what ballbar run irb2400_tracker_moving states of that path is 0.09 mm, with fitted gears too
    assert 5e-5 < plan["tcp_sigma_m"]["rms_median_robot"] < 3e-4
    scenario = load_scenario(str(tmp_path / "plan" / "scenario.yaml"))
    assert scenario.cell.instrument == "tracker_point"
    assert scenario.logs.tracker is not None
    program = (tmp_path / "plan" / "followed.mod").read_text()
    assert "mount the tracked target" in program
    assert "stroke" not in program


def test_results_before_are_refused_for_an_instrument_that_follows(tmp_path: Path) -> None:
    (tmp_path / "request.yaml").write_text(yaml.safe_dump(REQUEST))
    folder = FollowedRobot(seed=8).write(tmp_path / "made", seconds=15.0, rate=50.0)
    result = tmp_path / "result"
    ballbar("identify", folder, "--out", result)
    code, _, err = ballbar(
        "plan", tmp_path / "request.yaml", "--after", result, "--out", tmp_path / "plan"
    )
    assert code == 2
    assert "result of still poses" in err or "of poses" in err


def planned(*changes: str) -> PathPlan:
    """The planned path of an IRB 2400 on a ball-bar, as a request with changes predicts it."""
    request = load_request(SHIPPED.parent / "plans" / "irb2400.yaml", overrides=changes)
    assert isinstance(request, PlanRequest)
    (evaluator,) = evaluators(request).values()
    scenario = load_scenario(SHIPPED.parent / "irb2400_planned.yaml")
    place = np.array(scenario.cell.ballbar_position_m)
    return assess(evaluator, PathCandidate(load_lissajous(SHIPPED / "irb2400_planned.yaml"), place))


def test_a_tracker_beside_a_ball_bar_counts_in_what_is_predicted() -> None:
    """It adds information in every direction, and tells the scale, which no ball-bar does."""
    alone, both = planned(), planned("cell.tracker=tracker_point")
    assert alone.scale_adds > 1e-5
    assert both.scale_adds == 0.0
    assert (both.tcp < np.hypot(alone.tcp, alone.scale_adds)).all()
    on = replace(both.evaluator.predictor, exact_scale=False)
    assert both.forces is not None
    bar, joined = predict(on, both.trajectory, both.forces.tension[0]), both.predictions[0]
    shared = [joined.layout.names.index(name) for name in bar.layout.names]
    scale = np.outer(bar.layout.sigma, bar.layout.sigma)
    gained = (bar.covariance - joined.covariance[np.ix_(shared, shared)]) / scale
    assert np.linalg.eigvalsh(gained).min() > -1e-9
    assert joined.sigma["ra6"] < 0.8 * bar.sigma["ra6"]


@pytest.mark.parametrize("name", ["lund_600", "qc20w_300"])
def test_what_follows_no_target_is_refused_as_a_tracker(name: str) -> None:
    with pytest.raises(InputError, match="follows no target"):
        planned(f"cell.tracker={name}")


def test_a_tracker_stands_beside_a_ball_bar_alone(tmp_path: Path) -> None:
    request = {**REQUEST, "cell": REQUEST["cell"] | {"tracker": "tracker_pose"}}
    (tmp_path / "request.yaml").write_text(yaml.safe_dump(request))
    with pytest.raises(DescriptionError, match="stands beside a ball-bar"):
        load_request(tmp_path / "request.yaml")
