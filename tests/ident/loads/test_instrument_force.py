"""The force along a telescoping rod or a wire."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ident.loads.instrument_force import SLIDING, instrument_forces


def test_the_force_has_a_constant_a_spring_and_a_friction_of_one_newton_each() -> None:
    extension = np.array([-1e-3, 0.0, 1e-3])
    samples = SimpleNamespace(extension=extension, extension_rate=np.array([-1.0, 0.0, SLIDING]))
    constant, spring, friction = instrument_forces(samples, (0.299, 0.301)).toarray()  # type: ignore[arg-type]
    np.testing.assert_array_equal(constant, 1.0)
    np.testing.assert_allclose(spring, [-1.0, 0.0, 1.0])
    np.testing.assert_allclose(friction, [-1.0, 0.0, np.sqrt(0.5)])
