"""A robot that a laser tracker follows, white noise: error over the Cramer-Rao bound, intervals.

The robots, their motion and the rows are made by tests.helpers.followed_robot, plain arithmetic
that shares nothing with the product: 60 s at 200 Hz, 15 um + 6 um/m along each axis. At poses of
the same ranges that were not measured the target is predicted in the tracker's frame. Its error is
compared with the bound, the covariance of the true noise without inflation, and with the stated
intervals.

python -m benchmarks.moving_tracker [--seeds 60]
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.logs import RobotLog, TrackerLog
from ballbar.cell.poses import PoseGroup
from ballbar.ident.cross_validation import position_rows, spread_of
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.robust_fit import LEAST, equations_at
from ballbar.ident.signals.smooth_log import motion_of
from ballbar.ident.start.followed import SEAT, TARGET, followed_table
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_fit import fit_table
from tests.helpers.followed_robot import FollowedRobot

STUDY = Path(__file__).parents[1] / "docs/studies/moving_tracker.csv"
SECONDS, RATE, ROBOT_RATE = 60.0, 200.0, 250.0
NOISE = 15e-6, 6e-6  # [m], [m/m] of a laser tracker, along each axis
POSES, QUANTILE = 200, 1.959964  # of a normal number: 95 %
ROBOT = load_robot("ur10e")


def made(seed: int) -> FollowedRobot:
    """The robot of a seed, its angles logged without noise: the bound then is of the tracker's."""
    return FollowedRobot(seed=seed, noise_m=NOISE, angle_noise=1e-8)


def fitted(robot: FollowedRobot) -> TableEstimate:
    """Robot, clock, seat and target by the logs."""
    t, rows = np.arange(0.0, SECONDS, 1.0 / ROBOT_RATE), np.arange(0.0, SECONDS - 1.0, 1.0 / RATE)
    values = robot.measured(rows)
    away = np.linalg.norm(values, axis=1)[:, None]
    sigma = np.repeat(NOISE[0] + NOISE[1] * away, 3, axis=1)
    logged, log = RobotLog(t, robot.logged(t)), TrackerLog(rows, values, sigma)
    motion = motion_of(logged, logged.q)
    return fit_table(followed_table("moving", ROBOT, robot_geometry(ROBOT), motion, log))


def errors_of(robot: FollowedRobot, result: TableEstimate) -> tuple[Array, Array, Array]:
    """(N, 3) [m] errors at other poses, their bounds, and their stated standard deviations."""
    rng, q = np.random.default_rng([robot.seed, 9]), result.table.q
    other = rng.uniform(q.min(axis=0), q.max(axis=0), (POSES, q.shape[1]))
    values = (robot.points(other) - np.array(robot.seat)) @ robot.turn
    group = PoseGroup(
        measured="point",
        seat=SEAT,
        target=TARGET,
        q=other,
        values=values,
        sigma=np.full(values.shape, NOISE[0]),
        rows=np.arange(1, POSES + 1),
        file="other",
    )
    fit = result.fit
    model = replace(fit.model, table=replace(result.table, groups=(group,)))
    (point,) = model.at_rest(fit.x)
    moves = whole_jacobian(model, fit.x, 0, point, position_rows(point))
    least = ExcessNoise(position=LEAST.position)
    bound = inverse(equations_at(fit.model, fit.x, least, fit.linear.robust).normal)
    variances = (
        np.diagonal(spread_of(moves, covariance), axis1=1, axis2=2)
        for covariance in (bound, fit.covariance)
    )
    return point.closure.error[:3].T, *(np.sqrt(v) for v in variances)


def main() -> None:
    """Prints a line a seed and the figures of all, and writes the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=60)
    rows, held, clocks = [], [], []
    for seed in range(1, parser.parse_args().seeds + 1):
        robot = made(seed)
        result = fitted(robot)
        error, bound, stated = errors_of(robot, result)
        clock, sigma = result.clocks["moving"]
        off = (clock.offset - robot.offset) / sigma[0], (clock.skew - robot.skew) / sigma[1]
        held.append(np.abs(error) < QUANTILE * stated)
        clocks += [abs(z) < QUANTILE for z in off]
        rows.append(
            {
                "seed": seed,
                "error_um": f"{np.sqrt((error**2).sum(axis=1).mean()) * 1e6:.3f}",
                "bound_um": f"{np.sqrt((bound**2).sum(axis=1).mean()) * 1e6:.3f}",
                "within_95": f"{held[-1].mean():.4f}",
                "clock_offset_us": f"{(clock.offset - robot.offset) * 1e6:+.3f}",
                "clock_sigma_us": f"{sigma[0] * 1e6:.3f}",
                "status": result_status(result),
            }
        )
        print(rows[-1], flush=True)
    error, bound = (np.array([float(r[key]) for r in rows]) for key in ("error_um", "bound_um"))
    print(
        f"error over bound {np.sqrt((error**2).mean() / (bound**2).mean()):.3f}; within 95 %: "
        f"{np.mean(held):.4f} of the tool, {np.mean(clocks):.4f} of the clock"
    )
    with STUDY.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def result_status(result: TableEstimate) -> str:
    """Size of the noise beyond the stated one, or "as stated"."""
    unexplained = result.unexplained
    return "as stated" if unexplained < 0.5 * NOISE[0] else f"{unexplained * 1e6:.1f} um left"


if __name__ == "__main__":
    main()
