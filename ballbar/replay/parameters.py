"""The parameters as a picture: what each changed by, and how far it is known, with error bars. One row a parameter, always the same.

Drawn in units of a row's height (the viewer's plots have time as their axis, so this is a 2D view). Left: identified minus
nominal, in mm or mrad. Right: two standard deviations either side, in um or urad, about the error where the truth is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from ballbar.replay.entities import (
    GREEN,
    PARAMETER_AXES,
    PARAMETER_TABLE,
    PARAMETER_VALUES,
    RED,
    Colour,
    rounded_up,
)
from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.geometry import INDEX, PARAMETERS

ROWS = tuple(
    p.name for p in PARAMETERS if (p.side == "robot" and p.kind != "beta") or p.name == "bd3"
)
HALF = 9.0  # [row heights] half the width of each of the two plots
LEFT, RIGHT = 0.0, 24.0  # their middles
NAMES_AT, SIZES_AT = -12.0, 36.5
SIGMAS = 2.0
_RAISED = 0.55  # [rows]
_QUIET, _TEXT = (70, 76, 88), (205, 210, 220)


@dataclass(frozen=True, eq=False)
class ParameterTable:
    """What the picture shows of one run; K parameters that were identified."""

    names: tuple[str, ...]  # (K,)
    moved: Array  # (K,) [mm, mrad] identified minus nominal
    sigma: Array  # (K,) [um, urad]
    error: Array  # (K,) [um, urad] identified minus true; 0 where nobody knows the truth
    has_truth: bool

    @property
    def ends(self) -> tuple[float, float]:
        """Where the two axes must end at least."""
        return float(np.abs(self.moved).max(initial=0.0)), float(
            (np.abs(self.error) + SIGMAS * self.sigma).max(initial=0.0)
        )


def parameter_table(data: RunData) -> ParameterTable:
    """The table of one run."""
    result = data.identification
    errors = data.comparison.deviations if data.comparison else {}
    names = tuple(name for name in ROWS if name in result.sigma)
    return ParameterTable(
        names,
        np.array([(result.geometry[n] - result.nominal[n]) * 1e3 for n in names]),
        np.array([result.sigma[n] * 1e6 for n in names]),
        np.array([errors.get(n, 0.0) * 1e6 for n in names]),
        bool(errors),
    )


def log_parameters(stream: rr.RecordingStream, data: RunData) -> None:
    """The picture of one run, and its table, for whoever compares."""
    table, result = parameter_table(data), data.identification
    log_axes(stream, [table])
    log_values(stream, PARAMETER_VALUES, table, table.ends, (RED, GREEN))
    sizes = [
        f"{result.geometry[n] * 1e3:.4f} {_large(n)} ± {result.sigma[n] * 1e6:.1f} {_small(n)}"
        for n in table.names
    ]
    _labels(
        stream,
        f"{PARAMETER_VALUES}/sizes",
        [(SIZES_AT, float(ROWS.index(n))) for n in table.names],
        sizes,
    )
    columns = {
        "names": list(table.names),
        "moved": table.moved,
        "sigma": table.sigma,
        "error": table.error,
    }
    stream.log(
        PARAMETER_TABLE,
        rr.AnyValues(drop_untyped_nones=True, has_truth=[table.has_truth], **columns),
        static=True,
    )


def read_table(chunk: Chunk) -> ParameterTable:
    """The table that a replay holds at PARAMETER_TABLE."""
    batch = chunk.to_record_batch()
    found = {
        name: batch.column(name)[0].as_py()
        for name in ("names", "moved", "sigma", "error", "has_truth")
    }
    moved, sigma, error = (
        np.array(found[name], dtype=float) for name in ("moved", "sigma", "error")
    )
    return ParameterTable(tuple(found["names"]), moved, sigma, error, bool(found["has_truth"][0]))


def common_ends(tables: Sequence[ParameterTable]) -> tuple[float, float]:
    """Ends of the two axes that suit all tables."""
    left, right = (max(table.ends[k] for table in tables) for k in (0, 1))
    return rounded_up(left), rounded_up(right)


def log_values(
    stream: rr.RecordingStream,
    entity: str,
    table: ParameterTable,
    ends: tuple[float, float],
    colours: tuple[Colour, Colour],
    *,
    lower: float = 0.0,
) -> None:
    """Changes and error bars; ends : of the axes, as they are drawn; lower : [rows] so much below the middle of each row."""
    ends = rounded_up(ends[0]), rounded_up(ends[1])
    rows = np.array([ROWS.index(name) + lower for name in table.names])
    left, right = LEFT + HALF / ends[0] * table.moved, RIGHT + HALF / ends[1] * table.error
    reach = HALF / ends[1] * SIGMAS * table.sigma
    _strips(
        stream,
        f"{entity}/change",
        np.stack((np.full(rows.size, LEFT), rows, left, rows), axis=1),
        colours[0],
        0.14,
    )
    _strips(
        stream,
        f"{entity}/interval",
        np.stack((right - reach, rows, right + reach, rows), axis=1),
        colours[1],
        0.09,
    )
    points = rr.Points2D(np.column_stack((right, rows)), colors=[colours[1]], radii=[0.22])
    stream.log(f"{entity}/identified", points, static=True)


def _large(name: str) -> str:
    return "mm" if PARAMETERS[INDEX[name]].is_length else "mrad"


def _small(name: str) -> str:
    return "um" if PARAMETERS[INDEX[name]].is_length else "urad"


def log_axes(stream: rr.RecordingStream, tables: Sequence[ParameterTable]) -> None:
    """Grid, marks and names for one run or several."""
    ends, bottom, lines = common_ends(tables), len(ROWS) - 0.3, []
    marks = (-1.0, -0.5, 0.0, 0.5, 1.0)
    for middle in (LEFT, RIGHT):
        lines += [[[middle + x * HALF, -0.8], [middle + x * HALF, bottom]] for x in marks]
    stream.log(
        f"{PARAMETER_AXES}/grid", rr.LineStrips2D(lines, colors=[_QUIET], radii=[-0.5]), static=True
    )
    ticks = [
        (m + x * HALF, bottom + 0.6, f"{x * e:g}")
        for m, e in zip((LEFT, RIGHT), ends, strict=True)
        for x in marks
    ]
    _labels(stream, f"{PARAMETER_AXES}/ticks", [t[:2] for t in ticks], [t[2] for t in ticks])
    error = "error against the truth" if all(table.has_truth for table in tables) else "uncertainty"
    titles = ["identified minus nominal [mm | mrad]", f"{error}, bars ±2 sigma [um | urad]"]
    _labels(stream, f"{PARAMETER_AXES}/titles", [(LEFT, -2.0), (RIGHT, -2.0)], titles)
    found = {name for table in tables for name in table.names}
    words = [f"{name}{'' if name in found else ' (nominal)'}" for name in ROWS]
    _labels(
        stream, f"{PARAMETER_AXES}/names", [(NAMES_AT, float(k)) for k in range(len(ROWS))], words
    )


def _strips(
    stream: rr.RecordingStream, entity: str, ends: Array, colour: Colour, radius: float
) -> None:
    """Bars; ends : (R, 4) x y of either end."""
    if len(ends):
        stream.log(
            entity,
            rr.LineStrips2D(list(ends.reshape(-1, 2, 2)), colors=[colour], radii=[radius]),
            static=True,
        )


def _labels(
    stream: rr.RecordingStream, entity: str, places: Sequence[Sequence[float]], words: Sequence[str]
) -> None:
    """The viewer writes a label below its point, so the points are raised."""
    if words:
        raised = [(place[0], place[1] - _RAISED) for place in places]
        stream.log(
            entity,
            rr.Points2D(raised, labels=words, colors=[_TEXT], radii=[0.01], show_labels=True),
            static=True,
        )
