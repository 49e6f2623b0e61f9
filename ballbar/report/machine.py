"""Sections about the machine: what drives its TCP error, parameters, corrections and fit.

What all recordings have in common stands once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.extended_yaml import SHIPPED
from ballbar.cell.geometry import parameter_named
from ballbar.ident.estimator.uncertainty import correlated_groups
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.tcp_correction import CorrectionPart, correction_parts
from ballbar.ident.robot.tcp_uncertainty import MASSES, SCALE, TcpDirection, TcpUncertainty
from ballbar.ident.verdict import Status
from ballbar.planning import next_step
from ballbar.planning.questions import ENCODERS
from ballbar.planning.trajectory import Passage
from ballbar.report.maps import correlation_map
from ballbar.report.motion import bar_angles_at, logged_joints
from ballbar.report.numbers import fixed, listed, significant
from ballbar.report.parameters import (
    coefficient_text,
    coefficients_at_prior,
    correction_tables,
    left_at_nominal,
    not_requested,
    parameter_groups,
    parameters_at_prior,
)
from ballbar.report.recording import overview
from ballbar.report.section import MACHINE, Section, machine_row, section
from ballbar.result.compare import z_rms
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.sim.path_files import load_lissajous
from ballbar.units import MM

STEP = 0.1  # [s] of a recording's motion, half that of planned ones: it may be faster
SHOWN = 8  # rows of a table; what follows is added up
NAMED = 4  # unknowns of a direction that are named
WORTHWHILE = 0.05  # share of the stated uncertainty below which a step is not recommended
PATHS = ("a", "b", "planned")  # of scenarios/paths, behind the robot's name
ENOUGH = (Status.GOOD, Status.SUSPECT, Status.UNCERTAIN)  # nothing is to be repaired first

_KINDS = {
    "a": "link length",
    "d": "link offset",
    "alpha": "twist",
    "beta": "Hayati angle",
    "theta": "joint offset",
}


def machine_sections(run: RunData) -> list[Section]:
    """Held-out recordings, parameters and corrections, and the fit."""
    held_out, links = list[Section](), {"held-out": "Held-out"}
    if outcomes := [validation.outcome for validation in run.validations]:
        held_out = [section("held_out.html", links, machine_row(run), held_out=outcomes)]
    return [*held_out, _parameters(run), *_fit(run)]


def _parameters(run: RunData) -> Section:
    """Parameters and corrections of the robot."""
    robot, comparison = run.identification.robot, run.comparison
    if comparison is not None and not comparison.deviations:
        comparison = None  # of still poses: their gauge, too, parts them from the true ones
    covariance, corrections = robot.covariance, correction_tables(robot)
    groups = correlated_groups(covariance.values, covariance.names)
    return section(
        "machine.html",
        {"parameters": "Parameters", "corrections": "Corrections" if corrections else ""},
        machine_row(run),
        result=run.identification,
        against_truth=comparison is not None,
        several=run.several,
        groups=parameter_groups(robot, comparison),
        z_rms=z_rms(run.identification, comparison) if comparison else None,
        left_at_nominal=left_at_nominal(robot),
        not_requested=not_requested(robot),
        correlated=[", ".join(names) for names in groups],
        correlations=correlation_map(covariance, groups),
        corrections=corrections,
        weights=any(c.name == "unit_weights" for c in robot.corrections),
        at_prior=parameters_at_prior(robot),
        coefficients_at_prior=[(c.name, coefficient_text(c)) for c in coefficients_at_prior(robot)],
    )


def _fit(run: RunData) -> list[Section]:
    """The fit, and an overview of the recordings."""
    if not run.recordings:
        return []
    return [
        section(
            "fit.html",
            {"fit": "Fit", "recordings": "Recordings" if run.several else ""},
            machine_row(run),
            result=run.identification,
            several=run.several,
            corrections=bool(run.identification.robot.corrections),
            overviews={fitted.name: overview(fitted) for fitted in run.recordings},
        )
    ]


def held_out_imports(run: RunData) -> list[Section]:
    """How the held-out recordings were read."""
    imports = [(v.outcome.name, v.recording.report) for v in run.validations]
    return [section("held_out_imports.html", {}, MACHINE, imports=imports)] if imports else []


@dataclass(frozen=True)
class Driver:
    """One thing that moves the tool, over the poses of the workspace."""

    names: str  # of parameters or coefficients, in the notation of the tables
    what: str
    share: float  # of the whole; outside 0 to 1 where parts outweigh each other
    size: float | None = None  # [m] rms; None of several together
    sigma: float | None = None  # [m]


@dataclass(frozen=True)
class Steps:
    """Predicted next steps, and the one that would help most."""

    advice: str = ""  # one sentence; empty where nothing was predicted
    present: str = ""  # predicted of what was recorded
    rows: tuple[tuple[str, ...], ...] = ()


def advised_steps(run: RunData) -> Steps:
    """Predicted next steps of a ball-bar's logs, where nothing is to be repaired first."""
    if not run.recordings:
        return Steps()
    result, robot = run.identification, run.identification.robot
    if robot.cell.ballbar.stroke is not None or result.verdict.status not in ENOUGH:
        return Steps()
    recordings = [recorded_passage(fitted) for fitted in run.recordings]
    present = next_step.predicted(robot, result.fit.excess, recordings)
    paths = {
        file.stem: load_lissajous(file)
        for kind in PATHS
        if (file := SHIPPED / "paths" / f"{robot.cell.robot.name}_{kind}.yaml").is_file()
    }
    steps = next_step.next_steps(robot, result.fit.excess, recordings, paths)
    return Steps(
        advice=_advice(steps, present),
        present=f"{_mm(present.sigma)} mm with the scale, {_mm(present.without_scale)} mm without",
        rows=tuple(_step_row(step, present) for step in steps),
    )


def diagnosis_section(run: RunData, steps: Steps) -> list[Section]:
    """Drivers of the error before and after, and next steps."""
    if not run.recordings:
        return []
    robot = run.identification.robot
    parts = correction_parts(robot, accuracy_grid(robot.cell.robot))
    sentences = {c.name: c.sentence for c in robot.corrections}
    return [
        section(
            "diagnosis.html",
            {"diagnosis": "Diagnosis"},
            MACHINE,
            percent=_percent,
            before=_before(parts, sentences),
            after=_after(robot.tcp),
            several=run.several,
            steps=steps,
        )
    ]


def _before(parts: Sequence[CorrectionPart], sentences: dict[str, str]) -> list[Driver]:
    rows = [
        Driver(p.name, sentences.get(p.source) or _meaning(p.name), p.share, p.size, p.sigma)
        for p in parts[:SHOWN]
    ]
    if others := parts[SHOWN:]:
        what = f"{len(others)} smaller ones together"
        rows.append(Driver("", what, sum(part.share for part in others)))
    return rows


def _after(tcp: TcpUncertainty) -> list[Driver]:
    directions = tcp.directions[:SHOWN]
    rows = [Driver(_members(d), _direction(d), tcp.share(d), d.rms) for d in directions]
    return [*rows, Driver("", "all other directions", 1.0 - sum(map(tcp.share, directions)))]


def _members(direction: TcpDirection) -> str:
    members = [(n, c) for n, c in direction.members if not n.startswith(MASSES)][:NAMED]
    return ", ".join(f"{name} {fixed(c, 2, sign=True)}" for name, c in members)


def _direction(direction: TcpDirection) -> str:
    if direction.name == SCALE:
        return "scale of all lengths, which no recording shows"
    if direction.name == MASSES:
        return "masses that the fit took from the files"
    return "" if _members(direction) else "many unknowns, each a little"


def _meaning(name: str) -> str:
    parameter = parameter_named(name)
    return f"{_KINDS[parameter.kind]}, row {parameter.row + 1}"


def recorded_passage(fitted: FittedRecording) -> next_step.RecordedPassage:
    """A recording from the first instant of its fit to the last, evenly spaced."""
    estimate, log = fitted.estimate, fitted.recording.ballbar_log
    times = estimate.after.t
    t = np.linspace(times[0], times[-1], 1 + round(float(times[-1] - times[0]) / STEP))
    q = logged_joints(fitted, t)
    b = np.unwrap(bar_angles_at(estimate, log, t, q), axis=0)  # unmeasured ones are within a turn
    robot_rate = _rate(fitted.recording.robot_log.t)
    tension = np.zeros(t.size)
    if estimate.tension is not None:
        tension = np.interp(t, times, estimate.tension)
    return next_step.RecordedPassage(
        passage=Passage(nominal=estimate.geometry, t=t, b=b, q=q),
        tension=tension,
        force_source=estimate.tension_source,
        sensors=next_step.recorded_sensors(
            estimate.noise,
            estimate.encoders,
            robot_rate,
            robot_rate if log is None else _rate(log.t),
        ),
    )


def _rate(t: Array) -> float:
    """[Hz] of a log's rows, t (N,) [s]."""
    return 1.0 / float(np.median(np.diff(t)))


def _advice(steps: Sequence[next_step.NextStep], present: TcpUncertainty) -> str:
    best = min(steps, key=lambda step: float(step.predicted.sigma.mean()))
    gain = _gain(best, present)
    if gain < WORTHWHILE:
        return "None of the steps below would lower the stated uncertainty by 5 %."
    return (
        f"Most would help next: {_words(best)}; the uncertainty would be {_percent(gain)} % less, "
        "as far as it can be predicted."
    )


def _words(step: next_step.NextStep) -> str:
    return {
        ENCODERS: f"an encoder on {listed(step.value.split())} too",
        "rod_sigma": f"the rod measured to {significant(next_step.ROD_SIGMA * 1e6, 1)} µm "
        "(--rod-sigma)",
        next_step.REPEAT: "the same path once more",
        next_step.PATH: f"another path from the same place, such as {step.value} "
        "(ballbar plan finds others)",
    }[step.key]


def _step_row(step: next_step.NextStep, present: TcpUncertainty) -> tuple[str, ...]:
    """A step, the uncertainty after it with the scale and without, and its change."""
    sigmas = step.predicted.sigma, step.predicted.without_scale
    return (_words(step), *map(_mm, sigmas), _percent(-_gain(step, present)))


def _gain(step: next_step.NextStep, present: TcpUncertainty) -> float:
    return 1.0 - float(step.predicted.sigma.mean() / present.sigma.mean())


def _mm(sigma: Array) -> str:
    return significant(float(sigma.mean()) * MM)


def _percent(share: float) -> str:
    return fixed(100.0 * share, 0 if abs(share) >= 0.1 else 1)
