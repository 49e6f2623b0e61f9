"""How fast the identifier is.

    python -m benchmarks.identifier_speed         # about half a minute

Processor time of one core, medians; arrays to estimate and covariance. The rival gets the same
residual, vectorised, and scipy's Levenberg-Marquardt with its numeric Jacobian.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.optimize import least_squares

from ballbar.acquisition.recording import read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.load import load_cell
from ballbar.cell.threads import one_thread_each
from ballbar.ident.estimator.build_unknowns import kinematic_unknowns
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.identifiability import candidates
from ballbar.ident.estimator.model import Model, joints_as_logged
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs, identifiable_parameters
from ballbar.ident.result import Identification
from ballbar.ident.thesis.paired_samples import through_samples
from ballbar.scenario import Scenario, load_scenario
from ballbar.trial.sample_trial import trial_samples
from tests.helpers.drawn_robots import SCENARIOS, recorded, scenario_of

T = TypeVar("T")
SAMPLES = 1500
JOINTS = (1, 2, 3, 4, 5)
ROD = 2e-6  # [m]


def spent(function: Callable[[], object], times: int) -> float:
    """[ms] Median processor time of a call."""
    function()
    found = []
    for _ in range(times):
        begin = time.process_time()
        function()
        found.append(time.process_time() - begin)
    return 1e3 * float(np.median(found))


def white_scenario() -> Scenario:
    """1 mm and 1 mrad of static errors, noise of 10 urad, five encoders."""
    changed = load_scenario(SCENARIOS / "irb2400.yaml").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    changed["plant"]["kind"] = "kinematic"
    changed["errors"] = {
        "static": {"sigma_m": 1e-3, "sigma_rad": 1e-3},
        "joint_noise": {"sigma_rad": 1e-5},
    }
    changed["encoders"]["fitted"] = list(JOINTS)
    changed["identify"] = {"data": "samples", "samples": SAMPLES}
    return Scenario.model_validate(changed, strict=False)


def kinematic() -> None:
    """The complete kinematic model and the clock, against scipy."""
    samples = trial_samples(white_scenario(), SCENARIOS)
    inside = samples.t[20:-20]

    clock, excess = Clock(0.0, 0.0), ExcessNoise(rod=ROD)

    def ready() -> Samples:
        robot, bar = through_samples(samples.t, samples.q), through_samples(samples.t, samples.b)
        return samples_of(robot, bar, JOINTS, np.ones(5), inside, spacing=robot.row_period)

    every = candidates(samples.nominal.table, JOINTS, complete=True)
    chosen = identifiable_parameters(
        ready(), samples.nominal, clock, excess, samples.nominal, every
    ).parameters

    def ours() -> Fit:
        return fit_kinematics(ready(), samples.nominal, clock, chosen, excess)

    def rival() -> Array:
        layout, start = kinematic_unknowns(samples.nominal, clock, chosen)
        here = ready()
        model = Model(joints_as_logged(6), None, (), layout, (here,))
        ballbar = here.ballbar_angles(samples.nominal, clock)
        weights = model.weights(start, model.evaluate(start, 0, ballbar), excess)

        def residual(x: Array) -> Array:
            return weights(model.evaluate(x, 0, ballbar).closure.error).reshape(-1)

        found = least_squares(residual, start, method="lm")
        np.linalg.inv(found.jac.T @ found.jac)
        return np.asarray(found.x)

    fit = ours()
    sigma = np.sqrt(np.diag(fit.covariance))[:-2]
    apart = np.abs(rival() - fit.x)[:-2] / sigma
    mine, theirs = spent(ours, 15), spent(rival, 3)
    print(
        f"complete kinematic model and clock, {len(fit.covariance)} parameters, {SAMPLES} samples: "
        f"{mine:.1f} ms"
    )
    print(f"scipy lm with numeric Jacobian: {theirs:.0f} ms, {theirs / mine:.0f} times slower")
    print(f"  largest difference of the answers: {apart.max():.1e} standard deviations")


def record(folder: Path) -> None:
    """One IRB 2400, 120 s, everything on."""
    recorded(scenario_of("irb2400", "a", 1, 120.0), folder)


def read(folder: Path) -> tuple[Cell, Logs]:
    """Cell and logs, which are all that an identifier gets."""
    recording = read_recording(folder)
    description = recording.description
    return load_cell(description.robot, description.ballbar, description.plate), Logs(
        recording.robot_log, recording.ballbar_log, recording.force_log
    )


def corrected(folder: Path) -> tuple[float, int]:
    """[ms] of an identification with all corrections, from logs to verdict; count of unknowns."""
    cell, logs = read(folder)
    options = FitOptions(model="complete", force="torque", samples=SAMPLES)

    def identified() -> Identification:
        return identify_together(cell, [logs], options=options)

    return spent(identified, 5), identified().fit.unknowns


def in_own_process(function: Callable[..., T], *arguments: object) -> T:
    """Result of a function in a fresh process, with the environment's number of BLAS threads."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


@one_thread_each()
def main() -> None:
    """Prints all rows."""
    in_own_process(kinematic)
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "a"
        in_own_process(record, folder)
        took, unknowns = in_own_process(corrected, folder)
        print(f"all corrections, {unknowns} unknowns, from logs to verdict: {took:.0f} ms")


if __name__ == "__main__":
    main()
