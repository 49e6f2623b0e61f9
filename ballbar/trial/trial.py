"""One trial: a scenario simulated, identified and compared with its truth, as a row of results.

identify.data = files     plant -> device logs -> reader -> alignment and ml [-> paired -> cost]
identify.data = samples   reference path -> paired samples -> fit   (ch. 3; sample_trial.py)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from weakref import finalize

import numpy as np
from scipy.interpolate import BSpline, CubicSpline

from ballbar.acquisition.recording import Recording
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import BAR_ROWS, Geometry
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.thesis_names import ENCODER_OFFSETS
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.signals.smooth_log import ARM_KNOT_SPACING, smooth_log
from ballbar.ident.thesis.cost_fit import fit_cost
from ballbar.ident.thesis.costs import Cost, cost_named
from ballbar.ident.thesis.names import Smoothing
from ballbar.ident.thesis.pairing import moving_average, pair_logs
from ballbar.ident.verdict import Status, noise_status
from ballbar.identify_settings import IdentifySettings
from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.result.compare import Comparison, compare_geometry, compare_kinematics, z_rms
from ballbar.result.identify import identified
from ballbar.result.names import RECORDING
from ballbar.result.run_data import FittedRecording
from ballbar.scenario import Scenario, with_absolute_names
from ballbar.sim.errors.sample_errors import delay_of
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import simulate
from ballbar.sim.truth import Truth
from ballbar.trial.nominal_path import recorded_log
from ballbar.trial.sample_trial import (
    cost_parameters,
    fit_cost_to_samples,
    fit_ml_to_samples,
    nominal_of,
    sampled_cell,
)
from ballbar.truth.compare import compare_with_truth, identification_against_truth
from ballbar.units import MM, MRAD, PPM, UM, US

Row = dict[str, float | int | str]

RECORDINGS = 3  # simulated recordings that are kept, for fits of several costs


def run_trial(scenario: Scenario, folder: Path) -> Row:
    """Results of one trial by name; errors are identified minus true, in mm and mrad.

    The row has parameter distance and largest parameter error (thesis sec. 3.4), TCP error, how the
    fit went, and the error of each parameter.

    folder : folder of the scenario file, to which the names of other files are relative.

    Raises InputError, StartError, PlantError, NoEquilibriumError, UnreachableError as its stages.
    """
    if scenario.identify.data == "files":
        return _files_row(scenario, folder)
    if scenario.identify.cost == "ml":
        return _ml_samples_row(scenario, folder)
    return _cost_samples_row(scenario, folder)


def _cost_samples_row(scenario: Scenario, folder: Path) -> Row:
    samples, shifted = fit_cost_to_samples(scenario, folder)
    fit = shifted.fit
    names = [fit.geometry.table.names[i] for i in fit.parameters]
    cell = sampled_cell(scenario, folder)
    comparison = compare_kinematics(cell, fit.geometry, samples.nominal, samples.true, names)
    row = _row(comparison, fit.iterations, fit.rms, converged=fit.converged)
    if scenario.identify.shift_rounds:  # robot time = t - shift
        row["clock_offset_error_us"] = (delay_of(scenario.errors) - shifted.shift) * US
        row["last_move_us"] = shifted.last_move * US
    if scenario.identify.rod_sign:
        row["rod_deviation_um"] = fit.rod_deviation * UM
    return row


def _ml_samples_row(scenario: Scenario, folder: Path) -> Row:
    samples, result = fit_ml_to_samples(scenario, folder)
    fit = result.fit
    # the motion at t is in the robot's sample at t - delay
    clock, true_offset = fit.clock(), -delay_of(scenario.errors)
    comparison = compare_kinematics(
        sampled_cell(scenario, folder),
        fit.geometry(),
        samples.nominal,
        samples.true,
        [samples.nominal.table.names[i] for i in result.parameters],
        clock=(clock.offset - true_offset, clock.skew) if scenario.encoders.fitted else None,
    )
    status = noise_status(fit.chi2_per_dof) if fit.converged else Status.NOT_CONVERGED
    verdict: Row = {"chi2_per_dof": fit.chi2_per_dof, "verdict": str(status)}
    residual = rms(fit.linear.residuals[0])
    return _row(comparison, result.iterations, residual, converged=fit.converged, verdict=verdict)


@dataclass(frozen=True, eq=False)
class _Recorded:
    """A simulated recording on disk, for as long as this object lives."""

    folder: Path
    cell: Cell
    truth: Truth


@lru_cache(RECORDINGS)
def _recorded(settings: Scenario, folder: Path) -> _Recorded:
    """The files of a scenario. settings : without its identification, so that all have the same."""
    log = recorded_log(settings.needed_path, folder)
    simulation = simulate(settings, relative_to=folder, recorded=log)
    top = mkdtemp(prefix="ballbar-trial-")
    made = _Recorded(Path(top) / RECORDING, simulation.cell, simulation.truth)
    finalize(made, rmtree, top)
    write_recording(simulation, settings, made.folder)
    return made


@lru_cache(RECORDINGS)
def _read(made: _Recorded) -> Recording:
    """The clean logs of a recording, which its costs share."""
    return read_with_causes(made.folder)


def _files_row(scenario: Scenario, folder: Path) -> Row:
    scenario = with_absolute_names(scenario, folder)
    made = _recorded(scenario.model_copy(update={"identify": IdentifySettings()}), folder)
    if scenario.identify.cost == "ml":
        return _ml_row(scenario, made)
    parameters = cost_parameters(scenario, folder)
    cost = cost_named(scenario.identify.cost, scenario.identify.form)
    start, q, b, clock = _paired(scenario.identify, cost, made, nominal_of(scenario, folder))
    stop = scenario.identify.relative_stop
    fit = fit_cost(cost, start, q=q, b=b, parameters=parameters, relative_stop=stop)
    robot = IdentifiedRobot(made.cell, fit.geometry)
    names = [fit.geometry.table.names[i] for i in fit.parameters]
    comparison = compare_with_truth(robot, start, made.truth, names, clock)
    row = _row(comparison, fit.iterations, fit.rms, converged=fit.converged)
    return row | _identified(fit.geometry, start, names)


def _ml_row(scenario: Scenario, made: _Recorded) -> Row:
    data = identified([_read(made)], options=scenario.identify.options)
    (recording,), result = data.recordings, data.identification
    estimate, fitted = recording.estimate, result.fit
    comparison = identification_against_truth(result, made.truth)
    verdict: Row = {"chi2_per_dof": fitted.chi2_per_dof, "verdict": str(result.verdict.status)}
    verdict["z_rms"] = z_rms(result, comparison)
    residual = rms(estimate.whitened)
    row = _row(comparison, fitted.iterations, residual, converged=fitted.converged, verdict=verdict)
    return row | _identified(estimate.geometry, estimate.nominal, list(comparison.deviations))


def _paired(
    settings: IdentifySettings, cost: Cost, made: _Recorded, nominal: Geometry
) -> tuple[Geometry, Array, Array, tuple[float, float] | None]:
    """Start of a thesis cost, angles q (N, J) and b (N, 5) [rad] of its samples, and its clock.

    The clock is offset [s] and skew where the cost has its own.
    """
    if settings.pairing == "logs":
        read = _read(made)
        if read.ballbar_log is None:
            raise InputError("identify.pairing = logs needs a ball-bar with encoders")
        paired = pair_logs(cost, nominal, read.robot_log, read.ballbar_log, count=settings.samples)
        return paired.start, paired.q, paired.b, (paired.offset, 0.0)
    data = identified([_read(made)], options=settings.options)
    (recording,) = data.recordings
    estimate = recording.estimate
    offsets = {name: estimate.geometry[name] for name in ENCODER_OFFSETS}
    q, b = _paired_angles(recording, settings.smoothing)
    return estimate.nominal.replaced(offsets), q, b, None


def _identified(model: Geometry, nominal: Geometry, names: Sequence[str]) -> Row:
    """Identified errors: model minus nominal, without origin and encoder offsets (sec. 5.4)."""
    compared = [
        name for name in names if name.startswith(("r", "b")) and name not in ENCODER_OFFSETS
    ]
    errors = compare_geometry(model, nominal, compared)
    row: Row = {
        "identified_mm_mrad": float(np.linalg.norm(list(errors.values()))) * MM,
        "identified_largest_mm_mrad": max(map(abs, errors.values())) * MM,
    }
    return row | {f"identified.{name}": error * MRAD for name, error in errors.items()}


def _paired_angles(recording: FittedRecording, smoothing: Smoothing) -> tuple[Array, Array]:
    """Robot and ball-bar angles at the instants of the fit, by splines of their logs.

    Returns q (N, 6) and b (N, 5) [rad]; b is 0 for joints without encoder.
    """
    logs, estimate = recording.recording, recording.estimate
    t, log = estimate.after.t, logs.ballbar_log
    b = np.zeros((t.size, BAR_ROWS))
    if log is not None:
        columns = [j - 1 for j in log.joints]
        b[:, columns] = _spline(log.t, log.angles, smoothing)(t) * np.array(estimate.directions)
    robot_time = estimate.clock.robot_time(t) if estimate.clock else t
    return np.asarray(_spline(logs.robot_log.t, logs.robot_log.q, smoothing)(robot_time)), b


def _spline(t: Array, angles: Array, smoothing: Smoothing) -> CubicSpline | BSpline:
    """Spline of a log: through its rows, through their moving average, or of least squares."""
    if smoothing == "spline":
        return smooth_log(t, angles, widest_knot_spacing=ARM_KNOT_SPACING).spline
    return CubicSpline(t, moving_average(t, angles) if smoothing == "moving_average" else angles)


def _row(
    comparison: Comparison,
    iterations: int,
    residual: float,
    *,
    converged: bool,
    verdict: Row | None = None,
) -> Row:
    """The row of a fit: errors of robot, fit quality, errors of clock and parameters."""
    name, largest = comparison.largest
    row: Row = {
        "distance_mm_mrad": comparison.distance * MM,
        "largest_mm_mrad": abs(largest) * MM,
        "largest_parameter": name,
        "parameters": len(comparison.deviations),
        "tcp_mean_mm": comparison.tcp.mean * MM,
        "tcp_max_mm": comparison.tcp.maximum * MM,
        # share of the nominal robot's error
        "tcp_left": comparison.tcp.mean / comparison.tcp_nominal.mean,
    }
    row |= {"iterations": iterations, "converged": int(converged), "rms_residual": residual}
    row |= verdict or {}
    if comparison.offset is not None and comparison.skew is not None:
        row["clock_offset_error_us"] = comparison.offset * US
        row["clock_skew_error_ppm"] = comparison.skew * PPM
    return row | {f"error.{name}": error * MRAD for name, error in comparison.deviations.items()}
