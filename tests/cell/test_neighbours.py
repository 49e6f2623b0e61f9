"""Local cubics: prediction errors, fits against numpy's least squares, damaged bursts."""

import numpy as np
import pytest

from ballbar.cell.neighbours import (
    CUBIC,
    DAMAGED,
    SIDE_ROWS,
    damaged_bursts,
    local_fits,
    powers,
    prediction_errors,
    robust_sigma,
    stretches,
    suspects,
)

PERIOD = 0.01  # [s]
NOISE = 1e-6  # [rad]


def log(rows: int = 400, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """A smooth motion of two channels at irregular times, with noise."""
    rng = np.random.default_rng(seed)
    t = PERIOD * (np.arange(rows) + rng.uniform(-0.2, 0.2, rows))
    motion = np.stack((0.4 * np.sin(1.1 * t), 0.7 * np.cos(0.6 * t)), axis=1)
    return t, motion + rng.normal(0.0, NOISE, motion.shape)


def test_a_cubic_is_predicted_exactly_whatever_the_times() -> None:
    t = log()[0]
    cubics = powers(t, CUBIC).T @ np.array([[1.0, -0.3], [0.5, 2.0], [-1.0, 0.1], [0.2, 0.4]])
    assert prediction_errors(t, cubics).max() < 1e-13


def test_prediction_errors_have_the_noise_of_one_value() -> None:
    t, values = log(20_000)
    assert robust_sigma(prediction_errors(t, values)) == pytest.approx(NOISE, rel=0.05)


def test_a_damaged_value_does_not_change_the_robust_sigma() -> None:
    errors = np.random.default_rng(1).normal(0.0, 1.0, (5000, 1))
    errors[::100] = 1e6
    assert robust_sigma(errors) == pytest.approx(1.0, rel=0.05)


def test_local_fits_agree_with_least_squares_of_numpy() -> None:
    rng = np.random.default_rng(7)
    columns, values = rng.normal(0.0, 1.0, (3, 5, 12)), rng.normal(0.0, 1.0, (5, 12))
    known = rng.uniform(size=(5, 12)) < 0.7
    fits = local_fits(columns, known)
    residual = fits.residual(values)
    for k in range(5):
        basis = columns[:, k].T
        coefficients, squares, _, _ = np.linalg.lstsq(basis[known[k]], values[k][known[k]])
        assert fits.coefficients(values)[k] == pytest.approx(coefficients, abs=1e-12)
        assert residual[k] == pytest.approx(values[k] - basis @ coefficients, abs=1e-12)
        spread = np.sqrt(squares[0] / (known[k].sum() - 3))
        assert fits.spread(residual)[k] == pytest.approx(spread, rel=1e-10)
        inverse = np.linalg.inv(basis[known[k]].T @ basis[known[k]])
        leverage = np.einsum("ri,ij,rj->r", basis, inverse, basis)
        assert fits.deviation(np.ones(5))[k] == pytest.approx(np.sqrt(1.0 + leverage), rel=1e-10)
        assert 1.0 / fits.triangle[k, -1, -1] ** 2 == pytest.approx(inverse[-1, -1], rel=1e-10)
    assert fits.full.all()


def test_rows_that_do_not_determine_a_cubic_are_reported() -> None:
    x = np.linspace(-1.0, 1.0, 9)
    known = np.array([[True] * 9, [True] * 3 + [False] * 6])
    fits = local_fits(np.broadcast_to(powers(x, CUBIC)[:, None], (CUBIC, 2, 9)), known)
    assert fits.full.tolist() == [True, False]
    assert np.isfinite(fits.residual(np.ones((2, 9)))).all()


@pytest.mark.parametrize("rows", [(200,), (200, 201, 202), (200, 202, 204), (200, 201, 203, 206)])
def test_a_burst_of_damaged_values_is_found_and_nothing_else(rows: tuple[int, ...]) -> None:
    t, values = log()
    values[rows, 0] += 3e-3 * np.array([1.0, -0.7, 2.0, -1.5])[: len(rows)]
    assert np.argwhere(damaged_bursts(t, values)).tolist() == [[row, 0] for row in rows]


def test_a_burst_shows_at_its_edges_and_its_inside_is_suspect_too() -> None:
    t, values = log()
    values[200:209, 1] += 3e-3  # equal, so that those in the middle agree with one another
    mask = suspects(t, values, sigmas=DAMAGED)[0]
    assert mask[200:209, 1].all()
    assert not mask[:, 0].any()


def test_a_step_is_no_burst() -> None:
    t, values = log()
    values[200:, 0] += 2e-3
    assert not damaged_bursts(t, values).any()


def test_the_first_row_of_a_log_is_beside_a_stretch_near_the_start() -> None:
    t, suspect = log()[0], np.zeros(400, dtype=bool)
    suspect[2:4] = True
    only = stretches(t, suspect, PERIOD)
    assert sorted(only.beside[0][only.known[0]].tolist()) == [0, 1, *range(4, 4 + SIDE_ROWS)]
