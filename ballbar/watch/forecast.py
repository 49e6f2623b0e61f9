"""Where the uncertainty of a growing recording will be at its end.

From the latest estimate, part by part. What plate and ball-bar leave of the scale stays; of the
factor by which known lengths that contradict each other widen it, nobody knows whether it will be
there, and the square root is foretold. What priors and masses leave of the rest stays too. The part
of the data falls as a power of time: slowly what white noise leaves, fast what is added because
residuals are not white, for it is estimated from what single blocks of time hold alone, and every
lap leaves less of that (benchmarks.live_identification sound).
"""

from __future__ import annotations

import numpy as np

from ballbar.watch.state import Estimate

# Exponents with which the parts of the data fall while a path covers ever more. A repeated path
# would give 0.5 to the first; the second is that of machines with all errors.
WHITE, WIDENED = 0.8, 2.0


def foretold(last: Estimate, duration: float, *, scale: float) -> float:
    """[m] TCP uncertainty once a recording has its duration [s], if the fit remains good.

    scale : [m] what plate and ball-bar leave of the scale.
    """
    along = float(np.sqrt(max(0.0, last.tcp_sigma**2 - last.without_scale**2)))
    stays = along if along <= scale else np.sqrt(along * scale)
    share = min(1.0, last.until / duration)
    fallen = last.white**2 * (1.0 - share ** (2.0 * WHITE))
    fallen += last.widened**2 * (1.0 - share ** (2.0 * WIDENED))
    return float(np.sqrt(stays**2 + max(0.0, last.without_scale**2 - fallen)))
