"""Where the uncertainty of a growing recording will be at its end.

From the latest estimate, part by part. What plate and ball-bar leave of the scale stays; of the
factor by which known lengths that contradict each other widen it, nobody knows whether it will be
there, and the square root is foretold. The rest falls as a power of time. The slope of the latest
estimates tells less: two complete fits scatter by a fifth (benchmarks.live_identification sound).
"""

from __future__ import annotations

import numpy as np

from ballbar.watch.state import Estimate

# Exponent with which the rest falls while a path covers ever more. Of nine machines with all errors
# 98 % of 45 forecasts are then within 1.3 times of what came; a repeated path would give 0.5.
POWER = 0.8


def foretold(last: Estimate, duration: float, *, scale: float) -> float:
    """[m] TCP uncertainty once a recording has its duration [s], if the fit remains good.

    scale : [m] what plate and ball-bar leave of the scale.
    """
    along = float(np.sqrt(max(0.0, last.tcp_sigma**2 - last.without_scale**2)))
    stays = along if along <= scale else np.sqrt(along * scale)
    falls = last.without_scale * min(1.0, last.until / duration) ** POWER
    return float(np.hypot(stays, falls))
