"""Recordings or tables of still poses to an identified robot: one, several, and held-out ones.

Recordings that are fitted or validated together must be of the same robot, ball-bar and plate,
tables of the same robot: their files must say so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.cell.errors import InputError
from ballbar.cell.foreign_text import printable
from ballbar.cell.load import load_cell, load_measured_cell
from ballbar.cell.poses import KnownDistance, PoseGroup, PoseTable
from ballbar.cell.recording import load_recording_file
from ballbar.ident.estimates import result_at_rest
from ballbar.ident.held_out import held_out, held_out_poses
from ballbar.ident.identify import identify_together
from ballbar.ident.options import SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.ident.start.automatic import StartError
from ballbar.ident.table_fit import fit_table
from ballbar.ident.tracker import judged_by_tracker
from ballbar.identify_settings import IdentifySettings
from ballbar.recordings.followed import gives_poses, poses_of
from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.result.run_data import FittedRecording, RunData, Validation


def identify_files(
    paths: Sequence[Path],
    validate: Sequence[Path] = (),
    *,
    settings: IdentifySettings = IdentifySettings(),  # noqa: B008  frozen
    joint_errors: str = "auto",
    listener: Listener = SILENT,
) -> RunData:
    """One robot from recordings, tables of still poses or both, tried on held-out ones.

    settings : of recordings. joint_errors : of still poses alone, "auto" searches them, "none" does
    without, and the path of a result keeps its own.

    Raises as `identify_recordings`, and InputError for logs that are to be tried on still poses,
    and for an option that is not of what is fitted.
    """
    if logs := [path for path in paths if not gives_poses(path)]:
        if joint_errors != "auto":
            what = "is a recording, and joint errors are chosen for still poses alone."
            raise InputError.at(logs[0], what, "Leave --joint-errors out.")
        return identify_recordings(paths, validate, settings=settings, listener=listener)
    if stated := settings.stated:
        what = f"gives poses, and these settings are of a ball-bar's logs: {', '.join(stated)}."
        raise InputError.at(paths[0], what, "Leave them out.")
    options = FitOptions(joint_errors="none" if joint_errors == "none" else "auto")
    if joint_errors not in ("auto", "none"):
        from ballbar.result.calibration import Calibration  # noqa: PLC0415  needed here alone

        options = replace(options, joint_errors=Calibration.load(joint_errors).joint_errors())
    return _identify_poses(paths, validate, options, listener)


def identify_recordings(
    folders: Sequence[Path],
    validate: Sequence[Path] = (),
    *,
    settings: IdentifySettings = IdentifySettings(),  # noqa: B008  frozen
    listener: Listener = SILENT,
) -> RunData:
    """One robot from recordings, and tables of still poses of it, tried on held-out recordings.

    Raises InputError for bad files, for recordings that do not belong together and for settings
    that contradict them; StartError when the logs of a recording do not fit together.
    """
    if still := [folder for folder in validate if gives_poses(folder)]:
        raise InputError(
            f"{still[0]}: is a table of still poses. A robot that was identified from recordings "
            "is tried on recordings; name the table among those that are fitted."
        )
    called = dict(zip([*folders, *validate], distinct_names([*folders, *validate]), strict=True))
    tables = [folder for folder in folders if gives_poses(folder)]
    folders = [folder for folder in folders if folder not in tables]
    inputs = [*folders, *validate]
    names = [called[folder] for folder in inputs]
    _check_settings(settings)
    _check_same_cell(inputs)
    listener.progress("reading the recordings" if len(inputs) > 1 else "reading the recording")
    read = [read_with_causes(folder) for folder in inputs]
    for folder, recording in zip(inputs, read, strict=True):
        _check_force(settings, folder, recording)
    first = read[0].description
    load = load_measured_cell if first.ballbar is None else load_cell
    cell = load(first.robot, first.measured_by, first.plate, relative_to=folders[0])
    options, count = settings.options, len(folders)
    logs = [logs_of(name, recording) for name, recording in zip(names, read, strict=True)]
    still_poses = read_tables(tables, [called[folder] for folder in tables])
    result = identify_together(
        cell,
        logs[:count],
        _joined(still_poses) if still_poses else None,
        options=options,
        listener=listener,
    )
    others = zip(validate, read[count:], logs[count:], strict=True)
    validations = tuple(
        _validated(result, folder, recording, other, options, listener)
        for folder, recording, other in others
    )
    for validation, other in zip(validations, logs[count:], strict=True):
        tracker, name = validation.outcome.tracker, other.name
        verdict = judged_by_tracker(result.verdict, other.tracker, tracker, name=name)
        result = replace(result, verdict=verdict)
    fitted = zip(names[:count], folders, read[:count], result.recordings, strict=True)
    return RunData(
        name=" + ".join([*names[:count], *(name for name, _, _ in still_poses)]),
        recordings=tuple(FittedRecording(*parts) for parts in fitted),
        identification=result,
        validations=validations,
        tables=still_poses,
    )


def _refuse_logs(inputs: Sequence[Path]) -> None:
    if logs := [folder for folder in inputs if not gives_poses(folder)]:
        raise InputError(
            f"{logs[0]}: holds no poses.yaml. A robot that was identified from still poses alone "
            "is tried on still poses; name the recording among those that are fitted."
        )


def _identify_poses(
    folders: Sequence[Path], validate: Sequence[Path], options: FitOptions, listener: Listener
) -> RunData:
    inputs = [*folders, *validate]
    _refuse_logs(inputs)
    names = distinct_names(inputs)
    listener.progress("reading the poses")
    read = read_tables(inputs, names)
    fitted = read[: len(folders)]
    poses = fit_table(_joined(fitted), options, listener)
    outcomes = tuple(
        (folder, content, held_out_poses(poses, replace(content.table, name=name)))
        for name, folder, content in read[len(folders) :]
    )
    elsewhere = any(outcome.elsewhere and outcome.acceptable for _, _, outcome in outcomes)
    return RunData(
        name=" + ".join(name for name, _, _ in fitted),
        recordings=(),
        identification=result_at_rest(poses, elsewhere=elsewhere),
        tables=fitted,
        held_out_tables=outcomes,
    )


def read_tables(
    folders: Sequence[Path], names: Sequence[str]
) -> tuple[tuple[str, Path, PoseImport], ...]:
    """Name, folder and content of tables of still poses.

    Raises InputError for bad files, and where they are of unlike robots.
    """
    read = [poses_of(folder) for folder in folders]
    for folder, content in zip(folders, read, strict=True):
        first = read[0].table.robot
        if content.table.robot.title != first.title:
            what = f"is of robot {content.table.robot.title}, {folders[0]} of {first.title}."
            raise InputError.at(folder, what, "Tables that belong together must be of one robot.")
    return tuple(zip(names, folders, read, strict=True))


def _joined(tables: Sequence[tuple[str, Path, PoseImport]]) -> PoseTable:
    """Several tables as one: each has seats of its own, targets of one name are one target."""
    if len(tables) == 1:
        name, _, content = tables[0]
        return replace(content.table, name=name)
    groups: list[PoseGroup] = []
    distances: list[KnownDistance] = []
    for name, _, content in tables:
        groups += [replace(g, seat=f"{name}/{g.seat}") for g in content.table.groups]
        distances += [
            replace(d, seats=(f"{name}/{d.seats[0]}", f"{name}/{d.seats[1]}"))
            for d in content.table.distances
        ]
    return PoseTable(
        " + ".join(name for name, _, _ in tables),
        tables[0][2].table.robot,
        tuple(groups),
        tuple(distances),
    )


def distinct_names(folders: Sequence[Path]) -> list[str]:
    """Each folder's last part, or as many parts from the end as tell it from the others, printable.

    Raises InputError when one of them is given twice.
    """
    paths = [folder.resolve() for folder in folders]
    if twice := [str(folders[i]) for i, path in enumerate(paths) if path in paths[:i]]:
        remedy = "A recording counts once, and what was fitted proves nothing as held out."
        raise InputError.at(twice[0], "given twice.", remedy)
    names = [""] * len(paths)
    for parts in range(1, max(len(path.parts) for path in paths) + 1):
        tails = [printable("/".join(path.parts[-parts:]), allowed="") for path in paths]
        count = Counter(tails)
        names = [
            name or (tail if count[tail] == 1 else "")
            for name, tail in zip(names, tails, strict=True)
        ]
    return names


def validated(
    folders: Sequence[Path], data: RunData, settings: IdentifySettings
) -> tuple[Validation, ...]:
    """Recordings that took no part in an identification, against it.

    settings : of the identification. Raises as `identify_recordings`.
    """
    result, options = data.identification, settings.options
    read = [(folder, read_with_causes(folder)) for folder in folders]
    return tuple(
        _validated(result, folder, recording, logs_of(folder.name, recording), options, SILENT)
        for folder, recording in read
    )


def _validated(
    result: Identification,
    folder: Path,
    recording: Recording,
    logs: Logs,
    options: FitOptions,
    listener: Listener,
) -> Validation:
    try:
        outcome = held_out(result, logs, options=options, listener=listener)
    except StartError as error:
        raise StartError(f"{logs.name}: {error}") from None
    return Validation(folder, recording, outcome)


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


def _check_settings(settings: IdentifySettings) -> None:
    if settings.model == "dh" and (
        settings.corrections is not None
        or settings.force != "auto"
        or settings.rod_sigma_m is not None
    ):
        raise InputError(
            "model dh has neither corrections nor loads nor a measured rod; leave them out, or "
            "choose model complete"
        )


def _check_same_cell(folders: Sequence[Path]) -> None:
    if len(folders) == 1:
        return
    first = load_recording_file(folders[0])
    for folder in folders[1:]:
        other = load_recording_file(folder)
        pairs = (
            ("robot", first.robot, other.robot),
            ("instrument", first.measured_by, other.measured_by),
            ("plate", first.plate, other.plate),
        )
        for what, name, here in pairs:
            if description_identity(here, folder) != description_identity(name, folders[0]):
                raise InputError(
                    f"{folder}: is of {what} {here}, {folders[0]} of {name}"
                    f"{', whose content differs' * (name == here)}. "
                    "Recordings that belong together must be of the same robot, ball-bar and plate."
                )


def description_identity(name: str, folder: Path) -> str | bytes:
    """A shipped description by its name, an own one by its content."""
    return (folder / name).read_bytes() if name.endswith(".yaml") else name


def _check_force(settings: IdentifySettings, folder: Path, recording: Recording) -> None:
    if settings.force == "sensor" and recording.force_log is None:
        raise InputError(
            f"{folder}: has no log of a force sensor (`sources.force` in recording.yaml); choose "
            "force auto, torque or none"
        )
    if settings.force == "torque" and recording.robot_log.torque is None:
        raise InputError(
            f"{folder}: the robot's log has no motor torques (columns tau1 to tau6); choose force "
            "auto, sensor or none"
        )
