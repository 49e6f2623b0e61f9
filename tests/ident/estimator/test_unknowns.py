"""The vector of unknowns: names, priors, and where everything stands in it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.estimator.build_unknowns import (
    RecordingStart,
    complete_unknowns,
    kinematic_unknowns,
)
from ballbar.ident.estimator.priors import belongs_to_recording, of_robot
from ballbar.ident.estimator.unknowns import MAX_OFFSET_STEP, MAX_SKEW, Unknowns
from ballbar.sim.errors.plant_errors import BaseCompliance
from ballbar.sim.errors.static_errors import AXIS_ANGLES, AXIS_OFFSETS, BallbarAxes
from tests.helpers.six_axes import INDEX, NAMES, SHARED
from tests.helpers.synthetic_recording import CELL, NOMINAL

ENCODERS = (1, 2, 4, 5)
GAUGE = NOMINAL.table.gauge
FIRST = RecordingStart(ENCODERS, NOMINAL, Clock(0.3, 1e-5), knots=3, tension_sigma=12.0)
SECOND = RecordingStart(
    ENCODERS, NOMINAL.replaced({"ox": 0.8, "btheta1": 0.2}), Clock(-1.0, 0.0), clock_steps=2
)
WITHOUT_ENCODERS = RecordingStart((), NOMINAL, None)


def complete(*recordings: RecordingStart, force: bool = False) -> tuple[Unknowns, np.ndarray]:
    corrections = [CORRECTIONS[name](CELL, ENCODERS) for name in ("rod_strain", "gear_backlash")]
    return complete_unknowns(
        CELL, NOMINAL, recordings, corrections, gain_sigma=0.03 if force else None, rod_sigma=None
    )


def indices(*names: str) -> np.ndarray:
    return np.array([INDEX[name] for name in names], dtype=np.intp)


def test_encoder_offsets_and_base_pose_belong_to_a_recording_all_else_to_the_machine() -> None:
    own = [name for name in NAMES if belongs_to_recording(name)]
    assert own == [f"btheta{j}" for j in range(1, 6)] + ["ox", "oy", "oz", "otx", "oty"]
    assert set(SHARED) == set(NAMES) - set(own)


def test_kinematic_unknowns_are_the_parameters_then_the_clock_without_priors() -> None:
    parameters = indices("btheta1", "ox", "ra2", "bd3")
    layout, x = kinematic_unknowns(NOMINAL, Clock(0.2, 1e-6), parameters)
    assert layout.names == ("ra2", "bd3", "btheta1", "ox", "offset", "skew")
    assert np.isinf(layout.sigma).all()
    assert x == pytest.approx([NOMINAL["ra2"], NOMINAL["bd3"], 0.0, 0.70, 0.2, 1e-6])
    assert layout.clock(x, 0) == Clock(0.2, 1e-6)
    assert layout.count == 6
    assert layout.gain is None
    x[0] += 1e-3
    assert layout.geometry(x, 0)["ra2"] == pytest.approx(NOMINAL["ra2"] + 1e-3)
    assert layout.geometry(x, 0)["rd4"] == NOMINAL["rd4"]


def test_a_prior_stays_with_its_parameter_though_the_order_changes() -> None:
    parameters = indices("btheta1", "ra2", "ox", "bd3")
    sigma = np.array([1.0, 2.0, 3.0, 4.0])
    layout, _ = kinematic_unknowns(NOMINAL, None, parameters, sigma)
    assert dict(zip(layout.names, layout.sigma, strict=True)) == {
        "btheta1": 1.0, "ra2": 2.0, "ox": 3.0, "bd3": 4.0,
    }  # fmt: skip


@given(st.lists(st.sampled_from(NAMES), unique=True))
def test_unknowns_stand_in_the_order_of_the_table_in_whichever_they_are_asked_for(
    names: list[str],
) -> None:
    """Poorly excited ones stood behind the others, and no result of a short log was written."""
    layout, x = kinematic_unknowns(NOMINAL, None, indices(*names), np.arange(1.0, 1.0 + len(names)))
    own = {name for name in names if belongs_to_recording(name)}
    expected = [*(n for n in NAMES if n in names and n not in own), *(n for n in NAMES if n in own)]
    assert list(layout.names) == expected
    assert [names[int(sigma) - 1] for sigma in layout.sigma] == expected
    assert x == pytest.approx([NOMINAL[name] for name in expected])
    held = [n for n in SHARED if n not in names]
    more, started = layout.with_shared(indices(*held), x)
    assert more.names[: len(SHARED)] == SHARED
    assert more.names[len(SHARED) :] == tuple(n for n in NAMES if n in own)
    assert np.array_equal(more.geometry(started, 0).values, NOMINAL.values)
    assert all(np.isinf(s) == (n in held) for n, s in zip(more.names, more.sigma, strict=True))


def test_a_ball_bar_without_encoders_has_no_clock_of_its_own() -> None:
    layout, x = kinematic_unknowns(NOMINAL, None, indices("ra2"))
    assert layout.names == ("ra2",)
    assert layout.own[0].clock is None
    assert layout.clock(x, 0) == Clock(0.0, 0.0)
    complete_layout, x = complete(WITHOUT_ENCODERS)
    assert complete_layout.names[-5:] == ("ox", "oy", "oz", "otx", "oty")
    assert complete_layout.clock(x, 0) == Clock(0.0, 0.0)


def test_the_unknowns_of_one_recording_have_plain_names() -> None:
    layout, x = complete(FIRST, force=True)
    free = set(SHARED) - set(GAUGE)
    assert set(layout.names[: len(free)]) == free
    coefficients = ("rod_compliance", "rod_backlash", *(f"backlash{i}" for i in range(1, 7)))
    assert layout.names[layout.coefficients] == coefficients
    assert layout.names[layout.coefficients.stop :] == (
        "force_gain", "btheta1", "btheta2", "btheta4", "btheta5", "ox", "oy", "oz", "otx", "oty",
        "offset", "skew", "tension1", "tension2", "tension3",
    )  # fmt: skip
    assert layout.gain == layout.names.index("force_gain")
    assert len(set(layout.names)) == layout.count == x.size
    assert np.array_equal(layout.machine, np.arange(layout.coefficients.stop))


def test_the_unknowns_of_several_recordings_are_numbered_from_1() -> None:
    layout, x = complete(FIRST, SECOND)
    assert len(set(layout.names)) == layout.count == x.size
    own = layout.names[layout.coefficients.stop :]
    assert "tension3@1" in own
    assert own[-4:] == ("offset@2", "skew@2", "clock_step1@2", "clock_step2@2")
    assert layout.own[0].steps is None
    assert layout.own[1].knots is None
    assert layout.clock(x, 1) == Clock(-1.0, 0.0)
    assert layout.geometry(x, 0)["ox"] == 0.70
    assert layout.geometry(x, 1)["ox"] == 0.80
    assert layout.geometry(x, 1)["btheta1"] == 0.2
    assert layout.geometry(x, 0)["btheta1"] == 0.0
    x[layout.names.index("ra3")] += 1e-3
    assert layout.geometry(x, 0)["ra3"] == layout.geometry(x, 1)["ra3"] != NOMINAL["ra3"]


def test_priors_are_of_physical_size_and_centred_on_the_catalogue() -> None:
    """In figures: a prior twice as wide has a quarter of the weight, and no fit fails for it.

    The ball-bar's axes, which the data hardly show, are believed as far off as the simulator draws
    them; a base of the stiffness that it assumes is within a deviation of the rod's compliance, and
    beyond half of one.
    """
    layout, x = complete(FIRST, SECOND, force=True)
    sigma = dict(zip(layout.names, layout.sigma, strict=True))
    mean = dict(zip(layout.names, layout.mean, strict=True))
    assert np.array_equal(x, layout.mean)
    assert x is not layout.mean
    assert sigma["ra3"] == 7e-4
    assert sigma["ralpha3"] == sigma["rbeta2"] == 2e-3
    axes = BallbarAxes()
    assert {sigma[name] for name in AXIS_OFFSETS} == {axes.sigma_m} == {5e-6}
    assert {sigma[name] for name in AXIS_ANGLES} == {axes.sigma_rad} == {5e-5}
    assert sigma["bd3"] == CELL.ballbar.length_tolerance
    assert sigma["otx@1"] == sigma["oty@2"] == 3e-3
    assert sigma["ox@1"] == sigma["btheta1@2"] == 1.0
    assert (sigma["offset@2"], sigma["skew@2"]) == (1.0, 1e-3)
    assert sigma["clock_step1@2"] == 1.0
    assert sigma["force_gain"] == 0.03
    assert sigma["tension1@1"] == 12.0
    assert sigma["rod_compliance"] == pytest.approx(0.7 / CELL.ballbar.axial_stiffness)
    assert 0.5 < 1.0 / BaseCompliance().stiffness_N_per_m / sigma["rod_compliance"] < 1.0
    assert sigma["rod_backlash"] == 0.5 * CELL.ballbar.backlash
    assert mean["rod_compliance"] == 1.0 / CELL.ballbar.axial_stiffness
    assert mean["ra3"] == NOMINAL["ra3"]
    assert mean["offset@1"] == 0.3
    assert (mean["otx@1"], mean["tension1@1"], mean["force_gain"]) == (0.0, 0.0, 0.0)


def test_a_measured_rod_length_replaces_the_catalogues_tolerance() -> None:
    layout, _ = complete_unknowns(CELL, NOMINAL, [FIRST], (), gain_sigma=None, rod_sigma=2e-6)
    assert layout.sigma[layout.names.index("bd3")] == 2e-6
    assert layout.gain is None


def test_a_step_moves_every_unknown_and_keeps_the_clocks_where_the_splines_say_anything() -> None:
    layout, x = complete(FIRST, SECOND)
    step = np.full(x.size, 1e-4)
    assert np.array_equal(layout.moved(x, step)[:-6], (x + step)[:-6])
    offsets = [i for i, name in enumerate(layout.names) if name.startswith("offset")]
    skews = [i for i, name in enumerate(layout.names) if name.startswith("skew")]
    step[offsets], step[skews] = [100.0, -100.0], [1.0, -1.0]
    moved = layout.moved(x, step)
    assert moved[offsets] == pytest.approx(x[offsets] + [MAX_OFFSET_STEP, -MAX_OFFSET_STEP])
    assert moved[skews] == pytest.approx([MAX_SKEW, -MAX_SKEW])
    others = np.setdiff1d(np.arange(x.size), [*offsets, *skews])
    assert np.array_equal(moved[others], (x + step)[others])


def test_moving_changes_neither_the_vector_nor_the_step() -> None:
    layout, x = complete(FIRST)
    before, step = x.copy(), np.full(x.size, 10.0)
    layout.moved(x, step)
    assert np.array_equal(x, before)
    assert (step == 10.0).all()


def test_gauge_directions_stay_fixed_at_the_catalogue() -> None:
    layout, x = complete(FIRST)
    geometry: Geometry = layout.geometry(x + 1e-3, 0)
    for name in GAUGE:
        assert name not in layout.names
        assert geometry[name] == NOMINAL[name]
    assert layout.sigma[layout.names.index("ra6")] == CELL.plate.length_sigma


def test_tails_are_of_the_robots_own_parameters_and_not_of_the_instruments() -> None:
    """A wrong rod or plate took a wider prior in the fit of one recording, and less was said."""
    table = NOMINAL.table
    own = {table.names[i] for i in np.flatnonzero(of_robot(table, table.parameters))}
    assert {"ra2", "rtheta3"} <= own
    assert not own & {"bd3", "ba5", table.plate}
