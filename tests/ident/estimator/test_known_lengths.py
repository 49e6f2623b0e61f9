"""Known lengths that share the scale: how far they contradict each other, by Bayes on a sum."""

from __future__ import annotations

import numpy as np
import pytest

from cell.arrays import Array
from ident.estimator.build_unknowns import complete_unknowns
from ident.estimator.known_lengths import KNOWN, KnownLengths, known_lengths
from ident.estimator.unknowns import Unknowns
from tests.helpers.synthetic_recording import CELL, NOMINAL

ROD = 5e-6  # [m]


def layout() -> Unknowns:
    out, _ = complete_unknowns(CELL, NOMINAL, [], (), measured_force=False, rod_sigma=ROD)
    return out


def posterior(unknowns: Unknowns, error: float) -> tuple[Array, Array]:
    """Estimate and covariance after a measurement of ra6 + bd3 that is off by `error` [m]."""
    row = np.array([float(name in ("ra6", "bd3")) for name in unknowns.names])
    normal = np.diag(unknowns.sigma**-2.0) + np.outer(row, row) / 1e-7**2
    covariance = np.linalg.inv(normal)
    return unknowns.mean + covariance @ row * error / 1e-7**2, covariance


def judged(error: float, noise: float = 1.0) -> tuple[Unknowns, KnownLengths]:
    """noise : of the measurement over what its weight says, as the blocks of time show it."""
    unknowns = layout()
    x, covariance = posterior(unknowns, error)
    data = covariance - covariance @ (covariance / unknowns.sigma[:, None] ** 2)
    return unknowns, known_lengths(unknowns, x, covariance, (noise**2 - 1.0) * data)


def test_noise_that_is_worse_than_white_contradicts_no_length() -> None:
    """The estimate is then off by what the data are off, of which the prior knows nothing."""
    unknowns, lengths = judged(30e-6, noise=200.0)
    plate = unknowns.sigma[unknowns.names.index("ra6")]
    expected = np.sqrt(plate**2 + ROD**2 + 200.0**2 * 1e-7**2)
    assert lengths.apart == pytest.approx(30e-6 / expected, rel=0.01)


def test_a_contradiction_is_in_standard_deviations_of_the_sum() -> None:
    unknowns, lengths = judged(30e-6)
    plate = unknowns.sigma[unknowns.names.index("ra6")]
    assert {"ra6", "bd3"} <= {unknowns.names[i] for i in lengths.unknowns}
    assert lengths.apart == pytest.approx(30e-6 / np.hypot(plate, ROD), rel=0.01)
    assert lengths.widening == lengths.apart
    assert lengths.off == pytest.approx(30e-6, rel=0.01)  # together, whichever of them is wrong


def test_lengths_that_agree_are_not_made_surer() -> None:
    assert judged(0.0)[1].apart == pytest.approx(0.0, abs=1e-6)
    assert judged(1e-6)[1].widening == 1.0


def test_what_the_data_tell_alone_contradicts_nothing() -> None:
    """A length that the data determine by itself may be anywhere in its prior."""
    unknowns = layout()
    index = unknowns.names.index("bd3")
    normal = np.diag(unknowns.sigma**-2.0)
    normal[index, index] += 1e-7**-2.0
    covariance = np.linalg.inv(normal)
    x = unknowns.mean.copy()
    x[index] += 4.0 * ROD
    lengths = known_lengths(unknowns, x, covariance, np.zeros_like(covariance))
    assert index not in lengths.unknowns
    assert lengths.apart == 0.0


def test_a_length_that_is_only_roughly_known_contradicts_nothing() -> None:
    """The nominal lengths of the links are priors too, of a millimetre."""
    unknowns = layout()
    x = unknowns.mean + np.where(unknowns.sigma > KNOWN, 0.5 * unknowns.sigma, 0.0)
    rough = [n for n, s in zip(unknowns.names, unknowns.sigma, strict=True) if s > KNOWN]
    assert {"ra2", "rd4"} <= set(rough)
    _, covariance = posterior(unknowns, 0.0)
    lengths = known_lengths(unknowns, x, covariance, np.zeros_like(covariance))
    assert not {unknowns.names[i] for i in lengths.unknowns} & set(rough)
    assert lengths.apart == pytest.approx(0.0, abs=1e-6)
