"""The complete model of a minute of the nominal cell, away from its prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from ballbar.ident.corrections import correction_named, supported_corrections
from ballbar.ident.estimator.build_unknowns import RecordingStart, complete_unknowns
from ballbar.ident.estimator.fit import Fit, fit
from ballbar.ident.estimator.model import Model, gearing
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.loads.gear_loads import mass_model
from ballbar.ident.loads.logged_tension import tension_splines
from tests.helpers.complete_model import EXCESS, CompleteModel
from tests.helpers.synthetic_recording import (
    CELL,
    NO_CLOCK_ERROR,
    NOMINAL,
    UNIVERSAL_AND_GIMBAL,
    exact_log,
    minute,
)


@pytest.fixture(scope="session")
def machine() -> CompleteModel:
    """200 samples, every correction, a measured tension, a clock step at 20 s."""
    path = minute()
    columns = [j - 1 for j in UNIVERSAL_AND_GIMBAL]
    times = np.linspace(3.0, 57.0, 200)
    samples = Samples(
        robot=exact_log(path.t, path.q),
        ballbar=exact_log(path.t, path.b[:, columns]),
        encoders=UNIVERSAL_AND_GIMBAL,
        directions=np.ones(4),
        times=times,
        joint_noise=np.full(6, 2e-6),
        encoder_noise=np.array([1e-5, 1e-5, 0.0, 1e-5, 1e-5]),
        tension=20.0 * np.sin(times),
        splines=tension_splines(times),
        clock_steps=(20.0,),
    )
    every = (*supported_corrections(CELL.robot), "joint_lag")
    corrections = tuple(correction_named(name, CELL, UNIVERSAL_AND_GIMBAL) for name in every)
    start = RecordingStart(
        encoders=UNIVERSAL_AND_GIMBAL,
        geometry=NOMINAL,
        clock=NO_CLOCK_ERROR,
        knots=samples.splines.shape[0],
        tension_sigma=10.0,
        clock_steps=1,
    )
    layout, x = complete_unknowns(
        CELL, NOMINAL, [start], corrections, gain_sigma=0.03, rod_sigma=None
    )
    rng = np.random.default_rng(3)
    x = x + 0.1 * np.minimum(layout.sigma, 1e-3) * rng.standard_normal(x.size)
    ballbar = make_interp_spline(path.t, path.b, k=5)(times)
    model = Model(gearing(CELL.robot), mass_model(CELL), corrections, layout, (samples,))
    return CompleteModel(model, x, ballbar)


@pytest.fixture(scope="session")
def machine_fit(machine: CompleteModel) -> Fit:
    return fit(machine.model, machine.x, [machine.ballbar], EXCESS, max_iterations=40)


@pytest.fixture(scope="session")
def rigid(machine: CompleteModel) -> CompleteModel:
    """The same recording without corrections, clock step and tension; x at its prior."""
    (samples,) = machine.model.recordings
    samples = replace(samples, tension=np.zeros(200), splines=samples.splines[:0], clock_steps=())
    start = RecordingStart(UNIVERSAL_AND_GIMBAL, NOMINAL, NO_CLOCK_ERROR)
    layout, x = complete_unknowns(CELL, NOMINAL, [start], (), gain_sigma=None, rod_sigma=None)
    return CompleteModel(
        Model(gearing(CELL.robot), None, (), layout, (samples,)), x, machine.ballbar
    )
