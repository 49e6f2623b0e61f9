"""From true angles to what the devices count.

Ball-bar: incremental encoder, `lines` periods a turn interpolated with `bits`, in a uint32 counter that wraps. Its zero is
wherever it was at power-up, so a reading means `b = sign * 2 pi counts / (lines 2^bits) + zero`. Robot: motor angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from cell.descriptions import Robot, joints_to_motors

COUNTER_RANGE = 2**32


@dataclass(frozen=True)
class BarEncoder:
    """One fitted ball-bar encoder as it really is."""

    joint: int  # 1..5
    lines: int
    bits: int
    sign: int  # of the counts against the DH sense
    zero: float  # [rad] DH angle at which the counter reads 0
    noise_sigma: float  # [rad] white

    @property
    def counts_per_turn(self) -> int:
        return self.lines << self.bits

    def counts(self, angle: Array, rng: np.random.Generator) -> NDArray[np.uint32]:
        """Counter values of true angles (N,) [rad]."""
        seen = self.sign * (angle + rng.normal(0.0, self.noise_sigma, angle.shape) - self.zero)
        return np.rint(seen * (self.counts_per_turn / (2.0 * np.pi))).astype(np.int64).astype(np.uint32)


def healthy_status(cycles: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) EL5021 status words without a fault: only the toggle, bit 15, flips with each PLC cycle (log_formats A.1)."""
    return (cycles & 1) << 15


def motor_angles(robot: Robot, q: Array, *, noise_sigma: float, rng: np.random.Generator) -> Array:
    """(N, 6) [rad] motor angles of joint angles (N, 6); the noise [rad] is that of the joint angle they give."""
    return joints_to_motors(robot, q + rng.normal(0.0, noise_sigma, q.shape))
