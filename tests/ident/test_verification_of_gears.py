"""A stored machine with ripple of its gears against recordings, on drawn machines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.result import Machine
from ident.verification import Verification
from ident.verify_recording import verify_recording
from tests.helpers.drawn_machines import OPTIONS, Truth, drawn, identified, recorded


@pytest.fixture(scope="module")
def stored() -> tuple[Truth, Machine]:
    truth = drawn(914)
    return truth, identified(truth)


def verified(machine: Machine, true: Truth, duration: float, seed: int) -> Verification:
    logs = recorded(true, "b", duration, np.random.default_rng([77, seed]))
    return verify_recording(machine, logs, options=OPTIONS)


@pytest.mark.slow
@pytest.mark.parametrize("duration", [20.0, 30.0, 50.0])
def test_ripple_faster_than_the_rows_is_no_exchanged_gear(
    stored: tuple[Truth, Machine], duration: float
) -> None:
    """In rows of 10 ms the smoothing loses ripple that passes at 50 Hz.

    Its amplitude came out too small, and gear 6 was named with a log Bayes factor of 9 to 77.
    """
    truth, machine = stored
    outcome = verified(machine, truth, duration, 914)
    assert outcome.holds, outcome.sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size", "kind"),
    [("bd4", 2e-4, "ball-bar"), ("ra2", 5.8e-5, "geometry"), ("ra5", -6.5e-5, "geometry")],
)
def test_another_length_is_not_taken_for_a_gear(
    stored: tuple[Truth, Machine], name: str, size: float, kind: str
) -> None:
    """The dozen coefficients of gear 1, 2 or 5 took up these, and the gear was named."""
    truth, machine = stored
    geometry = truth.geometry
    now = replace(truth, geometry=geometry.replaced({name: geometry[name] + size}))
    (named,) = verified(machine, now, 60.0, 1).named
    assert named.cause.kind == kind
    assert name in named.cause.names
    if kind == "geometry":
        assert named.size[0] == pytest.approx(size, abs=4.0 * named.sigma[0])
        assert named.sentence.startswith(f"parameter {name} by ")
