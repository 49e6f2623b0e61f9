"""Smoothing attenuates gear harmonics."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.splines import smoothing_spline
from ballbar.ident.estimator.smoothed_harmonics import spline_response


@pytest.mark.parametrize("share", [0.2, 0.45, 0.5, 0.55, 0.7, 3.3])
def test_the_share_that_smoothing_keeps_is_that_of_a_spline_of_many_rows(share: float) -> None:
    """Fitted to sine waves of eight phases, away from the ends, where a spline has more freedom."""
    spacing, t = 0.08, np.arange(0.0, 16.0, 1e-3)
    frequency = share / spacing
    phases = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    waves = np.sin(2.0 * np.pi * frequency * t[:, None] + phases)
    spline = smoothing_spline(t, waves, np.arange(spacing, 16.0 - spacing / 2.0, spacing))
    inner = waves[2000:-2000]
    response = (spline(t[2000:-2000]) * inner).sum() / (inner * inner).sum()
    assert spline_response(np.array([frequency, -frequency]), spacing) == pytest.approx(
        response, abs=0.01
    )


def test_a_harmonic_that_stands_still_is_kept_whole() -> None:
    assert spline_response(np.zeros((2, 3)), 0.08) == pytest.approx(np.ones((2, 3)))
