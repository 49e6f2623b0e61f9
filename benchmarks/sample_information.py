"""Instants for the fit: evenly spread, or chosen by what they tell. Predicted TCP sigma at equal count.

    python -m benchmarks.sample_information

One 60 s run of the kinematic plant, dh model, five encoders. Candidates lie 80 ms apart, the widest knot spacing of the smoothed
logs: closer ones share noise. Chosen greedily, one after another: the one that adds most to the determinant of the information,
or the one that takes most from the mean TCP variance itself. Nothing better than the latter is to be had one instant at a time.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from acquisition import read_recording
from benchmarks.alignment_after_fit import SCENARIOS, settings
from ident.estimator.identifiability import candidates
from ident.estimator.noise import noise_from_logs
from ident.estimator.problem import Problem
from ident.estimator.sampling import sample_times
from ident.estimator.solver import Fit, solve
from ident.identify import ROD_SIGMA_START, WIDEST_KNOT_SPACING, Identification, identify
from ident.robot.accuracy import accuracy_grid, tcp_sigma
from ident.signals.smooth_log import smooth_log
from sim.recording_files import write_recording
from sim.simulate import simulate

COUNTS = (75, 150, 300)
DURATION = 60.0  # [s]

Array = np.ndarray


def fitted() -> tuple[Identification, Fit, int]:
    """The identification of one run, a fit at all candidates, and their number."""
    chosen = settings(DURATION, {"skew": 5e-5}, 1)
    simulation = simulate(chosen, relative_to=SCENARIOS)
    with tempfile.TemporaryDirectory() as work:
        write_recording(simulation, chosen, Path(work) / "recording")
        read = read_recording(Path(work) / "recording")
    assert read.ballbar_log is not None
    found = identify(simulation.cell, read.robot_log, read.ballbar_log, model="dh")
    assert found.clock is not None
    robot = smooth_log(read.robot_log.t, read.robot_log.q, widest_knot_spacing=WIDEST_KNOT_SPACING)
    bar = smooth_log(
        read.ballbar_log.t, read.ballbar_log.angles, widest_knot_spacing=WIDEST_KNOT_SPACING
    )
    times = sample_times(robot, bar, found.clock, int(DURATION / WIDEST_KNOT_SPACING))
    noise = noise_from_logs(
        robot, bar, found.joints, spacing=WIDEST_KNOT_SPACING, rod=ROD_SIGMA_START
    )
    problem = Problem(robot, bar, found.joints, np.array(found.signs, dtype=float), times, noise)
    kept = np.array([i for i in candidates(found.joints) if i in set(found.parameters.tolist())])
    fit = solve(problem, problem.start(found.geometry, found.clock), kept)
    return found, fit, times.size


def target(found: Identification, parameters: Array, size: int) -> tuple[Array, Array]:
    """(P, P) matrix A with mean TCP variance trace(A C), from the variance that each pair of unknowns brings; and the grid."""
    grid, out = accuracy_grid(found.cell.robot), np.zeros((size, size))

    def variance(direction: Array) -> float:
        return float(
            (
                tcp_sigma(found.geometry, grid, parameters, np.outer(direction, direction)) ** 2
            ).mean()
        )

    unit = np.eye(size)
    alone = np.array([variance(unit[i]) for i in range(size)])
    for i in range(size):
        for j in range(size):
            out[i, j] = (
                alone[i] if i == j else 0.5 * (variance(unit[i] + unit[j]) - alone[i] - alone[j])
            )
    return out, grid


def greedy(columns: Array, start: Array, count: int, aim: Array | None) -> Array:
    """Indices of `count` samples; columns : (P, E, N) whitened Jacobian; start : (P, P) covariance; aim : A, None for the determinant."""
    covariance, left, taken = start, list(range(columns.shape[2])), []
    for _ in range(count):
        here = columns[:, :, left]
        spread = np.einsum("pq,qen->pen", covariance, here)
        growth = np.einsum("pen,pfn->nef", here, spread) + np.eye(columns.shape[1])
        if aim is None:
            gain = np.linalg.slogdet(growth)[1]
        else:
            gain = np.einsum(
                "nef,nfe->n",
                np.linalg.inv(growth),
                np.einsum("pen,pq,qfn->nef", spread, aim, spread),
            )
        taken.append(left.pop(int(np.argmax(gain))))
        one = columns[:, :, taken[-1]]
        moved = covariance @ one
        covariance = (
            covariance - moved @ np.linalg.inv(np.eye(one.shape[1]) + one.T @ moved) @ moved.T
        )
    return np.array(taken)


def main() -> None:
    """One line for each count."""
    found, fit, samples = fitted()
    columns = fit.final.jacobian.reshape(fit.final.jacobian.shape[0], -1, samples)
    every = np.einsum("pen,qen->pq", columns, columns)
    prior = np.linalg.inv(fit.covariance) - every
    aim, grid = target(found, fit.parameters, len(columns))

    def predicted(rows: Array) -> float:
        covariance = np.linalg.inv(
            prior + np.einsum("pen,qen->pq", columns[:, :, rows], columns[:, :, rows])
        )
        return float(tcp_sigma(found.geometry, grid, fit.parameters, covariance).mean() * 1e6)

    print(f"all {samples} candidates: mean TCP sigma {predicted(np.arange(samples)):.2f} um")
    start = np.linalg.inv(prior + 1e-3 * every)
    for count in COUNTS:
        even = predicted(np.linspace(0, samples - 1, count).round().astype(int))
        by_determinant, by_tcp = (
            predicted(greedy(columns, start, count, one)) for one in (None, aim)
        )
        print(
            f"{count:4} samples: evenly {even:.2f} um, by determinant {by_determinant:.2f} um, by TCP variance {by_tcp:.2f} um"
        )


if __name__ == "__main__":
    main()
