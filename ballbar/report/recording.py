"""Figures about the recording itself, as thesis Figs. 5.2 to 5.5: jitter at rest, stillness of both logs, what is used, clock shift.

Each gives one SVG element; an empty one where the recording has nothing to show (no rest, no encoders).
"""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from acquisition import find_dwells
from ballbar.figure_style import QUIET
from ballbar.replay.marks import Marks, mark_sentences, marks
from ballbar.replay.motion import CellMotion, cell_motion, mechanism_angles
from ballbar.report.figures import AFTER, BEFORE, STYLE, WIDTH, as_svg
from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.geometry import bar_frames, robot_frames

SHIFTS = np.linspace(-0.3, 0.3, 61)  # [s] of the ball-bar's clock, as in thesis Fig. 5.5
_POINTS = 600  # of a log that are drawn, and instants of the shift figure
_JITTER = 150  # rows of the jitter figure
_SPAN = 20.0  # [s] of the stillness figure: an excerpt, as in the thesis
_NEAR = "#b3477a"


def recording_section(data: RunData) -> dict[str, object]:
    """Sentences and figures for the report."""
    motion = cell_motion(data)
    found = marks(data, motion)
    figures = {
        "jitter": jitter_at_rest(data),
        "stillness": stillness_of_both(data),
        "angles": angles_with_marks(data, motion, found),
        "shift": mismatch_over_shift(data),
    }
    return {
        "sentences": mark_sentences(found),
        "figures": {name: figure for name, figure in figures.items() if figure},
    }


def jitter_at_rest(data: RunData) -> str:
    """Angles of both logs while everything stands still, less their mean over the longest rest (Fig. 5.2)."""
    robot, bar = data.recording.robot_log, data.recording.ballbar_log
    sides = [("robot", robot.t, robot.q, BEFORE)]
    if bar is not None:
        sides.append(("ball-bar", bar.t, bar.angles, AFTER))
    rests = [_longest_rest(t, angles) for _, t, angles, _ in sides]
    if any(rest is None for rest in rests):
        return ""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 1.5 * len(sides) + 0.4))
        panels = np.atleast_1d(figure.subplots(len(sides), 1))
        for axes, (name, t, angles, colour), rest in zip(panels, sides, rests, strict=True):
            assert rest is not None
            rows = slice(rest[0], min(rest[1] + 1, rest[0] + _JITTER))
            axes.plot(
                t[rows],
                (angles[rows] - angles[rows].mean(axis=0)) * 1e6,
                color=colour,
                linewidth=0.5,
            )
            axes.set(ylabel=f"{name} [µrad]", xlim=(t[rows][0], t[rows][-1]))
        panels[-1].set_xlabel("time on each log's own clock [s]")
        return as_svg(figure)


def _longest_rest(t: Array, angles: Array) -> tuple[int, int] | None:
    intervals = find_dwells(t, angles).intervals
    if not len(intervals):
        return None
    first, last = intervals[int(np.argmax(t[intervals[:, 1]] - t[intervals[:, 0]]))]
    return int(first), int(last)


def stillness_of_both(data: RunData) -> str:
    """When each log stands still, on one clock, around a rest in the middle of the run (Fig. 5.3)."""
    robot, bar, clock = (
        data.recording.robot_log,
        data.recording.ballbar_log,
        data.identification.clock,
    )
    if bar is None or clock is None:
        return ""
    still = find_dwells(robot.t, robot.q).standing, find_dwells(bar.t, bar.angles).standing
    inner = robot.t[still[0] & (robot.t > 0.1 * robot.t[-1]) & (robot.t < 0.9 * robot.t[-1])]
    middle = (
        float(inner[np.abs(inner - inner.mean()).argmin()])
        if inner.size
        else 0.5 * float(robot.t[-1])
    )  # within a rest
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 1.9))
        axes = figure.subplots()
        axes.step(robot.t, still[0].astype(float), where="mid", color=BEFORE, label="robot")
        axes.step(
            clock.robot_time(bar.t),
            -still[1].astype(float),
            where="mid",
            color=AFTER,
            label="ball-bar",
        )
        axes.set(
            xlim=(middle - _SPAN / 2, middle + _SPAN / 2),
            ylim=(-1.2, 1.2),
            xlabel="time on the robot's clock [s]",
        )
        axes.set_yticks([-1, 0, 1], ["still", "moving", "still"])
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        return as_svg(figure)


def angles_with_marks(data: RunData, motion: CellMotion, found: Marks) -> str:
    """Robot and ball-bar angles over the whole log; what the fit uses is between the lines (Fig. 5.4)."""
    result, bar = data.identification, data.recording.ballbar_log
    used = result.after.t if result.clock is None else result.clock.robot_time(result.after.t)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 4.1))
        panels = figure.subplots(2, 1, sharex=True)
        rows = slice(None, None, max(1, motion.t.size // _POINTS))
        panels[0].plot(
            motion.t[rows],
            motion.q[rows],
            linewidth=0.7,
            label=[f"q{j + 1}" for j in range(motion.q.shape[1])],
        )
        panels[0].set_ylabel("robot joints [rad]")
        if bar is not None and result.clock is not None:
            rows = slice(None, None, max(1, bar.t.size // _POINTS))
            angles = mechanism_angles(result, bar)[rows]
            panels[1].plot(
                result.clock.robot_time(bar.t[rows]),
                angles,
                linewidth=0.7,
                label=[f"b{j}" for j in bar.joints],
            )
        panels[1].set(ylabel="ball-bar joints [rad]", xlabel="time on the robot's clock [s]")
        for axes in panels:
            if axes.lines:
                axes.legend(
                    loc="lower left",
                    bbox_to_anchor=(0.0, 1.0),
                    ncols=6,
                    handlelength=0.9,
                    columnspacing=0.9,
                    fontsize=7,
                )
            for begin, end in found.rests:
                axes.axvspan(begin, end, color=QUIET, alpha=0.18, linewidth=0)
            for name, spans in found.near_singular.items():
                if name.startswith("ball-bar"):
                    for begin, end in spans:
                        axes.axvspan(begin, end, color=_NEAR, alpha=0.25, linewidth=0)
            _limits(axes, float(used[0]), float(used[-1]))
        return as_svg(figure)


def _limits(axes: Axes, first: float, last: float) -> None:
    for t in (first, last):
        axes.axvline(t, color=AFTER, linestyle="--", linewidth=1.0)


def mismatch_over_shift(data: RunData) -> str:
    """Distance between the ends of robot and ball-bar when the clocks are shifted against each other (Fig. 5.5)."""
    curve = shift_curve(data)
    if curve is None:
        return ""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 2.2))
        axes = figure.subplots()
        axes.plot(SHIFTS * 1e3, curve * 1e3, color=AFTER)
        axes.set(
            xlabel="shift of the ball-bar's clock [ms]",
            ylabel="mismatch, rms [mm]",
            ylim=(0.0, None),
            xlim=(-300, 300),
        )
        return as_svg(figure)


def shift_curve(data: RunData) -> Array | None:
    """(61,) [m] rms distance at each of SHIFTS; None without encoders of b1 and b2, which place the rod's end."""
    result, robot, bar = data.identification, data.recording.robot_log, data.recording.ballbar_log
    if bar is None or result.clock is None or not {1, 2} <= set(bar.joints):
        return None
    t = result.after.t[:: max(1, result.after.t.size // _POINTS)]
    t = t[
        (result.clock.robot_time(t + SHIFTS[0]) > 0.0)
        & (result.clock.robot_time(t + SHIFTS[-1]) < robot.t[-1])
    ]
    if t.size < 2:
        return None
    b = np.zeros((t.size, 5))
    for column, (joint, sign) in enumerate(zip(bar.joints, result.signs, strict=True)):
        b[:, joint - 1] = np.interp(t, bar.t, bar.angles[:, column]) * sign
    end = bar_frames(result.geometry, b).tip  # of the rod: b3 to b5 turn about it
    out = []
    for shift in SHIFTS:
        at = result.clock.robot_time(t + shift)
        q = np.stack([np.interp(at, robot.t, column) for column in robot.q.T], axis=1)
        out.append(
            float(np.sqrt(((robot_frames(result.geometry, q).tip - end) ** 2).sum(axis=0).mean()))
        )
    return np.array(out)
