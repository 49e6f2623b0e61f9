"""Recording folders to an identified robot: one recording or several together, and held-out ones to try it on.

Recordings that are fitted or validated together must be of the same robot, ball-bar and plate: their files must say so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from acquisition import Recording, read_recording
from ballbar.result.run_data import Joined, RunData, Validation
from ballbar.scenario import IdentifySettings
from cell.errors import InputError
from cell.load import load_cell
from cell.recording import load_recording_file
from ident.estimator.iteration import IterationCallback
from ident.held_out import held_out
from ident.identify import Identification, Logs, identify_together
from ident.start.automatic import StartError
from ident.verdict import Verdict

Progress = Callable[[str], None]

_SEVERITY = ("implausible", "not converged", "ambiguous", "misfit", "suspect", "good")


def identify_recordings(
    folders: Sequence[Path],
    validate: Sequence[Path] = (),
    *,
    settings: IdentifySettings,
    progress: Progress,
    on_iteration: IterationCallback | None = None,
) -> RunData:
    """One robot from one or several recordings, tried on the held-out ones; on_iteration : hears the iterations.

    Raises InputError for bad files, for recordings that do not belong together and for settings that contradict them;
    StartError when the logs of a recording do not fit together.
    """
    every = [*folders, *validate]
    names = distinct_names(every)
    _check_settings(settings, folders)
    _check_same_cell(every)
    progress("reading the recordings" if len(every) > 1 else "reading the recording")
    read = [read_recording(folder) for folder in every]
    for folder, recording in zip(every, read, strict=True):
        _check_force(settings, folder, recording)
    first = read[0].description
    cell = load_cell(first.robot, first.ballbar, first.plate, relative_to=folders[0])
    results = identify_together(
        cell,
        [_logs(recording) for recording in read[: len(folders)]],
        model=settings.model,
        corrections=settings.corrections,
        force=settings.force,
        rod_sigma=settings.rod_sigma_m,
        samples=settings.samples,
        progress=progress,
        on_iteration=on_iteration,
    )
    result = replace(results[0], verdict=_verdict(names, results, settings))
    held = zip(names[len(folders) :], validate, read[len(folders) :], strict=True)
    validations = tuple(
        _validated(result, name, folder, recording, settings, progress)
        for name, folder, recording in held
    )
    joined = (
        tuple(
            Joined(*one) for one in zip(names, folders, read, [result, *results[1:]], strict=False)
        )
        if len(folders) > 1
        else ()
    )
    return RunData(
        " + ".join(names[: len(folders)]),
        folders[0],
        read[0],
        result,
        joined=joined,
        validations=validations,
    )


def distinct_names(folders: Sequence[Path]) -> list[str]:
    """Each folder's last part, or as many parts from the end as tell it from the others.

    Raises InputError when one of them is given twice.
    """
    whole = [folder.resolve() for folder in folders]
    if twice := [str(folders[i]) for i, path in enumerate(whole) if path in whole[:i]]:
        raise InputError(
            f"{twice[0]}: given twice. A recording counts once, and what was fitted proves nothing as held out."
        )
    names = [""] * len(whole)
    for parts in range(1, max(len(path.parts) for path in whole) + 1):
        tails = ["/".join(path.parts[-parts:]) for path in whole]
        count = Counter(tails)
        names = [
            name or (tail if count[tail] == 1 else "")
            for name, tail in zip(names, tails, strict=True)
        ]
    return names


def _validated(
    result: Identification,
    name: str,
    folder: Path,
    recording: Recording,
    settings: IdentifySettings,
    progress: Progress,
) -> Validation:
    try:
        outcome = held_out(
            result,
            _logs(recording),
            name=name,
            force=settings.force,
            samples=settings.samples,
            progress=progress,
        )
    except StartError as error:
        raise StartError(f"{name}: {error}") from None
    return Validation(folder, recording, outcome)


def _logs(recording: Recording) -> Logs:
    return Logs(recording.robot_log, recording.ballbar_log, recording.force_log)


def _check_settings(settings: IdentifySettings, folders: Sequence[Path]) -> None:
    if settings.model != "dh":
        return
    if (
        settings.corrections is not None
        or settings.force != "auto"
        or settings.rod_sigma_m is not None
    ):
        raise InputError(
            "model dh has neither corrections nor loads nor a measured rod; leave them out, or choose model complete"
        )
    if len(folders) > 1:
        raise InputError(
            f"model dh fits one recording, {len(folders)} were given; choose model complete, or identify each by itself"
        )


def _check_same_cell(folders: Sequence[Path]) -> None:
    if len(folders) == 1:
        return
    first = load_recording_file(folders[0])
    for folder in folders[1:]:
        other = load_recording_file(folder)
        pairs = (
            ("robot", first.robot, other.robot),
            ("ball-bar", first.ballbar, other.ballbar),
            ("plate", first.plate, other.plate),
        )
        for what, name, here in pairs:
            if _identity(here, folder) != _identity(name, folders[0]):
                raise InputError(
                    f"{folder}: is of {what} {here}, {folders[0]} of {name}{', whose content differs' * (name == here)}. "
                    "Recordings that belong together must be of the same robot, ball-bar and plate."
                )


def _identity(name: str, folder: Path) -> object:
    """A shipped description by its name, an own one by its content."""
    return (folder / name).read_bytes() if name.endswith(".yaml") else name


def _check_force(settings: IdentifySettings, folder: Path, recording: Recording) -> None:
    if settings.force == "sensor" and recording.force_log is None:
        raise InputError(
            f"{folder}: has no log of a force sensor (`sources.force` in recording.yaml); choose force auto, torque or none"
        )
    if settings.force == "torque" and recording.robot_log.torque is None:
        raise InputError(
            f"{folder}: the robot's log has no motor torques (columns tau1 to tau6); choose force auto, sensor or none"
        )


def _verdict(
    names: Sequence[str], results: Sequence[Identification], settings: IdentifySettings
) -> Verdict:
    """The worst verdict of all recordings, the remarks of each."""
    worst = min(range(len(results)), key=lambda k: _SEVERITY.index(results[k].verdict.status))
    verdict = results[worst].verdict
    several = len(results) > 1
    warnings = [
        f"{name}: {w}" if several else w
        for name, one in zip(names, results, strict=False)
        for w in one.verdict.warnings
    ]
    if settings.rod_sigma_m is not None and results[0].model == "dh":
        warnings.append(
            "the measured rod length was not used: the dh model explains the recording and finds the rod by itself"
        )
    sentence = f"{names[worst]}: {verdict.sentence}" if worst > 0 else verdict.sentence
    return Verdict(verdict.status, sentence, tuple(warnings))
