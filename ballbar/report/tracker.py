"""The page's section about an optical tracker: distances of its points from both robots."""

from __future__ import annotations

from dataclasses import dataclass

from ballbar.report.numbers import significant
from ballbar.report.residual_figures import norms_over_time
from ballbar.units import MM
from ident.tracker import TrackerCheck


@dataclass(frozen=True)
class TrackerRow:
    """One size of the distances [mm]."""

    name: str
    nominal: str
    identified: str


@dataclass(frozen=True)
class TrackerSection:
    """Distances of a tracker's points from the nominal and from the identified robot."""

    rows: list[TrackerRow]
    noise: str  # [mm]
    expected: str  # [mm]
    points: int
    unknowns: int
    degrees: int
    figure: str


def tracker_section(check: TrackerCheck | None) -> TrackerSection | None:
    """The section of a recording; None where there is nothing to show."""
    if check is None:
        return None
    nominal, identified = check.nominal, check.identified
    sizes = {"rms": (nominal.rms, identified.rms), "largest": (nominal.largest, identified.largest)}
    return TrackerSection(
        rows=[
            TrackerRow(name, *(significant(size * MM) for size in both))
            for name, both in sizes.items()
        ],
        noise=significant(check.noise * MM),
        expected=significant(check.expected * MM),
        points=check.t.size,
        unknowns=identified.unknowns,
        degrees=check.degrees,
        figure=norms_over_time(
            check.t, nominal.error * MM, identified.error * MM, label="distance [mm]", clock="robot"
        ),
    )
