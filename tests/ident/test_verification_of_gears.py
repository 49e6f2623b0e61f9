"""A stored machine with ripple of its gears against recordings, on robots of the benchmark."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verify_recordings import OPTIONS, Truth, drawn, identified, recorded
from ident.result import Machine
from ident.verification import RecordingVerification, verify_recording


@pytest.fixture(scope="module")
def stored() -> tuple[Truth, Machine]:
    truth = drawn(914)
    return truth, identified(truth)


def verified(machine: Machine, true: Truth, duration: float, seed: int) -> RecordingVerification:
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
