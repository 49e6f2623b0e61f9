"""The main job: simulate, read, identify, compare with the truth, and write the results."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ballbar.cell.errors import InputError
from ballbar.cell.extended_yaml import files_of
from ballbar.cell.files import DESCRIPTIONS, claimed_folder, write_yaml
from ballbar.cell.load import load_robot
from ballbar.cell.pose_file import load_poses_file
from ballbar.cell.processes import Begin, begin_in_copy
from ballbar.cell.recording import load_recording_file
from ballbar.ident.options import SILENT, Listener
from ballbar.result.identify import identified
from ballbar.result.names import HELD_OUT, OUTPUTS, RECORDING
from ballbar.result.run_data import RunData
from ballbar.scenario import (
    SCENARIOS,
    Scenario,
    load_scenario,
    scenario_file,
    scenario_path,
    with_absolute_names,
    with_copied_descriptions,
    write_scenario,
)
from ballbar.sim.recording_files import TABLE, truth_path, write_poses, write_recording
from ballbar.sim.simulate import Simulation
from ballbar.sim.simulate import simulate as simulate_motion
from ballbar.sim.still_poses import PoseSimulation, simulate_poses
from ballbar.trial.nominal_path import recorded_log
from ballbar.truth.compare import against_simulation
from ballbar.truth.limits import plant_limits, result_limits

# file, data, and words of what a scenario makes: of the whole, where it is real, and on the way
_RECORDING = ("recording.yaml", "raw", "a recording", "a real recording", "simulating the cell")
_TABLE = ("poses.yaml", TABLE, "a table of poses", "real poses", "simulating the poses")

# Of a scenario's cell, in the request for the path that it does not name
_CELL = {"robot", "ballbar", "instrument", "plate", "ballbar_position_m"}

if TYPE_CHECKING:  # a run without --live imports no viewer
    from ballbar.outputs import Progress
    from ballbar.replay.live import LiveRun


def simulate(
    scenario: str | PathLike[str],
    folder: str | PathLike[str] | None = None,
    *,
    overrides: Sequence[str] = (),
) -> Simulation | PoseSimulation:
    """The simulated cell of a scenario, with its truth, motion or poses.

    scenario : a path, or the name of a shipped one. folder : to which its recording or table of
        poses is written, and beside it truth and scenario; by default nowhere. overrides : texts
        `KEY=VALUE`, such as `seed=2`, that replace values of the scenario.

    Raises InputError when the scenario cannot be run, or when `folder` holds something else.
    """
    file = scenario_file(Path(scenario))
    chosen = load_scenario(file, overrides=overrides)
    if folder is not None:
        return simulate_scenario(chosen, file, Path(folder), progress=SILENT.progress)
    with tempfile.TemporaryDirectory() as temporary:
        return _simulated(chosen, file.parent, Path(temporary))[1]


def _simulated(
    scenario: Scenario, files: Path, temporary: Path, live: LiveRun | None = None
) -> tuple[Scenario, Simulation | PoseSimulation]:
    """The scenario with a path where it names none, and its simulation.

    files : folder of the scenario's file. temporary : folder for a path that is found.
    """
    whole = _with_found_path(scenario, files, temporary / "path.yaml")
    if whole.path is None:
        return whole, simulate_poses(whole, relative_to=files)
    moved, log = live.moved if live else None, recorded_log(whole.path, files)
    return whole, simulate_motion(whole, relative_to=files, recorded=log, on_motion=moved)


def simulate_scenario(
    scenario: Scenario,
    scenario_file: Path,
    folder: Path,
    *,
    progress: Progress,
    live: LiveRun | None = None,
) -> Simulation | PoseSimulation:
    """Simulates a scenario and writes its recording or table, and beside it truth and scenario.

    live : window that shows the motion while it is simulated.

    Raises InputError when the scenario cannot be run, or when `folder` holds something else, or
    what was really measured.
    """
    with (
        _simulating(scenario_file, folder, progress, still=scenario.path is None) as files,
        tempfile.TemporaryDirectory() as temporary,
    ):
        whole, simulation = _simulated(scenario, files, Path(temporary), live)
        progress("writing the files")
        write_scenario(whole, files, folder)
        copied = with_copied_descriptions(whole, files, folder)
        if simulation.still is True:
            write_poses(simulation, copied, folder)
        else:
            write_recording(simulation, copied, folder)
        return simulation


@contextmanager
def _simulating(
    scenario_file: Path, folder: Path, progress: Progress, *, still: bool
) -> Iterator[Path]:
    """A folder that a simulated recording or table is written to; yields that of the scenario.

    Raises InputError where it holds something else, or what was really measured, which is never
    replaced. Errors of the simulation are those of the scenario's file.
    """
    marker, data, what, real, doing = _TABLE if still else _RECORDING
    with claimed_folder(folder, {marker, data, DESCRIPTIONS}, what):
        if (file := folder / marker).exists():
            stored = load_poses_file(file) if still else load_recording_file(folder)
            if stored.kind == "real":
                wrong = f"holds {real}; nothing was written."
                raise InputError.at(folder, wrong, "Choose another folder with --out.")
        progress(doing)
        try:
            yield scenario_file.parent
        except InputError as error:
            raise InputError(f"{scenario_file}: {error}") from None


def run_scenario(
    scenario: Scenario,
    scenario_file: Path,
    *,
    out: Path,
    command: str,
    progress: Progress,
    answered: Callable[[RunData], None] = lambda _: None,
    live: LiveRun | None = None,
    begin: Begin = partial,
) -> RunData:
    """Simulates, identifies, compares with the truth, and writes report and, of a motion, replay.

    A recording on accept.held_out_file, of the same machine, is tried on the result.

    command : the command line, for the report. answered : takes the result before report and replay
    are written. live : window that shows each stage while it runs.
    begin : writes the replay meanwhile (ballbar.cell.processes).

    Raises InputError when the scenario cannot be run or identifies with one of the thesis's costs,
    or when `out` holds something else.
    """
    if scenario.identify.data != "files" or scenario.identify.cost != "ml":
        raise InputError(
            f"{scenario_file}: identify.cost = {scenario.identify.cost}, data = "
            f"{scenario.identify.data}: a run with report and replay identifies device logs with "
            "ml. The thesis's costs and paired samples are for sweeps."
        )
    accept, moves = scenario.accept, scenario.path is not None
    logs = (out / RECORDING, out / HELD_OUT) if moves else (out / RECORDING,)
    known = {
        *OUTPUTS,
        *(f.name for log in logs for f in (log, truth_path(log), scenario_path(log))),
    }
    with claimed_folder(out, known, "a run"):
        folder, *held_out = logs if accept.held_out_file else logs[:1]
        simulation = simulate_scenario(
            scenario, scenario_file, folder, progress=progress, live=live
        )
        for other in held_out:
            simulate_scenario(_held_out(scenario), scenario_file, other, progress=progress)
        options, listener = scenario.identify.options, Listener(progress, begin_in_copy)
        data = identified([folder], held_out, options=options, listener=listener)
        comparison = against_simulation(data.identification, simulation)
        outcomes = [validation.outcome for validation in data.validations]
        limits = (
            *result_limits(data.identification, comparison, accept, outcomes),
            *plant_limits(simulation.truth, accept),
        )
        data = replace(
            data,
            name=scenario.name,
            simulation=simulation,
            comparison=comparison,
            limits=limits,
            scenario=scenario,
            scenario_files=tuple(files_of(scenario_file, SCENARIOS)),
        )
        answered(data)
        from ballbar.outputs import write_outputs  # noqa: PLC0415  imports what writes results

        if live:
            live.finished(data)
        write_outputs(out, data, command=command, replay=moves, progress=progress, begin=begin)
        return data


def _held_out(scenario: Scenario) -> Scenario:
    """The scenario of the recording that takes no part in the fit: another path and noise."""
    path = scenario.needed_path.model_copy(update={"file": scenario.accept.held_out_file})
    return scenario.model_copy(update={"path": path, "recording": scenario.recording + 1})


def _with_found_path(scenario: Scenario, folder: Path, file: Path) -> Scenario:
    """The scenario with a path and a place of the ball-bar where it states none.

    folder : of the scenario's file. file : to which the path is written. A ball-bar with fewer than
    two encoders is planned for with four. Raises InputError where no path is found in
    ballbar.planning.plan.SECONDS.
    """
    path, cell = scenario.path, scenario.cell
    if path is None or path.kind != "lissajous" or path.file:
        return scenario
    # A run whose path is known loads no planner.
    from ballbar.planning.files import planned_path_data  # noqa: PLC0415
    from ballbar.planning.plan import plans  # noqa: PLC0415
    from ballbar.planning.request import PlanRequest, completed  # noqa: PLC0415

    named, fitted = with_absolute_names(scenario, folder).cell, scenario.encoders.fitted
    data: dict[str, object] = {
        "schema": "ballbar-plan/1",
        "name": scenario.name,
        "cell": named.model_dump(include=_CELL, exclude_none=True),
        "timing": path.model_dump(include={"duration_s", "dwell_s", "stops"}),
        "seed": scenario.seed,
    }
    if cell.ballbar is not None:
        data |= {"servo": scenario.plant.servo}
        data |= {"sensors": {"encoders": fitted}} if len(fitted) > 1 else {}
    request = completed(PlanRequest.model_validate(data), load_robot(named.robot))
    first = plans(
        request, relative_to=folder, workers=1, seconds=0, evaluations=0, since=time.monotonic
    )
    plan = next(first)
    write_yaml(file, planned_path_data(plan))
    place = tuple(plan.evaluation.candidate.position.tolist())
    path = path.model_copy(update={"file": str(file.resolve())})
    cell = cell.model_copy(update={"ballbar_position_m": place})
    return scenario.model_copy(update={"path": path, "cell": cell})
