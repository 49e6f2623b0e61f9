"""The arrangement in which a replay opens: a tab for each recording, and one for the parameters.

Of a recording: left the cell with ball-bar, sphere and path, below it pages of text; right, from
top to bottom: loop-closure residual before and after, events, angles, and tabs with true TCP error,
rod, clock and coverage. Two runs over each other: ballbar.replay.comparison.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from ballbar.cell.arrays import Array
from ballbar.replay import entities
from ballbar.replay.series import Series
from ballbar.replay.window import blueprint
from ballbar.report.colours import BACKGROUND

_EYE = np.array([0.28, -0.69, 0.31])  # from the robot's right, in front and above; times the reach
_LEGEND = 1.3  # time axis over duration: the legend lies on the plot, so some of it stays free
_SPEED = 4.0  # a run takes minutes; the eye still follows
_MORE = (  # tab, entity and title of a plot, and whether zero is in its middle
    ("TCP error", entities.TCP_ERROR, "TCP error against the truth [um]", False),
    ("TCP error", entities.TCP_AFTER, "Of the identified robot alone [um]", False),
    ("Rod", entities.FORCE, "Rod force, tension positive [N]", True),
    ("Rod", entities.STRAIN, "Axial elongation of the rod [um]", True),
    ("Clock", entities.CLOCK, "Clock offset: robot's minus the other log's [ms]", False),
    ("Clock", entities.CLOCK_ERROR, "Error of the identified offset [us]", True),
    ("Coverage", entities.COVERAGE_SHARE, "Part of the sphere covered [%]", False),
)


@dataclass(frozen=True, eq=False)
class Shown:
    """A recording as its views show it."""

    name: str  # title of its tab
    root: str
    series: Mapping[str, Series]  # its curves by entity
    duration: float  # [s]
    middle: Array  # (3,) [m] of the scene
    reach: float  # [m] size of the scene

    def largest(self, entity: str) -> float | None:
        """Largest absolute value of all curves at or below an entity; None without curves."""
        curves = (s.values for path, s in self.series.items() if path.startswith(entity))
        return max((float(np.abs(v).max(initial=0.0)) for v in curves), default=None)


def layout(recordings: Sequence[Shown]) -> rrb.Blueprint:
    """The blueprint of a replay."""
    notes = rrb.TextDocumentView(
        origin=entities.NOTES, name="Notes: verdict, key figures, parameters"
    )
    parameters = rrb.Horizontal(
        parameter_view(), notes, column_shares=[3, 2], name="Parameters and notes"
    )
    tabs = rrb.Tabs(*map(_recording, recordings), parameters, active_tab=0)
    return blueprint(tabs, entities.TIMELINE, _SPEED)


def parameter_view(root: str = "", run: str = "") -> rrb.Spatial2DView:
    """The picture of the parameters; root, run : where it lies in a comparison, and its title."""
    title = "Parameters: change from nominal, and how well each is known"
    return rrb.Spatial2DView(
        origin=f"{root}{entities.PARAMETERS}",
        name=run or title,
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=(-17.0, 44.0), y_range=(-3.5, 28.0)),
    )


def cell_view(
    root: str, title: str, eye_controls: rrb.EyeControls3D | None = None
) -> rrb.Spatial3DView:
    """The cell; of the path's steps and the patches, one a row, those up to the time shown."""
    so_far = rrb.VisibleTimeRange(
        entities.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    gathered = [rrb.VisibleTimeRanges(so_far)]
    return rrb.Spatial3DView(
        origin=f"{root}{entities.CELL}",
        name=title,
        background=BACKGROUND,
        eye_controls=eye_controls,
        overrides={
            f"{root}{entities.PATH_SO_FAR}": gathered,
            f"{root}{entities.COVERED}": gathered,
        },
    )


def whole_range(duration: float) -> rrb.TimeRange:
    """The time axis of a run of so many seconds, with room for the legend."""
    return rrb.TimeRange(
        rrb.TimeRangeBoundary.absolute(seconds=0.0),
        rrb.TimeRangeBoundary.absolute(seconds=_LEGEND * duration),
    )


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5, 10, 20, ...: an axis that ends there has readable marks."""
    if value <= 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * min(step for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value))


def _recording(shown: Shown) -> rrb.Container:
    eye = rrb.EyeControls3D(
        position=shown.middle + shown.reach * _EYE, look_target=shown.middle, eye_up=(0.0, 0.0, 1.0)
    )
    title = "Cell: path of the tool on the sphere of the rod (yellow: so far), patches covered"
    scene = cell_view(shown.root, title, eye)
    texts = _texts(shown.root)
    if entities.TCP_BEFORE in shown.series:  # the arrows are against the truth
        legend = rrb.TextDocumentView(origin=f"{shown.root}{entities.LEGEND}", name="Arrows")
        left = rrb.Vertical(scene, legend, texts, row_shares=[11, 3, 6])
    else:
        left = rrb.Vertical(scene, texts, row_shares=[13, 7])
    time_axis = rrb.TimeAxis(view_range=whole_range(shown.duration))
    lanes = rrb.StateTimelineView(
        origin=f"{shown.root}{entities.LANES}", name="Events", time_view=time_axis
    )
    angles = [_plot(shown, entities.JOINTS, "Robot joint angles [deg]")]
    if entities.ENCODERS in shown.series:
        angles.append(_plot(shown, entities.ENCODERS, "Ball-bar encoder angles [deg]"))
    rows = (_residuals(shown), lanes, rrb.Horizontal(*angles), _more(shown))
    right = rrb.Vertical(*rows, row_shares=[5, 5, 5, 5])
    return rrb.Horizontal(left, right, column_shares=[11, 9], name=shown.name)


def _texts(root: str) -> rrb.Container:
    return rrb.Tabs(
        rrb.TextDocumentView(origin=entities.NOTES, name="Verdict and key figures"),
        rrb.TextLogView(origin=f"{root}{entities.EVENT_LOG}", name="Events as text"),
        rrb.TextDocumentView(origin=f"{root}{entities.SCENARIO}", name="Scenario"),
        active_tab=0,
    )


def _residuals(shown: Shown) -> rrb.Container:
    tabs = []
    for kind, quantity in ((entities.POSITION, "position [um]"), (entities.ANGLE, "angle [urad]")):
        before, after = f"{entities.BEFORE}/{kind}", f"{entities.AFTER}/{kind}"
        if after in shown.series:
            both = _plot(shown, before, f"Residual before and after, {quantity}", also=after)
            alone = _plot(shown, after, f"Residual after, {quantity}", about_zero=True)
            tabs.append(rrb.Horizontal(both, alone, name=f"Loop closure: {quantity}"))
    return rrb.Tabs(*tabs, active_tab=0)


def _more(shown: Shown) -> rrb.Container:
    """TCP error, rod, clock and coverage, as far as they are known."""
    views: dict[str, list[rrb.View]] = {}
    for tab, entity, title, about_zero in _MORE:
        if shown.largest(entity) is not None or entity == entities.COVERAGE_SHARE:
            views.setdefault(tab, []).append(_plot(shown, entity, title, about_zero=about_zero))
    tabs = [rrb.Horizontal(*plots, name=tab) for tab, plots in views.items()]
    return rrb.Tabs(*tabs, active_tab=0)


def _plot(
    shown: Shown, entity: str, title: str, *, also: str = "", about_zero: bool = False
) -> rrb.TimeSeriesView:
    """A plot of everything below an entity; about_zero : whether zero is in its middle."""
    end = 1.1 * rounded_up(shown.largest(entity) or 0.0)
    return rrb.TimeSeriesView(
        origin=f"{shown.root}{entity}",
        contents=[f"{shown.root}{path}/**" for path in (entity, also) if path],
        name=title,
        axis_x=rrb.TimeAxis(view_range=whole_range(shown.duration)),
        axis_y=rrb.ScalarAxis(range=(-end, end)) if about_zero else None,
        plot_legend=rrb.Corner2D.RightTop,
    )
