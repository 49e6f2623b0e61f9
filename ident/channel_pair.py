"""The map between a group of channels of two logs, in the units of the logs, and what it lacks.

The fit works with channels about their centres and over their spreads; its constants and their
covariance are those of the channels themselves again here. Where the motion turns the body about
one axis only, hand-eye calibration leaves directions free (Tsai & Lenz 1989): they are named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.channel_groups import Group
from ballbar.ident.estimator.channel_map import skew
from ballbar.ident.estimator.clock_fit import GroupFit, Side

# Times its noise: a channel with less spread stands still, a direction that turns less is unknown.
MOVES = 3.0


@dataclass(frozen=True, eq=False)
class ChannelPair:
    """A group of channels of both logs that hold one motion, and the map between them.

    Single channels: `a = gain b + zero`. Points: `a + R_a lever = gain turn b + zero`.
    Rotations: `R_a hand = turn R_b` (ballbar.ident.estimator.channel_map). Quaternions are (x, y,
    z, w).
    """

    a: str  # names, with commas between them
    b: str
    correlation: tuple[float, ...]  # of single channels' values; of the speeds of points, rotations
    residual: tuple[float, ...]  # [unit of a; rad] rms of a component of points, of rotations
    residual_share: tuple[float, ...]  # of the rms of a about its mean
    gain: float  # [unit of a per unit of b]
    zero: Array  # (d,) [unit of a]
    turn: Array | None  # (4,) quaternion that turns vectors of b into those of a
    lever: Array | None  # (3,) [unit of a] in the body frame of a; [unit of b] if only b turns
    hand: Array | None  # (4,) quaternion
    sigma: dict[str, Array]  # of each constant; of rotations (3,) [rad] about the axes of a
    undetermined: tuple[str, ...]  # what of the map the motion does not show

    def constants(self) -> dict[str, Array]:
        """The constants that the map has, by name; quaternions of turn and hand."""
        every = vars(self) | {"gain": np.array([self.gain])}
        return {name: np.asarray(every[name]) for name in self.sigma}


def channel_pair(
    group: Group, sides: tuple[Side, Side], fit: GroupFit, of_clock: Array
) -> ChannelPair:
    """The map of a group in the units of the logs.

    sides : of A and of B, whose centres and scales the fit has taken out.
    of_clock : (2, 2) covariance of the clock at the middle [s] and of the skew [-], which adds to
    that of the map.
    """
    (a, b), m = sides, fit.map
    covariance, white = fit.covariances(of_clock)
    own, gain, d = m.unknowns, m.gain * a.scale / b.scale, m.zero.size
    matrix = np.eye(d) if m.turn is None else m.turn.as_matrix()
    arm = a.scale if fit.a.turn is not None else b.scale
    units = {"gain": a.scale / b.scale, "zero": a.scale, "lever": arm}
    change = np.diag(
        np.concatenate([np.full(p.stop - p.start, units.get(k, 1.0)) for k, p in own.items()])
    )
    zero = a.scale * m.zero + a.centre
    if d:  # the shift belongs to the origin of B, not to its centre
        centre = gain * matrix @ b.centre
        zero = zero - centre
        change[own["zero"], own["gain"]] = -centre[:, None] / m.gain
        if m.turn is not None:
            change[own["zero"], own["turn"]] = skew(centre[None])[0]
    sigma = np.sqrt(np.diag(change @ covariance @ change.T))
    unit = np.array([a.scale if d and k == 0 else 1.0 for k in range(len(m.parts))])
    correlation = fit.correlation
    if d == 1:
        correlation = np.corrcoef(fit.a.point[:, 0], fit.b.point[:, 0])[:1, 1]
    return ChannelPair(
        a=",".join(group[0]),
        b=",".join(group[1]),
        correlation=tuple(correlation.tolist()),
        residual=tuple((fit.rms * unit).tolist()),
        residual_share=tuple((fit.rms / fit.spread).tolist()),
        gain=gain,
        zero=zero,
        turn=None if m.turn is None else m.turn.as_quat(canonical=True),
        lever=None if m.lever is None else m.lever * arm,
        hand=None if m.hand is None else m.hand.as_quat(canonical=True),
        sigma={name: sigma[part] for name, part in own.items()},
        undetermined=_undetermined(fit, white),
    )


def _undetermined(fit: GroupFit, white: Array) -> tuple[str, ...]:
    """Directions of a map in which the motion reaches less than MOVES times its noise."""
    own, count = fit.map.unknowns, fit.t.size
    words = {"turn": "the rotation about", "hand": "the rotation of the body frame about"}
    words |= {"lever": "the lever arm, and the shift with it, along"}
    # An arm is shown by how far the body turns, against the noise of its rotation.
    limits = {"lever": fit.rms[0] / (MOVES * fit.rms[-1]) if fit.map.hand is not None else 1.0}
    free = []
    for name in words.keys() & own.keys():
        values, vectors = np.linalg.eigh(count * white[own[name], own[name]])
        for axis in vectors.T[np.sqrt(values) > limits.get(name, 1.0 / MOVES)]:
            x, y, z = axis * np.sign(axis[np.argmax(np.abs(axis))]) + 0.0
            free.append(f"{words[name]} ({x:.2f}, {y:.2f}, {z:.2f})")
    return tuple(sorted(free))
