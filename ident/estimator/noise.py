"""Noise levels: of the logs from their smoothing residual, of the rest from the loop-closure error.

Encoder and robot noise come from the residual of each log's spline (ballbar.ident.signals). What
the logs do not show row by row is estimated from the loop-closure error as variance components, by
maximum likelihood: sub-divisional error, which repeats ten times a degree and passes for encoder
noise; what the model of the gears leaves over; the deviation of the rod from a constant length.
"""

from __future__ import annotations

from dataclasses import dataclass

from ballbar.cell.arrays import Array


@dataclass(frozen=True)
class ExcessNoise:
    """Standard deviations of the variance components: noise beyond what the logs show."""

    gear: float = 0.0  # [rad] of axes 1 to 3
    wrist: float = 0.0  # [rad] of the axes behind them
    bar: float = 0.0  # [rad] of each ball-bar encoder: sub-divisional error
    rod: float = 0.0  # [m] of the rod's length
    position: float = 0.0  # [m] of a still pose along each axis: what the model leaves unexplained
    rotation: float = 0.0  # [rad] the same of its orientation


@dataclass(frozen=True, eq=False)
class LogNoise:
    """Standard deviations of one row of each log."""

    joint: Array  # (J,) [rad]
    encoder: Array  # (5,) [rad]; 0 where unmeasured
    length: float = 0.0  # [m] of a sensed length
