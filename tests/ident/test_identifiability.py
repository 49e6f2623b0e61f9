"""What one recording can determine: counts and dependencies of thesis Tables 3.2 and 3.3, and the priority of sec. 3.3."""

from __future__ import annotations

import numpy as np
import pytest
from ident.estimator.problem import Clock, Problem
from ident.estimator.sampling import sample_times

from cell.geometry import NAMES, Geometry
from cell.logs import BallBarLog, RobotLog
from ident.estimator.identifiability import Identifiability, candidates, identifiable
from ident.estimator.noise import noise_from_logs
from ident.identify import WIDEST_KNOT_SPACING
from ident.signals.smooth_log import smooth_log
from tests.helpers.simulated_recordings import Recorded, record


@pytest.fixture(scope="module")
def kinematic(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("kin") / "recording", plant={"kind": "kinematic"})


def judged(
    recorded: Recorded, nominal: Geometry, joints: tuple[int, ...], *, complete: bool
) -> Identifiability:
    motion = recorded.simulation.motion
    robot = smooth_log(motion.t, motion.q, widest_knot_spacing=WIDEST_KNOT_SPACING)
    bar = (
        smooth_log(
            motion.t, motion.b[:, [j - 1 for j in joints]], widest_knot_spacing=WIDEST_KNOT_SPACING
        )
        if joints
        else None
    )
    times = sample_times(robot, bar, Clock(0.0, 0.0), 300)
    noise = noise_from_logs(robot, bar, joints, spacing=1.0, rod=1e-6)
    loud = type(noise)(
        np.full(6, 1e-5), np.where(np.isin(np.arange(1, 6), joints), 1e-5, 0.0), 1e-6
    )
    problem = Problem(robot, bar, joints, np.ones(len(joints)), times, loud)
    return identifiable(
        problem,
        problem.start(nominal, Clock(0.0, 0.0)),
        nominal,
        candidates(joints, complete=complete),
    )


@pytest.mark.parametrize(
    ("joints", "directions"), [((), 26), ((1, 2), 34), ((1, 2, 4, 5), 42), ((1, 2, 3, 4, 5), 43)]
)
def test_the_complete_model_has_the_expected_number_of_directions(
    kinematic: Recorded, nominal: Geometry, joints: tuple[int, ...], directions: int
) -> None:
    found = judged(kinematic, nominal, joints, complete=True)
    assert found.parameters.size == directions


def test_five_encoders_determine_the_29_parameters_of_the_thesis_model_and_the_clock(
    kinematic: Recorded, nominal: Geometry
) -> None:
    found = judged(kinematic, nominal, (1, 2, 3, 4, 5), complete=False)
    assert found.rank == 31
    assert found.condition < 100.0
    assert {d.name for d in found.dropped} == {"rd1", "rd3", "rtheta1"}


def test_dropped_parameters_name_their_partners_of_table_3_2(
    kinematic: Recorded, nominal: Geometry
) -> None:
    dropped = {
        d.name: d for d in judged(kinematic, nominal, (1, 2, 3, 4, 5), complete=True).dropped
    }
    assert dropped["rd1"].on == ("oz",)
    assert dropped["rd3"].on == ("rd2",)
    assert "btheta1" in dropped["rtheta1"].on
    assert "oz" in dropped["bd1"].on
    assert "rd6" in dropped["bd5"].on
    assert "ralpha6" in dropped["balpha5"].on


def test_without_encoders_the_orientation_of_the_tool_has_no_effect(
    kinematic: Recorded, nominal: Geometry
) -> None:
    dropped = {d.name: d.reason for d in judged(kinematic, nominal, (), complete=True).dropped}
    assert dropped["ralpha6"] == "no effect"  # Table 3.3, first row
    assert {
        dropped[name]
        for name in ("balpha1", "balpha2", "balpha3", "balpha4", "bd2", "bd4", "otx", "oty")
    } == {"no effect"}


def test_zeros_and_origin_are_kept_before_robot_parameters() -> None:
    order = [NAMES[i] for i in candidates((1, 2))]
    assert order[:5] == ["btheta1", "btheta2", "ox", "oy", "oz"]
    assert order[-1] == "bd3"
    assert "ra6" not in order


def test_a_robot_that_hardly_moves_an_axis_is_said_to_be_poorly_excited(
    kinematic: Recorded, nominal: Geometry
) -> None:
    motion = kinematic.simulation.motion
    few = slice(2000, 2150)  # a second and a half of the path
    t = motion.t[few] - motion.t[few][0]
    robot = smooth_log(t, motion.q[few], widest_knot_spacing=0.08)
    bar = smooth_log(t, motion.b[few], widest_knot_spacing=0.08)
    joints = (1, 2, 3, 4, 5)
    times = np.linspace(0.3, float(t[-1]) - 0.3, 60)
    noise = noise_from_logs(robot, bar, joints, spacing=1.0, rod=1e-6)
    problem = Problem(
        robot, bar, joints, np.ones(5), times, type(noise)(np.full(6, 1e-5), np.full(5, 1e-5), 1e-6)
    )
    found = identifiable(
        problem, problem.start(nominal, Clock(0.0, 0.0)), nominal, candidates(joints)
    )
    assert any(d.reason == "poorly excited" for d in found.dropped)


def test_logs_refuse_what_is_no_log() -> None:
    with pytest.raises(ValueError, match="do not increase strictly"):
        RobotLog(np.array([0.0, 0.0]), np.zeros((2, 6)))
    with pytest.raises(ValueError, match="do not fit"):
        RobotLog(np.array([0.0, 1.0]), np.zeros((2, 5)))
    with pytest.raises(ValueError, match="not distinct"):
        BallBarLog(np.array([0.0, 1.0]), np.zeros((2, 2)), (2, 1))
