"""The parameters as a picture: what each changed by, and how far it is known, with error bars. One row a parameter, always the same.

Drawn in units of a row's height (the viewer's plots have time as their axis, so this is a 2D view). Left: identified minus
nominal, in mm or mrad. Right: two standard deviations either side, in um or urad, about the error where the truth is known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from ballbar.replay_layout import GREEN, PARAMETER_AXES, PARAMETER_VALUES, RED, Colour, rounded_up
from ballbar.run_data import RunData
from cell.chain import Array
from cell.geometry import INDEX, PARAMETERS
from ident.identify import Identification

ROWS = tuple(p.name for p in PARAMETERS if (p.side == "robot" and p.kind != "beta") or p.name == "bd3")
HALF = 9.0  # [row heights] half the width of each of the two plots
LEFT, RIGHT = 0.0, 24.0  # their middles
NAMES_AT, SIZES_AT = -12.0, 36.5
SIGMAS = 2.0
_QUIET, _TEXT = (70, 76, 88), (205, 210, 220)


def log_parameters(stream: rr.RecordingStream, data: RunData) -> None:
    """Writes axes and values."""
    result = data.identification
    errors = data.comparison.deviations if data.comparison else {}
    named = [name for name in ROWS if name in result.sigma]
    moved = {name: (result.geometry[name] - result.nominal[name]) * 1e3 for name in named}
    spread = {name: SIGMAS * result.sigma[name] * 1e6 for name in named}
    off = {name: errors.get(name, 0.0) * 1e6 for name in named}
    ends = rounded_up(max(map(abs, moved.values()), default=1.0)), rounded_up(max((abs(off[n]) + spread[n] for n in named), default=1.0))
    _log_axes(stream, result, ends, with_truth=bool(errors))
    rows = np.array([float(ROWS.index(name)) for name in named])
    left = LEFT + HALF / ends[0] * np.array([moved[n] for n in named])
    right = RIGHT + HALF / ends[1] * np.array([off[n] for n in named])
    reach = HALF / ends[1] * np.array([spread[n] for n in named])
    _strips(stream, "change", np.stack((np.full(rows.size, LEFT), rows, left, rows), axis=1), RED, 0.14)
    _strips(stream, "interval", np.stack((right - reach, rows, right + reach, rows), axis=1), GREEN, 0.09)
    points = rr.Points2D(np.column_stack((right, rows)), colors=[GREEN], radii=[0.22])
    stream.log(f"{PARAMETER_VALUES}/identified", points, static=True)
    sizes = [f"{result.geometry[n] * 1e3:.4f} {_large(n)} ± {result.sigma[n] * 1e6:.1f} {_small(n)}" for n in named]
    _labels(stream, f"{PARAMETER_VALUES}/sizes", [(SIZES_AT, row) for row in rows], sizes, _TEXT)


def _large(name: str) -> str:
    return "mm" if PARAMETERS[INDEX[name]].is_length else "mrad"


def _small(name: str) -> str:
    return "um" if PARAMETERS[INDEX[name]].is_length else "urad"


def _log_axes(stream: rr.RecordingStream, result: Identification, ends: tuple[float, float], *, with_truth: bool) -> None:
    bottom, lines = len(ROWS) - 0.3, []
    for middle in (LEFT, RIGHT):
        lines += [[[middle + x * HALF, -0.8], [middle + x * HALF, bottom]] for x in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    stream.log(f"{PARAMETER_AXES}/grid", rr.LineStrips2D(lines, colors=[_QUIET], radii=[-0.5]), static=True)
    marks = (-1.0, -0.5, 0.0, 0.5, 1.0)
    ticks = [(m + x * HALF, bottom + 0.6, f"{x * e:g}") for m, e in zip((LEFT, RIGHT), ends, strict=True) for x in marks]
    _labels(stream, f"{PARAMETER_AXES}/ticks", [t[:2] for t in ticks], [t[2] for t in ticks], _TEXT)
    error = "error against the truth" if with_truth else "uncertainty"
    titles = ["identified minus nominal [mm | mrad]", f"{error}, bars ±2 sigma [um | urad]"]
    _labels(stream, f"{PARAMETER_AXES}/titles", [(LEFT, -2.0), (RIGHT, -2.0)], titles, _TEXT)
    left = [f"{name}{'' if name in result.sigma else ' (nominal)'}" for name in ROWS]
    _labels(stream, f"{PARAMETER_AXES}/names", [(NAMES_AT, float(k)) for k in range(len(ROWS))], left, _TEXT)


def _strips(stream: rr.RecordingStream, name: str, ends: Array, colour: Colour, radius: float) -> None:
    """Bars; ends : (R, 4) x y of either end."""
    if len(ends):
        bars = rr.LineStrips2D(list(ends.reshape(-1, 2, 2)), colors=[colour], radii=[radius])
        stream.log(f"{PARAMETER_VALUES}/{name}", bars, static=True)


def _labels(stream: rr.RecordingStream, entity: str, places: Sequence[Sequence[float]], words: Sequence[str], colour: Colour) -> None:
    if words:
        points = rr.Points2D(places, labels=words, colors=[colour], radii=[0.01], show_labels=True)
        stream.log(entity, points, static=True)
