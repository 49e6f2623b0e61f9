"""Two recorders of one motion: what each would log, on a clock of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.logs import ChannelLog

NOISE = 1e-4  # [unit of A] of every row of A; B's is as large after its gain
GAINS, ZEROS = np.array([-57.3, 0.4]), np.array([3.0, -20.0])

Motion = Callable[[Array], Array]  # times (N,) [s] to values (N, 2)


def wandering(rng: np.random.Generator) -> Motion:
    """Two channels of twelve frequencies each, below 0.6 Hz, that do not repeat themselves."""
    frequency = rng.uniform(0.05, 0.6, (2, 12))
    phase, size = rng.uniform(0.0, 2.0 * np.pi, (2, 12)), rng.uniform(0.1, 1.0, (2, 12))

    def values(t: Array) -> Array:
        angle = 2.0 * np.pi * frequency[:, :, None] * t + phase[:, :, None]
        return np.asarray((size[:, :, None] * np.sin(angle)).sum(axis=1).T)

    return values


def two_logs(
    motion: Motion,
    clock: Clock,
    rng: np.random.Generator,
    *,
    duration: float = 40.0,
    names: tuple[str, str] = ("u", "v"),
) -> tuple[ChannelLog, ChannelLog]:
    """Log A in rows of 4 ms, log B in rows of 10 ms with other units and directions."""
    t_a, t_b = np.arange(0.0, duration, 0.004), np.arange(0.0, duration, 0.01)
    a = motion(t_a) + NOISE * rng.standard_normal((t_a.size, 2))
    seen = motion(np.asarray(clock.robot_time(t_b)))
    b = (seen + NOISE * rng.standard_normal((t_b.size, 2))) * GAINS + ZEROS
    return ChannelLog("A", t_a, a, ("x", "y")), ChannelLog("B", t_b, b, names)
