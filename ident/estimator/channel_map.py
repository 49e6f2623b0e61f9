"""The constant map between channels of two logs that hold one motion.

Log A holds a point p_a of a rigid body in a frame of its own, its rotation R_a, or both; log B a
point p_b and a rotation R_b of the same body. Frames, units, points of the body and body frames
differ by constants:

    p_a + R_a x = g R p_b + z,        R_a X = R R_b,

with the gain g, the rotation R and the shift z between the two frames, the lever arm x from one
point of the body to the other, and the rotation X between the two body frames (R_a X = R R_b is
the hand-eye equation AX = YB of Shah, Eastman & Hong 2012). One channel is the case of one
dimension, a gain and a zero. Three channels have no lever arm unless a log holds the rotation too;
if only B does, the law is `p_a = g R (p_b + R_b x) + z`. Angular rates of a body are vectors in its
frame.

Residuals are measured (A) minus predicted (from B); that of a rotation is the rotation vector from
the predicted to the measured one, in A's body frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.rigid_fit import kabsch

EXACT = 1e-9  # of the size of the values: residual of exact ones
FIRST_STEPS, STEPS = 12, 2  # of a map from its closed form, and at each step of the clock
CONVERGED = 1e-3
# Standard deviations that keep the steps finite where nothing shows an unknown: of a rotation
# [rad], and of all others, whose values are near 1.
PRIOR_TURN, PRIOR = 3.0, 100.0


@dataclass(frozen=True, eq=False)
class Trace:
    """One log's side of a group of channels at N instants."""

    point: Array  # (N, d) values, d = 0, 1 or 3
    speed: Array  # (N, d) [1/s]
    turn: Rotation | None  # N rotations of the body, if logged
    rate: Array  # (N, 3) [rad/s] angular rate in the body's frame


def trace(spline: BSpline, t: Array, *, points: int, as_rate: bool) -> Trace:
    """The channels of a spline at times t (N,) [s]: `points` values, then perhaps a quaternion.

    as_rate : the angular rate that the quaternion (x, y, z, w) shows stands for the point.
    """
    values, change = np.asarray(spline(t)), np.asarray(spline(t, nu=1))
    point, speed = values[:, :points], change[:, :points]
    if values.shape[1] < points + 4:
        return Trace(point, speed, None, np.zeros((t.size, 3)))
    q = values[:, points:]
    rate = _rate(q, change[:, points:])
    if as_rate:
        return Trace(rate, _rate(q, np.asarray(spline(t, nu=2))), None, rate)
    return Trace(point, speed, Rotation.from_quat(q), rate)


def _rate(q: Array, change: Array) -> Array:
    """(N, 3) twice the vector part of conj(q) times the quaternion `change` (N, 4), q (N, 4)."""
    vector, scalar = q[:, :3], q[:, 3:]
    product = scalar * change[:, :3] - change[:, 3:] * vector - np.cross(vector, change[:, :3])
    return np.asarray(2.0 * product / (q * q).sum(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class ChannelMap:
    """The constants of one group of channels."""

    gain: float
    turn: Rotation | None  # R; None of one channel
    zero: Array  # (d,)
    lever: Array | None  # (3,) x in the body frame of A; in that of B if A has no rotation
    hand: Rotation | None  # X

    @property
    def unknowns(self) -> dict[str, slice]:
        """Place of each constant in the vector of unknowns (P,); of rotations a small rotation."""
        d, turns = self.zero.size, {"turn": self.turn, "hand": self.hand}
        sizes = {"turn": 3, "gain": min(d, 1), "zero": d, "lever": 3, "hand": 3}
        sizes |= {name: 0 for name, rotation in turns.items() if rotation is None}
        sizes |= {"lever": 0} if self.lever is None else {}
        ends = np.cumsum(list(sizes.values()))
        return {
            name: slice(int(end) - size, int(end))
            for (name, size), end in zip(sizes.items(), ends, strict=True)
            if size
        }

    @property
    def prior(self) -> Array:
        """(P,) standard deviations of the unknowns."""
        own = self.unknowns
        prior = np.full(max(part.stop for part in own.values()), PRIOR)
        for name in {"turn", "hand"} & own.keys():
            prior[own[name]] = PRIOR_TURN
        return prior

    def moved(self, step: Array) -> ChannelMap:
        """The map after a step (P,) of its unknowns; rotations turn about the axes of log A."""
        own = {name: step[part] for name, part in self.unknowns.items()}
        turned = {
            name: None if old is None else Rotation.from_rotvec(own[name]) * old
            for name, old in (("turn", self.turn), ("hand", self.hand))
        }
        return ChannelMap(
            gain=self.gain + float(own.get("gain", np.zeros(1))[0]),
            turn=turned["turn"],
            zero=self.zero + own.get("zero", 0.0),
            lever=None if self.lever is None else self.lever + own["lever"],
            hand=turned["hand"],
        )

    @property
    def parts(self) -> list[slice]:
        """Columns of the residual that share a unit: of the points, and of the rotation."""
        d = self.zero.size
        return [*([slice(0, d)] if d else []), *([slice(d, d + 3)] if self.hand else [])]


def first_map(a: Trace, b: Trace) -> ChannelMap:
    """A map to start from: rotations by Kabsch (1976), gain and shift by Umeyama (1991).

    The rotation between two body frames is that of the angular rates, `w_a = X w_b`.
    """
    turn, hand, d = None, None, a.point.shape[1]
    if a.turn is not None and b.turn is not None:
        hand = Rotation.from_matrix(kabsch(b.rate, a.rate))
        turn = (a.turn * hand * b.turn.inv()).mean()
    centred = [x.point - x.point.mean(axis=0) for x in (a, b)]
    if turn is None and d == 3:
        turn = Rotation.from_matrix(kabsch(centred[1], centred[0]))
    turned = centred[1] if turn is None or not d else turn.apply(centred[1])
    power = max(float((turned * turned).sum()), np.finfo(float).tiny)
    gain = float((turned * centred[0]).sum()) / power if d else 1.0
    mean = b.point.mean(axis=0)
    zero = a.point.mean(axis=0) - gain * (mean if turn is None or not d else turn.apply(mean))
    lever = np.zeros(3) if d and (a.turn is not None or b.turn is not None) else None
    return ChannelMap(gain, turn, zero, lever, hand)


@dataclass(frozen=True, eq=False)
class Linearised:
    """The residual of a map, and its change with the map's unknowns and with time."""

    residual: Array  # (N, m)
    columns: Array  # (N, m, P)
    measured_rate: Array  # (N, m) [1/s] change of A's values with A's time
    predicted_rate: Array  # (N, m) [1/s] the same by B's values


def linearised(m: ChannelMap, a: Trace, b: Trace) -> Linearised:
    """Residual and derivatives at N instants; small angles between measured and predicted.

    m : the map, of points over the scales of their logs [-] and of rotations [rad].
    """
    arm = np.zeros(3) if m.lever is None else m.lever
    none, residual, rates, blocks = np.zeros((a.rate.shape[0], 0)), [], [], []
    n, d, both = len(none), m.zero.size, m.hand is not None
    matrix = np.eye(d) if m.turn is None else m.turn.as_matrix()
    if d:
        (p_a, v_a), (p_b, v_b) = _carried(a, arm), _carried(b, arm if a.turn is None else 0.0 * arm)
        turned = p_b @ matrix.T
        residual.append(p_a - m.gain * turned - m.zero)
        rates.append((v_a, m.gain * v_b @ matrix.T))
        own = [] if m.turn is None else [skew(m.gain * turned)]
        own += [-turned[:, :, None], np.broadcast_to(-np.eye(d), (n, d, d))]
        if m.lever is not None and a.turn is not None:
            own.append(a.turn.as_matrix())
        elif m.lever is not None and b.turn is not None:
            own.append(-m.gain * matrix @ b.turn.as_matrix())
        blocks.append(np.concatenate([*own, np.zeros((n, d, 3 if both else 0))], axis=2))
    if m.hand is not None and m.turn is not None and a.turn is not None and b.turn is not None:
        predicted = m.turn * b.turn * m.hand.inv()
        residual.append((predicted.inv() * a.turn).as_rotvec())
        rates.append((a.rate, m.hand.apply(b.rate)))
        between = np.zeros((n, 3, m.prior.size - 6))
        own = [-predicted.inv().as_matrix(), between, np.broadcast_to(np.eye(3), (n, 3, 3))]
        blocks.append(np.concatenate(own, axis=2))
    measured, by_b = (np.concatenate(side, axis=1) for side in zip(*rates, strict=True))
    return Linearised(
        np.concatenate(residual, axis=1), np.concatenate(blocks, axis=1), measured, by_b
    )


def _carried(side: Trace, arm: Array) -> tuple[Array, Array]:
    """The point at the end of a lever arm (3,) in the body frame, and its speed."""
    if side.turn is None or not arm.any():
        return side.point, side.speed
    return (
        side.point + side.turn.apply(arm),
        side.speed + side.turn.apply(np.cross(side.rate, arm)),
    )


def skew(x: Array) -> Array:
    """(N, 3, 3) matrices of the cross products with x (N, 3), both in the unit of x, [-] or [m]."""
    return np.asarray(np.cross(x[:, None, :], np.eye(3)[None]).swapaxes(1, 2))


def weights(m: ChannelMap, residual: Array) -> Array:
    """(m,) one over the variance of each column of a residual, pooled over its part.

    residual : (N, m) of points over the scale of A [-], then of the rotation [rad].
    """
    weight = np.empty(residual.shape[1])
    for part in m.parts:
        weight[part] = 1.0 / max(EXACT**2, float((residual[:, part] ** 2).mean()))
    return weight


def normal_of(m: ChannelMap, columns: Array) -> Array:
    """(P, P) normal matrix of whitened columns, kept finite by the priors of the unknowns.

    columns : (N, m, P) derivatives over the residual's sigma, by rotations [1/rad], by others [-].
    """
    flat = columns.reshape(-1, columns.shape[2])
    normal = flat.T @ flat
    prior = m.prior**-2.0
    return np.asarray(normal + np.diag(np.maximum(prior, 1e-13 * np.diag(normal).max(initial=0.0))))


def fitted(m: ChannelMap | None, a: Trace, b: Trace) -> ChannelMap:
    """The map of least squares (Gauss-Newton), from a previous map or its closed form."""
    steps = FIRST_STEPS if m is None else STEPS
    m = first_map(a, b) if m is None else m
    for _ in range(steps):
        at = linearised(m, a, b)
        root = np.sqrt(weights(m, at.residual))
        columns = at.columns * root[:, None]
        gradient = np.einsum("nmp,nm->p", columns, at.residual * root)
        step = -np.linalg.solve(normal_of(m, columns), gradient)
        turned = np.abs(step[m.prior == PRIOR_TURN]).max(initial=0.0)
        m = m.moved(step / max(1.0, float(turned)))
        if np.abs(step).max() < CONVERGED:
            break
    return m
