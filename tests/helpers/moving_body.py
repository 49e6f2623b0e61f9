"""Two recorders of one rigid body that moves: positions, quaternions and rates, by plain numpy.

The law of the frames is written down once more here, with scipy's rotations alone:

    p_a + R_a lever = turn p_b + shift,      R_a hand = turn R_b.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.logs import ChannelLog

POINT, TURN, RATE = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("wx", "wy", "wz")
KINDS = {  # channels of A and of B
    "vector": (POINT, POINT),
    "rotation": (TURN, TURN),
    "pose": (POINT + TURN, POINT + TURN),
    "point of a pose": (POINT + TURN, POINT),
    "rates": (TURN, RATE),
}


@dataclass(frozen=True, eq=False)
class Bodies:
    """Both logs and what is to be recovered from them."""

    a: ChannelLog
    b: ChannelLog
    clock: Clock
    turn: Rotation
    hand: Rotation
    shift: Array  # (3,)
    lever: Array  # (3,)


def wandering(rng: np.random.Generator, size: float) -> Callable[[Array], Array]:
    """Three channels of eight frequencies each, below 0.6 Hz: times (N,) [s] to values (N, 3)."""
    f, phase = rng.uniform(0.05, 0.6, (3, 8)), rng.uniform(0.0, 2.0 * np.pi, (3, 8))
    amplitude = rng.uniform(0.2, 1.0, (3, 8)) * size * 0.6

    def values(t: Array) -> Array:
        angle = 2.0 * np.pi * f[:, :, None] * t + phase[:, :, None]
        return np.asarray((amplitude[:, :, None] * np.sin(angle)).sum(axis=1).T)

    return values


def two_recorders(
    kind: str,
    seed: int,
    *,
    axes: tuple[float, float, float] = (1.0, 1.0, 1.0),
    jitter: float = 0.0,
    position: Callable[[Array], Array] | None = None,
) -> Bodies:
    """A body's logs: A every 20 ms, B every 33 ms, with noise and random signs of quaternions.

    axes : share of the turning about z, y and x. jitter : [s] of B's stamps. position : of times.
    """
    rng = np.random.default_rng(seed)
    where, angles = position or wandering(rng, 0.3), wandering(rng, 0.5)
    turn, hand = (Rotation.from_quat(rng.normal(size=4)) for _ in range(2))
    shift, lever = rng.normal(size=3), 0.1 * rng.normal(size=3)
    clock = Clock(rng.uniform(-3.0, 3.0), rng.uniform(-1e-4, 1e-4))

    def attitude(t: Array) -> Rotation:
        return Rotation.from_euler("ZYX", angles(t) * axes)

    def noisy(rotation: Rotation, size: float) -> Array:
        late = Rotation.from_rotvec(size * rng.standard_normal((len(rotation), 3)))
        return (rotation * late).as_quat() * rng.choice([-1.0, 1.0], (len(rotation), 1))

    t_a, t_b = np.arange(0.0, 40.0, 0.02), np.arange(0.0, 40.0, 1.0 / 30.0)
    at_b = clock.offset + (1.0 + clock.skew) * (t_b + jitter * rng.standard_normal(t_b.size))
    arm = attitude(at_b).apply(lever) if kind in ("pose", "point of a pose") else 0.0
    step = 1e-4
    rate = (attitude(at_b - step).inv() * attitude(at_b + step)).as_rotvec() / (2.0 * step)
    values_a = {
        POINT: where(t_a) + 1e-3 * rng.standard_normal((t_a.size, 3)),
        TURN: noisy(attitude(t_a), 1e-3),
    }
    values_b = {
        POINT: turn.inv().apply(where(at_b) + arm - shift)
        + 3e-3 * rng.standard_normal((t_b.size, 3)),
        TURN: noisy(turn.inv() * attitude(at_b) * hand, 4e-3),
        RATE: hand.inv().apply(rate) + 0.02 + 0.01 * rng.standard_normal((t_b.size, 3)),
    }
    logs = []
    for name, t, values, names in zip(
        "AB", (t_a, t_b), (values_a, values_b), KINDS[kind], strict=True
    ):
        columns = [v for part, v in values.items() if set(part) <= set(names)]
        logs.append(ChannelLog(name, t, np.hstack(columns), names))
    return Bodies(logs[0], logs[1], clock, turn, hand, shift, lever)
