"""Numbers as people read them: without exponents, and without digits that no measurement has.

Values are in the unit that is shown: mm, mrad, um, urad, us, ppm, per cent.
"""

from __future__ import annotations

import math

from ballbar.cell.clock import UNSEEN_OFFSET, UNSEEN_SKEW, Clock

# Of the unit shown. 1e-6 mm or mrad is a nanometre or nanoradian, a four-hundredth of the finest
# encoder step (3600 lines, 12 bits: 4e-7 rad); what is smaller is rounding, and is shown as 0.
SMALLEST_SHOWN = 1e-6
NOT_DETERMINED = "not determined"


def significant_text(value: float, digits: int = 3, *, sign: bool = False) -> str:
    """A number with so many significant digits; 0 below SMALLEST_SHOWN."""
    if not math.isfinite(value):
        return str(value)
    if abs(value) < SMALLEST_SHOWN:
        return "0"
    # after rounding: 9.996 has two digits before the point
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    return f"{value:{'+' if sign else ''}.{max(0, digits - 1 - exponent)}f}"


def duration_text(seconds: float, digits: int = 2) -> str:
    """A duration or its standard deviation [s] in us, ms or s, whichever is readable."""
    size = abs(seconds)
    factor, unit = (1.0, "s") if size >= 1.0 else (1e3, "ms") if size >= 1e-3 else (1e6, "us")
    return f"{significant_text(seconds * factor, digits)} {unit}"


def clock_offset_text(clock: Clock, sigma: float, *, longest: float = UNSEEN_OFFSET) -> str:
    """A clock offset with its standard deviation [s]; or that it is not determined.

    longest : [s] standard deviation from which it is not.
    """
    stated = f"(sigma {duration_text(sigma)})"
    if not sigma <= longest:
        return f"{NOT_DETERMINED} {stated}"
    return f"{clock.offset * 1e3:+.4f} ms {stated}"


def clock_skew_text(clock: Clock, sigma: float) -> str:
    """A clock skew with its standard deviation [1]; or that it is not determined."""
    stated = f"(sigma {significant_text(sigma * 1e6, 2)} ppm)"
    if not sigma <= UNSEEN_SKEW:
        return f"{NOT_DETERMINED} {stated}"
    return f"{clock.skew * 1e6:+.3f} ppm {stated}"
