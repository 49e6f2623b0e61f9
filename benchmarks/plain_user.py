"""The baseline: identification as a user of SciPy would write it in an afternoon.

The printed scalar of C_T (thesis eq. 2.4), `scipy.optimize.least_squares(method="lm")` on it, the
Jacobian by finite differences, and a forward pass that multiplies 4x4 matrices, all samples at
once. No cost is missed that a careful user would save: the chain whose parameters do not change is
computed again, as the solver cannot know.

    python -m benchmarks.plain_user    # against ballbar.ident.thesis.cost_fit, on the main scenario
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain
from ballbar.cell.geometry import Geometry
from ballbar.ident.thesis.cost_fit import fit_cost
from ballbar.ident.thesis.costs import cost_named
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.kinematic_samples import KinematicSamples
from ballbar.trial.sample_trial import cost_parameters, trial_samples

SCENARIO = Path(__file__).parents[1] / "scenarios" / "irb2400.yaml"


@dataclass(frozen=True, eq=False)
class PlainFit:
    """Result of the plain user."""

    geometry: Geometry
    parameters: NDArray[np.intp]  # (P,) indices into the table
    iterations: int  # evaluations of the cost over all samples, those of the Jacobians included
    converged: bool
    seconds: float


def plain_user_identify(
    samples: KinematicSamples, nominal: Geometry, parameters: Sequence[int] | NDArray[np.intp]
) -> PlainFit:
    """Identify `parameters` (indices into the table) from paired samples, from nominal values."""
    chosen = np.asarray(parameters, dtype=np.intp)
    begin = time.perf_counter()
    found = least_squares(
        _costs, nominal.values[chosen], method="lm", args=(nominal, chosen, samples.q, samples.b)
    )
    return PlainFit(
        _with(nominal, chosen, found.x),
        chosen,
        int(found.nfev),
        bool(found.success),
        time.perf_counter() - begin,
    )


def _costs(x: Array, nominal: Geometry, chosen: NDArray[np.intp], q: Array, b: Array) -> Array:
    """(N,) C_T of every sample."""
    geometry = _with(nominal, chosen, x)
    base = np.eye(4)
    base[:3, 3] = geometry.origin
    difference = _forward(np.eye(4), geometry.robot, q) - _forward(base, geometry.bar, b)
    return np.asarray((difference**2).sum(axis=(1, 2)))


def _forward(base: Array, chain: Chain, angles: Array) -> Array:
    """(N, 4, 4) poses of the end of a chain at joint angles (N, J)."""
    pose = np.broadcast_to(base, (angles.shape[0], 4, 4))
    for i in range(chain.rows):
        pose = pose @ _link(chain.a[i], chain.d[i], chain.alpha[i], chain.theta[i] + angles[:, i])
    return pose


def _link(a: float, d: float, alpha: float, theta: Array) -> Array:
    """(N, 4, 4) of one DH row, as textbooks print it."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    link = np.zeros((theta.size, 4, 4))
    link[:, 0] = np.stack((ct, -st * ca, st * sa, a * ct), axis=1)
    link[:, 1] = np.stack((st, ct * ca, -ct * sa, a * st), axis=1)
    link[:, 2] = [0.0, sa, ca, d]
    link[:, 3, 3] = 1.0
    return link


def _with(nominal: Geometry, chosen: NDArray[np.intp], x: Array) -> Geometry:
    values = nominal.values.copy()
    values[chosen] = x
    return nominal.with_values(values)


def main() -> None:
    """Both ways on the same samples, once."""
    described = load_scenario(SCENARIO).model_dump() | {
        "plant": {"kind": "kinematic"},
        "errors": {"static": {"table": "thesis_3_1"}, "joint_noise": {"sigma_rad": 1e-5}},
        "identify": {"cost": "transform", "data": "samples"},
    }
    scenario = Scenario.model_validate(described)
    samples, parameters = (
        trial_samples(scenario, SCENARIO.parent),
        cost_parameters(scenario, SCENARIO.parent),
    )
    plain = plain_user_identify(samples, samples.nominal, parameters)
    begin = time.perf_counter()
    ours = fit_cost(
        cost_named("transform", "vector"),
        samples.nominal,
        q=samples.q,
        b=samples.b,
        parameters=parameters,
    )
    seconds = time.perf_counter() - begin
    evaluations, iterations = f"{plain.iterations} evaluations", f"{ours.iterations} iterations"
    for name, fit, count, spent in (
        ("least_squares, printed scalar", plain, evaluations, plain.seconds),
        ("ident.thesis.cost_fit, vector form", ours, iterations, seconds),
    ):
        distance = 1e3 * np.linalg.norm((fit.geometry.values - samples.true.values)[parameters])
        print(
            f"{name}: {count}, converged {fit.converged}, distance {distance:.4f} mm|mrad, "
            f"{spent:.3f} s"
        )


if __name__ == "__main__":
    main()
