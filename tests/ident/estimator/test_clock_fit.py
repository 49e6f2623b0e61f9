"""Least squares of the clock between two logs, from a start that is a tenth of a second off."""

from __future__ import annotations

import numpy as np
import pytest

from cell.clock import Clock
from ident.estimator.clock_fit import fit_clock
from ident.signals.smooth_log import interpolating_log
from tests.helpers.two_recorders import wandering

NONE = np.zeros(2)


def test_exact_logs_give_the_clock_to_a_nanosecond_and_their_gains() -> None:
    motion, clock = wandering(np.random.default_rng(1)), Clock(3.0, 1e-4)
    t = np.arange(0.0, 60.0, 0.01)
    a = interpolating_log(t, motion(t), NONE)
    b = interpolating_log(t, 2.0 * motion(np.asarray(clock.robot_time(t))) + 1.0, NONE)
    fit = fit_clock(a, b, 3.1)
    assert fit is not None
    assert fit.clock.offset == pytest.approx(3.0, abs=1e-9)
    assert fit.clock.skew == pytest.approx(1e-4, abs=1e-10)
    np.testing.assert_allclose(fit.gain, 0.5, rtol=1e-8)
    np.testing.assert_allclose(fit.zero, -0.5, rtol=1e-8)


def test_no_clock_without_overlap() -> None:
    motion, t = wandering(np.random.default_rng(1)), np.arange(0.0, 20.0, 0.01)
    log = interpolating_log(t, motion(t), NONE)
    assert fit_clock(log, log, 19.0) is None
