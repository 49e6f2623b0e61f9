"""Next steps that would help most: predicted TCP uncertainty of the recordings with one change.

The prediction is that of ballbar.planning.crlb along the recorded motions, of the identified robot
with the corrections and the noise that were identified; recordings together share the machine.
Changes are those of ballbar.planning.questions (a fifth encoder, a measured rod), the same path
once more, or another path of the same ball-bar at the same place. Plate and axis offsets keep their
priors, so the scale is in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.statistics import rms
from ballbar.ident.complete_fit import DEVIATION, WANDERING, needs_loads, wanders
from ballbar.ident.corrections import correction_of_result
from ballbar.ident.estimator.build_unknowns import TENSION_PRIOR
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.noise import ExcessNoise, LogNoise
from ballbar.ident.estimator.sample_times import DWELL_KEPT
from ballbar.ident.loads.gear_loads import mass_model
from ballbar.ident.result import RobotEstimate
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.tcp_uncertainty import TcpUncertainty, tcp_uncertainty
from ballbar.planning.candidate import PathCandidate
from ballbar.planning.crlb import PathPrediction, Predictor, predict
from ballbar.planning.limits import violations
from ballbar.planning.questions import ENCODERS
from ballbar.planning.request import PlanLimits, PlanSensors, PlanTiming
from ballbar.planning.trajectory import Passage, trajectories
from ballbar.sim.path import Lissajous

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

    key: str  # of ballbar.planning.questions, PATH or REPEAT
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


def _size(values: Array) -> float:
    """Root mean square, kept from zero, which no prior may be."""
    return max(1e-12, rms(values))


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
    """Steps that could be taken next, the most helpful first.

    paths : by name; of those that the robot can run at the ball-bar's present place the best one
        is among the steps.
    """
    present = _predictions(robot, excess, recordings)
    fitted = {joint for r in recordings for joint in r.sensors.encoders}
    missing = " ".join(f"b{joint}" for joint in EVERY_ENCODER if joint not in fitted)
    changes: list[tuple[str, str, dict[str, object]]] = []
    if missing:
        changes.append((ENCODERS, missing, {"encoders": EVERY_ENCODER}))
    if robot.cell.ballbar.length_tolerance > ROD_SIGMA:
        changes.append(("rod_sigma", f"{ROD_SIGMA * 1e6:g} um", {"rod_sigma_m": ROD_SIGMA}))
    steps = []
    for key, value, sensors in changes:
        changed = [replace(r, sensors=r.sensors.model_copy(update=sensors)) for r in recordings]
        steps.append(NextStep(key, value, _together(_predictions(robot, excess, changed))))
    steps.append(NextStep(REPEAT, "", _together([*present, *present])))
    others = [
        NextStep(PATH, name, _together([*present, *_predictions(robot, excess, [other])]))
        for name, other in _other_paths(robot, recordings[0], paths)
    ]

    def size(step: NextStep) -> float:
        return float(step.predicted.sigma.mean())

    return sorted([*steps, *([min(others, key=size)] if others else [])], key=size)


def _other_paths(
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
    """The prediction of each recording, with the corrections that belong to the machine."""
    cell = robot.cell
    corrections = tuple(
        correction_of_result(c.name, [k.name for k in c.coefficients], cell, robot.encoders)
        for c in robot.corrections
        if not any("@" in k.name for k in c.coefficients)  # belongs to one recording
    )
    predictions = []
    for recorded in recordings:
        knots = DEVIATION.get(recorded.force_source, TENSION_PRIOR)
        if recorded.force_source == "none":  # as likely as it turned out, as in the fit
            knots = _size(recorded.tension)
        # the samples lie between the ends of the passage
        first, last = float(recorded.passage.t[0]), float(recorded.passage.t[-1])
        timing = PlanTiming.model_construct(
            duration_s=first + last, dwell_s=first + DWELL_KEPT, stops=0
        )
        on = Predictor(
            cell=cell,
            masses=mass_model(cell) if needs_loads(corrections) else None,
            sensors=recorded.sensors,
            timing=timing,
            corrections=corrections,
            grid=accuracy_grid(cell.robot)[:POSES],
            excess=excess,
            exact_scale=False,
            tension_sigma=WANDERING if wanders(corrections) else knots,
        )
        predictions.append(predict(on, recorded.passage, recorded.tension))
    return predictions


def _together(predictions: Sequence[PathPrediction]) -> TcpUncertainty:
    """The uncertainty by all predictions, whose recordings share the machine and nothing else."""
    first = predictions[0]
    machine = first.layout.machine
    prior = np.diag(first.layout.sigma[machine] ** -2.0)
    normal = prior.copy()
    for prediction in predictions:
        information = prediction.normal
        recording = np.setdiff1d(np.arange(len(information)), machine)  # eliminated as unknown
        mixed = information[np.ix_(machine, recording)]
        eliminated = mixed @ np.linalg.solve(information[np.ix_(recording, recording)], mixed.T)
        normal += information[np.ix_(machine, machine)] - eliminated - prior
    return tcp_uncertainty(*first.tool, inverse(normal), [first.layout.names[i] for i in machine])
