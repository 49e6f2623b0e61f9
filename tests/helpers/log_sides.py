"""One log's side of a group of channels, through exact values."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.clock_fit import Side
from ballbar.ident.signals.smooth_log import interpolating_log


def side_of(t: Array, values: Array, *, centre: float = 0.0, scale: float = 1.0) -> Side:
    """The side of one or three channels, taken about a centre and over a scale.

    t : (N,) [s], even. values : (N, d) [unit], d = 1 or 3. centre, scale : [unit].
    """
    d = values.shape[1]
    smooth = interpolating_log(t, (values - centre) / scale, np.zeros(d))
    return Side(
        smooth, smooth.spline, points=d, as_rate=False, centre=np.full(d, centre), scale=scale
    )
