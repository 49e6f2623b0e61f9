"""The day: record live, identify, plan on, record and identify together, correct, verify.

    scenario -> simulated devices -> recorder -> path1 -> result1 -> plan -> path2
             -> result -> corrected targets -> plant;  path3 -> verify

Each step is that of the command of its name. The truth is read here alone, to judge what came out.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ballbar.compensation.joint_targets import axis_columns, read_targets
from ballbar.compensation.targets_file import correct_file, write_corrected
from ballbar.export.result import Result, load_result
from ballbar.outputs import Progress, write_outputs
from ballbar.plan.show import plan_path
from ballbar.rehearsal.live import LivePath, record_live
from ballbar.result.compare import Comparison, identification_against_truth
from ballbar.result.iterations import IterationLog
from ballbar.result.limits import Limit, corrected_limits, tcp_limits
from ballbar.result.run_data import RunData
from ballbar.result.run_recordings import identify_recordings, validated
from ballbar.result.verification import verify_folder
from ballbar.run import simulate_scenario
from ballbar.scenario import Scenario, with_absolute_names
from ballbar.terminal import PlainConsole
from ballbar.units import MM
from cell.arrays import Array
from cell.errors import FailureError
from cell.files import write_whole, write_yaml
from cell.geometry import robot_frames
from cell.number_text import significant_text
from cell.robot_angles import joints_to_axes
from cell.statistics import rms
from cell.strict_yaml import load_model, load_yaml
from ident.robot.accuracy import accuracy_grid, position_error
from ident.robot.inverse_calibration import TargetError, corrected_targets
from planning.request import PlanRequest, load_request
from sim.path_files import LissajousFile
from sim.plant.held import hold_targets, pose_distance
from sim.true_robot import true_machine
from sim.truth import Truth

SEARCH = 10.0  # [s] of the search for the second path: the same search as of `plan`, shorter
REACH = 0.15  # [m] to each side of its first seat within which the ball-bar may be set up again
# [deg] about the vertical in which the rod of a telescoping bar may lean in its cup, as in
# scenarios/plans/ur10e_telescoping.yaml
CONE = 80.0
TARGETS = 50
SIMULATED, RECORDINGS, PLAN = "simulated", "recordings", "plan"
FIRST, RESULT = "result1", "result"
GIVEN, CORRECTED = "targets.csv", "targets-corrected.csv"
REQUEST = "request.yaml"


@dataclass(frozen=True, eq=False)
class Stage:
    """One step of the day."""

    name: str
    sentence: str  # what came out
    met: bool
    took: float  # [s] of wall time
    figures: dict[str, object]  # SI units


@dataclass(frozen=True, eq=False)
class HeldTargets:
    """Targets in the plant: (N,) each."""

    before: Array  # [m] distance of the tool from where it belongs, targets as planned
    after: Array  # [m] likewise with corrected targets
    aligned: Array  # [m] likewise after the best rigid motion of the base


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A day that was rehearsed."""

    scenario: Scenario
    speed: float
    fault: str | None
    stages: tuple[Stage, ...]
    limits: tuple[Limit, ...]
    paths: dict[str, LivePath]  # by the name of the recording
    nominal: float  # [m] mean TCP error of the nominal robot
    held: HeldTargets

    @property
    def acceptable(self) -> bool:
        return all(stage.met for stage in self.stages) and all(limit.met for limit in self.limits)

    @property
    def took(self) -> float:
        """[s] of wall time."""
        return sum(stage.took for stage in self.stages)


@dataclass(eq=False)
class _Day:
    """A day under way."""

    scenario: Scenario  # as its devices deliver it
    file: Path
    folder: Path
    speed: float
    command: str
    show: Callable[[Stage], None]
    progress: Progress
    stages: list[Stage] = field(default_factory=list)
    paths: dict[str, LivePath] = field(default_factory=dict)
    since: float = field(default_factory=time.monotonic)

    def done(self, name: str, sentence: str, figures: dict[str, object], *, met: bool) -> None:
        """Adds a stage, and shows it."""
        now = time.monotonic()
        self.stages.append(Stage(name, sentence, met, now - self.since, figures))
        self.since = now
        self.show(self.stages[-1])

    def recording(self, name: str) -> Path:
        """Folder of a recording."""
        return self.folder / RECORDINGS / name


def rehearse(
    scenario: Scenario,
    *,
    file: Path,
    folder: Path,
    speed: float,
    fault: str | None,
    command: str,
    show: Callable[[Stage], None],
    progress: Progress,
) -> Rehearsal:
    """Rehearses a day in a folder.

    scenario : as its devices deliver it (`live.as_recorded`). file : where it was read. speed :
    times real time. fault : a key of FAULTS that begins midway in the first path, which is then
    recorded once more. show : called with each stage when it is done.

    Raises InputError and FailureError as the commands of the day do.
    """
    day = _Day(
        scenario=scenario,
        file=file,
        folder=folder,
        speed=speed,
        command=command,
        show=show,
        progress=progress,
    )
    truth = _simulated(day, "path1", scenario)
    if fault is not None:
        _with_fault(day, fault)
    _recorded(day, "path1")
    first = _identified(day, FIRST, ("path1",), truth)
    second = _planned(day)
    _simulated(day, "path2", second)
    _recorded(day, "path2")
    together = _identified(day, RESULT, ("path1", "path2"), truth)
    held = _corrected(day)
    data, comparison = together
    _verified(day, data)
    return Rehearsal(
        scenario=scenario,
        speed=speed,
        fault=fault,
        stages=tuple(day.stages),
        limits=(
            *tcp_limits(data.identification, comparison, scenario.accept),
            *corrected_limits(held.after, scenario.accept),
        ),
        paths=day.paths,
        nominal=first[1].tcp_nominal.mean,
        held=held,
    )


def _simulated(day: _Day, name: str, scenario: Scenario) -> Truth:
    """Simulates what the devices will deliver of a path."""
    simulation = simulate_scenario(
        scenario, day.file, day.folder / SIMULATED / name, progress=day.progress
    )
    return simulation.truth


def _taken(
    day: _Day, name: str, source: str, *, fault: str | None = None, identify: bool = True
) -> LivePath:
    day.progress(f"recording {name}")
    path = record_live(
        day.folder / SIMULATED / source,
        day.scenario,
        folder=day.recording(name),
        relative_to=day.file.parent,
        speed=day.speed,
        fault=fault,
        identify=identify,
    )
    day.paths[name] = path
    return path


def _with_fault(day: _Day, fault: str) -> None:
    """The first path with a fault, until it is noticed."""
    path = _taken(day, "fault", "path1", fault=fault)
    cause, alarm = path.cause, path.noticed
    assert cause is not None  # it was injected
    figures: dict[str, object] = {
        "fault": fault,
        "began_s": cause.began,
        "shows_s": cause.shows,
        "noticed_after_s": None if alarm is None else alarm.raised - cause.shows,
        "alarm": None if alarm is None else {"kind": alarm.kind, "sentence": alarm.sentence},
    }
    began = f"{fault} from {cause.shows:.0f} s on"
    if alarm is None:
        sentence = f"{began}: not noticed"
    else:
        sentence = (
            f"{began}: noticed {alarm.raised - cause.shows:.1f} s of recording later: "
            f"{alarm.kind}: {alarm.sentence}"
        )
    day.done("record with a fault", sentence, figures, met=alarm is not None)


def _recorded(day: _Day, name: str) -> None:
    """Records a path and identifies it meanwhile."""
    path = _taken(day, name, name)
    alarms, last = path.alarms, path.last
    live = path.stated[-1][1] if path.stated else None
    final = None if last is None else last["tcp_sigma_m"]
    words = ["no result yet" if sigma is None else _mm(sigma) for sigma in (live, final)]
    stated = f"stated {words[0]} while it moved, {words[1]} at its end"
    figures = {
        "seconds": path.seconds,
        "lost": path.lost,
        "tcp_sigma_live_m": live,
        "tcp_sigma_final_m": final,
        "alarms": [vars(alarm) for alarm in alarms],
    }
    said = "".join(f"; ALARM {a.kind} at {a.raised:.0f} s: {a.sentence}" for a in alarms)
    sentence = f"{path.seconds:.0f} s, {path.lost} records lost, {stated}{said or ', no alarm'}"
    day.done(f"record {name}", sentence, figures, met=not alarms and not path.lost)


def _identified(
    day: _Day, name: str, recordings: tuple[str, ...], truth: Truth
) -> tuple[RunData, Comparison]:
    """Identifies recordings, and compares with the truth of the first."""
    log = IterationLog(day.progress)
    folders = [day.recording(recording) for recording in recordings]
    data = identify_recordings(folders, settings=day.scenario.identify, listener=log.listener)
    out = day.folder / name
    write_outputs(out, data, command=day.command, replay=False, progress=day.progress)
    robot, verdict = data.identification.robot, data.identification.verdict
    comparison = identification_against_truth(data.identification, truth)
    tcp, sigma, without = comparison.tcp, rms(robot.tcp_sigma), rms(robot.tcp.without_scale)
    figures = {
        "verdict": str(verdict.status),
        "tcp_sigma_m": sigma,
        "tcp_sigma_without_scale_m": without,
        "true_tcp_error_m": {
            "mean": tcp.mean,
            "rms": rms(tcp.error),
            "max": tcp.maximum,
            "rms_without_scale": rms(tcp.error_without_scale),
        },
        "nominal_tcp_error_m": comparison.tcp_nominal.mean,
    }
    sentence = (
        f"{verdict.status}, stated {_mm(sigma)} ({_mm(without)} without scale); true error "
        f"{_mm(rms(tcp.error))} rms ({_mm(rms(tcp.error_without_scale))} without scale), "
        f"largest {_mm(tcp.maximum)}"
    )
    day.done(f"identify {' and '.join(recordings)}", sentence, figures, met=verdict.acceptable)
    return data, comparison


def _planned(day: _Day) -> Scenario:
    """Plans the second path after the first result; the scenario of its recording."""
    day.progress("planning the second path")
    file, plan = day.folder / REQUEST, day.folder / PLAN
    write_yaml(file, request_data(day.scenario, day.file.parent))
    said = PlainConsole(file=io.StringIO())
    request = load_request(file)
    assert isinstance(request, PlanRequest)
    feasible = plan_path(
        request, file, folder=plan, seconds=SEARCH, after=[day.folder / FIRST], out=said, err=said
    )
    planned = load_yaml(plan / "plan.yaml").data
    if planned["search"]["stopped"]:  # a plan keeps its best path, a day does not go on
        raise KeyboardInterrupt
    predicted = planned["tcp_sigma_m"]
    before, then = predicted["by_results_before"], predicted["rms_median_robot"]
    path = load_model(plan / "path.yaml", LissajousFile)
    position = path.ballbar_position_m
    assert position is not None  # a plan states it
    seat = ", ".join(f"{v:.3f}" for v in position)
    sentence = (
        f"seat ({seat}) m; scale known, {_mm(before)} by the first result, {_mm(then)} "
        f"foretold with the path{'' if feasible else '; a limit is violated in MuJoCo'}"
    )
    figures = {"tcp_sigma_m": predicted, "seat_m": list(position), "feasible": feasible}
    day.done("plan path2", sentence, figures, met=feasible)
    scenario = day.scenario
    return scenario.model_copy(
        update={
            "cell": scenario.cell.model_copy(update={"ballbar_position_m": position}),
            "path": scenario.path.model_copy(update={"file": str((plan / "path.yaml").resolve())}),
            "recording": scenario.recording + 1,
        }
    )


def request_data(scenario: Scenario, relative_to: Path) -> dict[str, object]:
    """The planning request of a scenario's second path: its cell, times and sensors."""
    named = with_absolute_names(scenario, relative_to).cell
    position, encoders = np.array(named.ballbar_position_m), scenario.encoders
    region = {
        "lower": (position - REACH).round(6).tolist(),
        "upper": (position + REACH).round(6).tolist(),
    }
    request: dict[str, object] = {
        "schema": "ballbar-plan/1",
        "name": "path2",
        "timing": scenario.path.model_dump(include={"duration_s", "dwell_s", "stops"}),
        "seed": scenario.seed,
    }
    cell: dict[str, object] = {
        "robot": named.robot,
        "plate": named.plate,
        "ballbar_region_m": region,
    }
    if named.instrument is not None:
        seat = {"axis": [0.0, 0.0, 1.0], "cone_deg": CONE}
        return request | {"cell": cell | {"instrument": named.instrument, "seat": seat}}
    sensors = {"encoders": list(encoders.fitted)}
    return request | {"cell": cell | {"ballbar": named.ballbar}, "sensors": sensors}


def _corrected(day: _Day) -> HeldTargets:
    """Corrects targets over the workspace, and lets the true robot hold them."""
    day.progress("correcting targets")
    result = load_result(day.folder / RESULT)
    if not isinstance(result, Result):
        raise FailureError(f"{day.folder / RESULT}: is no result of recordings")
    given, written = day.folder / GIVEN, day.folder / CORRECTED
    _write_targets(given, result)
    correction = correct_file(given, result)
    write_corrected(written, correction, result)
    expected = correction.corrected.position_before
    figures: dict[str, object] = {
        "targets": len(expected),
        "expected_before_m": {"mean": float(expected.mean()), "max": float(expected.max())},
        "included": ["geometry", *correction.included],
    }
    sentence = (
        f"{len(expected)} targets for {', '.join(['geometry', *correction.included])}; the result "
        f"expects {_mm(expected.mean())} mean, {_mm(expected.max())} largest without it"
    )
    day.done("correct targets", sentence, figures, met=True)
    held = _held(day, read_targets(given, result.robot).q, read_targets(written, result.robot).q)
    figures = {
        name: {"mean": float(values.mean()), "max": float(values.max())}
        for name, values in (
            ("nominal_targets_m", held.before),
            ("corrected_targets_m", held.after),
            ("corrected_base_aligned_m", held.aligned),
        )
    }
    sentence = (
        f"off by {_mm(held.before.mean())} mean, {_mm(held.before.max())} largest as planned; by "
        f"{_mm(held.after.mean())} mean, {_mm(held.after.max())} largest corrected "
        f"({_mm(held.aligned.mean())} mean with the base aligned)"
    )
    met = held.after.mean() < held.before.mean()
    day.done("hold them in the plant", sentence, figures, met=bool(met))
    return held


def _write_targets(file: Path, result: Result) -> None:
    """The first targets of the accuracy box that can be corrected; at singularities none can."""
    q = _correctable(result, accuracy_grid(result.robot))[:TARGETS]
    axes = np.degrees(joints_to_axes(result.robot, q))
    lines = [",".join(axis_columns(result.robot)), *(",".join(map(repr, r)) for r in axes.tolist())]
    write_whole(file, ("\n".join(lines) + "\n").encode())


def _correctable(result: Result, q: Array) -> Array:
    """(K, J) [rad] of targets (N, J) those that can be corrected.

    Targets are refused for one reason at a time, so those that are left are tried again.
    """
    robot, nominal = result.calibration.unloaded_robot(result.cell), result.calibration.nominal
    while True:
        try:
            corrected_targets(robot, nominal, q)
        except TargetError as error:
            q = np.delete(q, list(error.faults), axis=0)
        else:
            return q


def _held(day: _Day, given: Array, corrected: Array) -> HeldTargets:
    day.progress("holding targets in the plant")
    robot = true_machine(day.scenario, relative_to=day.file.parent)
    wanted, after = robot_frames(robot.nominal, given), hold_targets(robot, corrected)
    return HeldTargets(
        before=pose_distance(wanted, hold_targets(robot, given))[0],
        after=pose_distance(wanted, after)[0],
        aligned=position_error(wanted.tip.T, after.tool[:, :3, 3]).error,
    )


def _verified(day: _Day, data: RunData) -> None:
    """One more path against the result: held out, if the scenario names one.

    Of a sensed length it is validated instead: `verify` calls unchanged machines changed there
    (docs/limits.md).
    """
    scenario = day.scenario
    chosen = scenario.accept.held_out_file or scenario.path.file
    again = scenario.model_copy(
        update={
            "path": scenario.path.model_copy(update={"file": chosen}),
            "recording": scenario.recording + 2,
        }
    )
    _simulated(day, "path3", again)
    path = _taken(day, "path3", "path3", identify=False)
    day.progress("verifying")
    folder = day.recording("path3")
    if scenario.cell.instrument is None:
        outcome, _ = verify_folder(day.folder / RESULT, folder)
        name, met, ratio = "verify with path3", bool(outcome.holds), outcome.innovation
        sentence = outcome.sentence
    else:
        held_out = validated([folder], data, scenario.identify)[0].outcome
        name, met = "validate on path3", bool(held_out.acceptable)
        ratio = held_out.normalised_innovation
        sentence = held_out.sentence
    figures: dict[str, object] = {"holds": met, "innovation": float(ratio), "lost": path.lost}
    day.done(name, sentence, figures, met=met and not path.lost)


def _mm(length: float) -> str:
    return f"{significant_text(length * MM)} mm"
