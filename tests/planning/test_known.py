"""Results before a path: the information of two recordings adds up, priors count once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import nominal_geometry
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.crlb import (
    EXACT,
    PathPrediction,
    Predictor,
    before,
    planned_unknowns,
    predict,
    predictor,
)
from ballbar.planning.known import Known, Stated
from ballbar.planning.request import PlanSensors, PlanTiming
from ballbar.planning.trajectory import trajectories
from ballbar.sim.path_files import load_lissajous
from tests.helpers.simulated_recordings import SCENARIOS

EXCESS = ExcessNoise(1e-5, 2e-5, 1e-5, 1e-6)
SAMPLES = 120


def along(on: Predictor, path: str) -> PathPrediction:
    shape = load_lissajous(SCENARIOS / "paths" / f"irb2400_{path}.yaml")
    candidate = PathCandidate(shape, np.array([0.70, 0.0, 0.54]))
    trajectory = next(iter(trajectories(on.cell, candidate, on.timing)))
    return predict(on, trajectory, np.zeros(trajectory.t.size))


def plain(cell: Cell, known: Known | None = None) -> Predictor:
    on = predictor(cell, PlanSensors(), PlanTiming(), None, samples=SAMPLES, known=known)
    return replace(on, excess=EXCESS, exact_scale=False)


def about_machine(normal: Array, count: int) -> Array:
    """Information about the first unknowns, all others unknown."""
    mixed, own = normal[:count, count:], normal[count:, count:]
    return np.asarray(normal[:count, :count] - mixed @ np.linalg.solve(own, mixed.T))


@pytest.fixture(scope="module")
def first(cell: Cell) -> PathPrediction:
    return along(plain(cell), "a")


def known_by(prediction: PathPrediction, results: int = 1) -> Known:
    count = prediction.layout.machine.size
    covariance = prediction.covariance[:count, :count]
    stated = Stated(prediction.layout.names[:count], covariance)
    return Known(
        results=(stated,) * results,
        corrections={
            c.name: tuple(k.name for k in c.coefficients) for c in prediction.model.corrections
        },
        excess=EXCESS,
    )


def test_a_path_after_a_result_knows_what_both_recordings_do(
    cell: Cell, first: PathPrediction
) -> None:
    count = first.layout.machine.size
    alone, after = along(plain(cell), "b"), along(plain(cell, known_by(first)), "b")
    assert after.layout.names == alone.layout.names
    sum_of_both = (
        about_machine(first.normal, count)
        + about_machine(alone.normal, count)
        - np.diag(first.layout.sigma[:count] ** -2.0)
    )
    expected = np.sqrt(np.diag(np.linalg.inv(sum_of_both)))
    found = np.sqrt(np.diag(np.linalg.inv(about_machine(after.normal, count))))
    assert found == pytest.approx(expected, rel=1e-4)
    assert np.mean(after.tcp_sigma) < 0.95 * np.mean(first.tcp_sigma)


def known_normal(cell: Cell, known: Known, **sensors: float) -> tuple[Array, tuple[str, ...]]:
    on = plain(cell, known)
    on = replace(on, sensors=on.sensors.model_copy(update=sensors))
    layout, _ = planned_unknowns(on, nominal_geometry(cell, np.zeros(3)), ())
    return before(on, layout), layout.names


def test_two_results_hold_their_priors_once(cell: Cell, first: PathPrediction) -> None:
    one, names = known_normal(cell, known_by(first))
    two, _ = known_normal(cell, known_by(first, results=2))
    i = names.index("bd1")  # which no path shows: prior alone
    assert two[i, i] == pytest.approx(one[i, i], rel=1e-3)
    j = names.index("ra2")
    assert two[j, j] > 1.5 * one[j, j]


def test_a_measured_rod_adds_to_what_is_known(cell: Cell, first: PathPrediction) -> None:
    normal, names = known_normal(cell, known_by(first))
    measured, _ = known_normal(cell, known_by(first), rod_sigma_m=5e-6)
    i = names.index("bd3")
    gained = 5e-6**-2.0 - cell.ballbar.length_tolerance**-2.0
    assert measured[i, i] - normal[i, i] == pytest.approx(gained, rel=1e-3)


def test_what_a_result_took_as_exact_stays_exact(cell: Cell, first: PathPrediction) -> None:
    known = known_by(first)
    (stated,) = known.results
    left = [k for k, name in enumerate(stated.names) if name != "ra3"]
    fewer = Stated(tuple(stated.names[k] for k in left), stated.covariance[np.ix_(left, left)])
    normal, names = known_normal(cell, replace(known, results=(fewer,)))
    i = names.index("ra3")
    assert normal[i, i] ** -0.5 < 10.0 * EXACT


def test_results_that_state_less_than_their_priors_leave_a_plan_sound(
    cell: Cell, first: PathPrediction
) -> None:
    """A widened length is known worse than its file says; three such results know it once."""
    known = known_by(first)
    (stated,) = known.results
    covariance = stated.covariance.copy()
    k = stated.names.index("bd3")
    covariance[k, k] += (2.0 * cell.ballbar.length_tolerance) ** 2
    wide = Stated(stated.names, covariance)
    one, names = known_normal(cell, replace(known, results=(wide,)))
    three, _ = known_normal(cell, replace(known, results=(wide,) * 3))
    assert np.linalg.eigvalsh(three / np.sqrt(np.outer(np.diag(one), np.diag(one)))).min() > 0.0
    j = names.index("ra2")
    assert three[j, j] > 1.5 * one[j, j]
