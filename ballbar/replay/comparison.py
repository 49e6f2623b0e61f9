"""Two replays over each other: finished files in one, the first below /A, the second below /B.

Their chunks are copied, and get a layout in which each curve of both stands in one plot.
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
from ballbar.cell.errors import InputError
from ballbar.replay.blueprint import cell_view, parameter_view, whole_range
from ballbar.replay.entities import (
    AFTER,
    ANGLE,
    CLOCK,
    CLOCK_IDENTIFIED,
    CLOCK_TRUE,
    ENCODERS,
    FORCE,
    FORCE_IDENTIFIED,
    FORCE_TRUE,
    JOINTS,
    NOTES,
    POSITION,
    TCP_AFTER,
    TIMELINE,
)
from ballbar.replay.window import blueprint
from ballbar.report.colours import on_dark, shades

APPLICATION = "ballbar-compare"  # the viewer keeps one layout per application
_CURVES = (
    (f"{AFTER}/{POSITION}", "Residual after, position [um]"),
    (f"{AFTER}/{ANGLE}", "Residual after, angle [urad]"),
    (TCP_AFTER, "TCP error of the identified robot [um]"),
    (JOINTS, "Robot joint angles [deg]"),
    (ENCODERS, "Ball-bar encoder angles [deg]"),
    (FORCE, "Rod force [N]"),
    (CLOCK, "Clock offset [ms]"),
)
_STYLED = (TCP_AFTER, FORCE_TRUE, FORCE_IDENTIFIED, CLOCK_TRUE, CLOCK_IDENTIFIED)


@dataclass(frozen=True, eq=False)
class _Run:
    """One of two runs that are compared."""

    letter: str
    title: str
    colour: str  # of figure_style
    chunks: tuple[Chunk, ...]  # below /LETTER

    @property
    def entities(self) -> set[str]:
        return {chunk.entity_path for chunk in self.chunks}

    @property
    def roots(self) -> list[str]:
        """Roots of its recordings."""
        return sorted(e.removesuffix(JOINTS) for e in self.entities if e.endswith(JOINTS))

    @property
    def duration(self) -> float:
        """[s] of its longest recording."""
        ends = [
            chunk.to_record_batch().column(TIMELINE).cast("int64").to_numpy()[-1]
            for chunk in self.chunks
            if chunk.entity_path.endswith(JOINTS) and TIMELINE in chunk.timeline_names
        ]
        return float(max(ends, default=0)) * 1e-9


@contextmanager
def comparison(first: Path, second: Path) -> Iterator[Path]:
    """Two replays in one file, which goes when the block ends.

    Raises InputError when one is no replay.
    """
    titles = [
        file.resolve().parent.name if file.stem == "run" else file.stem for file in (first, second)
    ]
    if titles[0] == titles[1]:
        titles = [f"{titles[0]} (A)", f"{titles[1]} (B)"]
    colours = figure_style.BLUE, figure_style.ORANGE
    runs = [
        _Run(
            letter,
            title,
            colour,
            tuple(c.with_entity_path(f"/{letter}{c.entity_path}") for c in _chunks(file)),
        )
        for letter, title, colour, file in zip("AB", titles, colours, (first, second), strict=True)
    ]
    name = f"{titles[0]} against {titles[1]}"
    with TemporaryDirectory(prefix="ballbar-replay-") as folder:
        path = Path(folder) / "replay.rrd"
        stream = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
        try:
            with stream:
                stream.save(path, default_blueprint=_layout(runs))
                stream.send_recording_name(name)
                for run in runs:
                    stream.send_chunks(run.chunks)
                    _log_styles(stream, run)
        finally:
            stream.disconnect()
        yield path


def _chunks(file: Path) -> list[Chunk]:
    """Data of a replay, without what rerun says about the recording itself."""
    try:
        chunks = RrdReader(str(file)).stream().to_chunks()
    except (OSError, ValueError, RuntimeError) as error:
        what = f"cannot be read as a replay ({error})."
        raise InputError.at(file, what, "Write it again with `ballbar run`.") from None
    data = [chunk for chunk in chunks if not chunk.entity_path.startswith("/__")]
    if not any(chunk.entity_path == NOTES for chunk in data):
        raise InputError(f"{file}: is no replay of a run. `ballbar run` writes run.rrd.")
    return data


def _log_styles(stream: rr.RecordingStream, run: _Run) -> None:
    """The curves of a run in its colour, its letter before their names."""
    for root in run.roots:
        styles = {
            f"{AFTER}/{kind}": ([f"{run.letter} {axis}" for axis in "xyz"], shades(run.colour))
            for kind in (POSITION, ANGLE)
        }
        for entity in _STYLED:
            name = entity.rpartition("/")[2].removesuffix("_um")
            styles[entity] = [f"{run.letter} {name}"], [on_dark(run.colour)]
        for entity, (names, colours) in styles.items():
            style = rr.SeriesLines.from_fields(names=names, colors=colours)
            stream.log(f"{root}{entity}", style, static=True)


def _layout(runs: Sequence[_Run]) -> rrb.Blueprint:
    """Cells and notes of both runs side by side, their curves over each other."""
    time_range = whole_range(max(run.duration for run in runs))
    cells = [
        cell_view(root, f"{run.letter}: {run.title}{root.removeprefix(f'/{run.letter}')}")
        for run in runs
        for root in run.roots
    ]
    entities = {entity for run in runs for entity in run.entities}
    curves = []
    for entity, title in _CURVES:
        paths = sorted(f"{root}{entity}" for run in runs for root in run.roots)
        if any(e.startswith(tuple(paths)) for e in entities):
            curves.append(
                rrb.TimeSeriesView(
                    origin="/",
                    contents=[f"{path}/**" for path in paths],
                    name=title,
                    axis_x=rrb.TimeAxis(view_range=time_range),
                    plot_legend=rrb.Corner2D.RightTop,
                )
            )
    notes = [
        rrb.TextDocumentView(origin=f"/{run.letter}{NOTES}", name=f"{run.letter}: {run.title}")
        for run in runs
    ]
    overview = rrb.Horizontal(
        rrb.Vertical(rrb.Horizontal(*cells), rrb.Horizontal(*notes)),
        rrb.Vertical(*curves[:3]),
        column_shares=[3, 2],
        name="Two runs",
    )
    parameters = [parameter_view(f"/{run.letter}", f"{run.letter}: {run.title}") for run in runs]
    return blueprint(
        rrb.Tabs(
            overview,
            rrb.Horizontal(*parameters, name="Parameters"),
            rrb.Grid(*curves[3:], name="More curves"),
            active_tab=0,
        ),
        TIMELINE,
        speed=4.0,
    )
