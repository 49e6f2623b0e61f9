"""The parameters as a picture: change from nominal and uncertainty, one row a parameter.

Drawn in units of a row's height (the viewer's plots have time as their axis, so this is a 2D view).
Left: identified minus nominal, in mm or mrad. Right: two standard deviations either side, in um or
urad, about the error where the truth is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from ballbar.replay.blueprint import rounded_up
from ballbar.replay.colours import AFTER_COLOUR, BEFORE_COLOUR, Colour
from ballbar.replay.entities import PARAMETER_AXES, PARAMETER_TABLE, PARAMETER_VALUES
from ballbar.result.run_data import RunData
from ballbar.units import MM, UM
from cell.arrays import Array
from cell.geometry import parameter_named, table_of_names

HALF = 9.0  # [row heights] half the width of each of the two plots
LEFT, RIGHT = 0.0, 24.0  # their middles
NAMES_AT, SIZES_AT = -12.0, 36.5
SIGMAS = 2.0
_RAISED = 0.55  # [rows] the viewer writes a label below its point
_QUIET, _TEXT = (70, 76, 88), (205, 210, 220)


@dataclass(frozen=True, eq=False)
class ParameterTable:
    """What the picture shows of one run; K parameters that were identified."""

    names: tuple[str, ...]  # (K,)
    moved: Array  # (K,) [mm, mrad] identified minus nominal
    sigma: Array  # (K,) [um, urad]
    error: Array  # (K,) [um, urad] identified minus true; 0 where the truth is not known
    has_truth: bool

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest ends of the two axes that show everything."""
        reach = np.abs(self.error) + SIGMAS * self.sigma
        return float(np.abs(self.moved).max(initial=0.0)), float(reach.max(initial=0.0))


def parameter_table(data: RunData) -> ParameterTable:
    """The table of one run."""
    robot = data.identification.robot
    errors = data.comparison.deviations if data.comparison else {}
    names = tuple(name for name in rows_of(robot.geometry.table.names) if name in robot.sigma)
    return ParameterTable(
        names=names,
        moved=np.array([(robot.geometry[n] - robot.nominal[n]) * MM for n in names]),
        sigma=np.array([robot.sigma[n] * UM for n in names]),
        error=np.array([errors.get(n, 0.0) * UM for n in names]),
        has_truth=bool(errors),
    )


def rows_of(names: Iterable[str]) -> tuple[str, ...]:
    """The robot's rows and the rod, for as many axes, six at least, as the names have."""
    return (*table_of_names(("ra6", *names)).robot, "bd3")


def log_parameters(stream: rr.RecordingStream, data: RunData) -> None:
    """The picture of one run, and its table, for a comparison."""
    table, robot = parameter_table(data), data.identification.robot
    log_axes(stream, [table])
    log_values(stream, PARAMETER_VALUES, table, table.ends, (BEFORE_COLOUR, AFTER_COLOUR))
    sizes = []
    for name, sigma in zip(table.names, table.sigma, strict=True):
        large, small = units_of(name)
        sizes.append(f"{robot.geometry[name] * MM:.4f} {large} ± {sigma:.1f} {small}")
    rows = rows_of(table.names)
    positions = [(SIZES_AT, float(rows.index(name))) for name in table.names]
    _labels(stream, f"{PARAMETER_VALUES}/sizes", positions, sizes)
    values = rr.AnyValues(
        drop_untyped_nones=True,
        has_truth=[table.has_truth],
        names=list(table.names),
        moved=table.moved,
        sigma=table.sigma,
        error=table.error,
    )
    stream.log(PARAMETER_TABLE, values, static=True)


def units_of(name: str) -> tuple[str, str]:
    """Units in which a parameter's value and its uncertainty are shown."""
    return ("mm", "um") if parameter_named(name).is_length else ("mrad", "urad")


def read_table(chunk: Chunk) -> ParameterTable:
    """The table that a replay holds at PARAMETER_TABLE."""
    batch = chunk.to_record_batch()
    names, truth = (batch.column(name)[0].as_py() for name in ("names", "has_truth"))
    numbers = (batch.column(name)[0].as_py() for name in ("moved", "sigma", "error"))
    moved, sigma, error = (np.array(column, dtype=float) for column in numbers)
    return ParameterTable(
        names=tuple(names), moved=moved, sigma=sigma, error=error, has_truth=bool(truth[0])
    )


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
    """Changes and error bars.

    ends : of the two axes, before rounding up. lower : [rows] below the middle of each row.
    """
    left_end, right_end = (rounded_up(end) for end in ends)
    every = rows_of(table.names)
    rows = np.array([every.index(name) + lower for name in table.names])
    left = LEFT + HALF / left_end * table.moved
    right = RIGHT + HALF / right_end * table.error
    reach = HALF / right_end * SIGMAS * table.sigma
    changes = np.stack((np.full(rows.size, LEFT), rows, left, rows), axis=1)
    intervals = np.stack((right - reach, rows, right + reach, rows), axis=1)
    for name, bars, colour, radius in (
        ("change", changes, colours[0], 0.14),
        ("interval", intervals, colours[1], 0.09),
    ):
        if rows.size:
            strips = list(bars.reshape(-1, 2, 2))
            lines = rr.LineStrips2D(strips, colors=[colour], radii=[radius])
            stream.log(f"{entity}/{name}", lines, static=True)
    points = rr.Points2D(np.column_stack((right, rows)), colors=[colours[1]], radii=[0.22])
    stream.log(f"{entity}/identified", points, static=True)


def log_axes(stream: rr.RecordingStream, tables: Sequence[ParameterTable]) -> None:
    """Grid, marks and names for one run or several."""
    rows = rows_of(name for table in tables for name in table.names)
    ends, bottom = common_ends(tables), len(rows) - 0.3
    marks = [
        (middle + x * HALF, f"{x * end:g}")
        for middle, end in zip((LEFT, RIGHT), ends, strict=True)
        for x in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]
    lines = [[[x, -0.8], [x, bottom]] for x, _ in marks]
    grid = rr.LineStrips2D(lines, colors=[_QUIET], radii=[-0.5])
    stream.log(f"{PARAMETER_AXES}/grid", grid, static=True)
    positions = [(x, bottom + 0.6) for x, _ in marks]
    _labels(stream, f"{PARAMETER_AXES}/ticks", positions, [number for _, number in marks])
    error = "error against the truth" if all(table.has_truth for table in tables) else "uncertainty"
    titles = ["identified minus nominal [mm | mrad]", f"{error}, bars ±2 sigma [um | urad]"]
    _labels(stream, f"{PARAMETER_AXES}/titles", [(LEFT, -2.0), (RIGHT, -2.0)], titles)
    identified = {name for table in tables for name in table.names}
    words = [f"{name}{'' if name in identified else ' (nominal)'}" for name in rows]
    positions = [(NAMES_AT, float(k)) for k in range(len(rows))]
    _labels(stream, f"{PARAMETER_AXES}/names", positions, words)


def _labels(
    stream: rr.RecordingStream,
    entity: str,
    positions: Sequence[tuple[float, float]],
    words: Sequence[str],
) -> None:
    if words:
        raised = [(x, y - _RAISED) for x, y in positions]
        points = rr.Points2D(raised, labels=words, colors=[_TEXT], radii=[0.01], show_labels=True)
        stream.log(entity, points, static=True)
