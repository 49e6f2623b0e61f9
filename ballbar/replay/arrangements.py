"""Other arrangements of a replay: the iterations as they converge, and two runs over each other.

Both are made of finished replay files: their chunks are copied, for a comparison below /A and /B,
and get another layout.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from ballbar import figure_style
from ballbar.replay.blueprint import blueprint, cell_view, parameter_view, whole_range
from ballbar.replay.colours import BACKGROUND, Colour, on_dark, shades
from ballbar.replay.entities import (
    AFTER,
    ANGLE,
    CELL,
    CLOCK,
    CLOCK_IDENTIFIED,
    CLOCK_TRUE,
    CLOSURE_ERROR,
    CLOSURE_RMS,
    COST,
    ENCODERS,
    FORCE,
    FORCE_IDENTIFIED,
    FORCE_TRUE,
    ITERATION,
    JOINTS,
    NOTES,
    PARAMETER_AXES,
    PARAMETER_TABLE,
    PARAMETER_VALUES,
    POSITION,
    STAGE,
    TCP_AFTER,
    TIMELINE,
    TOOL_FROM_RESULT,
    TOOL_FROM_TRUTH,
)
from ballbar.replay.parameters import common_ends, log_axes, log_values, read_table
from cell.errors import InputError

# the viewer keeps one layout per application
IDENTIFY, COMPARE = "ballbar-identify", "ballbar-compare"
_LOWER = 0.3  # [rows] run B's error bars stand so much below those of run A
_POWERS = "powers of ten"


@dataclass(frozen=True, eq=False)
class _Run:
    """One of two runs that are compared."""

    letter: str
    title: str
    colour: str  # of figure_style
    chunks: tuple[Chunk, ...]  # below /LETTER

    @property
    def roots(self) -> list[str]:
        """Roots of its recordings."""
        paths = dict.fromkeys(chunk.entity_path for chunk in self.chunks)
        return [path.removesuffix(JOINTS) for path in paths if path.endswith(JOINTS)]


@contextmanager
def identify_replay(file: Path) -> Iterator[Path]:
    """The same replay with the iterations as its timeline; the file goes when the block ends.

    Raises InputError when it holds no iterations, or is no replay.
    """
    chunks = _chunks(file)
    entities = {chunk.entity_path for chunk in chunks}
    roots = [path.removesuffix(STAGE) for path in entities if path.endswith(STAGE)]
    if not roots:
        raise InputError(
            f"{file}: holds no iterations. Write it again with `ballbar run`, or "
            "`ballbar identify RECORDING --rerun`."
        )
    known = [path for path in (TOOL_FROM_RESULT, TOOL_FROM_TRUTH) if roots[0] + path in entities]
    view = identify_layout(known, roots[0])
    with _written(IDENTIFY, _title(file), chunks, view) as path:
        yield path


@contextmanager
def comparison(first: Path, second: Path) -> Iterator[Path]:
    """Two replays in one file, the first below /A, the second below /B.

    Raises InputError when one is no replay.
    """
    titles = _title(first), _title(second)
    if titles[0] == titles[1]:
        titles = f"{titles[0]} (A)", f"{titles[1]} (B)"
    colours = figure_style.BLUE, figure_style.ORANGE
    runs = [
        _Run(letter, title, colour, tuple(_below(f"/{letter}", chunk) for chunk in _chunks(file)))
        for letter, title, colour, file in zip("AB", titles, colours, (first, second), strict=True)
    ]
    chunks = [chunk for run in runs for chunk in run.chunks]
    name = f"{titles[0]} against {titles[1]}"
    with _written(COMPARE, name, chunks, _compare_layout(runs), runs) as path:
        yield path


def _title(file: Path) -> str:
    """The run's folder, which people name, rather than the file in it."""
    return file.resolve().parent.name if file.stem == "run" else file.stem


def _chunks(file: Path) -> list[Chunk]:
    """Data of a replay, without what rerun says about the recording itself."""
    try:
        chunks = RrdReader(str(file)).stream().to_chunks()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            f"{file}: cannot be read as a replay ({error}). Write it again with `ballbar run`."
        ) from None
    data = [chunk for chunk in chunks if not chunk.entity_path.startswith("/__")]
    if not any(chunk.entity_path == NOTES for chunk in data):
        raise InputError(f"{file}: is no replay of a run. `ballbar run` writes run.rrd.")
    return data


def _below(root: str, chunk: Chunk) -> Chunk:
    return chunk.with_entity_path(f"{root}{chunk.entity_path}")


@contextmanager
def _written(
    application: str,
    name: str,
    chunks: Sequence[Chunk],
    view: rrb.Blueprint,
    runs: Sequence[_Run] = (),
) -> Iterator[Path]:
    """A replay file that goes when the block ends; runs : drawn over each other besides."""
    with TemporaryDirectory(prefix="ballbar-replay-") as folder:
        path = Path(folder) / "replay.rrd"
        stream = rr.RecordingStream(application, recording_id=name, send_properties=False)
        try:
            with stream:
                stream.save(path, default_blueprint=view)
                stream.send_recording_name(name)
                stream.send_chunks(chunks)
                if runs:
                    _log_comparison(stream, runs)
        finally:
            stream.disconnect()
        yield path


def _log_comparison(stream: rr.RecordingStream, runs: Sequence[_Run]) -> None:
    """The runs in one picture: each in its colour, the parameters of the second a little lower."""
    tables = [
        read_table(chunk)
        for run in runs
        for chunk in run.chunks
        if chunk.entity_path.endswith(PARAMETER_TABLE)
    ]
    log_axes(stream, tables)
    ends = common_ends(tables)
    for run, table, lower in zip(runs, tables, (0.0, _LOWER), strict=True):
        colour = on_dark(run.colour)
        entity = f"{PARAMETER_VALUES}/{run.letter}"
        log_values(stream, entity, table, ends, (colour, colour), lower=lower)
        residuals = [f"{run.letter} {axis}" for axis in "xyz"]
        for root in run.roots:
            for entity in (f"{AFTER}/{POSITION}", f"{AFTER}/{ANGLE}"):
                _log_style(stream, f"{root}{entity}", residuals, shades(run.colour))
            for entity in (TCP_AFTER, FORCE_TRUE, FORCE_IDENTIFIED, CLOCK_TRUE, CLOCK_IDENTIFIED):
                name = entity.rpartition("/")[2].removesuffix("_um")
                _log_style(stream, f"{root}{entity}", [f"{run.letter} {name}"], [colour])


def _log_style(
    stream: rr.RecordingStream, entity: str, names: Sequence[str], colours: Sequence[Colour]
) -> None:
    stream.log(entity, rr.SeriesLines.from_fields(names=names, colors=colours), static=True)


def identify_layout(distances: Sequence[str] = (), root: str = "") -> rrb.Blueprint:
    """The iterations: loop-closure error in the scene; its size, cost and distances as curves.

    distances : entities of the tool's distances. root : of the recording that is shown.
    """
    arrows = rrb.Spatial3DView(
        origin=f"{root}{CELL}",
        contents=[
            f"{root}{CELL}/{part}"
            for part in ("sphere", "tool/path", "ballbar/**", "plate/**", "robot/**")
        ]
        + [f"{root}{CLOSURE_ERROR}/**"],
        name="Loop-closure error along the path, magnified: it shrinks",
        background=BACKGROUND,
    )
    closure = f"Loop-closure error, RMS: {_POWERS} of um and urad"
    tool = f"Tool over the workspace, rigid robot: {_POWERS} of um"
    cost = f"Chi-square of each whitened residual: {_POWERS}; 0 is what noise explains"
    curves = [_powers(closure, f"{root}{CLOSURE_RMS}/**")]
    if distances:
        curves.append(_powers(tool, *(f"{root}{entity}" for entity in distances)))
    curves.append(_powers(cost, f"{root}{COST}"))
    stage = rrb.TextDocumentView(origin=f"{root}{STAGE}", name="Stage of the identification")
    left = rrb.Vertical(arrows, stage, row_shares=[3, 1])
    views = rrb.Horizontal(left, rrb.Vertical(*curves), column_shares=[11, 9])
    return blueprint(views, ITERATION, speed=0.1)


def _powers(title: str, *contents: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin="/", contents=list(contents), name=title, plot_legend=rrb.Corner2D.RightTop
    )


def _compare_layout(runs: Sequence[_Run]) -> rrb.Blueprint:
    whole = whole_range(max(map(_duration, runs)))
    cells = [
        cell_view(root, f"{run.letter}: {run.title}{root.removeprefix(f'/{run.letter}')}")
        for run in runs
        for root in run.roots
    ]
    curves = [
        (f"{AFTER}/{POSITION}", "Residual after, position [um]"),
        (f"{AFTER}/{ANGLE}", "Residual after, angle [urad]"),
        (TCP_AFTER, "TCP error of the identified robot [um]"),
        (JOINTS, "Robot joint angles [deg]"),
        (ENCODERS, "Ball-bar encoder angles [deg]"),
        (FORCE, "Rod force [N]"),
        (CLOCK, "Clock offset [ms]"),
    ]
    views = [view for path, title in curves if (view := _over(runs, path, title, whole))]
    notes = [
        rrb.TextDocumentView(origin=f"/{run.letter}{NOTES}", name=f"{run.letter}: {run.title}")
        for run in runs
    ]
    overview = rrb.Horizontal(
        rrb.Vertical(rrb.Horizontal(*cells), rrb.Horizontal(*notes)),
        rrb.Vertical(*views[:3]),
        column_shares=[3, 2],
        name="Two runs",
    )
    first, second = (run.title for run in runs)
    parameters = rrb.Horizontal(
        parameter_view(PARAMETER_AXES, PARAMETER_VALUES),
        name=f"Parameters: {first} blue, {second} orange",
    )
    more = rrb.Grid(*views[3:], name="More curves")
    return blueprint(rrb.Tabs(overview, parameters, more, active_tab=0), TIMELINE, speed=4.0)


def _over(
    runs: Sequence[_Run], entity: str, title: str, whole: rrb.TimeRange
) -> rrb.TimeSeriesView | None:
    """The same plot of all recordings in one view; None where no recording has it."""
    paths = {f"{root}{entity}" for run in runs for root in run.roots}
    every = [chunk.entity_path for run in runs for chunk in run.chunks]
    if not any(path.startswith(tuple(paths)) for path in every):
        return None
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"{path}/**" for path in sorted(paths)],
        name=title,
        axis_x=rrb.TimeAxis(view_range=whole),
        plot_legend=rrb.Corner2D.RightTop,
    )


def _duration(run: _Run) -> float:
    """[s] of its longest recording."""
    ends = [
        chunk.to_record_batch().column(TIMELINE).cast("int64").to_numpy()[-1]
        for chunk in run.chunks
        if chunk.entity_path.endswith(JOINTS) and TIMELINE in chunk.timeline_names
    ]
    return float(max(ends, default=0)) * 1e-9
