"""Where the uncertainty of a growing recording will be at its end.

From the latest estimate, part by part. What plate and ball-bar leave of the scale stays. Whether
the doubts that widen a stated uncertainty will be there at the end, nobody knows: of the factor by
which known lengths that contradict each other widen the scale the square root is foretold, and of
the doubt of masses the half. The rest falls as a power of time. The slope of the latest estimates
tells less: two complete fits scatter by a fifth (benchmarks.live_identification sound).
"""

from __future__ import annotations

import numpy as np

from ballbar.watch.state import Estimate

# Exponent with which the rest falls while a path covers ever more. Of nine machines with all errors
# 98 % of 45 forecasts are then within 1.3 times of what came; a repeated path would give 0.5.
POWER = 0.8


def foretold(last: Estimate, duration: float, *, scale: float) -> float:
    """[m] TCP uncertainty once a recording has its duration [s].

    scale : [m] what plate and ball-bar leave of the scale.
    """
    along = float(np.sqrt(max(0.0, last.tcp_sigma**2 - last.without_scale**2)))
    stays = along if along <= scale else np.sqrt(along * scale)
    rest = np.sqrt(max(0.0, last.without_scale**2 - last.doubt**2))
    falls = rest * min(1.0, last.until / duration) ** POWER
    return float(np.linalg.norm([stays, falls, 0.5 * last.doubt]))
