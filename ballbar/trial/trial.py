"""One trial: a scenario simulated, identified and compared with its truth, as one row of figures. The unit of work of sweeps.

identify.data = files     plant -> device logs -> reader -> alignment and ml [-> angles on one clock -> cost]
identify.data = samples   reference path -> paired samples -> fit                    (thesis ch. 3; ballbar.trial.sample_trial)
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.interpolate import CubicSpline

from acquisition import Recording
from ballbar.result.compare import (
    Comparison,
    compare_kinematics,
    compare_with_truth,
    identification_against_truth,
)
from ballbar.result.run_recordings import identify_recordings
from ballbar.run import RECORDING, recorded_log
from ballbar.scenario import Scenario
from ballbar.trial.sample_trial import (
    cost_parameters,
    fit_cost_to_samples,
    fit_ml_to_samples,
    sampled_cell,
)
from cell.chain import Array
from cell.geometry import BAR_ROWS, NAMES
from ident.identify import Identification
from ident.robot.unloaded_robot import UnloadedRobot
from ident.thesis.cost_fit import CostFit, fit_cost
from ident.thesis.costs import cost_named
from ident.verdict import MISFIT, SUSPECT, WELL_UNDER
from sim.errors.sample_errors import delay_of
from sim.recording_files import write_recording
from sim.simulate import simulate

Row = dict[str, float | int | str]


def run_trial(scenario: Scenario, folder: Path) -> Row:
    """One row of figures: parameter distance and largest error (thesis sec. 3.4), TCP error, how the fit went, error of each parameter.

    folder : of the scenario, for files it names. Errors are identified minus true, in mm and mrad.

    Raises InputError, StartError, PlantError, NoEquilibriumError, UnreachableError as the stages do.
    """
    if scenario.identify.data == "files":
        return _files_row(scenario, folder)
    return (
        _ml_samples_row(scenario, folder)
        if scenario.identify.cost == "ml"
        else _cost_samples_row(scenario, folder)
    )


def _cost_samples_row(scenario: Scenario, folder: Path) -> Row:
    samples, fit, shift = fit_cost_to_samples(scenario, folder)
    names = [NAMES[i] for i in fit.parameters]
    row = _cost_row(
        fit,
        compare_kinematics(
            sampled_cell(scenario, folder), fit.geometry, samples.nominal, samples.true, names
        ),
    )
    if shift is not None:  # robot time = t - shift
        row["clock_offset_error_us"] = (delay_of(scenario.errors) - shift) * 1e6
    if scenario.identify.rod_sign:
        row["rod_deviation_um"] = fit.rod_deviation * 1e6
    return row


def _ml_samples_row(scenario: Scenario, folder: Path) -> Row:
    samples, found = fit_ml_to_samples(scenario, folder)
    fit, true_offset = (
        found.fit,
        -delay_of(scenario.errors),
    )  # what the robot did at t stands in its samples at t - delay
    clock = (
        (found.clock.offset - true_offset, found.clock.skew) if scenario.encoders.fitted else None
    )
    names = [NAMES[i] for i in fit.parameters]
    cell = sampled_cell(scenario, folder)
    comparison = compare_kinematics(
        cell, found.geometry, samples.nominal, samples.true, names, clock=clock
    )
    status = _status(fit.chi2_per_dof) if fit.converged else "not converged"
    return _row(
        comparison,
        found.iterations,
        fit.converged,
        _rms(fit.final.residual),
        ml=(fit.chi2_per_dof, status),
    )


def _files_row(scenario: Scenario, folder: Path) -> Row:
    scenario = _with_absolute_names(scenario, folder)
    simulation = simulate(
        scenario, relative_to=folder, recorded=recorded_log(scenario.path, folder)
    )
    with TemporaryDirectory(prefix="ballbar-trial-") as top:
        logs = Path(top) / RECORDING
        write_recording(simulation, scenario, logs)
        found = identify_recordings([logs], settings=scenario.identify, progress=lambda _: None)
    recording, result = found.recording, found.identification
    if scenario.identify.cost == "ml":
        comparison = identification_against_truth(result, simulation.truth)
        judged = (result.chi2_per_dof, result.verdict.status)
        return _row(
            comparison, result.iterations, result.converged, _rms(result.whitened), ml=judged
        )
    cost = cost_named(scenario.identify.cost, scenario.identify.form)
    q, b = _angles_on_one_clock(recording, result)
    zeros = {name: result.geometry[name] for name in NAMES if name.startswith("btheta")}
    fitted = fit_cost(cost, result.nominal.replaced(zeros), q, b, cost_parameters(scenario, folder))
    names = [NAMES[i] for i in fitted.parameters]
    robot = UnloadedRobot(simulation.cell, fitted.geometry)
    return _cost_row(
        fitted, compare_with_truth(robot, result.nominal, simulation.truth, names, None)
    )


def _with_absolute_names(scenario: Scenario, folder: Path) -> Scenario:
    """Robot, ball-bar and plate files by names that hold in another folder too, where recording.yaml will state them."""
    names = scenario.cell.model_dump(include={"robot", "ballbar", "plate"})
    found = {
        key: str((folder / name).resolve()) for key, name in names.items() if name.endswith(".yaml")
    }
    return scenario.model_copy(update={"cell": scenario.cell.model_copy(update=found)})


def _angles_on_one_clock(recording: Recording, result: Identification) -> tuple[Array, Array]:
    """(N, 6), (N, 5) [rad] robot and ball-bar angles between the rows of their logs, at the instants of the fit; 0 without encoder."""
    t, log = result.after.t, recording.ballbar_log
    b = np.zeros((t.size, BAR_ROWS))
    if log is not None:
        b[:, [j - 1 for j in log.joints]] = CubicSpline(log.t, log.angles)(t) * np.array(
            result.signs
        )
    robot_time = result.clock.robot_time(t) if result.clock else t
    return np.asarray(CubicSpline(recording.robot_log.t, recording.robot_log.q)(robot_time)), b


def _cost_row(fit: CostFit, comparison: Comparison) -> Row:
    return _row(comparison, fit.iterations, fit.converged, fit.rms)


def _row(
    comparison: Comparison,
    iterations: int,
    converged: bool,
    rms: float,
    *,
    ml: tuple[float, str] | None = None,
) -> Row:
    """The figures of one fit; ml : chi-square per degree of freedom and verdict of a whitened one."""
    name, largest = comparison.largest
    row: Row = {
        "distance_mm_mrad": comparison.distance * 1e3,
        "largest_mm_mrad": abs(largest) * 1e3,
        "largest_parameter": name,
        "parameters": len(comparison.deviations),
        "tcp_mean_mm": comparison.tcp.mean * 1e3,
        "tcp_max_mm": comparison.tcp.maximum * 1e3,
        "iterations": iterations,
        "converged": int(converged),
        "rms_residual": rms,
    }
    if ml:
        row |= {"chi2_per_dof": ml[0], "verdict": ml[1]}
    if comparison.offset is not None and comparison.skew is not None:
        row |= {
            "clock_offset_error_us": comparison.offset * 1e6,
            "clock_skew_error_ppm": comparison.skew * 1e6,
        }
    return row | {
        f"error.{parameter}": error * 1e3 for parameter, error in comparison.deviations.items()
    }


def _status(chi2_per_dof: float) -> str:
    """The verdict's first word, by what the noise explains alone (ident.verdict)."""
    if chi2_per_dof > MISFIT:
        return "misfit"
    return "suspect" if chi2_per_dof > SUSPECT or chi2_per_dof < WELL_UNDER else "good"


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual * residual)))
