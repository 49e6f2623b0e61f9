"""Instants for the fit, evenly spread or chosen by information: TCP sigma at equal count.

    python -m benchmarks.sample_information

One 60 s run of the kinematic plant, dh model, five encoders. Candidates lie 80 ms apart, the widest
knot spacing of the smoothed logs: closer ones share noise. Chosen greedily, one after another: the
one that adds most to the determinant of the information, or the one that takes most from the mean
TCP variance itself. Nothing better than the latter is to be had one instant at a time.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import jacobian
from ballbar.ident.estimator.sample_times import sample_times
from ballbar.ident.estimator.samples import samples_of
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import ROD_SIGMA_START, Logs, fit_recording
from ballbar.ident.robot.accuracy import accuracy_grid, tcp_sigma
from ballbar.ident.signals.smooth_log import WIDEST_KNOT_SPACING
from ballbar.ident.thesis.paired_samples import SampleFit
from benchmarks.alignment_after_fit import settings
from benchmarks.study import SCENARIOS, recorded

COUNTS = (75, 150, 300)
DURATION = 60.0  # [s]

Array = np.ndarray


def fitted() -> tuple[Cell, Fit]:
    """The cell of one run, and a fit at all candidate samples."""
    simulation, read = recorded(settings(DURATION, {"skew": 5e-5}, 1), SCENARIOS)
    assert read.ballbar_log is not None
    logs = Logs(read.robot_log, read.ballbar_log)
    found = fit_recording(simulation.cell, logs, FitOptions(model="dh"))
    old = found.samples
    times = sample_times(old.robot, old.ballbar, found.clock, int(DURATION / WIDEST_KNOT_SPACING))
    samples = samples_of(
        old.robot, old.ballbar, old.encoders, old.directions, times, spacing=WIDEST_KNOT_SPACING
    )
    excess = ExcessNoise(rod=ROD_SIGMA_START)
    fit = fit_kinematics(samples, found.geometry, found.clock, found.subset.parameters, excess)
    return simulation.cell, fit


def target(cell: Cell, geometry: Geometry, parameters: Array, size: int) -> tuple[Array, Array]:
    """(P, P) matrix A with mean TCP variance trace(A C), pair by pair; and the grid."""
    grid, out = accuracy_grid(cell.robot), np.zeros((size, size))

    def variance(direction: Array) -> float:
        return float(
            (tcp_sigma(geometry, grid, parameters, np.outer(direction, direction)) ** 2).mean()
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
    """Indices of `count` samples.

    columns : (P, E, N) whitened Jacobian. start : (P, P) covariance. aim : A, None for the
    determinant.
    """
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
    cell, fit = fitted()
    (block,) = jacobian(fit.model, fit.linear, 0)
    columns, geometry = block.values[np.argsort(block.index)], fit.geometry()
    samples = columns.shape[2]
    parameters = SampleFit(fit, 0).parameters
    every = np.einsum("pen,qen->pq", columns, columns)
    prior = np.linalg.inv(fit.covariance) - every
    aim, grid = target(cell, geometry, parameters, len(columns))

    def predicted(rows: Array) -> float:
        covariance = np.linalg.inv(
            prior + np.einsum("pen,qen->pq", columns[:, :, rows], columns[:, :, rows])
        )
        return float(tcp_sigma(geometry, grid, parameters, covariance).mean() * 1e6)

    print(f"all {samples} candidates: mean TCP sigma {predicted(np.arange(samples)):.2f} um")
    start = np.linalg.inv(prior + 1e-3 * every)
    for count in COUNTS:
        even = predicted(np.linspace(0, samples - 1, count).round().astype(int))
        by_determinant, by_tcp = (
            predicted(greedy(columns, start, count, one)) for one in (None, aim)
        )
        print(
            f"{count:4} samples: evenly {even:.2f} um, by determinant {by_determinant:.2f} um, "
            f"by TCP variance {by_tcp:.2f} um"
        )


if __name__ == "__main__":
    main()
