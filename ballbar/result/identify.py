"""From measurements of one robot, moving or still, to its calibration, tried on held-out ones.

Recordings that are fitted or validated together must be of the same robot, ball-bar and plate,
tables of the same robot: their files must say so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.cell.descriptions import Cell, same_contents
from ballbar.cell.errors import InputError
from ballbar.cell.foreign_text import printable
from ballbar.cell.load import load_cell, load_measured_cell
from ballbar.cell.poses import KnownDistance, PoseGroup, PoseTable
from ballbar.cell.temperature import at_temperature, temperature_of
from ballbar.ident.estimates import result_at_rest
from ballbar.ident.held_out import held_out, held_out_poses
from ballbar.ident.identify import identify_together
from ballbar.ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.ident.start.automatic import StartError
from ballbar.ident.table_fit import fit_table
from ballbar.ident.tracker import judged_by_tracker
from ballbar.recordings.read import Measured, Thing, measured
from ballbar.result.names import CALIBRATION
from ballbar.result.run_data import FittedRecording, RunData, Validation

if TYPE_CHECKING:
    from ballbar.result.calibration import Calibration

# Measurements with their name
Moving = tuple[str, Recording]
Still = tuple[str, PoseImport]


def identify(
    *things: Thing,
    validate: Sequence[Thing] = (),
    cell: Cell | None = None,
    options: FitOptions = DEFAULTS,
    listener: Listener = SILENT,
) -> Calibration:
    """The calibration of one robot from all that was measured of it, tried on held-out parts.

    things : recordings and tables of still poses, as folders, files, as `read` gives them, or as
        arrays: `Logs` and `PoseTable`. validate : the same, held out: not fitted. cell : in which
        logs that are given as arrays were taken.

    Raises InputError for bad files, for things that do not belong together, and for options that
    contradict them; StartError when logs do not fit together, and PoseStartError when poses do not.
    """
    if not things:
        raise InputError("nothing to identify: name a recording or a table of still poses.")
    # The answer of a command comes before the schema of its file
    from ballbar.result.calibration import Calibration  # noqa: PLC0415
    from ballbar.result.write_calibration import calibration_of  # noqa: PLC0415

    data = identified(things, validate, cell=cell, options=options, listener=listener)
    return Calibration(calibration_of(data), data.folder / CALIBRATION, data)


def identified(
    things: Sequence[Thing],
    validate: Sequence[Thing] = (),
    *,
    cell: Cell | None = None,
    options: FitOptions = DEFAULTS,
    listener: Listener = SILENT,
) -> RunData:
    """The fit of one robot, with all that its report shows; arguments and errors as `identify`."""
    count, every = len(things), [*things, *validate]
    listener.progress("reading the recordings" if len(every) > 1 else "reading the recording")
    read = [measured(thing, cell) for thing in every]
    names = distinct_names(read)
    recordings, tables = _by_kind(names[:count], read[:count])
    tried, held = _by_kind(names[count:], read[count:])
    _check_one_robot([content for _, content in tables + held])
    if not recordings:
        return _from_poses(tables, tried, held, options, listener)
    _check_options(options, recordings)
    if held:
        raise InputError(
            f"{held[0][0]}: is a table of still poses. A robot that was identified from recordings "
            "is tried on recordings; name the table among those that are fitted."
        )
    return _from_recordings(recordings, tables, tried, cell, options, listener)


def _by_kind(names: Sequence[str], things: Sequence[Measured]) -> tuple[list[Moving], list[Still]]:
    """Recordings and tables of still poses, each with its name."""
    named = list(zip(names, things, strict=True))
    moving = [(name, thing) for name, thing in named if isinstance(thing, Recording)]
    return moving, [(name, thing) for name, thing in named if isinstance(thing, PoseImport)]


def _from_recordings(
    recordings: Sequence[Moving],
    tables: Sequence[Still],
    tried: Sequence[Moving],
    cell: Cell | None,
    options: FitOptions,
    listener: Listener,
) -> RunData:
    _check_same_cell([*recordings, *tried])
    _check_force(options, [*recordings, *tried])
    still = _joined(tables) if tables else None
    logs = [logs_of(name, recording) for name, recording in recordings]
    cell = _cell_of(recordings, cell)
    result = identify_together(cell, logs, still, options=options, listener=listener)
    validations = tuple(_validated(result, *other, options, listener) for other in tried)
    for validation in validations:
        tracker, log = validation.outcome.tracker, validation.recording.tracker_log
        verdict = judged_by_tracker(result.verdict, log, tracker, name=validation.outcome.name)
        result = replace(result, verdict=verdict)
    return RunData(
        name=" + ".join(name for name, _ in (*recordings, *tables)),
        recordings=tuple(
            FittedRecording(name, recording, estimate)
            for (name, recording), estimate in zip(recordings, result.recordings, strict=True)
        ),
        identification=result,
        validations=validations,
        tables=tuple(tables),
    )


def _from_poses(
    tables: Sequence[Still],
    logs: Sequence[Moving],
    held: Sequence[Still],
    options: FitOptions,
    listener: Listener,
) -> RunData:
    if logs:
        raise InputError(
            f"{logs[0][0]}: holds no poses.yaml. A robot that was identified from still poses "
            "alone is tried on still poses; name the recording among those that are fitted."
        )
    if stated := options.of_logs:
        what = f"gives poses, and these settings are of a ball-bar's logs: {', '.join(stated)}."
        raise InputError.at(_place(tables[0][1]) or tables[0][0], what, "Leave them out.")
    poses = fit_table(_joined(tables), options, listener)
    outcomes = tuple(
        (content, held_out_poses(poses, replace(content.table, name=name)))
        for name, content in held
    )
    elsewhere = any(outcome.elsewhere and outcome.acceptable for _, outcome in outcomes)
    return RunData(
        name=" + ".join(name for name, _ in tables),
        recordings=(),
        identification=result_at_rest(poses, elsewhere=elsewhere),
        tables=tuple(tables),
        held_out_tables=outcomes,
    )


def _cell_of(recordings: Sequence[Moving], given: Cell | None) -> Cell:
    """The cell that recording.yaml names; of arrays alone, the one that was given with them."""
    described = [r for _, r in recordings if r.folder is not None]
    if given is not None and not described:
        return given
    named, folder = described[0].description, described[0].folder
    load = load_measured_cell if named.ballbar is None else load_cell
    cell = load(named.robot, named.measured_by, named.plate, relative_to=folder)
    if given is not None and not same_contents(cell, given):
        what = "describes another robot, ball-bar or plate than `cell`, which arrays came with."
        raise InputError.at(folder, what, "One fit is of one cell.")
    warmth = temperature_of([recording.description for recording in described], robot=False)
    return at_temperature(cell, warmth)


def _joined(tables: Sequence[Still]) -> PoseTable:
    """Several tables as one: each has seats of its own, targets of one name are one target."""
    if len(tables) == 1:
        name, content = tables[0]
        return replace(content.table, name=name)
    groups: list[PoseGroup] = []
    distances: list[KnownDistance] = []
    for name, content in tables:
        groups += [replace(g, seat=f"{name}/{g.seat}") for g in content.table.groups]
        distances += [
            replace(d, seats=(f"{name}/{d.seats[0]}", f"{name}/{d.seats[1]}"))
            for d in content.table.distances
        ]
    return PoseTable(
        " + ".join(name for name, _ in tables),
        tables[0][1].table.robot,
        tuple(groups),
        tuple(distances),
    )


def _place(thing: Measured) -> Path | None:
    """The folder of what was measured, or its file, where that has a name of its own."""
    if isinstance(thing, Recording):
        return thing.folder
    usual = thing.file is not None and thing.file.name in ("poses.yaml", "recording.yaml")
    return thing.file.parent if thing.file is not None and usual else thing.file


def distinct_names(things: Sequence[Measured]) -> list[str]:
    """Name of each thing: its own if it was given as arrays, else as `names_of_places`.

    Raises InputError when one of them is given twice.
    """
    places = [_place(thing) for thing in things]
    names = iter(names_of_places([place for place in places if place is not None]))
    own = [thing.name if isinstance(thing, Recording) else thing.table.name for thing in things]
    return [
        name or f"recording {k}" if place is None else next(names)
        for k, (place, name) in enumerate(zip(places, own, strict=True), start=1)
    ]


def names_of_places(folders: Sequence[Path]) -> list[str]:
    """Each folder's last part, or as many parts from the end as tell it from the others, printable.

    Raises InputError when one of them is given twice.
    """
    paths = [folder.resolve() for folder in folders]
    if twice := [str(folders[i]) for i, path in enumerate(paths) if path in paths[:i]]:
        remedy = "A recording counts once, and what was fitted proves nothing as held out."
        raise InputError.at(twice[0], "given twice.", remedy)
    names = [""] * len(paths)
    for parts in range(1, max((len(path.parts) for path in paths), default=0) + 1):
        tails = [printable("/".join(path.parts[-parts:]), allowed="") for path in paths]
        count = Counter(tails)
        names = [
            name or (tail if count[tail] == 1 else "")
            for name, tail in zip(names, tails, strict=True)
        ]
    return names


def _validated(
    result: Identification, name: str, recording: Recording, options: FitOptions, listener: Listener
) -> Validation:
    try:
        outcome = held_out(result, logs_of(name, recording), options=options, listener=listener)
    except StartError as error:
        raise StartError(f"{name}: {error}") from None
    return Validation(recording, outcome)


def logs_of(name: str, recording: Recording) -> Logs:
    """The logs of a recording as they are identified, under a name for messages."""
    return Logs(
        recording.robot_log,
        recording.ballbar_log,
        recording.force_log,
        name,
        recording.length_log,
        recording.tracker_log,
    )


def _check_options(options: FitOptions, recordings: Sequence[Moving]) -> None:
    if options.joint_errors != "auto":
        name, recording = recordings[0]
        what = "is a recording, and joint errors are chosen for still poses alone."
        raise InputError.at(recording.folder or name, what, "Leave joint errors out.")
    if options.model == "dh" and (
        options.corrections is not None or options.force != "auto" or options.rod_sigma is not None
    ):
        raise InputError(
            "model dh has neither corrections nor loads nor a measured rod; leave them out, or "
            "choose model complete"
        )


def _check_one_robot(tables: Sequence[PoseImport]) -> None:
    for content in tables:
        first, own = tables[0].table.robot, content.table.robot
        arrays = content.file is None or tables[0].file is None
        if own.title != first.title or (arrays and not same_contents(own, first)):
            places = [_place(table) or table.table.name for table in (content, tables[0])]
            what = f"is of robot {own.title}, {places[1]} of {first.title}."
            remedy = "Tables that belong together must be of one robot."
            raise InputError.at(places[0], what, remedy)


def _check_same_cell(recordings: Sequence[Moving]) -> None:
    first = recordings[0][1]
    for _, other in recordings[1:]:
        for what, attribute in (("robot", "robot"), ("instrument", "measured_by"), ("plate",) * 2):
            name, here = (getattr(r.description, attribute) for r in (first, other))
            if description_identity(here, other.folder) != description_identity(name, first.folder):
                raise InputError(
                    f"{other.folder}: is of {what} {here}, {first.folder} of {name}"
                    f"{', whose content differs' * (name == here)}. "
                    "Recordings that belong together must be of the same robot, ball-bar and plate."
                )


def description_identity(name: str, folder: Path | None) -> str | bytes:
    """A shipped description by its name, an own one by its content."""
    return ((folder or Path()) / name).read_bytes() if name.endswith(".yaml") else name


def _check_force(options: FitOptions, recordings: Sequence[Moving]) -> None:
    for name, recording in recordings:
        place = recording.folder or name
        if options.force == "sensor" and recording.force_log is None:
            raise InputError(
                f"{place}: has no log of a force sensor (`sources.force` in recording.yaml); "
                "choose force auto, torque or none"
            )
        if options.force == "torque" and recording.robot_log.torque is None:
            raise InputError(
                f"{place}: the robot's log has no motor torques (columns tau1 to tau6); choose "
                "force auto, sensor or none"
            )
