"""One recording determines the counts and dependencies of thesis Tables 3.2 and 3.3, sec. 3.3."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.build_unknowns import kinematic_unknowns
from ballbar.ident.estimator.identifiability import Identifiability, candidates, identifiable
from ballbar.ident.estimator.model import Model, joints_as_logged
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples
from ballbar.sim.errors.static_errors import THESIS_3_1
from tests.helpers.six_axes import INDEX, NAMES, TABLE
from tests.helpers.synthetic_recording import NO_CLOCK_ERROR, NOMINAL, exact_log, minute, recording

FIVE = (1, 2, 3, 4, 5)
TRUE = NOMINAL.replaced({name: NOMINAL[name] + e * 1e-3 for name, e in THESIS_3_1.items()})


def judged_by(
    samples: Samples, *, complete: bool, geometry: Geometry = NOMINAL, extra: tuple[int, ...] = ()
) -> Identifiability:
    clock = NO_CLOCK_ERROR if samples.has_clock else None
    layout, x = kinematic_unknowns(geometry, clock, np.zeros(0, dtype=np.intp))
    model = Model(joints_as_logged(6), None, (), layout, (samples,))
    point = model.evaluate(x, 0, samples.ballbar_angles(geometry, NO_CLOCK_ERROR))
    requested = np.array([*candidates(TABLE, samples.encoders, complete=complete), *extra])
    return identifiable(point, ExcessNoise(rod=1e-6), NOMINAL, requested)


@lru_cache
def judged(encoders: tuple[int, ...], *, complete: bool) -> Identifiability:
    """The minute of a robot with the errors of thesis Table 3.1."""
    return judged_by(recording(encoders=encoders, true=TRUE, noise=1e-5), complete=complete)


@pytest.mark.parametrize(
    ("encoders", "directions"), [((), 26), ((1, 2), 34), ((1, 2, 4, 5), 42), (FIVE, 43)]
)
def test_the_complete_model_has_the_expected_number_of_directions(
    encoders: tuple[int, ...], directions: int
) -> None:
    assert judged(encoders, complete=True).parameters.size == directions


def test_five_encoders_determine_the_29_parameters_of_the_thesis_model_and_the_clock() -> None:
    found = judged(FIVE, complete=False)
    assert found.rank == 31
    assert found.condition < 100.0
    assert {d.name for d in found.dropped} == {"rd1", "rd3", "rtheta1"}


def test_dropped_parameters_name_their_partners_of_table_3_2() -> None:
    dropped = {d.name: d for d in judged(FIVE, complete=True).dropped}
    assert dropped["rd1"].on == ("oz",)
    assert dropped["rd3"].on == ("rd2",)
    assert "btheta1" in dropped["rtheta1"].on
    assert "oz" in dropped["bd1"].on
    assert "rd6" in dropped["bd5"].on
    assert "ralpha6" in dropped["balpha5"].on


def test_without_encoders_the_orientation_of_the_tool_has_no_effect() -> None:
    dropped = {d.name: d.reason for d in judged((), complete=True).dropped}
    assert dropped["ralpha6"] == "no effect"  # Table 3.3, first row
    assert {
        dropped[name]
        for name in ("balpha1", "balpha2", "balpha3", "balpha4", "bd2", "bd4", "otx", "oty")
    } == {"no effect"}


def test_offsets_and_base_position_are_kept_before_robot_parameters() -> None:
    order = [NAMES[i] for i in candidates(TABLE, (1, 2))]
    assert order[:5] == ["btheta1", "btheta2", "ox", "oy", "oz"]
    assert order[-1] == "bd3"
    assert "ra6" not in order


def test_the_complete_candidates_are_the_rest_of_the_ball_bar_its_tilt_and_hayati_angles() -> None:
    extra = set(candidates(TABLE, FIVE, complete=True)) - set(candidates(TABLE, FIVE))
    names = {NAMES[i] for i in extra}
    assert {"rbeta2", "rbeta6", "otx", "oty", "ba1", "bd5", "balpha2"} < names
    assert not names & {"bd3", "ra6", "btheta1"}


def test_dependencies_are_judged_on_the_nominal_mechanism() -> None:
    """A robot off by a milliradian separates rd2 from rd3 by a thousandth: that is no knowledge."""
    samples = recording(encoders=FIVE, true=TRUE, noise=1e-5)
    found = judged_by(samples, complete=False, geometry=TRUE)
    assert {d.name for d in found.dropped} == {"rd1", "rd3", "rtheta1"}


def test_the_plate_is_the_scale_of_all_lengths() -> None:
    """Requested after all others it depends on them; the partners begin with the longest."""
    samples = recording(encoders=FIVE, true=TRUE, noise=1e-5)
    found = judged_by(samples, complete=False, extra=(INDEX["ra6"],))
    (plate,) = [d for d in found.dropped if d.name == "ra6"]
    assert plate.reason == "depends on"
    assert {"ra2", "rd4", "bd3", "ox"} < set(plate.on)


def test_a_robot_that_hardly_moves_an_axis_is_said_to_be_poorly_excited() -> None:
    """A second and a half of the path."""
    path = minute(0.01)
    few = slice(2000, 2151)
    robot = exact_log(path.t[few], path.q[few], 1e-5)
    bar = exact_log(path.t[few], path.b[few], 1e-5)
    times = np.linspace(path.t[2000] + 0.3, path.t[2150] - 0.3, 60)
    samples = replace(
        recording(encoders=FIVE),
        robot=robot,
        ballbar=bar,
        times=times,
        joint_noise=np.full(6, 1e-5),
        encoder_noise=np.full(5, 1e-5),
    )
    found = judged_by(samples, complete=False)
    assert any(d.reason == "poorly excited" for d in found.dropped)


def test_poses_that_the_nominal_robot_cannot_take_are_passed_over() -> None:
    """The ball-bar is believed to stand so far out that part of the path is out of reach."""
    samples = recording(encoders=FIVE, noise=1e-5).thinned(6)
    away = NOMINAL.replaced({"ox": NOMINAL["ox"] + 0.55})
    found = judged_by(samples, complete=False, geometry=away)
    assert 25 < found.parameters.size <= 29
