"""Least squares of the clock between two logs, from a start that is a tenth of a second off."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.estimator.clock_fit import ClockFit, Side, fit_clock
from ballbar.ident.estimator.sample_times import MARGIN
from tests.helpers.log_sides import side_of
from tests.helpers.two_recorders import wandering

Log = tuple[Array, Array]


def fitted(t: Array, clock: Clock, start: float, *, zero: float = 0.0) -> ClockFit | None:
    """Two exact logs of a motion at t (N,) [s], channels of B twice those of A and 1 more.

    zero : [s] that B's clock shows at its first row.
    """
    motion = wandering(np.random.default_rng(1))
    seen = 2.0 * motion(np.asarray(clock.robot_time(t))) + 1.0
    return fit_clock(single_channels((t, motion(t)), (t + zero, seen)), start)


def single_channels(a: Log, b: Log) -> list[tuple[Side, Side]]:
    """Each channel of A with that of the same place in B; a log : times (N,) [s], values (N, C)."""
    return [
        (side_of(a[0], a[1][:, [k]]), side_of(b[0], b[1][:, [k]])) for k in range(a[1].shape[1])
    ]


MINUTE = np.arange(0.0, 60.0, 0.01)


@pytest.mark.parametrize(
    ("clock", "start"), [(Clock(3.0, 1e-4), 3.1), (Clock(0.0, 0.0), 0.5)], ids=["near", "half a s"]
)
def test_exact_logs_give_the_clock_to_a_nanosecond_and_their_gains(
    clock: Clock, start: float
) -> None:
    fit = fitted(MINUTE, clock, start)
    assert fit is not None
    assert fit.clock.offset == pytest.approx(clock.offset, abs=1e-9)
    assert fit.clock.skew == pytest.approx(clock.skew, abs=1e-10)
    assert len(fit.groups) == 2
    for group in fit.groups:
        assert group.map.gain == pytest.approx(0.5, rel=1e-8)
        np.testing.assert_allclose(group.map.zero, -0.5, rtol=1e-8)


def test_no_clock_without_overlap() -> None:
    assert fitted(np.arange(0.0, 20.0, 0.01), Clock(0.0, 0.0), 19.0) is None


@pytest.mark.parametrize("zero", [-30.0, -MARGIN - 0.01, -MARGIN, 5000.0])
def test_the_zero_of_a_clock_does_not_matter(zero: float) -> None:
    """Also where the first instant that is compared is that of zero, or hardly before it."""
    fit = fitted(MINUTE, Clock(0.1, 0.0), -zero, zero=zero)
    assert fit is not None
    assert fit.clock.offset + (1.0 + fit.clock.skew) * zero == pytest.approx(0.1, abs=1e-9)


def test_a_skew_that_shifts_the_ends_by_a_second_is_followed_from_the_middle() -> None:
    """Periods of the motion are 0.6 s and more: at the ends the start is more than one off."""
    motion, clock = wandering(np.random.default_rng(2)), Clock(0.0, 2e-3)
    t = np.arange(500.0, 1500.0, 0.05)
    seen = motion(3.0 * np.asarray(clock.robot_time(t)))
    fit = fit_clock(single_channels((t, motion(3.0 * t)), (t, seen)), 2.0)
    assert fit is not None
    assert fit.clock.skew == pytest.approx(2e-3, abs=1e-8)


def test_a_channel_that_stands_still_is_no_evidence() -> None:
    motion, t = wandering(np.random.default_rng(1)), np.arange(0.0, 20.0, 0.01)
    still = motion(t) * [1.0, 0.0] + [0.0, 0.25]
    fits = [fit_clock(single_channels((t, log), (t, log)), 0.0) for log in (still[:, :1], still)]
    assert fits[0] is not None
    assert fits[1] is not None
    assert fits[1].evidence == pytest.approx(fits[0].evidence, rel=1e-9)
