"""Paired samples of a scenario, and fits to them (thesis ch. 3).

    reference path -> instants -> paired samples -> fit from the nominal geometry

What does not depend on the seed (cell, reference path, nominal robot along it, parameters to identify) is kept between trials of one
process; files that a scenario names must not change meanwhile.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.run import recorded_log
from ballbar.scenario import Scenario
from cell.descriptions import Cell
from cell.geometry import Geometry, nominal_geometry
from cell.load import load_cell
from ident.thesis.cost_fit import CostFit, fit_cost, identifiable_by
from ident.thesis.cost_shift import fit_cost_with_shift
from ident.thesis.costs import ENCODERS_NEEDED, CostName, cost_named
from ident.thesis.paired_samples import SampleFit, fit_samples
from sim.errors.sample_errors import delay_of
from sim.kinematic_samples import (
    KinematicSamples,
    SampledPath,
    kinematic_samples,
    sample_path,
    without_mean,
)
from sim.path import ReferencePath
from sim.path_files import scenario_path
from sim.settings import CellSettings, PathSettings

KEPT = 4  # scenarios: a sweep goes through its points one by one, and 100 000 samples take 40 MB
SELECTION_SAMPLES = 300  # instants that tell what is identifiable (ident.estimator.identifiability)


def fit_cost_to_samples(
    scenario: Scenario, folder: Path
) -> tuple[KinematicSamples, CostFit, float | None]:
    """Samples, the fit of one of the thesis's costs, and the shift [s] of the logs if it was asked for.

    Raises as ballbar.trial.trial.run_trial.
    """
    asked = scenario.identify
    if asked.cost == "ml":
        raise ValueError("ml is none of the thesis's costs")
    samples = trial_samples(scenario, folder)
    cost, chosen = cost_named(asked.cost, asked.form), cost_parameters(scenario, folder)
    sign = without_mean(samples.sign) if asked.rod_sign else None  # the mean is in bd3
    if not asked.shift_rounds:
        return (
            samples,
            fit_cost(cost, samples.nominal, samples.q, samples.b, chosen, rod_sign=sign),
            None,
        )
    found = fit_cost_with_shift(
        cost,
        samples.nominal,
        samples.t,
        samples.q,
        samples.b,
        chosen,
        rounds=asked.shift_rounds,
        rod_sign=sign,
    )
    return samples, found.fit, found.shift


def fit_ml_to_samples(scenario: Scenario, folder: Path) -> tuple[KinematicSamples, SampleFit]:
    """Samples, and the whitened fit with the clock as parameter; raises as ballbar.trial.trial.run_trial."""
    samples = trial_samples(scenario, folder)
    return samples, fit_samples(
        samples.t, samples.q, samples.b, scenario.encoders.fitted, samples.nominal
    )


def trial_samples(scenario: Scenario, folder: Path) -> KinematicSamples:
    """The paired samples of a scenario."""
    sampled = _sampled(
        scenario.cell, scenario.path, folder, scenario.identify.samples, delay_of(scenario.errors)
    )
    return kinematic_samples(scenario, sampled)


def sampled_cell(scenario: Scenario, folder: Path) -> Cell:
    """What stands in the cell of a scenario."""
    return _planned(scenario.cell, scenario.path, folder)[0]


def cost_parameters(scenario: Scenario, folder: Path) -> NDArray[np.intp]:
    """What the scenario's cost can identify along its path, by thesis sec. 3.3: indices into PARAMETERS."""
    cost = scenario.identify.cost
    if cost == "ml":
        raise ValueError("ml is none of the thesis's costs")
    return _parameters(scenario.cell, scenario.path, folder, cost)


@lru_cache(KEPT)
def _planned(
    cell: CellSettings, path: PathSettings, folder: Path
) -> tuple[Cell, Geometry, ReferencePath]:
    stands = load_cell(cell.robot, cell.ballbar, cell.plate, relative_to=folder)
    nominal = nominal_geometry(stands, np.array(cell.ballbar_position_m))
    return (
        stands,
        nominal,
        scenario_path(
            path, stands, nominal, relative_to=folder, recorded=recorded_log(path, folder)
        ),
    )


@lru_cache(KEPT)
def _sampled(
    cell: CellSettings, path: PathSettings, folder: Path, count: int, delay: float
) -> SampledPath:
    return sample_path(*_planned(cell, path, folder), count, delay=delay)


@lru_cache(KEPT * len(ENCODERS_NEEDED))
def _parameters(
    cell: CellSettings, path: PathSettings, folder: Path, cost: CostName
) -> NDArray[np.intp]:
    nominal, reference = _planned(cell, path, folder)[1:]
    some = (
        np.linspace(0, reference.t.size - 1, min(SELECTION_SAMPLES, reference.t.size))
        .round()
        .astype(int)
    )
    return identifiable_by(cost, nominal, reference.q[some], reference.b[some])
