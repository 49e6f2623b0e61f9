"""Low-pass filters of first order, behind which a robot's controller logs its motors' angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Robot
from sim.motion import Motion
from sim.settings import JointLag
from sim.streams import stream


def joint_lags(lag: JointLag | None, *, joints: int, seed: int) -> Array:
    """(J,) [s] drawn time constant of each motor's filter; (0,) without filters."""
    if lag is None:
        return np.zeros(0)
    z = stream(seed, "joint_lag").standard_normal(joints)
    return np.asarray(lag.time_constant_s * np.exp(lag.spread * z))


def with_lags(motion: Motion, robot: Robot, lags: Array) -> Motion:
    """The motion as the controller shows it, which begins at rest.

    lags : (J,) [s] of the motors, or (0,).
    """
    if not lags.size:
        return motion
    gears, step = motion.shown @ robot.joint_to_gear, motion.t[1] - motion.t[0]
    shown = np.stack(
        [_filtered(g, float(np.exp(-step / lag))) for g, lag in zip(gears.T, lags, strict=True)],
        axis=1,
    )
    return replace(motion, shown=shown @ robot.gear_to_joint)


def _filtered(values: Array, decay: float) -> Array:
    """(K,) exact response of the filter to values (K,) that are linear between steps."""
    # The output after a step of a ramp: decay y + (1 - decay) u0 + (1 - gain) (u1 - u0), with
    # gain = (1 - decay) / -log(decay).
    from scipy.signal import lfilter  # noqa: PLC0415  slow to import, and needed here alone

    gain = (decay - 1.0) / np.log(decay)
    taps = [1.0 - gain, gain - decay]
    out, _ = lfilter(taps, [1.0, -decay], values, zi=[gain * values[0]])
    return np.asarray(out)
