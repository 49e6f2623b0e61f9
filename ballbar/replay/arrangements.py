"""The other arrangements of a replay: `identify`, the iterations as they converge, and `compare`, two runs over each other.

Both are made of finished replay files: their chunks are copied, for a comparison below /A and /B, and get another layout.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from ballbar.replay.entities import (
    AFTER,
    ANGLE,
    CELL,
    CLOCK,
    CLOCK_FOUND,
    CLOCK_TRUE,
    COST,
    COVERED,
    ENCODERS,
    FORCE,
    FORCE_FOUND,
    FORCE_TRUE,
    FROM_RESULT,
    FROM_TRUTH,
    ITERATION,
    JOINTS,
    MISMATCH,
    NOTES,
    PARAMETER_AXES,
    PARAMETER_TABLE,
    PARAMETER_VALUES,
    PATH_SO_FAR,
    POSITION,
    ROOM_FOR_LEGEND,
    STAGE,
    TCP_AFTER,
    TIMELINE,
    parameter_view,
)
from ballbar.replay.parameters import common_ends, log_axes, log_values, read_table
from cell.errors import InputError

BLUE, YELLOW = (90, 150, 235), (240, 190, 70)  # run A, run B
IDENTIFY, COMPARE = (
    "ballbar-identify",
    "ballbar-compare",
)  # the viewer keeps one layout per application
_LOWER = 0.3  # [rows] run B's error bars stand so much below those of run A


@contextmanager
def identify_replay(file: Path) -> Iterator[Path]:
    """The same replay with the iterations as its timeline; the file goes when the block ends.

    Raises InputError when it holds no iterations, or is no replay.
    """
    chunks = _chunks(file)
    entities = {chunk.entity_path for chunk in chunks}
    if STAGE not in entities:
        raise InputError(
            f"{file}: holds no iterations. Write it again with `ballbar run`, or `ballbar identify RECORDING --rerun`."
        )
    with _written(
        IDENTIFY,
        _title(file),
        chunks,
        identify_layout([one for one in (FROM_RESULT, FROM_TRUTH) if one in entities]),
    ) as path:
        yield path


@contextmanager
def comparison(first: Path, second: Path) -> Iterator[Path]:
    """Two replays in one file, the first below /A, the second below /B. Raises InputError when one is no replay."""
    both = []
    for name, file in (("A", first), ("B", second)):
        both += [_below(f"/{name}", chunk) for chunk in _chunks(file)]
    entities = {chunk.entity_path for chunk in both}
    titles = tuple(_title(file) for file in (first, second))
    if titles[0] == titles[1]:
        titles = f"{titles[0]} (A)", f"{titles[1]} (B)"
    with _written(
        COMPARE,
        f"{titles[0]} against {titles[1]}",
        both,
        _compare_layout(entities, titles, _duration(both)),
    ) as path:
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
    kept = [chunk for chunk in chunks if not chunk.entity_path.startswith("/__")]
    if not any(chunk.entity_path == NOTES for chunk in kept):
        raise InputError(f"{file}: is no replay of a run. `ballbar run` writes run.rrd.")
    return kept


def _below(root: str, chunk: Chunk) -> Chunk:
    return chunk.with_entity_path(f"{root}{chunk.entity_path}")


@contextmanager
def _written(
    application: str, name: str, chunks: Sequence[Chunk], blueprint: rrb.Blueprint
) -> Iterator[Path]:
    with TemporaryDirectory(prefix="ballbar-replay-") as folder:
        path = Path(folder) / "replay.rrd"
        stream = rr.RecordingStream(application, recording_id=name, send_properties=False)
        try:
            with stream:
                stream.save(path, default_blueprint=blueprint)
                stream.send_recording_name(name)
                stream.send_chunks(chunks)
                if application == COMPARE:
                    _tell_apart(stream, chunks)
        finally:
            stream.disconnect()
        yield path


def _tell_apart(stream: rr.RecordingStream, chunks: Sequence[Chunk]) -> None:
    """The two runs in one picture: each in its colours, the parameters of the second a little lower."""
    tables = {
        chunk.entity_path[:2]: read_table(chunk)
        for chunk in chunks
        if chunk.entity_path.endswith(PARAMETER_TABLE)
    }
    log_axes(stream, list(tables.values()))
    ends = common_ends(list(tables.values()))
    for root, colour, lower in (("/A", BLUE, 0.0), ("/B", YELLOW, _LOWER)):
        log_values(
            stream, f"{PARAMETER_VALUES}{root}", tables[root], ends, (colour, colour), lower=lower
        )
        shades = [tuple(int(c * share) for c in colour) for share in (1.0, 0.8, 0.6)]
        for entity in (f"{AFTER}/{POSITION}", f"{AFTER}/{ANGLE}"):
            names = [f"{root[1:]} {axis}" for axis in "xyz"]
            stream.log(
                f"{root}{entity}",
                rr.SeriesLines.from_fields(names=names, colors=shades),
                static=True,
            )
        for entity in (TCP_AFTER, FORCE_TRUE, FORCE_FOUND, CLOCK_TRUE, CLOCK_FOUND):
            name = f"{root[1:]} {entity.rpartition('/')[2].removesuffix('_um')}"
            stream.log(
                f"{root}{entity}",
                rr.SeriesLines.from_fields(names=[name], colors=[colour]),
                static=True,
            )


def identify_layout(distances: Sequence[str] = ()) -> rrb.Blueprint:
    """The iterations: mismatch in the scene, its size, cost and distance as curves; distances : entities of these."""
    arrows = rrb.Spatial3DView(
        origin=CELL,
        contents=[
            f"{CELL}/sphere",
            f"{CELL}/tool/path",
            f"{CELL}/ballbar/stand/**",
            f"{CELL}/robot/base/**",
            f"{MISMATCH}/**",
        ],
        name="Mismatch of robot and ball-bar along the path, magnified: it shrinks",
        background=(30, 34, 42),
    )
    tool = (
        [_powers("Tool over the workspace, rigid robot: powers of ten of um", *distances)]
        if distances
        else []
    )
    curves = rrb.Vertical(
        _powers("Mismatch, RMS: powers of ten of um and urad", "/identify/mismatch/**"),
        *tool,
        _powers(
            "Chi-square of each whitened residual: powers of ten; 0 is what noise explains", COST
        ),
    )
    left = rrb.Vertical(
        arrows,
        rrb.TextDocumentView(origin=STAGE, name="What the identifier is doing"),
        row_shares=[3, 1],
    )
    return _blueprint(rrb.Horizontal(left, curves, column_shares=[11, 9]), ITERATION, speed=0.1)


def _powers(title: str, *contents: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin="/", contents=list(contents), name=title, plot_legend=rrb.Corner2D.RightTop
    )


def _compare_layout(entities: set[str], titles: tuple[str, ...], duration: float) -> rrb.Blueprint:
    first, second = titles
    begin, end = (
        rrb.TimeRangeBoundary.absolute(seconds=0.0),
        rrb.TimeRangeBoundary.absolute(seconds=ROOM_FOR_LEGEND * duration),
    )
    whole = rrb.TimeRange(begin, end)
    cells = [_cell(root, title) for root, title in (("/A", first), ("/B", second))]
    curves = [
        _over(entities, f"{AFTER}/{POSITION}", "Residual after, position [um]", whole),
        _over(entities, f"{AFTER}/{ANGLE}", "Residual after, angle [urad]", whole),
        _over(entities, TCP_AFTER, "TCP error of the identified robot [um]", whole),
        _over(entities, JOINTS, "Robot joint angles [deg]", whole),
        _over(entities, ENCODERS, "Ball-bar encoder angles [deg]", whole),
        _over(entities, FORCE, "Rod force [N]", whole),
        _over(entities, CLOCK, "Clock offset [ms]", whole),
    ]
    shown = [view for view in curves if view is not None]
    parameters = parameter_view(PARAMETER_AXES, PARAMETER_VALUES)
    notes = [
        rrb.TextDocumentView(origin=f"/{root}{NOTES}", name=f"{root}: {title}")
        for root, title in zip("AB", titles, strict=True)
    ]
    overview = rrb.Horizontal(
        rrb.Vertical(rrb.Horizontal(*cells), rrb.Horizontal(*notes)),
        rrb.Vertical(*shown[:3]),
        column_shares=[3, 2],
        name="Two runs",
    )
    more = rrb.Grid(*shown[3:], name="More curves")
    known = rrb.Horizontal(parameters, name=f"Parameters: {first} blue, {second} yellow")
    return _blueprint(rrb.Tabs(overview, known, more, active_tab=0), TIMELINE, speed=4.0)


def _cell(root: str, title: str) -> rrb.Spatial3DView:
    so_far = rrb.VisibleTimeRange(
        TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    contents = ["$origin/**", f"- {root}{MISMATCH}/**"]
    return rrb.Spatial3DView(
        origin=f"{root}{CELL}",
        contents=contents,
        name=f"{root[1:]}: {title}",
        background=(30, 34, 42),
        overrides={
            f"{root}{PATH_SO_FAR}": [rrb.VisibleTimeRanges(so_far)],
            f"{root}{COVERED}": [rrb.VisibleTimeRanges(so_far)],
        },
    )


def _over(
    entities: set[str], entity: str, title: str, whole: rrb.TimeRange
) -> rrb.TimeSeriesView | None:
    """The same plot of both runs in one view, where either has it."""
    contents = [f"/{root}{entity}/**" for root in "AB"]
    if not any(one.startswith((f"/A{entity}", f"/B{entity}")) for one in entities):
        return None
    axis = rrb.TimeAxis(view_range=whole)
    return rrb.TimeSeriesView(
        origin="/", contents=contents, name=title, axis_x=axis, plot_legend=rrb.Corner2D.RightTop
    )


def _duration(chunks: Sequence[Chunk]) -> float:
    """[s] of the longer of the runs."""
    ends = [
        chunk.to_record_batch().column(TIMELINE).cast("int64").to_numpy()[-1]
        for chunk in chunks
        if chunk.entity_path.endswith(JOINTS) and TIMELINE in chunk.timeline_names
    ]
    return float(max(ends, default=0)) * 1e-9


def _blueprint(root: rrb.Container, timeline: str, *, speed: float) -> rrb.Blueprint:
    return rrb.Blueprint(
        root,
        rrb.TimePanel(
            timeline=timeline,
            state="collapsed",
            play_state="playing",
            loop_mode="all",
            playback_speed=speed,
        ),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )
