"""The parameters as a picture: change from nominal and uncertainty, one row a parameter.

Drawn in units of a row's height (the viewer's plots have time as their axis, so this is a 2D view).
Left: identified minus nominal, in mm or mrad. Right: two standard deviations either side, in um or
urad, about the error where the truth is known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from ballbar.cell.geometry import parameter_named, table_of_names
from ballbar.replay.blueprint import rounded_up
from ballbar.replay.entities import PARAMETERS
from ballbar.report.colours import AFTER_COLOUR, BEFORE_COLOUR
from ballbar.result.run_data import RunData
from ballbar.units import MM, UM

HALF = 9.0  # [row heights] half the width of each of the two plots
LEFT, RIGHT = 0.0, 24.0  # their middles
NAMES_AT, SIZES_AT = -12.0, 36.5
SIGMAS = 2.0
_RAISED = 0.55  # [rows] the viewer writes a label below its point
_QUIET, _TEXT = (70, 76, 88), (205, 210, 220)


def log_parameters(stream: rr.RecordingStream, data: RunData) -> None:
    """The picture of one run: the robot's rows and the rod, for six axes at least."""
    robot = data.identification.robot
    rows = (*table_of_names(("ra6", *robot.geometry.table.names)).robot, "bd3")
    names = [name for name in rows if name in robot.sigma]
    errors = data.comparison.deviations if data.comparison else {}
    change = np.array([(robot.geometry[n] - robot.nominal[n]) * MM for n in names])
    sigma = np.array([robot.sigma[n] * UM for n in names])
    error = np.array([errors.get(n, 0.0) * UM for n in names])
    change_end = rounded_up(float(np.abs(change).max(initial=0.0)))
    error_end = rounded_up(float((np.abs(error) + SIGMAS * sigma).max(initial=0.0)))
    _log_axes(stream, rows, names, (change_end, error_end), truth=bool(errors))
    at = np.array([float(rows.index(name)) for name in names])
    left = LEFT + HALF / change_end * change
    right, reach = RIGHT + HALF / error_end * error, HALF / error_end * SIGMAS * sigma
    for name, ends, colour, radius in (
        ("change", (np.full(at.size, LEFT), left), BEFORE_COLOUR, 0.14),
        ("interval", (right - reach, right + reach), AFTER_COLOUR, 0.09),
    ):
        strips = np.stack([np.stack((end, at), axis=1) for end in ends], axis=1)
        lines = rr.LineStrips2D(list(strips), colors=[colour], radii=[radius])
        stream.log(f"{PARAMETERS}/values/{name}", lines, static=True)
    points = rr.Points2D(np.column_stack((right, at)), colors=[AFTER_COLOUR], radii=[0.22])
    stream.log(f"{PARAMETERS}/values/identified", points, static=True)
    sizes = []
    for name, deviation in zip(names, sigma, strict=True):
        large, small = units_of(name)
        sizes.append(f"{robot.geometry[name] * MM:.4f} {large} ± {deviation:.1f} {small}")
    _log_labels(stream, "values/sizes", [(SIZES_AT, y) for y in at], sizes)


def units_of(name: str) -> tuple[str, str]:
    """Units in which a parameter's value and its uncertainty are shown."""
    return ("mm", "um") if parameter_named(name).is_length else ("mrad", "urad")


def _log_axes(
    stream: rr.RecordingStream,
    rows: Sequence[str],
    identified: Sequence[str],
    ends: tuple[float, float],
    *,
    truth: bool,
) -> None:
    """Grid, marks and names; ends : of both axes."""
    bottom = len(rows) - 0.3
    marks = [
        (middle + x * HALF, f"{x * end:g}")
        for middle, end in zip((LEFT, RIGHT), ends, strict=True)
        for x in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]
    lines = [[[x, -0.8], [x, bottom]] for x, _ in marks]
    grid = rr.LineStrips2D(lines, colors=[_QUIET], radii=[-0.5])
    stream.log(f"{PARAMETERS}/axes/grid", grid, static=True)
    positions = [(x, bottom + 0.6) for x, _ in marks]
    _log_labels(stream, "axes/ticks", positions, [number for _, number in marks])
    error = "error against the truth" if truth else "uncertainty"
    titles = ["identified minus nominal [mm | mrad]", f"{error}, bars ±2 sigma [um | urad]"]
    _log_labels(stream, "axes/titles", [(LEFT, -2.0), (RIGHT, -2.0)], titles)
    words = [f"{name}{'' if name in identified else ' (nominal)'}" for name in rows]
    _log_labels(stream, "axes/names", [(NAMES_AT, float(k)) for k in range(len(rows))], words)


def _log_labels(
    stream: rr.RecordingStream,
    entity: str,
    positions: Sequence[tuple[float, float]],
    words: Sequence[str],
) -> None:
    raised = [(x, y - _RAISED) for x, y in positions]
    points = rr.Points2D(raised, labels=words, colors=[_TEXT], radii=[0.01], show_labels=True)
    stream.log(f"{PARAMETERS}/{entity}", points, static=True)
