"""Where the uncertainty of a growing recording will be at its end.

The part of the scale that only plate and ball-bar give stays: no recording shows it. The rest falls
as a power of time: 1/2 where the path repeats itself, the slope of the latest estimates where it
leads to poses that tell more. The geometric mean of the usual and the latest slope is taken: the
latest alone foretold half of what came (benchmarks.live_identification sound).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbar.watch.state import Estimate

# Slope of complete fits between half time and the end of paths of two minutes: 0.65 to 1.07, median
# 0.8 (five machines with all errors), and how far one may be from it.
USUAL, SPREAD = 0.8, 0.5
SCATTER = 0.2  # of the logarithm of what two complete fits of nearly the same rows state
RECENT = 0.6  # share of the recording before the latest fits


def foretold(history: Sequence[Estimate], duration: float, *, scale: float) -> float | None:
    """[m] TCP uncertainty once a recording has its duration [s]; None before there is any.

    history : estimates of one model. scale : [m] what plate and ball-bar leave of the scale.
    """
    if not history:
        return None
    last = history[-1]
    stays = min(scale, float(np.sqrt(max(0.0, last.tcp_sigma**2 - last.without_scale**2))))
    recent = [e for e in history if e.until >= RECENT * last.until]
    t = np.log([e.until for e in recent])
    falls = 0.5 * np.log([max(e.tcp_sigma**2 - stays**2, e.without_scale**2) for e in recent])
    slope = _slope(t, falls)
    level = falls.mean() - slope * (t[-1] - t.mean())
    power = np.sqrt(USUAL * slope)
    return float(np.hypot(stays, np.exp(level) * (last.until / duration) ** power))


def _slope(t: np.ndarray, falls: np.ndarray) -> float:
    """How fast it falls: the usual slope and that of the estimates, weighted by their variances.

    Two estimates that scatter by a fifth tell no slope.

    t, falls : (N,) [-] logarithms of time and of the uncertainty.
    """
    if t.size < 2:
        return USUAL
    centred = t - t.mean()
    lever = float((centred**2).sum())
    own = -float((centred * falls).sum()) / lever
    left = falls - falls.mean() + own * centred
    variance = (SCATTER**2 + float((left**2).sum())) / (t.size - 1)
    weight = lever / variance
    return max(0.0, (weight * own + USUAL / SPREAD**2) / (weight + 1.0 / SPREAD**2))
