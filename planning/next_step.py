"""What would help most next: the predicted TCP uncertainty of what was recorded, with one change.

The prediction is that of planning.crlb along the recorded motions, of the identified robot with the
corrections and the noise that were identified; recordings together share the machine. Changes are
those of planning.questions (a fifth encoder, a measured rod), the same path once more, or another
path of the same ball-bar at the same place. Plate and axis offsets keep their priors, so the scale
is in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.descriptions import Cell
from cell.statistics import rms
from ident.complete_fit import DEVIATION, WANDERING, needs_loads, wanders
from ident.corrections import correction_of_result
from ident.corrections.base import Correction
from ident.estimator.gauss_newton import inverse
from ident.estimator.noise import ExcessNoise, LogNoise
from ident.estimator.samples import DWELL_KEPT
from ident.estimator.unknowns import TENSION_PRIOR
from ident.loads.gear_loads import mass_model
from ident.result import CorrectionEstimate, RobotEstimate
from ident.robot.accuracy import accuracy_grid
from ident.robot.tcp_uncertainty import TcpUncertainty, tcp_uncertainty
from planning.candidate import PathCandidate
from planning.crlb import PathPrediction, Predictor, moving, predict
from planning.limits import violations
from planning.questions import ENCODERS
from planning.request import PlanLimits, PlanSensors, PlanTiming
from planning.trajectory import Passage, trajectories
from sim.path import Lissajous

EVERY_ENCODER = (1, 2, 3, 4, 5)
ROD_SIGMA = 5e-6  # [m] of a rod that was measured, as well as the plate was
# A path that was recorded may come nearer to the ends of the axes than a plan does.
LIMITS = PlanLimits(axis_margin_deg=0.0)
POSES = 200  # of the accuracy grid; the means over a quarter of it differ by a percent


@dataclass(frozen=True, eq=False)
class RecordedPassage:
    """One recording, as a prediction takes it."""

    passage: Passage  # from the first sample of the fit to the last, as identified
    tension: Array  # (N,) [N] of the rod
    force_source: str  # as of Logs.force_source; empty where no loads were needed
    sensors: PlanSensors  # white noise and rates of its logs


@dataclass(frozen=True, eq=False)
class NextStep:
    """One thing that could be done next, and the predicted uncertainty with it."""

    key: str  # of planning.questions, PATH or REPEAT
    value: str  # what of it
    predicted: TcpUncertainty


PATH, REPEAT = "path", "repeat"


def recorded_sensors(
    noise: LogNoise, encoders: tuple[int, ...], robot_rate: float, ballbar_rate: float
) -> PlanSensors:
    """White noise and rates [Hz] of the logs of a recording."""
    white = {"encoder_noise_sigma_rad": _size(noise.encoder[[j - 1 for j in encoders]])}
    return PlanSensors().model_copy(  # a plan needs two encoders, a recording may have none
        update={
            "encoders": encoders,
            "robot_noise_sigma_rad": _size(noise.joint),
            "robot_rate_hz": robot_rate,
            "ballbar_rate_hz": ballbar_rate,
        }
        | (white if encoders else {})
    )


def predicted(
    robot: RobotEstimate, excess: ExcessNoise, recordings: Sequence[RecordedPassage]
) -> TcpUncertainty:
    """The predicted uncertainty of what was recorded, to compare the stated one with."""
    return _together(_predictions(robot, excess, recordings))


def next_steps(
    robot: RobotEstimate,
    excess: ExcessNoise,
    recordings: Sequence[RecordedPassage],
    paths: Mapping[str, Lissajous],
) -> list[NextStep]:
    """What could be done next, the most helpful first.

    paths : by name; of those that the robot can run at the ball-bar's present place the best one
        is among the steps.
    """
    steps = [
        NextStep(key, value, _together(_predictions(robot, excess, changed)))
        for key, value, changed in _changes(robot.cell, recordings)
    ]
    present = _predictions(robot, excess, recordings)
    steps.append(NextStep(REPEAT, "", _together([*present, *present])))
    others = [
        NextStep(PATH, name, _together([*present, *_predictions(robot, excess, [other])]))
        for name, other in _others(robot, recordings[0], paths)
    ]
    if others:
        steps.append(min(others, key=_size_of))
    return sorted(steps, key=_size_of)


def _size_of(step: NextStep) -> float:
    return float(step.predicted.sigma.mean())


def _size(values: Array) -> float:
    """Root mean square, kept from zero, which no prior may be."""
    return max(1e-12, rms(values))


def _changes(
    cell: Cell, recordings: Sequence[RecordedPassage]
) -> Iterator[tuple[str, str, list[RecordedPassage]]]:
    """Key, value and the recordings with each change of the sensors."""
    used = {joint for r in recordings for joint in r.sensors.encoders}
    missing = [joint for joint in EVERY_ENCODER if joint not in used]
    if missing:
        value = " ".join(f"b{joint}" for joint in missing)
        yield ENCODERS, value, [_with(r, encoders=EVERY_ENCODER) for r in recordings]
    if cell.ballbar.length_tolerance > ROD_SIGMA:
        changed = [_with(r, rod_sigma_m=ROD_SIGMA) for r in recordings]
        yield "rod_sigma", f"{ROD_SIGMA * 1e6:g} um", changed


def _with(recorded: RecordedPassage, **sensors: object) -> RecordedPassage:
    return replace(recorded, sensors=recorded.sensors.model_copy(update=sensors))


def _others(
    robot: RobotEstimate, recorded: RecordedPassage, paths: Mapping[str, Lissajous]
) -> Iterator[tuple[str, RecordedPassage]]:
    """Recordings of other paths from where the ball-bar stands, of those that can be run."""
    position = recorded.passage.nominal.origin
    for name, shape in paths.items():
        for trajectory in trajectories(robot.cell, PathCandidate(shape, position), PlanTiming()):
            if not violations(robot.cell, LIMITS, trajectory):
                tension = np.full(trajectory.t.size, rms(recorded.tension))  # as strong
                yield name, replace(recorded, passage=trajectory, tension=tension)
                break


def _predictions(
    robot: RobotEstimate, excess: ExcessNoise, recordings: Sequence[RecordedPassage]
) -> list[PathPrediction]:
    corrections = tuple(_corrections(robot))
    return [
        predict(_predictor(robot.cell, corrections, excess, r), r.passage, r.tension)
        for r in recordings
    ]


def _predictor(
    cell: Cell, corrections: tuple[Correction, ...], excess: ExcessNoise, recorded: RecordedPassage
) -> Predictor:
    knots = DEVIATION.get(recorded.force_source, TENSION_PRIOR)
    if recorded.force_source == "none":  # as likely as it turned out, as in the fit
        knots = _size(recorded.tension)
    return Predictor(
        cell=cell,
        masses=mass_model(cell) if needs_loads(corrections) else None,
        sensors=recorded.sensors,
        timing=_timing(recorded),
        corrections=corrections,
        grid=accuracy_grid(cell.robot)[:POSES],
        excess=excess,
        exact_scale=False,
        tension_sigma=WANDERING if wanders(corrections) else knots,
    )


def _timing(recorded: RecordedPassage) -> PlanTiming:
    """Of which the samples lie between the ends of the passage."""
    first, last = float(recorded.passage.t[0]), float(recorded.passage.t[-1])
    return PlanTiming.model_construct(duration_s=first + last, dwell_s=first + DWELL_KEPT, stops=0)


def _corrections(robot: RobotEstimate) -> Iterator[Correction]:
    """Those that belong to the machine, and not to one recording."""
    for estimate in robot.corrections:
        if not _of_recordings(estimate):
            names = [c.name for c in estimate.coefficients]
            yield correction_of_result(estimate.name, names, robot.cell, robot.encoders)


def _of_recordings(correction: CorrectionEstimate) -> bool:
    return any("@" in c.name for c in correction.coefficients)


def _together(predictions: Sequence[PathPrediction]) -> TcpUncertainty:
    """The uncertainty by all predictions, whose recordings share the machine and nothing else."""
    first = predictions[0]
    machine = first.layout.machine
    prior = np.diag(first.layout.sigma[machine] ** -2.0)
    normal = prior.copy()
    for prediction in predictions:
        normal += _of_machine(prediction.normal, machine) - prior
    moved = moving(first.layout)
    return tcp_uncertainty(
        first.unloaded.tool(first.grid),
        first.unloaded.jacobian(first.grid, first.layout.shared),
        inverse(normal)[np.ix_(moved, moved)],
        [first.layout.names[i] for i in moved],
    )


def _of_machine(normal: Array, machine: NDArray[np.intp]) -> Array:
    """Information (K, K) about the machine, whatever belongs to the recording unknown."""
    own = np.setdiff1d(np.arange(len(normal)), machine)
    mixed = normal[np.ix_(machine, own)]
    return np.asarray(
        normal[np.ix_(machine, machine)]
        - mixed @ np.linalg.solve(normal[np.ix_(own, own)], mixed.T)
    )
