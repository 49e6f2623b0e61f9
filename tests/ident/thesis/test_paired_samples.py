"""The whitened fit over samples that are already paired, its clock included."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.sample_times import MARGIN
from ballbar.ident.thesis.paired_samples import NOISE_FLOOR, fit_samples, noise_of, through_samples
from ballbar.sim.path import ReferencePath
from tests.helpers.six_axes import NAMES
from tests.helpers.synthetic_recording import NOMINAL, closed, exact_log

NOISE = 1e-5


@pytest.mark.parametrize("encoders", [(1, 2), (1, 2, 3, 4, 5)])
def test_parameters_and_a_late_clock_are_found_within_their_stated_noise(
    path: ReferencePath, true: Geometry, encoders: tuple[int, ...]
) -> None:
    """The ball-bar's angles belong to instants 20 ms earlier than the robot's."""
    rng, rows = np.random.default_rng(81), slice(0, None, 10)
    t = path.t[rows]
    q = closed(true, path.b[rows], path.q[rows]) + rng.normal(0.0, NOISE, (t.size, 6))
    b = exact_log(path.t, path.b).spline(t - 0.02) + rng.normal(0.0, NOISE, (t.size, 5))
    done = fit_samples(t, q, b, encoders, NOMINAL)
    assert done.fit.converged
    assert done.iterations >= done.fit.iterations
    assert done.fit.chi2_per_dof == pytest.approx(1.0, abs=0.25)  # noise is known to 5 %
    assert done.fit.clock().offset == pytest.approx(-0.02, abs=1e-4)
    assert len(done.parameters) == {2: 25, 5: 29}[len(encoders)]
    names = [NAMES[i] for i in done.parameters]
    at = [done.fit.model.unknowns.names.index(name) for name in names]
    off = np.array([done.fit.geometry()[name] - true[name] for name in names])
    normalised = off @ np.linalg.solve(done.fit.covariance[np.ix_(at, at)], off)
    # chi-square of that many degrees, three deviations; the noise itself is known to 5 %
    assert abs(normalised - len(at)) < 3.0 * np.sqrt(2.0 * len(at)) + 0.1 * len(at)


def test_only_requested_parameters_are_fitted(path: ReferencePath, true: Geometry) -> None:
    rows, some = slice(0, None, 20), np.array([NAMES.index(n) for n in ("ra2", "ox", "btheta1")])
    t, b = path.t[rows], path.b[rows]
    done = fit_samples(t, closed(true, b, path.q[rows]), b, (1, 2), true, some)
    assert sorted(done.parameters) == sorted(some)


def test_the_noise_of_a_channel_is_seen_through_its_motion() -> None:
    """Sixth differences of a motion of seconds at 0.05 s leave nothing; of white noise all."""
    t = np.arange(0.0, 60.0, 0.05)
    motion = np.stack((np.sin(1.3 * t), 2.0 * np.cos(0.7 * t)), axis=1)
    sigma = np.array([1e-5, 4e-5])
    noisy = motion + sigma * np.random.default_rng(82).standard_normal(motion.shape)
    # the median of 1200 absolute values that share noise: 5 %
    assert noise_of(noisy) == pytest.approx(sigma, rel=0.15)
    assert noise_of(np.zeros((20, 3))) == pytest.approx(np.full(3, NOISE_FLOOR))


def test_a_spline_passes_through_the_samples() -> None:
    t = np.arange(0.0, 2.0, 0.05)
    log = through_samples(t, np.column_stack((np.sin(t), np.cos(t))))
    assert log.spline(t) == pytest.approx(np.column_stack((np.sin(t), np.cos(t))), abs=1e-14)
    assert (log.start, log.end) == (t[0], t[-1])


def test_too_few_samples_are_refused_with_the_number_that_is_needed() -> None:
    with pytest.raises(ValueError, match="12 samples are too few; at least 13 are needed"):
        through_samples(np.arange(12.0), np.zeros((12, 2)))


def test_samples_that_the_moving_clock_could_lose_do_not_count(
    path: ReferencePath, true: Geometry
) -> None:
    """Whatever the time of the first one is."""
    rows, some = slice(0, None, 20), np.array([NAMES.index(n) for n in ("ox", "oy", "oz")])
    t, b = path.t[rows] + 10.0, path.b[rows]
    times = (
        fit_samples(t, closed(true, b, path.q[rows]), b, (1, 2), true, some)
        .fit.model.recordings[0]
        .times
    )
    assert times[0] == pytest.approx(t[0] + MARGIN, abs=0.21)
    assert t[0] + MARGIN <= times[0]
    assert times[-1] <= t[-1] - MARGIN
