"""The day: record live, identify, plan on, record and identify together, correct, verify.

    scenario -> simulated devices -> recorder -> path1 -> result1 -> plan -> path2
             -> result -> corrected targets -> plant;  path3 -> verify

Each step is that of the command of its name. The truth is read here alone, to judge what came out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from ballbar.cell.arrays import Array
from ballbar.cell.number_text import significant_text
from ballbar.cell.statistics import rms
from ballbar.export.result import load_result
from ballbar.ident.options import Listener
from ballbar.ident.result import Identification
from ballbar.outputs import Progress, write_outputs
from ballbar.rehearsal.live import LivePath, record_live
from ballbar.rehearsal.second_path import plan_second_path
from ballbar.rehearsal.targets import HeldTargets, correct_targets, hold_targets
from ballbar.result.compare import Comparison
from ballbar.result.identify import identified
from ballbar.result.verification import verify
from ballbar.run import simulate_scenario
from ballbar.scenario import Scenario
from ballbar.sim.simulate import Simulation
from ballbar.sim.still_poses import PoseSimulation
from ballbar.truth.compare import against_simulation
from ballbar.truth.limits import Limit, corrected_limits, tcp_limits
from ballbar.units import MM

SIMULATED, RECORDINGS = "simulated", "recordings"
FIRST, RESULT = "result1", "result"


@dataclass(frozen=True, eq=False)
class Stage:
    """One step of the day."""

    name: str
    sentence: str  # what came out
    met: bool
    took: float  # [s] of wall time
    figures: dict[str, object]  # SI units


@dataclass(eq=False)
class Day:
    """A day under way."""

    scenario: Scenario  # as its devices deliver it (`live.as_recorded`)
    file: Path  # where the scenario was read
    folder: Path
    speed: float  # times real time
    fault: str | None  # a key of FAULTS, with which the first path is recorded once more
    command: str
    show: Callable[[Stage], None]  # called with each stage when it is done
    progress: Progress
    stages: list[Stage] = field(default_factory=list)
    paths: dict[str, LivePath] = field(default_factory=dict)  # by the name of the recording
    since: float = field(default_factory=time.monotonic)

    @property
    def took(self) -> float:
        """[s] of wall time."""
        return sum(stage.took for stage in self.stages)

    def done(self, name: str, sentence: str, figures: dict[str, object], *, met: bool) -> None:
        """Adds a stage, and shows it."""
        now = time.monotonic()
        self.stages.append(Stage(name, sentence, met, now - self.since, figures))
        self.since = now
        self.show(self.stages[-1])

    def recording(self, name: str) -> Path:
        """Folder of a recording."""
        return self.folder / RECORDINGS / name


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A day that was rehearsed."""

    day: Day
    limits: tuple[Limit, ...]
    nominal: float  # [m] mean TCP error of the nominal robot
    held: HeldTargets

    @property
    def acceptable(self) -> bool:
        return all([*(s.met for s in self.day.stages), *(limit.met for limit in self.limits)])


def rehearse(day: Day) -> Rehearsal:
    """Rehearses a day in its folder.

    Raises InputError and FailureError as the commands of the day do.
    """
    accept, made = day.scenario.accept, _simulated(day, "path1", day.scenario)
    if day.fault is not None:
        _with_fault(day, day.fault)
    _recorded(day, "path1")
    _, first = _identified(day, FIRST, ("path1",), made)
    _simulated(day, "path2", _planned(day))
    _recorded(day, "path2")
    result, comparison = _identified(day, RESULT, ("path1", "path2"), made)
    held = _corrected(day)
    _verified(day)
    limits = tcp_limits(result.verdict.status, result.robot.tcp_sigma, comparison, accept)
    limits += corrected_limits(held.after, accept)
    return Rehearsal(day, limits, first.tcp_nominal.mean, held)


def _simulated(day: Day, name: str, scenario: Scenario) -> Simulation | PoseSimulation:
    """Simulates what the devices will deliver of a path."""
    folder = day.folder / SIMULATED / name
    return simulate_scenario(scenario, day.file, folder, progress=day.progress)


def _taken(
    day: Day, name: str, source: str, *, fault: str | None = None, identify: bool = True
) -> LivePath:
    """Records a simulated path; see `record_live`."""
    day.progress(f"recording {name}")
    day.paths[name] = record_live(
        day.folder / SIMULATED / source,
        day.scenario,
        folder=day.recording(name),
        relative_to=day.file.parent,
        speed=day.speed,
        fault=fault,
        identify=identify,
    )
    return day.paths[name]


def _with_fault(day: Day, fault: str) -> None:
    """The first path with a fault, until it is noticed."""
    path = _taken(day, "fault", "path1", fault=fault)
    after, alarm, sentence = None, path.noticed, "not noticed"
    if alarm is not None:
        after = alarm.raised - path.shows
        sentence = f"noticed {after:.1f} s of recording later: {alarm.kind}: {alarm.sentence}"
    figures: dict[str, object] = {
        "fault": fault,
        "began_s": path.began,
        "shows_s": path.shows,
        "noticed_after_s": after,
        "alarm": None if alarm is None else {"kind": alarm.kind, "sentence": alarm.sentence},
    }
    sentence = f"{fault} from {path.shows:.0f} s on: {sentence}"
    day.done("record with a fault", sentence, figures, met=alarm is not None)


def _recorded(day: Day, name: str) -> None:
    """Records a path and identifies it meanwhile."""
    path = _taken(day, name, name)
    alarms, last = list(path.alarms.values()), path.last
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
    listed = "".join(f"; ALARM {a.kind} at {a.raised:.0f} s: {a.sentence}" for a in alarms)
    sentence = f"{path.seconds:.0f} s, {path.lost} records lost, {stated}{listed or ', no alarm'}"
    day.done(f"record {name}", sentence, figures, met=not alarms and not path.lost)


def _identified(
    day: Day, name: str, recordings: tuple[str, ...], made: Simulation | PoseSimulation
) -> tuple[Identification, Comparison]:
    """Identifies recordings, and compares with the truth of the first."""
    folders = [day.recording(recording) for recording in recordings]
    listener = Listener(day.progress)
    data = identified(folders, options=day.scenario.identify.options, listener=listener)
    write_outputs(day.folder / name, data, command=day.command, replay=False, progress=day.progress)
    robot, verdict = data.identification.robot, data.identification.verdict
    comparison = against_simulation(data.identification, made)
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
    return data.identification, comparison


def _planned(day: Day) -> Scenario:
    """Plans the second path after the first result; the scenario of its recording.

    Where an instrument follows the robot the path is recorded again: no path for it is planned
    after a result.
    """
    if not load_result(day.folder / FIRST).calibration.of_logs:
        again = {"recording": day.scenario.recording + 1}
        day.done("path2", "the first path, recorded once more", {}, met=True)
        return day.scenario.model_copy(update=again)
    day.progress("planning the second path")
    second, predicted, feasible = plan_second_path(
        day.scenario, day.folder, day.folder / FIRST, day.file.parent
    )
    before, then = predicted["by_results_before"], predicted["rms_median_robot"]
    position = second.cell.position.tolist()
    seat = ", ".join(f"{v:.3f}" for v in position)
    violated = "" if feasible else "; a limit is violated in MuJoCo"
    sentence = (
        f"seat ({seat}) m; scale known, {_mm(before)} by the first result, {_mm(then)} "
        f"predicted with the path{violated}"
    )
    figures = {"tcp_sigma_m": predicted, "seat_m": position, "feasible": feasible}
    day.done("plan path2", sentence, figures, met=feasible)
    return second


def _corrected(day: Day) -> HeldTargets:
    """Corrects targets over the workspace, and lets the true robot hold them."""
    day.progress("correcting targets")
    result = load_result(day.folder / RESULT)
    correction = correct_targets(day.folder, result)
    expected, included = correction.corrected.position_before, ["geometry", *correction.included]
    figures: dict[str, object] = {
        "targets": len(expected),
        "expected_before_m": _mean_and_max(expected),
        "included": included,
    }
    sentence = (
        f"{len(expected)} targets for {', '.join(included)}; the result "
        f"expects {_mm(expected.mean())} mean, {_mm(expected.max())} largest without it"
    )
    day.done("correct targets", sentence, figures, met=True)
    day.progress("holding targets in the plant")
    targets = hold_targets(day.folder, result, day.scenario, day.file.parent)
    figures = {
        "nominal_targets_m": _mean_and_max(targets.before),
        "corrected_targets_m": _mean_and_max(targets.after),
        "corrected_base_aligned_m": _mean_and_max(targets.aligned),
    }
    sentence = (
        f"off by {_mm(targets.before.mean())} mean, {_mm(targets.before.max())} largest as "
        f"planned; by {_mm(targets.after.mean())} mean, {_mm(targets.after.max())} largest "
        f"corrected ({_mm(targets.aligned.mean())} mean with the base aligned)"
    )
    met = targets.after.mean() < targets.before.mean()
    day.done("hold them in the plant", sentence, figures, met=bool(met))
    return targets


def _mean_and_max(values: Array) -> dict[str, float]:
    return {"mean": float(values.mean()), "max": float(values.max())}


def _verified(day: Day) -> None:
    """One more path against the result: held out, if the scenario names one."""
    scenario = day.scenario
    file = scenario.accept.held_out_file or scenario.needed_path.file
    changes = {
        "path": scenario.needed_path.model_copy(update={"file": file}),
        "recording": scenario.recording + 2,
    }
    _simulated(day, "path3", scenario.model_copy(update=changes))
    path = _taken(day, "path3", "path3", identify=False)
    day.progress("verifying")
    outcome = verify(day.folder / RESULT, day.recording("path3"))
    figures: dict[str, object] = {
        "holds": outcome.holds,
        "innovation": outcome.figures.get("normalised_innovation"),  # none of poses
        "lost": path.lost,
    }
    met = outcome.holds and not path.lost
    day.done("verify with path3", outcome.sentence, figures, met=met)


def _mm(length: float) -> str:
    return f"{significant_text(length * MM)} mm"
