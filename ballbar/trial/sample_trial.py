"""Paired samples of a scenario, and fits to them (thesis ch. 3).

    reference path -> instants -> paired samples -> fit from the nominal geometry

What does not depend on the seed (cell, reference path, nominal robot along it, parameters to
identify), and the samples that several costs share, are cached between the trials of one process;
the files of a scenario must not change meanwhile.
"""

from __future__ import annotations

from functools import lru_cache, partial
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.ident.thesis.cost_fit import fit_cost, identifiable_by
from ballbar.ident.thesis.cost_shift import ShiftedFit, fit_cost_with_shift
from ballbar.ident.thesis.costs import cost_named
from ballbar.ident.thesis.names import ENCODERS_NEEDED, CostName, ParameterSet
from ballbar.ident.thesis.paired_samples import SampleFit, fit_samples
from ballbar.identify_settings import IdentifySettings
from ballbar.scenario import Scenario
from ballbar.sim.errors.sample_errors import delay_of
from ballbar.sim.kinematic_samples import (
    Instants,
    KinematicSamples,
    SampledPath,
    kinematic_samples,
    sample_path,
    without_mean,
)
from ballbar.sim.settings import CellSettings, PathSettings
from ballbar.trial.nominal_path import nominal_path, spread_rows

# Scenarios whose paths are cached: a sweep runs point after point, and 100 000 samples take 40 MB.
CACHED = 4
# Runs whose samples are cached, 0.2 MB each with 1500 samples: a sweep runs all seeds of one cost
# before the next cost.
SAMPLES = 16
SELECTION_SAMPLES = 300  # instants for the choice of parameters (estimator.identifiability)

_nominal_path = lru_cache(CACHED)(nominal_path)


def fit_cost_to_samples(scenario: Scenario, folder: Path) -> tuple[KinematicSamples, ShiftedFit]:
    """Samples, and the fit of one of the thesis's costs with the shift between the logs.

    Raises as ballbar.trial.trial.run_trial.
    """
    settings = scenario.identify
    samples, parameters = trial_samples(scenario, folder), cost_parameters(scenario, folder)
    cost = cost_named(_thesis_cost(settings), settings.form)
    sign = without_mean(samples.sign) if settings.rod_sign else None  # the mean is part of bd3
    stop = settings.relative_stop
    start, q, b = samples.nominal, samples.q, samples.b
    if not settings.shift_rounds:
        fit = fit_cost(
            cost, start, q=q, b=b, parameters=parameters, rod_sign=sign, relative_stop=stop
        )
        return samples, ShiftedFit(fit)
    return samples, fit_cost_with_shift(
        cost,
        start,
        t=samples.t,
        q=q,
        b=b,
        parameters=parameters,
        rounds=settings.shift_rounds,
        at=settings.shift_at,
        relative_stop=stop,
    )


def fit_ml_to_samples(scenario: Scenario, folder: Path) -> tuple[KinematicSamples, SampleFit]:
    """Samples, and the maximum-likelihood fit with the clock as parameter.

    Raises as ballbar.trial.trial.run_trial.
    """
    samples = trial_samples(scenario, folder)
    encoders = scenario.encoders.fitted
    return samples, fit_samples(samples.t, samples.q, samples.b, encoders, samples.nominal)


def trial_samples(scenario: Scenario, folder: Path) -> KinematicSamples:
    """The paired samples of a scenario."""
    settings = scenario.identify
    simulated = scenario.model_copy(update={"identify": IdentifySettings()})
    return _samples(simulated, folder, settings.samples, settings.instants)


def sampled_cell(scenario: Scenario, folder: Path) -> Cell:
    """Robot, ball-bar and plate of a scenario."""
    return _nominal_path(scenario.cell, scenario.needed_path, folder)[0]


def nominal_of(scenario: Scenario, folder: Path) -> Geometry:
    """Nominal geometry of a scenario's cell, the ball-bar where the scenario puts it."""
    return _nominal_path(scenario.cell, scenario.needed_path, folder)[1]


def cost_parameters(scenario: Scenario, folder: Path) -> NDArray[np.intp]:
    """(P,) indices into the table of what the cost can identify along the path (sec. 3.3).

    With `pairing: logs` those of C_l with every cost, and the offsets of its encoders (sec. 5.4).
    """
    cost, choice = _thesis_cost(scenario.identify), scenario.identify.parameters
    chosen = partial(_parameters, scenario.cell, scenario.needed_path, folder)
    if scenario.identify.pairing == "fit":
        return chosen(cost, choice)
    index = nominal_of(scenario, folder).table.index
    offsets = [index[f"btheta{j}"] for j in ENCODERS_NEEDED[cost]]
    return np.union1d(chosen("length", choice), np.array(offsets, dtype=np.intp))


def _thesis_cost(settings: IdentifySettings) -> CostName:
    if settings.cost == "ml":
        raise ValueError(f"ml is none of the thesis's costs {', '.join(ENCODERS_NEEDED)}")
    return settings.cost


@lru_cache(SAMPLES)
def _samples(simulated: Scenario, folder: Path, count: int, instants: Instants) -> KinematicSamples:
    """The paired samples of a scenario without its identification, which many costs share."""
    place = simulated.cell, simulated.path, folder
    path = _sampled_path(*place, count, delay_of(simulated.errors), instants)
    return kinematic_samples(simulated, path)


@lru_cache(CACHED)
def _sampled_path(
    cell: CellSettings, path: PathSettings, folder: Path, count: int, late: float, of: Instants
) -> SampledPath:
    return sample_path(*_nominal_path(cell, path, folder), count, delay=late, instants=of)


@lru_cache(CACHED * len(get_args(ParameterSet)) * len(ENCODERS_NEEDED))
def _parameters(
    cell: CellSettings, path: PathSettings, folder: Path, cost: CostName, choice: ParameterSet
) -> NDArray[np.intp]:
    _, nominal, reference = _nominal_path(cell, path, folder)
    rows = spread_rows(reference, SELECTION_SAMPLES)
    return identifiable_by(cost, nominal, reference.q[rows], reference.b[rows], choice=choice)
