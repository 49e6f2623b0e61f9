"""A fit in blocks of time, against its linearisation fitted again without each fold."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident.complete_fit import FIRST_EXCESS, fit_pose, posed
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.time_blocks import FOLDS, time_blocks
from ballbar.ident.joint_errors import linearised
from ballbar.ident.model_choice import coefficients_of
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import fit_recording
from tests.helpers.minute_logs import minute_logs
from tests.helpers.synthetic_recording import CELL, UNIVERSAL_AND_GIMBAL

OPTIONS = FitOptions(model="complete", samples=300)
NOTHING = np.empty(0, dtype=np.intp)


@pytest.fixture(scope="module")
def elastic() -> Fit:
    """Two recordings of gears softer than the catalogue's, with knots of the tension."""
    logs = [minute_logs(compliance=1.5, seed=seed) for seed in range(2)]
    recordings = [fit_recording(CELL, each, OPTIONS) for each in logs]
    chosen = [CORRECTIONS["joint_compliance"](CELL, UNIVERSAL_AND_GIMBAL)]
    return fit_pose(posed(CELL, recordings, chosen, OPTIONS), FIRST_EXCESS)


def test_blocks_add_up_to_the_fit(elastic: Fit) -> None:
    blocks = time_blocks(elastic)
    weight = elastic.model.unknowns.sigma**-2.0
    slope = weight * (elastic.x - elastic.model.unknowns.mean)
    linear = elastic.linear
    scale = np.sqrt(np.outer(np.diag(linear.normal), np.diag(linear.normal)))
    assert np.abs(blocks.whole.normal + np.diag(weight) - linear.normal).max() < 1e-9 * (
        scale.max()
    )
    assert blocks.whole.gradient + slope == pytest.approx(
        linear.gradient, abs=1e-6 * np.sqrt(scale.max())
    )
    assert blocks.whole.cost == pytest.approx(linear.data_cost)
    assert (np.diff(blocks.recording) >= 0).all()
    assert (np.bincount(blocks.recording) == 10).all()  # of 60 s


def test_held_out_cost_is_that_of_fits_without_the_blocks(elastic: Fit) -> None:
    compliance = coefficients_of(elastic, elastic.model.corrections[0])
    for absent in (NOTHING, np.r_[compliance]):
        expected = _refitted(elastic, absent)
        assert time_blocks(elastic).held_out_cost(absent) == pytest.approx(expected, rel=1e-6)


def test_what_the_machine_has_lowers_the_held_out_cost(elastic: Fit) -> None:
    blocks = time_blocks(elastic)
    compliance = np.r_[coefficients_of(elastic, elastic.model.corrections[0])]
    assert blocks.held_out_cost(compliance) > 2.0 * blocks.held_out_cost(NOTHING)


def _refitted(fit: Fit, absent: np.ndarray) -> float:
    """The same by dense least squares, sample by sample."""
    model, layout = linearised(fit), fit.model.unknowns
    count = layout.count
    jacobian, residual = model.columns, model.residual
    knots = np.concatenate([np.r_[own.knots] for own in layout.own if own.knots is not None])
    number = np.concatenate([_fold(r.times) for r in fit.model.recordings])
    total = 0.0
    for fold in range(FOLDS):
        rest, left = number != fold, number == fold
        step = np.zeros(count)
        step[absent] = (layout.mean - fit.x)[absent]
        free = np.setdiff1d(np.arange(count), absent)
        step = _solved(fit, jacobian[..., rest], residual[..., rest], step, free)
        step = _solved(fit, jacobian[..., left], residual[..., left], step, knots)
        error = residual[..., left] + np.einsum("pen,p->en", jacobian[..., left], step)
        prior = ((fit.x + step - layout.mean) / layout.sigma) ** 2
        at_fit = ((fit.x - layout.mean) / layout.sigma) ** 2
        total += float((error**2).sum() + (prior - at_fit)[knots].sum())
    return total


def _fold(times: Array) -> Array:
    edges = np.flatnonzero(np.diff(np.floor((times - times[0]) / 6.0), prepend=0.0) > 0)
    return np.asarray(np.searchsorted(edges, np.arange(times.size), side="right") % FOLDS)


def _solved(fit: Fit, jacobian: Array, residual: Array, step: Array, free: np.ndarray) -> Array:
    layout, out = fit.model.unknowns, step.copy()
    out[free] = 0.0
    begin = residual + np.einsum("pen,p->en", jacobian, out)
    columns = np.concatenate(
        [jacobian[free].reshape(free.size, -1).T, np.diag(1.0 / layout.sigma[free])]
    )
    rows = np.concatenate([begin.ravel(), ((fit.x - layout.mean) / layout.sigma)[free]])
    out[free] = -np.linalg.lstsq(columns, rows, rcond=None)[0]
    return out
