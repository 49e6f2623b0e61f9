"""White noise: error against the Cramer-Rao bound, coverage of the stated intervals.

    python -m benchmarks.white_noise    # 200 seeds for each encoder set, about three minutes
    python -m benchmarks.white_noise --verdicts    # 30 seeds of 60 s and of 120 s, two minutes

Kinematic plant, thesis Table 3.1 errors, 10 urad on every logged angle, 1500 samples, clock as
parameter. The bound is the inverse of the normal equations at the true parameters with the true
noise; the TCP error is that of the kinematic robot over the accuracy grid, base aligned, root mean
square over poses and seeds.

With --verdicts: device logs of the kinematic plant with Table 3.1 errors and white noise of 10 urad
on every angle, clocks off and drifting, and nothing else; five and four encoders. Nothing is wrong,
so each verdict that is not good and each remark is a false alarm.
"""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.load import load_robot
from ballbar.ident.estimator.fit import fit_kinematics
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.sample_times import MARGIN
from ballbar.ident.estimator.samples import samples_of
from ballbar.ident.robot.accuracy import accuracy_grid, tcp_error, tcp_sigma
from ballbar.ident.thesis.paired_samples import SampleFit, fit_samples, through_samples
from ballbar.ident.verdict import Status
from ballbar.result.identify import identify
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.errors.sensor_errors import JointNoise
from ballbar.sim.errors.static_errors import StaticErrors
from ballbar.sim.kinematic_samples import KinematicSamples
from ballbar.sim.recording_files import write_recording
from ballbar.sim.settings import (
    CellSettings,
    ClockSettings,
    EncoderSettings,
    ErrorSettings,
    PathSettings,
    PlantSettings,
    SimulationSettings,
)
from ballbar.sim.simulate import simulate
from ballbar.trial.sample_trial import trial_samples
from benchmarks.study import study_parser

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


def logged(fitted: tuple[int, ...], duration: float, seed: int) -> list[str]:
    """Faults that an identification finds in a run in which nothing is wrong."""
    settings = SimulationSettings(
        cell=CellSettings(
            robot="irb2400", ballbar="lund_600", ballbar_position_m=(0.70, 0.0, 0.54)
        ),
        path=PathSettings(kind="lissajous", file="paths/irb2400_a.yaml", duration_s=duration),
        plant=PlantSettings(kind="kinematic"),
        errors=ErrorSettings(
            static=StaticErrors(table="thesis_3_1"), joint_noise=JointNoise(sigma_rad=NOISE)
        ),
        encoders=EncoderSettings(fitted=fitted, noise_sigma_rad=NOISE),
        clocks=ClockSettings(offset_s=0.137, skew=5e-5),
        seed=seed,
    )
    with TemporaryDirectory() as folder:
        recording = Path(folder) / "recording"
        write_recording(simulate(settings, relative_to=SCENARIOS), settings, recording)
        data = identify(recording).data
    verdict = data.identification.verdict
    status = [] if verdict.status is Status.GOOD else [f"verdict: {verdict.sentence}"]
    found = [f for r in data.recordings for f in r.recording.report.findings]
    findings = [f"finding: {f.sentence}" for f in found if f.severity != "info"]
    return [*status, *(f"remark: {w}" for w in verdict.warnings), *findings]


def false_alarms(seeds: int) -> None:
    """Prints how many of the runs in which nothing is wrong were found fault with."""
    with ProcessPoolExecutor(2) as pool:
        for fitted in ENCODER_SETS[-2:]:
            for duration in (60.0, 120.0):
                alarms = list(
                    pool.map(logged, repeat(fitted), repeat(duration), range(1, seeds + 1))
                )
                verdicts = sum(any(a.startswith("verdict") for a in run) for run in alarms)
                print(
                    f"{len(fitted)} encoders, {duration:g} s: {sum(map(bool, alarms))} of {seeds} "
                    f"runs with a remark or warning, {verdicts} with a verdict that is not good"
                )
                for text, count in Counter(a for run in alarms for a in run).most_common():
                    print(f"    {count} times: {text}")


def main() -> None:
    """Prints efficiency and coverage of every encoder set, or the false alarms."""
    parser = study_parser(__doc__)
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--verdicts", action="store_true")
    options = parser.parse_args()
    if options.verdicts:
        false_alarms(options.seeds or 30)
        return
    seeds = range(1, (options.seeds or 200) + 1)
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
