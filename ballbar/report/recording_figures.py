"""Figures of a recording: its logs as thesis Figs. 5.2 to 5.5, residuals and forces over time.

Jitter in a dwell, dwells of both logs, what the fit uses, and the clock shift. Each gives one SVG
element; an empty one where the recording has nothing to show (no dwell, no encoders).
"""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ballbar.acquisition.dwells import find_dwells
from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.cell.logs import RobotLog
from ballbar.cell.statistics import rms
from ballbar.figure_style import AFTER, BEFORE, INK, LINES, PURPLE, QUIET
from ballbar.report.drawing import INCH
from ballbar.report.line_plot import Curve, Plot, draw
from ballbar.report.motion import CellMotion, Marks, mechanism_angles, on_robot_clock
from ballbar.result.run_data import FittedRecording
from ballbar.units import MM, MS, URAD

SHIFTS = np.linspace(-0.3, 0.3, 61)  # [s] of the ball-bar's clock, as in thesis Fig. 5.5
_POINTS = 600  # rows of a log that are drawn, and instants of the shift figure
_JITTER = 150  # rows of the jitter figure
_SPAN = 20.0  # [s] of the figure of dwells: an excerpt, as in the thesis
_HISTOGRAM_HALF_WIDTH = 5.0  # standard deviations; wider where the residuals are
_BINS = 50
_RESIDUALS = "#8fb4d9"


def log_figures(
    fitted: FittedRecording, motion: CellMotion, passed: Marks
) -> list[tuple[Markup, str]]:
    """Figures with their captions, without empty ones."""
    sensed = fitted.recording.length_log is not None
    figures = {
        f"Angles of {'the robot in its' if sensed else 'both logs in their'} longest dwell, less "
        "their mean.": jitter_in_dwell(fitted),
        "Dwells of each log, on one clock (excerpt).": dwells_of_both(fitted),
        "Both logs: the fit uses what lies between the dashed lines; grey in a dwell of the robot."
        if sensed
        else "Angles over the whole log: the fit uses what lies between the dashed lines; grey in "
        "a dwell, purple near a singular pose of the ball-bar.": angles_with_marks(
            fitted, motion, passed
        ),
        "Distance between the ends of robot and ball-bar when their clocks are shifted against "
        "each other.": error_over_shift(fitted),
    }
    return [(svg, caption) for caption, svg in figures.items() if svg]


def jitter_in_dwell(fitted: FittedRecording) -> Markup:
    """Angles of both logs in their longest dwell, less their mean over it (thesis Fig. 5.2)."""
    robot, ballbar = fitted.recording.robot_log, fitted.recording.ballbar_log
    logs = [("robot", robot.t, robot.q, BEFORE)]
    if ballbar is not None:
        logs.append(("ball-bar", ballbar.t, ballbar.angles, AFTER))
    dwells = [rows for _, t, q, _ in logs if (rows := _longest_dwell(t, q)) is not None]
    if len(dwells) < len(logs):
        return Markup()
    plots = []
    for (name, t, angles, colour), rows in zip(logs, dwells, strict=True):
        jitter = (angles[rows] - angles[rows].mean(axis=0)) * URAD
        curves = [Curve(t[rows], column, colour, width=0.5) for column in jitter.T]
        plots.append(Plot(curves, f"{name} [µrad]"))
    return draw(plots, "time on each log's own clock [s]", height=(1.5 * len(logs) + 0.4) * INCH)


def _longest_dwell(t: Array, angles: Array) -> slice | None:
    """The first rows of the longest dwell of a log, t (N,) [s], angles (N, C) [rad]."""
    intervals = find_dwells(t, angles).intervals
    if not len(intervals):
        return None
    first, last = intervals[int(np.argmax(t[intervals[:, 1]] - t[intervals[:, 0]]))]
    return slice(int(first), int(min(last + 1, first + _JITTER)))


def dwells_of_both(fitted: FittedRecording) -> Markup:
    """Dwells of each log, on one clock, around the middle of the run (thesis Fig. 5.3)."""
    robot, ballbar = fitted.recording.robot_log, fitted.recording.ballbar_log
    clock = fitted.estimate.clock
    if ballbar is None or clock is None:
        return Markup()
    robot_dwells = find_dwells(robot.t, robot.q).standing
    ballbar_dwells = find_dwells(ballbar.t, ballbar.angles).standing
    inner = (robot.t > 0.1 * robot.t[-1]) & (robot.t < 0.9 * robot.t[-1])
    instants, middle = robot.t[robot_dwells & inner], 0.5 * float(robot.t[-1])
    if instants.size:
        middle = float(instants[np.abs(instants - instants.mean()).argmin()])  # in a dwell
    curves = [
        Curve(*_steps(t, level), colour, name)
        for name, t, level, colour in (
            ("robot", robot.t, robot_dwells.astype(float), BEFORE),
            ("ball-bar", clock.robot_time(ballbar.t), -ballbar_dwells.astype(float), AFTER),
        )
    ]
    words = {-1.0: "dwell", 0.0: "motion", 1.0: "dwell"}
    return draw(
        [Plot(curves, "", y=(-1.2, 1.2), names=words)],
        "time on the robot's clock [s]",
        height=1.9 * INCH,
        x=(middle - _SPAN / 2, middle + _SPAN / 2),
        legend=True,
    )


def _steps(t: Array, level: Array) -> tuple[Array, Array]:
    """Corners of a level (N,) over t (N,) [s] that changes midway between two rows."""
    change = np.flatnonzero(np.diff(level))
    at = 0.5 * (t[change] + t[change + 1])
    levels = np.r_[level[change], level[-1]]
    return np.r_[t[0], np.repeat(at, 2), t[-1]], np.repeat(levels, 2)


def angles_with_marks(fitted: FittedRecording, motion: CellMotion, passed: Marks) -> Markup:
    """Robot and ball-bar angles over the whole log; the fit's part between lines (Fig. 5.4).

    The sensed length where there is one in place of the ball-bar's angles.
    """
    estimate, ballbar = fitted.estimate, fitted.recording.ballbar_log
    length = fitted.recording.length_log
    used = on_robot_clock(estimate, estimate.after.t)
    shaded = [(*span, QUIET, 0.18) for span in passed.dwells]
    for name, stretches in passed.near_singular.items():
        if name.startswith("ball-bar"):
            shaded += [(*span, PURPLE, 0.25) for span in stretches]
    lines = float(used[0]), float(used[-1])

    def plot(t: Array, angles: Array, names: list[str], label: str) -> Plot:
        rows = slice(None, None, max(1, t.size // _POINTS))
        curves = [
            Curve(t[rows], column[rows], LINES[k % len(LINES)], name, width=0.7)
            for k, (column, name) in enumerate(zip(angles.T, names, strict=True))
        ]
        return Plot(curves, label, legend=True, spans=shaded, lines=lines)

    joints = [f"q{j + 1}" for j in range(motion.q.shape[1])]
    plots = [plot(motion.t, motion.q, joints, "robot joints [rad]")]
    if ballbar is not None:
        angles, joints = mechanism_angles(estimate, ballbar), [f"b{j}" for j in ballbar.joints]
        times = on_robot_clock(estimate, ballbar.t)
        plots.append(plot(times, angles, joints, "ball-bar joints [rad]"))
    if length is not None:
        times, sensed = on_robot_clock(estimate, length.t), length.length[:, None] * MM
        plots.append(plot(times, sensed, ["length"], "sensed length [mm]"))
    x = float(motion.t[0]), float(motion.t[-1])
    return draw(plots, "time on the robot's clock [s]", height=2.05 * len(plots) * INCH, x=x)


def error_over_shift(fitted: FittedRecording) -> Markup:
    """Distance between the ends of robot and ball-bar over a shift of the clock (Fig. 5.5)."""
    curve = shift_curve(fitted)
    if curve is None:
        return Markup()
    plot = Plot(
        [Curve(SHIFTS * MS, curve * MM, AFTER)],
        "loop-closure error,\nrms [mm]",
        y=(0.0, 1.05 * float(curve.max()) * MM),
    )
    ends = float(SHIFTS[0] * MS), float(SHIFTS[-1] * MS)
    return draw([plot], "shift of the ball-bar's clock [ms]", height=2.2 * INCH, x=ends)


def shift_curve(fitted: FittedRecording) -> Array | None:
    """(61,) [m] rms distance at each of SHIFTS.

    None without encoders b1 and b2, which give the direction of the rod.
    """
    estimate, robot = fitted.estimate, fitted.recording.robot_log
    ballbar, clock = fitted.recording.ballbar_log, fitted.estimate.clock
    if ballbar is None or clock is None or not {1, 2} <= set(ballbar.joints):
        return None
    t = estimate.after.t[:: max(1, estimate.samples // _POINTS)]
    first, last = clock.robot_time(t + SHIFTS[0]), clock.robot_time(t + SHIFTS[-1])
    t = t[(first > 0.0) & (last < robot.t[-1])]
    if t.size < 2:
        return None
    b = np.zeros((t.size, 5))  # b3 to b5 turn about the rod's end
    for column, (joint, sign) in enumerate(zip(ballbar.joints, estimate.directions, strict=True)):
        b[:, joint - 1] = np.interp(t, ballbar.t, ballbar.angles[:, column]) * sign
    end = bar_frames(estimate.geometry, b).tip
    times = (clock.robot_time(t + shift) for shift in SHIFTS)
    return np.array([_rms_apart(robot, at, estimate.geometry, end) for at in times])


def _rms_apart(robot: RobotLog, t: Array, geometry: Geometry, end: Array) -> float:
    """[m] rms distance of the tool at times t (N,) [s] of the robot's log from points (3, N)."""
    q = np.stack([np.interp(t, robot.t, column) for column in robot.q.T], axis=1)
    return rms(np.linalg.norm(robot_frames(geometry, q).tip - end, axis=0))


def norms_over_time(t: Array, before: Array, after: Array, *, label: str, clock: str) -> Markup:
    """Norms of residuals before and after (N, 3), in the unit of `label`, on a logarithmic axis.

    t : (N,) [s] on the clock named `clock`.
    """
    curves = []
    for values, colour, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
        norm = np.linalg.norm(values, axis=1)
        curves.append(Curve(t, np.where(norm > 0.0, norm, np.nan), colour, name))
    plot = Plot(curves, label, y=_log_ends(curves), log=True)
    return draw([plot], _time(clock), height=2.9 * INCH, x=_span(t), legend=True)


def components_over_time(t: Array, values: Array, *, label: str, clock: str) -> Markup:
    """Three residual components (N, 3) after the fit, in the unit of `label`, on one scale.

    t : (N,) [s] on the clock named `clock`.
    """
    largest = 1.05 * float(np.abs(values).max()) or 1.0
    plots = [
        Plot(
            [Curve(t, column, AFTER, name, width=0.8)],
            name,
            y=(-largest, largest),
            upright=True,
            zero=True,
        )
        for column, name in zip(values.T, "xyz", strict=True)
    ]
    return draw(plots, _time(clock), height=3.5 * INCH, x=_span(t), title=label)


def tension_over_time(t: Array, tension: Array, *, clock: str) -> Markup:
    """Force in the rod (N,) [N], tension positive, at t (N,) [s] on the clock named `clock`."""
    plot = Plot([Curve(t, tension, AFTER)], "force in the rod [N]", zero=True)
    return draw([plot], _time(clock), height=2.4 * INCH, x=_span(t))


def whitened_histogram(whitened: Array) -> Markup:
    """Whitened residuals (E, N), with the unit normal curve that they should follow."""
    values = whitened.ravel()
    half = max(_HISTOGRAM_HALF_WIDTH, float(np.ceil(np.quantile(np.abs(values), 0.999))))
    density, edges = np.histogram(values, np.linspace(-half, half, _BINS + 1), density=True)
    x = np.linspace(-half, half, 201)
    normal = np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi)
    curves = [
        Curve(
            np.repeat(edges, 2)[1:-1],
            np.repeat(density, 2),
            _RESIDUALS,
            "residuals after",
            filled=True,
        ),
        Curve(x, normal, INK, "unit normal", width=1.4),
    ]
    top = 1.08 * max(float(density.max()), float(normal.max()))
    outside = f"{int((np.abs(values) > half).sum())} of {values.size} beyond ±{half:g}"
    plot = Plot(curves, "density", y=(0.0, top), note=outside)
    label = "whitened residual [standard deviations]"
    return draw([plot], label, height=2.9 * INCH, x=(-half, half), legend=True)


def _time(clock: str) -> str:
    return f"time on the {clock} clock [s]"


def _span(t: Array) -> tuple[float, float]:
    return float(t[0]), float(t[-1])


def _log_ends(curves: list[Curve]) -> tuple[float, float] | None:
    """Ends of the logarithmic axis: a norm that passes through zero would stretch it."""
    after = curves[-1].y[np.isfinite(curves[-1].y)]
    largest = max(float(np.nanmax(c.y, initial=0.0)) for c in curves)
    if not after.size or largest <= 0.0:
        return None
    return float(np.quantile(after, 0.02)) / 2.0, 1.3 * largest
