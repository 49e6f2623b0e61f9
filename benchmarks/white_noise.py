"""White noise: error against the Cramer-Rao bound, coverage of the stated intervals.

    python -m benchmarks.white_noise    # 200 seeds for each encoder set, about three minutes

Kinematic plant, thesis Table 3.1 errors, 10 urad on every logged angle, 1500 samples, clock as
parameter. The bound is the inverse of the normal equations at the true parameters with the true
noise; the TCP error is that of the kinematic robot over the accuracy grid, base aligned, root mean
square over poses and seeds.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.scenario import Scenario, load_scenario
from ballbar.trial.sample_trial import trial_samples
from cell.arrays import Array
from cell.clock import Clock
from cell.load import load_robot
from ident.estimator.fit import fit_kinematics
from ident.estimator.noise import ExcessNoise
from ident.estimator.samples import MARGIN, samples_of
from ident.robot.accuracy import accuracy_grid, tcp_error, tcp_sigma
from ident.thesis.paired_samples import SampleFit, fit_samples, through_samples
from sim.kinematic_samples import KinematicSamples

SCENARIOS = Path(__file__).parent.parent / "scenarios"
NOISE = 1e-5  # [rad]
ENCODER_SETS = ((), (1, 2), (1, 2, 4, 5), (1, 2, 3, 4, 5))


def scenario_of(fitted: tuple[int, ...]) -> Scenario:
    """Static errors and nothing else: the noise is added here, its mean left in."""
    base = load_scenario(SCENARIOS / "irb2400.yaml").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    base["plant"] = {"kind": "kinematic"}
    base["errors"] = {"static": {"table": "thesis_3_1"}}
    base["encoders"] = {"fitted": list(fitted)}
    base["identify"] = {"data": "samples", "samples": 1500}
    return Scenario.model_validate(base, strict=False)


def one(fitted: tuple[int, ...], seed: int) -> tuple[float, float, float]:
    """Mean square TCP error [m^2], its bound [m^2], and coverage of the 95 % intervals."""
    scenario = scenario_of(fitted)
    samples, rng = trial_samples(scenario, SCENARIOS), np.random.default_rng([seed, len(fitted)])
    q, b = (angles + NOISE * rng.standard_normal(angles.shape) for angles in (samples.q, samples.b))
    found = fit_samples(samples.t, q, b, fitted, samples.nominal)
    grid = accuracy_grid(load_robot(scenario.cell.robot))
    error = tcp_error(found.fit.geometry(), samples.true, grid).error
    bound = _bound(samples, fitted, found.parameters, grid)
    deviation = np.sqrt(np.diag(found.fit.covariance) * max(1.0, found.fit.chi2_per_dof))[
        : found.parameters.size
    ]
    difference = found.fit.geometry().values - samples.true.values
    wrapped = np.where(
        [n.startswith("btheta") for n in samples.nominal.table.names],
        np.arctan2(np.sin(difference), np.cos(difference)),
        difference,
    )
    inside = np.abs(wrapped[found.parameters]) < 1.96 * deviation
    return float((error**2).mean()), bound, float(inside.mean())


def _bound(
    samples: KinematicSamples, fitted: tuple[int, ...], parameters: NDArray[np.intp], grid: Array
) -> float:
    """[m^2] mean square TCP error of the best unbiased estimate, linearised at the truth."""
    t, b = samples.t, samples.b
    robot = through_samples(t, samples.q)
    bar = through_samples(t, b[:, [j - 1 for j in fitted]]) if fitted else None
    encoder = np.zeros(5)
    encoder[[j - 1 for j in fitted]] = NOISE
    inside = t[(t >= t[0] + MARGIN) & (t <= t[-1] - MARGIN)]
    samples_at = replace(
        samples_of(robot, bar, fitted, np.ones(len(fitted)), inside),
        joint_noise=np.full(6, NOISE),
        encoder_noise=encoder,
    )
    at_truth = fit_kinematics(
        samples_at, samples.true, Clock(0.0, 0.0), parameters, ExcessNoise(), max_iterations=0
    )
    indices = SampleFit(at_truth, 0).parameters
    return float((tcp_sigma(samples.true, grid, indices, at_truth.covariance) ** 2).mean())


def main() -> None:
    """Prints efficiency and coverage of every encoder set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=200)
    seeds = range(1, parser.parse_args().seeds + 1)
    with ProcessPoolExecutor(2) as pool:
        for fitted in ENCODER_SETS:
            errors, bounds, covered = np.array(
                list(pool.map(one, [fitted] * len(seeds), seeds, chunksize=10))
            ).T
            print(
                f"{len(fitted)} encoders, {len(seeds)} seeds: "
                f"rms TCP error {np.sqrt(errors.mean()) * 1e6:.2f} um, "
                f"Cramer-Rao {np.sqrt(bounds.mean()) * 1e6:.2f} um, "
                f"ratio {np.sqrt(errors.mean() / bounds.mean()):.3f}; "
                f"95 % intervals hold the truth in {covered.mean():.1%}"
            )


if __name__ == "__main__":
    main()
