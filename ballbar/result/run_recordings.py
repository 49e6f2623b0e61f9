"""Recording folders to an identified robot: one, or several in one fit, and held-out ones.

Recordings that are fitted or validated together must be of the same robot, ball-bar and plate:
their files must say so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from acquisition.pose_tables import import_poses
from acquisition.recording import Recording
from ballbar.identify_settings import IdentifySettings
from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.result.inputs import check_one_robot, distinct_names, holds_poses, joined
from ballbar.result.run_data import FittedRecording, RunData, Validation
from cell.errors import InputError
from cell.load import load_cell, load_measured_cell
from cell.recording import load_recording_file
from ident.held_out import held_out
from ident.identify import identify_together
from ident.options import SILENT, FitOptions, Listener
from ident.recording_fit import Logs
from ident.result import Identification
from ident.start.automatic import StartError
from ident.tracker import judged_by_tracker


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
    if still := [folder for folder in validate if holds_poses(folder)]:
        raise InputError(
            f"{still[0]}: is a table of still poses. A robot that was identified from recordings "
            "is tried on recordings; name the table among those that are fitted."
        )
    tables = [folder for folder in folders if holds_poses(folder)]
    names = distinct_names([*folders, *validate])
    called = dict(zip([*folders, *validate], names, strict=True))
    folders = [folder for folder in folders if folder not in tables]
    every = [*folders, *validate]
    names = [called[folder] for folder in every]
    _check_settings(settings)
    _check_same_cell(every)
    listener.progress("reading the recordings" if len(every) > 1 else "reading the recording")
    read = [read_with_causes(folder) for folder in every]
    for folder, recording in zip(every, read, strict=True):
        _check_force(settings, folder, recording)
    first = read[0].description
    load = load_measured_cell if first.ballbar is None else load_cell
    cell = load(first.robot, first.measured_by, first.plate, relative_to=folders[0])
    options, count = settings.options, len(folders)
    logs = [logs_of(name, recording) for name, recording in zip(names, read, strict=True)]
    imported = [(called[folder], folder, import_poses(folder)) for folder in tables]
    check_one_robot(tables, [content for _, _, content in imported])
    result = identify_together(
        cell,
        logs[:count],
        joined(imported) if imported else None,
        options=options,
        listener=listener,
    )
    held = zip(validate, read[count:], logs[count:], strict=True)
    validations = tuple(
        _validated(result, folder, recording, own, options, listener)
        for folder, recording, own in held
    )
    for validation, own in zip(validations, logs[count:], strict=True):
        tracker, name = validation.outcome.tracker, own.name
        verdict = judged_by_tracker(result.verdict, own.tracker, tracker, name=name)
        result = replace(result, verdict=verdict)
    fitted = zip(names[:count], folders, read[:count], result.recordings, strict=True)
    return RunData(
        name=" + ".join([*names[:count], *(called[folder] for folder in tables)]),
        recordings=tuple(FittedRecording(*parts) for parts in fitted),
        identification=result,
        validations=validations,
        tables=tuple(imported),
    )


def validated(
    folders: Sequence[Path], data: RunData, settings: IdentifySettings
) -> tuple[Validation, ...]:
    """Recordings that took no part in an identification, against it.

    settings : of the identification. Raises as `identify_recordings`.
    """
    result, options = data.identification, settings.options
    read = [(folder, read_with_causes(folder)) for folder in folders]
    return tuple(
        _validated(result, folder, each, logs_of(folder.name, each), options, SILENT)
        for folder, each in read
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
