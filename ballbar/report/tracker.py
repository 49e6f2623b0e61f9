"""The page's section about an optical tracker: distances of its points from both robots."""

from __future__ import annotations

from ballbar.report.numbers import significant
from ballbar.report.residual_figures import norms_over_time
from ballbar.units import MM
from ident.tracker import TrackerCheck


def tracker_section(check: TrackerCheck | None) -> dict[str, object] | None:
    """Distances of a tracker's points as the page shows them; None where there are none."""
    if check is None:
        return None
    nominal, identified = check.nominal, check.identified
    sizes = {"rms": (nominal.rms, identified.rms), "largest": (nominal.largest, identified.largest)}
    errors = nominal.error * MM, identified.error * MM
    return {
        "rows": [
            (name, *(significant(size * MM) for size in both)) for name, both in sizes.items()
        ],
        "noise": significant(check.noise * MM),
        "expected": significant(check.expected * MM),
        "points": check.t.size,
        "unknowns": identified.unknowns,
        "degrees": check.degrees,
        "figure": norms_over_time(check.t, *errors, label="distance [mm]", clock="robot"),
    }
