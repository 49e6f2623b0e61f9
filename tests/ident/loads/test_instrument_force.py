"""Force along rod or wire: constant, spring, friction."""

from __future__ import annotations

import numpy as np
import pytest

from ident.estimator.samples import samples_of
from ident.loads.instrument_force import instrument_forces
from ident.signals.smooth_log import interpolating_log


def test_the_spring_follows_the_extension_and_friction_the_sign_of_its_rate() -> None:
    t = np.arange(0.0, 20.0, 0.05)
    still = interpolating_log(t, np.zeros((t.size, 6)), np.zeros(6))
    extension = interpolating_log(t, 2e-3 * np.sin(t)[:, None], np.zeros(1))
    at = np.linspace(1.0, 19.0, 200)
    samples = samples_of(still, extension, (), (), at)
    constant, spring, friction = instrument_forces(samples, (0.995, 1.005)).toarray()
    assert (constant == 1.0).all()
    assert spring == pytest.approx(0.4 * np.sin(at), abs=1e-6)  # 1 N at the end of the stroke
    fast = np.abs(np.cos(at)) > 0.1
    assert friction[fast] == pytest.approx(np.sign(np.cos(at))[fast], abs=0.02)
