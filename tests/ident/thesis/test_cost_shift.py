"""The clock by least cost, as the thesis aligned it: identify and shift in turns."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.ident.thesis.cost_fit import identifiable_by
from ballbar.ident.thesis.cost_shift import (
    REACH,
    best_shift,
    fit_cost_with_shift,
    with_matched_offsets,
)
from ballbar.ident.thesis.costs import cost_named
from ballbar.ident.thesis.names import CostName
from ballbar.ident.thesis.paired_samples import through_samples
from ballbar.sim.path import ReferencePath
from tests.helpers.synthetic_recording import closed, exact_log

LATE = 0.03  # [s] by which the ball-bar's log is taken too late
COST: CostName = "transform"


@pytest.fixture(scope="module")
def shifted(path: ReferencePath, true: Geometry) -> dict[str, Array]:
    """t, q, b of rows 0.05 s apart, the ball-bar's of LATE before the robot's."""
    rows = slice(0, None, 5)
    t = path.t[rows]
    b = np.asarray(exact_log(path.t, path.b).spline(t - LATE))
    return {"t": t, "q": closed(true, path.b[rows], path.q[rows]), "b": b}


def test_at_the_true_geometry_the_least_cost_lies_at_the_true_shift(
    shifted: dict[str, Array], true: Geometry
) -> None:
    t, q, b = shifted.values()
    inside = (t > REACH) & (t < t[-1] - REACH)
    found = best_shift(
        cost_named(COST, "vector"), true, t[inside], q[inside], through_samples(t, b).spline
    )
    # A spline through rows 0.05 s apart leaves 1e-7 rad, and the motion passes 0.5 rad/s.
    assert found == pytest.approx(LATE, abs=1e-6)


def test_identifying_and_shifting_in_turns_approaches_the_clock_by_a_constant_factor(
    path: ReferencePath, shifted: dict[str, Array], nominal: Geometry, true: Geometry
) -> None:
    chosen = identifiable_by(COST, nominal, path.q[::50], path.b[::50])
    left = []
    for rounds in (1, 2, 3):
        done = fit_cost_with_shift(
            cost_named(COST, "vector"), nominal, **shifted, parameters=chosen, rounds=rounds
        )
        left.append(abs(done.shift - LATE))
    ratios = np.array(left[1:]) / left[:-1]
    assert (ratios < 1.0).all()
    assert ratios[1] == pytest.approx(ratios[0], rel=0.1)
    errors = np.abs((done.fit.geometry.values - true.values)[chosen])
    assert errors.max() < 1e-2 * LATE  # what is left of the clock, times the speed


def test_at_the_nominal_robot_the_log_is_moved_once_and_stays_off(
    path: ReferencePath, shifted: dict[str, Array], nominal: Geometry
) -> None:
    """The thesis's procedure: errors of the nominal robot move the minimum, repeating does not."""
    chosen = identifiable_by(COST, nominal, path.q[::50], path.b[::50])
    runs = [
        fit_cost_with_shift(
            cost_named(COST, "vector"),
            nominal,
            **shifted,
            parameters=chosen,
            rounds=rounds,
            at="nominal",
        )
        for rounds in (1, 4)
    ]
    assert runs[0].last_move == runs[0].shift
    assert abs(runs[1].last_move) < 1e-6
    assert 1e-5 < abs(runs[1].shift - LATE) < 0.2 * LATE


def test_matched_offsets_are_those_of_a_robot_that_is_nominal(
    path: ReferencePath, nominal: Geometry
) -> None:
    offsets = {"btheta1": 0.3, "btheta2": -0.2, "btheta3": 0.1, "btheta4": 0.02, "btheta5": 3.0}
    off = nominal.replaced({name: nominal[name] + x for name, x in offsets.items()})
    rows = slice(None, None, 50)
    b = path.b[rows] - list(offsets.values())
    matched = with_matched_offsets(nominal, path.q[rows], b, cost_named(COST, "vector"))
    assert np.abs(np.sin(matched.values - off.values)).max() < 1e-9
    some = with_matched_offsets(nominal, path.q[rows], b, cost_named("position", "vector"))
    assert some["btheta5"] == nominal["btheta5"]


def test_without_rounds_it_is_a_plain_fit(
    path: ReferencePath, shifted: dict[str, Array], nominal: Geometry
) -> None:
    chosen = identifiable_by(COST, nominal, path.q[::50], path.b[::50])
    done = fit_cost_with_shift(
        cost_named(COST, "vector"), nominal, **shifted, parameters=chosen, rounds=0
    )
    assert (done.shift, done.last_move) == (0.0, 0.0)
    assert done.fit.converged
