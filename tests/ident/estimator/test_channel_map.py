"""The constant map between two logs of one body: its derivatives, and the map that was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.channel_map import (
    PRIOR,
    PRIOR_TURN,
    ChannelMap,
    Trace,
    first_map,
    fitted,
    linearised,
    normal_of,
    skew,
    trace,
    weights,
)

T = np.linspace(0.0, 5.0, 40)
STEP = 1e-6
NONE = np.zeros((T.size, 0))


def body(t: Array) -> tuple[Array, Array, Array]:
    """Point (N, 3), rotation vector (N, 3) about a fixed axis, and its rate (N, 3)."""
    point = np.stack([np.sin(t), np.cos(1.3 * t), 0.4 * np.sin(2.1 * t)], axis=1)
    axis = np.array([0.6, 0.0, 0.8])
    return point, np.outer(0.7 * np.sin(t), axis), np.outer(0.7 * np.cos(t), axis)


def side(point: Array, speed: Array, turn: Rotation | None, rate: Array) -> Trace:
    return Trace(point, speed, turn, rate)


def log_b(*, points: int, turned: bool) -> Trace:
    """Log B of a tumbling body: Euler angles give it all three axes."""
    point, _, _ = body(T)
    speed = np.stack([np.cos(T), -1.3 * np.sin(1.3 * T), 0.84 * np.cos(2.1 * T)], axis=1)
    angles = np.stack([0.9 * np.sin(T), 0.5 * np.cos(1.7 * T), 0.3 * T], axis=1)
    turn = Rotation.from_euler("xyz", angles)
    later, earlier = (
        Rotation.from_euler("xyz", np.stack(
            [0.9 * np.sin(t), 0.5 * np.cos(1.7 * t), 0.3 * t], axis=1)
        )
        for t in (T + STEP, T - STEP)
    )  # fmt: skip
    rate = (earlier.inv() * later).as_rotvec() / (2.0 * STEP)
    zero = np.zeros((T.size, 3))
    return side(
        point[:, :points], speed[:, :points], turn if turned else None, rate if turned else zero
    )


GAIN, TURN, HAND = 1.02, Rotation.from_rotvec([0.2, -0.4, 1.1]), Rotation.from_rotvec([0.1, 0.7, 0])
ZERO, LEVER = np.array([0.3, -0.2, 0.5]), np.array([0.05, 0.02, -0.08])
TRUE = {
    "one channel": ChannelMap(GAIN, None, ZERO[:1], None, None),
    "three channels": ChannelMap(GAIN, TURN, ZERO, None, None),
    "lever in B": ChannelMap(GAIN, TURN, ZERO, LEVER, None),
    "lever in A": ChannelMap(GAIN, TURN, ZERO, LEVER, HAND),
    "rotation alone": ChannelMap(1.0, TURN, np.zeros(0), None, HAND),
}


def logs(case: str) -> tuple[Trace, Trace]:
    """Log A by the law of the module, `p_a + R_a x = g R p_b + z`, `R_a X = R R_b`, and log B."""
    m = TRUE[case]
    b = log_b(points=m.zero.size, turned=m.hand is not None or case == "lever in B")
    turn = None if m.hand is None or b.turn is None else TURN * b.turn * HAND.inv()
    rate = np.zeros((T.size, 3)) if turn is None else HAND.apply(b.rate)
    point, speed = NONE, NONE
    if m.zero.size:
        arm, moved = np.zeros((2, T.size, 3))
        if case == "lever in B":
            assert b.turn is not None
            arm, moved = b.turn.apply(LEVER), b.turn.apply(np.cross(b.rate, LEVER))
        p, v = b.point + arm[:, : m.zero.size], b.speed + moved[:, : m.zero.size]
        turned = (p, v) if m.turn is None else (m.turn.apply(p), m.turn.apply(v))
        point, speed = m.gain * turned[0] + m.zero, m.gain * turned[1]
        if case == "lever in A":
            assert turn is not None
            point = point - turn.apply(LEVER)
            speed = speed - turn.apply(np.cross(rate, LEVER))
    return side(point, speed, turn, rate), b


@pytest.mark.parametrize("case", TRUE)
def test_the_map_that_made_a_log_leaves_no_residual_and_the_same_rates(case: str) -> None:
    a, b = logs(case)
    at = linearised(TRUE[case], a, b)
    np.testing.assert_allclose(at.residual, 0.0, atol=1e-9)
    np.testing.assert_allclose(at.predicted_rate, at.measured_rate, atol=1e-8)


@pytest.mark.parametrize("case", TRUE)
def test_columns_are_the_derivatives_of_the_residual(case: str) -> None:
    """Against central differences, where measured and predicted agree."""
    (a, b), m = logs(case), TRUE[case]
    at = linearised(m, a, b)
    for k in range(m.prior.size):
        step = STEP * np.eye(m.prior.size)[k]
        ahead, behind = (linearised(m.moved(s * step), a, b).residual for s in (1, -1))
        slope = (ahead - behind) / (2.0 * STEP)
        np.testing.assert_allclose(at.columns[:, :, k], slope, atol=2e-8, err_msg=str(k))


@pytest.mark.parametrize("case", TRUE)
def test_the_fit_finds_the_map_that_was_put_in(case: str) -> None:
    """From its closed form, and in two steps from a map nearby; values with noise of 1e-6."""
    (a, b), m, rng = logs(case), TRUE[case], np.random.default_rng(2)
    a = replace(a, point=a.point + 1e-6 * rng.standard_normal(a.point.shape))
    if a.turn is not None:
        a = replace(a, turn=a.turn * Rotation.from_rotvec(1e-6 * rng.standard_normal((T.size, 3))))
    near = m.moved(1e-3 * np.ones(m.prior.size))
    for found in (fitted(None, a, b), fitted(near, a, b)):
        assert found.gain == pytest.approx(m.gain, abs=5e-6)
        np.testing.assert_allclose(found.zero, m.zero, atol=5e-6)
        for mine, true in ((found.turn, m.turn), (found.hand, m.hand)):
            assert (mine is None) == (true is None)
            if mine is not None and true is not None:
                assert (mine.inv() * true).magnitude() < 5e-6
        if m.lever is not None:
            assert found.lever is not None
            np.testing.assert_allclose(found.lever, m.lever, atol=5e-6)


def test_without_a_lever_the_closed_form_is_the_map() -> None:
    for case in ("one channel", "three channels"):
        (a, b), m = logs(case), TRUE[case]
        first = first_map(a, b)
        assert (first.gain, first.lever) == (pytest.approx(m.gain), None)
        np.testing.assert_allclose(first.zero, m.zero, atol=1e-12)
    a, b = logs("lever in A")
    assert first_map(a, b).lever is not None


def test_unknowns_are_counted_by_what_the_map_has() -> None:
    assert {case: dict(m.unknowns) for case, m in TRUE.items()} == {
        "one channel": {"gain": slice(0, 1), "zero": slice(1, 2)},
        "three channels": {"turn": slice(0, 3), "gain": slice(3, 4), "zero": slice(4, 7)},
        "lever in B": {
            "turn": slice(0, 3), "gain": slice(3, 4), "zero": slice(4, 7), "lever": slice(7, 10),
        },
        "lever in A": {
            "turn": slice(0, 3), "gain": slice(3, 4), "zero": slice(4, 7), "lever": slice(7, 10),
            "hand": slice(10, 13),
        },
        "rotation alone": {"turn": slice(0, 3), "hand": slice(3, 6)},
    }  # fmt: skip
    assert TRUE["lever in A"].parts == [slice(0, 3), slice(3, 6)]
    assert TRUE["rotation alone"].parts == [slice(0, 3)]
    turns = TRUE["lever in A"].prior == PRIOR_TURN
    assert np.flatnonzero(turns).tolist() == [0, 1, 2, 10, 11, 12]
    assert (TRUE["lever in A"].prior[~turns] == PRIOR).all()


def test_columns_are_weighted_by_the_variance_of_their_unit() -> None:
    """Points by all three coordinates together, and never by less than the size of rounding."""
    residual = np.array([[3e-3, 0.0, 0.0, 2e-4, 2e-4, 2e-4], [0.0, 4e-3, 0.0, 2e-4, -2e-4, 2e-4]])
    weight = weights(TRUE["lever in A"], residual)
    np.testing.assert_allclose(weight[:3], 6.0 / 25e-6)
    np.testing.assert_allclose(weight[3:], 1.0 / 4e-8)
    np.testing.assert_allclose(weights(TRUE["three channels"], 0.0 * residual[:, :3]), 1e18)


def test_the_normal_matrix_has_the_priors_or_so_much_that_it_can_be_solved() -> None:
    m, columns = TRUE["one channel"], np.array([[[3.0, 1.0]], [[4.0, 0.0]]])
    expected = np.array([[25.0, 3.0], [3.0, 1.0]]) + np.eye(2) * PRIOR**-2
    np.testing.assert_allclose(normal_of(m, columns), expected)
    one = normal_of(m, 1e7 * columns[1:])  # of the second unknown nothing is seen
    np.testing.assert_allclose(one, np.diag([16e14, 1e-13 * 16e14]), rtol=1e-12)


def test_a_matrix_of_a_cross_product_is_that() -> None:
    x, y = np.random.default_rng(3).normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(x), y), np.cross(x, y))


@pytest.mark.parametrize("points", [0, 3])
def test_a_spline_of_a_pose_gives_rotation_and_rate(points: int) -> None:
    """The rate of a body that turns about a fixed axis is known in closed form."""
    fine = np.linspace(-1.0, 6.0, 3001)
    point, vector, _ = body(fine)
    channels = np.hstack([point[:, :points], Rotation.from_rotvec(vector).as_quat()])
    spline = make_interp_spline(fine, channels, k=5)
    exact, turned, rate = body(T)
    made = trace(spline, T, points=points, as_rate=False)
    assert made.turn is not None
    np.testing.assert_allclose(made.point, exact[:, :points], atol=1e-9)
    np.testing.assert_allclose(made.turn.as_rotvec(), turned, atol=1e-9)
    np.testing.assert_allclose(made.rate, rate, atol=1e-7)
    if not points:
        angular = trace(spline, T, points=0, as_rate=True)
        np.testing.assert_allclose(angular.point, rate, atol=1e-7)
        change = np.outer(-0.7 * np.sin(T), [0.6, 0.0, 0.8])
        np.testing.assert_allclose(angular.speed, change, atol=1e-4)
    bare = trace(make_interp_spline(fine, point, k=5), T, points=3, as_rate=False)
    assert bare.turn is None
    assert not bare.rate.any()
