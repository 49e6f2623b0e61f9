"""The map between channels in the units of their logs, against what was planted and a straight fit.

Log A holds white noise, log B none, so an ordinary least-squares fit gives the constants too.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.ident.channel_pair import ChannelPair, channel_pair
from ballbar.ident.estimator.clock_fit import fit_clock
from tests.helpers.log_sides import side_of
from tests.helpers.moving_body import wandering

T = np.arange(0.0, 40.0, 0.01)
NOISE, GAIN = 0.05, -57.3  # [unit of A], [unit of A per unit of B]
NAMES = ("x", "y", "z")


def paired(a: Array, b: Array, *, centre: float = 20.0, scale: float = 0.3) -> ChannelPair:
    """The map from b (N, d) to a (N, d) of one clock; centre, scale : those taken out of B."""
    sides = side_of(T, a, centre=-1000.0, scale=17.0), side_of(T, b, centre=centre, scale=scale)
    fit = fit_clock([sides], 0.0)
    assert fit is not None
    names = NAMES[: a.shape[1]]
    return channel_pair((names, names), sides, fit.groups[0], fit.covariance)


@pytest.mark.parametrize(("centre", "scale"), [(0.0, 1.0), (20.0, 0.3), (-50.0, 4.0)])
def test_gain_and_zero_of_one_channel_are_those_of_a_straight_line(
    centre: float, scale: float
) -> None:
    """The zero is that at the origin of B, far from its values, whatever the centre of the fit."""
    rng = np.random.default_rng(1)
    b = 20.0 + wandering(rng, 0.3)(T)[:, :1]
    a = GAIN * b + 3.0 + NOISE * rng.standard_normal(b.shape)
    pair = paired(a, b, centre=centre, scale=scale)
    line, covariance = np.polyfit(b[:, 0], a[:, 0], 1, cov="unscaled")
    sigma = NOISE * np.sqrt(np.diag(covariance))
    assert sigma[1] > 10.0 * NOISE / np.sqrt(T.size)  # at the centre it would be that small
    for own, by_line, of_line, stated in zip(
        (pair.gain, pair.zero[0]),
        line,
        sigma,
        (pair.sigma["gain"][0], pair.sigma["zero"][0]),
        strict=True,
    ):
        assert own == pytest.approx(by_line, abs=0.5 * of_line)
        assert 0.8 < stated / of_line < 1.6
    assert pair.residual[0] == pytest.approx(NOISE, rel=0.05)
    assert pair.residual_share[0] == pytest.approx(NOISE / a.std(), rel=0.05)
    assert pair.correlation[0] == pytest.approx(np.corrcoef(a[:, 0], b[:, 0])[0, 1], abs=1e-4)
    assert pair.turn is pair.lever is pair.hand is None
    assert set(pair.constants()) == {"gain", "zero"}


def test_a_vector_has_the_planted_turn_gain_and_shift_within_its_sigmas() -> None:
    rng = np.random.default_rng(2)
    turn, b = Rotation.from_quat(rng.normal(size=4)), 20.0 + wandering(rng, 0.3)(T)
    a = 57.3 * turn.apply(b) + [3.0, -20.0, 400.0] + NOISE * rng.standard_normal(b.shape)
    pair = paired(a, b)
    assert (pair.a, pair.b, pair.undetermined) == ("x,y,z", "x,y,z", ())
    assert pair.turn is not None
    off = {
        "gain": np.array([pair.gain - 57.3]),
        "zero": pair.zero - [3.0, -20.0, 400.0],
        "turn": (Rotation.from_quat(pair.turn) * turn.inv()).as_rotvec(),
    }
    assert off.keys() == pair.sigma.keys()
    scores = np.concatenate([off[name] / pair.sigma[name] for name in off])
    assert 0.2 < np.sqrt(np.mean(scores**2)) < 2.0, scores
    assert np.abs(off["turn"]).max() < 5.0 * NOISE / (57.3 * 0.1 * np.sqrt(T.size))


def test_a_motion_along_a_line_does_not_show_the_rotation_about_it() -> None:
    rng = np.random.default_rng(3)
    b = wandering(rng, 0.3)(T) * [1.0, 0.0, 0.0]
    a = 57.3 * b[:, [1, 0, 2]] + NOISE * rng.standard_normal(b.shape)
    assert paired(a, b, centre=0.0).undetermined == ("the rotation about (0.00, 1.00, 0.00)",)
