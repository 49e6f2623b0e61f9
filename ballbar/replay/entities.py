"""Names and arrangement of a replay: what lies where in the file, and which views show it at first sight.

Left the cell with ball-bar, sphere and path, below it pages of text; right, from top to bottom: loop-closure residual before
and after, events, angles, and tabs with true TCP error, rod and clock. A second tab holds the parameters with error bars.
rerun has no unit field, so units stand in entity names and titles. Other arrangements: ballbar.replay.arrangements.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cell.arrays import Array

TIMELINE = "robot_time"  # [s] robot's clock, from the first row of its log
ITERATION = "iteration"  # of the identifier; 0 is the nominal robot
CELL = "/cell"
BAR_BODIES = ("stand", "gimbal_b1", "gimbal_b2", "rod_b3", "cardan_b4", "cardan_b5")
PATH_SO_FAR = "/cell/tool/path_so_far"
NOMINAL_ERROR, IDENTIFIED_ERROR = (
    "/cell/tool/error_of_nominal_robot",
    "/cell/tool/error_of_identified_robot",
)
BEFORE, AFTER = "/residual/before", "/residual/after"
POSITION, ANGLE = "position_um", "angle_urad"
JOINTS = "/robot/joint_angles_deg"
ENCODERS = "/ballbar/encoder_angles_deg"
TCP_ERROR = "/tcp_error"
TCP_BEFORE, TCP_AFTER = "/tcp_error/nominal_um", "/tcp_error/identified_um"
FORCE = "/ballbar/rod_force_N"
FORCE_TRUE, FORCE_FOUND = "/ballbar/rod_force_N/true", "/ballbar/rod_force_N/identified"
STRAIN = "/ballbar/rod_strain_um"
STRAIN_TRUE, STRAIN_FOUND = "/ballbar/rod_strain_um/true", "/ballbar/rod_strain_um/identified"
CLOCK = "/clock/offset_ms"
CLOCK_FOUND, CLOCK_TRUE = "/clock/offset_ms/identified", "/clock/offset_ms/true"
CLOCK_ERROR = "/clock/error_us"
COVERED, COVERAGE_SHARE = "/cell/sphere/covered", "/sphere/covered_percent"
LANES, EVENT_LOG = "/events/lanes", "/events/log"
PARAMETER_AXES, PARAMETER_VALUES = "/parameters/axes", "/parameters/values"
PARAMETER_TABLE = "/parameter_table"  # the numbers behind the picture
NOTES, SCENARIO = "/notes", "/scenario"
MISMATCH = "/cell/mismatch"
MISMATCH_POSITION, MISMATCH_ANGLE = (
    "/identify/mismatch/position_um_log10",
    "/identify/mismatch/angle_urad_log10",
)
COST = "/identify/chi_square_per_sample_log10"
FROM_RESULT, FROM_TRUTH = (
    "/identify/tool_um_log10/from_result",
    "/identify/tool_um_log10/from_truth",
)
STAGE = "/identify/stage"

Colour = tuple[int, int, int]
RED, GREEN = (225, 87, 76), (87, 190, 122)  # before, after
STEEL_GREY = (178, 184, 192)

_EYE = np.array(
    [0.28, -0.69, 0.31]
)  # from the robot's right and a little in front, above; times the size of the scene
_BACKGROUND = (30, 34, 42)
ROOM_FOR_LEGEND = (
    1.3  # time axis over duration: the legend lies on the plot, so some of it stays free
)
_PLAYBACK_SPEED = 4.0  # a run takes minutes; four times as fast the eye still follows


def at(t: Array) -> list[rr.TimeColumn]:
    """The timeline at instants t (N,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=t)]


def layout(
    plots: Mapping[str, float], *, duration: float, looking_at: Array, reach: float
) -> rrb.Blueprint:
    """The blueprint.

    plots : entities of the curves in the file, and the largest absolute value of each; duration : [s] of the run;
    looking_at : (3,) [m] middle of the scene; reach : [m] its size.
    """
    end = duration * ROOM_FOR_LEGEND
    whole = rrb.TimeRange(
        rrb.TimeRangeBoundary.absolute(seconds=0.0), rrb.TimeRangeBoundary.absolute(seconds=end)
    )
    shown = rrb.StateTimelineView(
        origin=LANES, name="Events", time_view=rrb.TimeAxis(view_range=whole)
    )
    rows = rrb.Vertical(
        _residuals(plots, whole),
        shown,
        _row(_angles(plots, whole)),
        _more(plots, whole),
        row_shares=[5, 4, 5, 5],
    )
    left = rrb.Vertical(_scene(looking_at, reach), _texts(), row_shares=[13, 7])
    run = rrb.Horizontal(left, rows, column_shares=[11, 9], name="Run")
    notes = rrb.TextDocumentView(origin=NOTES, name="Notes: verdict, key figures, parameters")
    parameters = rrb.Horizontal(
        parameter_view("/parameters"), notes, column_shares=[3, 2], name="Parameters and notes"
    )
    return rrb.Blueprint(
        rrb.Tabs(run, parameters, active_tab=0),
        rrb.TimePanel(
            timeline=TIMELINE,
            state="collapsed",
            play_state="playing",
            loop_mode="all",
            playback_speed=_PLAYBACK_SPEED,
        ),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def parameter_view(*contents: str) -> rrb.Spatial2DView:
    """The picture of the parameters, from one run or from several."""
    return rrb.Spatial2DView(
        origin="/",
        contents=[f"{entity}/**" for entity in contents],
        name="Parameters: change from nominal, and how well each is known",
        background=_BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=(-17.0, 44.0), y_range=(-3.5, 28.0)),
    )


def _texts() -> rrb.Container:
    return rrb.Tabs(
        rrb.TextDocumentView(origin=NOTES, name="Verdict and key figures"),
        rrb.TextLogView(origin=EVENT_LOG, name="Events in words"),
        rrb.TextDocumentView(origin=SCENARIO, name="Scenario"),
        active_tab=0,
    )


def _scene(looking_at: Array, reach: float) -> rrb.Spatial3DView:
    """The cell; of the path's steps, one a row, those up to the time shown."""
    so_far = rrb.VisibleTimeRange(
        TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=CELL,
        contents=["$origin/**", f"- {MISMATCH}/**"],
        name="Cell: path of the tool on the sphere of the rod (yellow: so far), patches covered so far",
        background=_BACKGROUND,
        eye_controls=rrb.EyeControls3D(
            position=looking_at + reach * _EYE, look_target=looking_at, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={
            PATH_SO_FAR: [rrb.VisibleTimeRanges(so_far)],
            COVERED: [rrb.VisibleTimeRanges(so_far)],
        },
    )


def _residuals(plots: Mapping[str, float], whole: rrb.TimeRange) -> rrb.Container:
    rows = [
        _residual_row(plots, POSITION, "position [um]", whole),
        _residual_row(plots, ANGLE, "angle [urad]", whole),
    ]
    return rrb.Tabs(*rows, active_tab=0)


def _residual_row(
    plots: Mapping[str, float], kind: str, what: str, whole: rrb.TimeRange
) -> rrb.Horizontal:
    before, after = f"{BEFORE}/{kind}", f"{AFTER}/{kind}"
    both = _plot("/residual", f"Residual before and after, {what}", whole, contents=(before, after))
    alone = _plot(after, f"Residual after, {what}", whole, largest=plots[after])
    return rrb.Horizontal(both, alone, name=f"Loop closure: {what}")


def _angles(plots: Mapping[str, float], whole: rrb.TimeRange) -> list[rrb.TimeSeriesView]:
    robot = _plot(JOINTS, "Robot joint angles [deg]", whole)
    return (
        [robot, _plot(ENCODERS, "Ball-bar encoder angles [deg]", whole)]
        if ENCODERS in plots
        else [robot]
    )


def _more(plots: Mapping[str, float], whole: rrb.TimeRange) -> rrb.Container:
    """What only a simulation knows, what the rod does, how the clocks run, what was covered."""
    rod, clock = [], []
    if (forces := _largest(plots, FORCE)) is not None:
        rod.append(_plot(FORCE, "Rod force, tension positive [N]", whole, largest=forces))
    if (strains := _largest(plots, STRAIN)) is not None:
        rod.append(_plot(STRAIN, "Rod strain: how much longer it is [um]", whole, largest=strains))
    if CLOCK_FOUND in plots:
        clock.append(_plot(CLOCK, "Clock offset: robot's minus ball-bar's [ms]", whole))
    if CLOCK_ERROR in plots:
        clock.append(
            _plot(
                CLOCK_ERROR,
                "Error of the identified offset [us]",
                whole,
                largest=plots[CLOCK_ERROR],
            )
        )
    tabs = []
    if TCP_BEFORE in plots:
        alone = _plot(TCP_AFTER, "Of the identified robot alone [um]", whole)
        tabs.append(
            rrb.Horizontal(
                _plot(TCP_ERROR, "TCP error against the truth [um]", whole), alone, name="TCP error"
            )
        )
    tabs += [
        rrb.Horizontal(*views, name=name)
        for name, views in (("Rod", rod), ("Clock", clock))
        if views
    ]
    tabs.append(
        rrb.Horizontal(
            _plot(COVERAGE_SHARE, "Part of the sphere covered [%]", whole), name="Coverage"
        )
    )
    return rrb.Tabs(*tabs, active_tab=0)


def _largest(plots: Mapping[str, float], below: str) -> float | None:
    """Of all curves below an entity."""
    return max((value for entity, value in plots.items() if entity.startswith(below)), default=None)


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5, 10, 20, ...: an axis that ends there has readable marks whatever its height."""
    if value <= 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * min(step for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value))


def _plot(
    origin: str,
    title: str,
    whole: rrb.TimeRange,
    *,
    contents: tuple[str, ...] = ("$origin/**",),
    largest: float | None = None,
) -> rrb.TimeSeriesView:
    """A plot of everything below `origin`; symmetric about zero where the `largest` absolute value is given."""
    end = 1.1 * rounded_up(largest) if largest is not None else None
    return rrb.TimeSeriesView(
        origin=origin,
        contents=list(contents),
        name=title,
        axis_x=rrb.TimeAxis(view_range=whole),
        axis_y=rrb.ScalarAxis(range=(-end, end)) if end else None,
        plot_legend=rrb.Corner2D.RightTop,
    )


def _row(views: list[rrb.TimeSeriesView]) -> rrb.Container:
    return rrb.Horizontal(*views)
