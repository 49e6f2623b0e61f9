"""Errors of poses that were not fitted, for several priors of the unit weights' coefficients.

    python -m benchmarks.sag_prior --data ../shared/real_robots [--splits 4] [--only NAME ...]
        [--priors NAME ...]

Priors of 1 to 30 mrad per metre of lever; `tails` : those of Student's distribution, as the priors
of the geometry have them; `scaled` : their common scale by its evidence, as the product has it;
`target` : a unit weight at the target besides those at the frames'
origins; `offset` : two more beside the flange's origin. Measured robots as in
benchmarks.real_robots; simulated ones without sag, with 0.3 mrad/m, and with a tool of 3 kg on
gears of 2e-4 and 6e-4 rad/(N m), which makes 5 to 20 mrad/m. The simulated ones have errors of 12
and 17 cycles a turn as well; the eighth of joint space in which axes 1 to 3 are above their middles
is not fitted and judged alone (beyond). Writes docs/studies/sag_prior.csv, a row for each set,
split and prior.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.files import write_whole
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.poses import PoseTable
from ballbar.ident import table_fit
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction, State
from ballbar.ident.estimator import robust_fit as fit
from ballbar.ident.estimator.common_scale import CommonScale
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.robot.accuracy import position_error
from ballbar.ident.start.placements import start_of_poses
from ballbar.ident.table_estimate import TableEstimate
from benchmarks import real_robots as real
from benchmarks import real_robots_tables as tables
from tests.helpers.still_poses import TrueRobot, angles, table_of, true_robot

RESULT = Path("docs/studies/sag_prior.csv")
SIMULATED = ("ur5", "irb120", "irb2400", "panda")
COUNTS = (30, 60, 300)
GRAVITY = 9.81  # [m/s^2]
LINK, TOOL = 2.0, 3.0  # [kg] of each link and of the tool
TOOL_AT = np.array([0.02, 0.0, 0.08])  # [m] centre of mass in the flange's frame
COMPLIANCE = 2e-4, 6e-4  # [rad/(N m)] main axes and wrist
ORDERS, AMPLITUDE = ((1, 17), (2, 12)), 1e-4  # [rad]

weights = importlib.import_module("ballbar.ident.corrections.unit_weights")
Judge = Callable[[TableEstimate], tuple[Array, float]]  # [mm] errors, share in the regions


@dataclass(frozen=True)
class Prior:
    """Prior of the coefficients, and what is changed besides it."""

    name: str
    sigma: float  # [rad/m]
    tails: bool = False
    scaled: bool = False
    more: str = ""  # unit weights


PRIORS = (
    *(Prior(f"{mrad}", 1e-3 * mrad) for mrad in (1, 2, 3, 5, 10, 30)),
    *(Prior(f"{mrad} tails", 1e-3 * mrad, tails=True) for mrad in (1, 2, 3)),
    Prior("3 tails scaled", 3e-3, tails=True, scaled=True),
    *(Prior(f"3 tails {more}", 3e-3, tails=True, more=more) for more in ("target", "offset")),
)
BESIDE = 0.1 * np.eye(3)[:2]  # [m] in the flange's frame: `offset`


@dataclass(frozen=True)
class Case:
    """A table that is identified, and the sets that judge the result."""

    fitted: PoseTable
    judges: dict[str, Judge]
    split: int


def identified(table: PoseTable, prior: Prior) -> TableEstimate:
    """An identification with this prior."""

    def widened(declared: Unknowns, x: Array, chosen: NDArray[np.intp]) -> Unknowns:
        part = declared.coefficients
        own = (chosen >= part.start) & (chosen < part.stop)
        return with_tails(declared, x, chosen if prior.tails else chosen[~own])

    def as_declared(estimate: Fit, chosen: NDArray[np.intp], declared: Array) -> CommonScale:
        del chosen, declared
        return CommonScale(1.0, np.zeros(estimate.covariance.shape))

    plain, with_tails = table_fit.sag, fit.widened

    def with_more(robot: Robot) -> list[Correction]:
        targets = start_of_poses(table, nominal_chain(robot)).targets.values()
        places = [t.origin for t in targets][:1] if prior.more == "target" else BESIDE
        return [*plain(robot), *(weight_at(robot, place, prior.sigma) for place in places)]

    with (
        patch.object(weights, "PRIOR", prior.sigma),
        patch.object(fit, "widened", widened),
        patch.object(table_fit, "sag", with_more if prior.more else plain),
        nullcontext() if prior.scaled else patch.object(table_fit, "common_scale", as_declared),
    ):
        return table_fit.fit_table(table)


def weight_at(robot: Robot, place: Array, sigma: float) -> Correction:
    """A unit weight at a place (3,) [m] in the flange's frame, felt by every axis."""
    chain = nominal_chain(robot)
    down = robot.gravity / np.linalg.norm(robot.gravity)

    def regressors(state: State) -> list[Array]:
        frames: Frames = forward(chain, state.gears.T @ robot.gear_to_joint)
        point = frames.tip + np.einsum("ijn,j->in", frames.rotation(), place)
        pulls = [cross(down[:, None] * np.ones(point.shape[1]), z) for z in frames.z[:-1]]
        return [((point - o) * p).sum(axis=0) for o, p in zip(frames.origin, pulls, strict=False)]

    coefficients = tuple(
        Coefficient(f"weight{place.tolist()}_joint{j + 1}", "rad/m", 0.0, sigma, GEAR + j)
        for j in range(robot.joints)
    )
    return Correction("tool_weight", "sag under the tool", coefficients, regressors)


def judged_by(table: PoseTable) -> Judge:
    """Judges a result by poses of its own seats."""
    return lambda result: (real.norms(result, table), float(result.within(table).mean()))


def ur5(folder: Path, splits: int) -> Iterator[Case]:
    """600 grid poses fitted; 20 random ones and the other 400."""
    grid, random = tables.ur5_grid(folder), tables.ur5_random(folder)
    groups = tuple(replace(g, seat=grid.seats[0], target=grid.targets[0]) for g in random.groups)
    random = replace(random, groups=groups)
    for seed in range(splits):
        fitted, rest = real.split(grid, 600, seed)
        judges = {"UR5, 20 random": judged_by(random), "UR5, other 400": judged_by(rest)}
        yield Case(fitted, judges, seed)
    yield from few("UR5", grid, splits)


def ur10_a(folder: Path, splits: int) -> Iterator[Case]:
    """1500 poses of series A fitted; regions left out."""
    table = tables.ur10_a(folder)
    for seed in range(splits):
        fitted, rest = real.split(table, 1500, seed, real.JUDGED)
        yield Case(fitted, {"UR10 A, 1500": judged_by(rest)}, seed)
    yield from few("UR10 A", table, splits)
    regions = real.joint_regions(table.q)
    for k in range(8):
        rest = real.drawn(table.part(regions == k), real.JUDGED, k)
        fitted = real.drawn(table.part(regions != k), 1500, k)
        yield Case(fitted, {"UR10 A, region left out": judged_by(rest)}, k)


def ur10_b(folder: Path, splits: int) -> Iterator[Case]:
    """Half of series B fitted."""
    table = tables.ur10_b(folder)
    for seed in range(splits):
        fitted, rest = real.split_by_pose(table, table.size // 2, seed)
        yield Case(fitted, {"UR10 B, half": judged_by(rest)}, seed)
    yield from few("UR10 B", table, splits)


def few(name: str, table: PoseTable, splits: int) -> Iterator[Case]:
    """60 poses."""
    for seed in range(2 * splits):
        fitted, rest = real.split_by_pose(table, 60, seed)
        rest = real.drawn(rest, real.JUDGED, seed)
        yield Case(fitted, {f"{name}, 60": judged_by(rest)}, seed)


def lengths(folder: Path, splits: int) -> Iterator[Case]:
    """Lengths of series B to three seats and to one, judged as points."""
    table = real.as_points(tables.ur10_b(folder))
    for seed in range(splits):
        fitted, rest = real.split_by_pose(table, table.size // 2, seed)
        q, values = rest.q, rest.groups[0].values

        def as_points(
            result: TableEstimate, q: Array = q, values: Array = values
        ) -> tuple[Array, float]:
            tip = result.identified_robot().frames(q).tip.T
            return position_error(tip, values).error * real.MM, np.nan

        three = real.as_lengths(fitted)
        one = replace(three, groups=three.groups[:1])
        yield Case(three, {"UR10 B, lengths, 3 seats": as_points}, seed)
        yield Case(one, {"UR10 B, lengths, 1 seat": as_points}, seed)


def pandas(folder: Path, splits: int) -> Iterator[Case]:
    """Sockets of some sites fitted, the others judged."""
    del splits  # as many as there are sites
    for robot, what in (("panda_3", "every second site"), ("panda_6", "one site")):
        table = tables.panda(folder, robot)
        sites = real.sites_of(table)
        parts = [sites[0::2], sites[1::2]] if robot == "panda_3" else [[s] for s in sites]
        for k, part in enumerate(parts):
            rest = real.with_sites(table, [s for s in sites if s not in part])
            judge: Judge = lambda result, rest=rest: real.judged_sockets(result, rest)  # noqa: E731
            yield Case(real.with_sites(table, part), {f"{robot}, {what}": judge}, k)


def simulated(folder: Path, splits: int) -> Iterator[Case]:
    """Drawn robots."""
    del folder
    for name in SIMULATED:
        for kind in ("none", "small", "tool"):
            for seed in range(max(1, splits // 2)):
                true = robot_with(name, kind, seed)
                q, new = angles(name, 400, seed), angles(name, 1600, 100 + seed)
                beyond, inside = new[octant(new, new)], new[~octant(new, new)]
                q = q[~octant(q, new)]
                sets = {"inside": inside[:500], "beyond": beyond}
                for count in COUNTS:
                    judges = {
                        f"{name}, sag {kind}, {count}, {where}": judged_by(
                            table_of(true, q=poses, noise=1e-6, seed=seed + 50)
                        )
                        for where, poses in sets.items()
                    }
                    yield Case(table_of(true, q=q[:count], seed=seed), judges, seed)


def octant(q: Array, of: Array) -> Array:
    """(N,) whether axes 1 to 3 are above the middle of the angles `of`."""
    middle = 0.5 * (of.min(axis=0) + of.max(axis=0))
    return np.asarray((q[:, :3] > middle[:3]).all(axis=1))


def robot_with(name: str, kind: str, seed: int) -> TrueRobot:
    """A drawn robot without sag, with a small one, or with that of a tool on elastic gears."""
    small = 3e-4 if kind == "small" else 0.0
    true = true_robot(name, seed=seed, orders=ORDERS, amplitude=AMPLITUDE, sag=small)
    if kind != "tool":
        return true
    links, harmonics = true.corrections
    tool = weight_at(true.robot, TOOL_AT, 1.0)
    joints = true.robot.joints
    size = np.where(np.arange(joints) < joints - 3, *COMPLIANCE)
    compliance = size * np.random.default_rng([seed, 8]).lognormal(0.0, 0.3, joints)
    loads = [
        GRAVITY * mass * compliance[int(c.name.rpartition("joint")[2]) - 1]
        for correction, mass in ((links, LINK), (tool, TOOL))
        for c in correction.coefficients
    ]
    waves = true.values[len(links.coefficients) :]
    values = np.concatenate((loads, waves))
    return replace(true, corrections=(links, tool, harmonics), values=values)


def rows_of(case: Case, prior: Prior) -> Iterator[dict[str, object]]:
    """Judgements on one identification."""
    result = identified(case.fitted, prior)
    for name, judge in case.judges.items():
        error, covered = judge(result)
        yield {
            "set": name,
            "split": case.split,
            "prior": prior.name,
            "mean_mm": round(float(error.mean()), 5),
            "q95_mm": round(float(np.quantile(error, 0.95)), 5),
            "max_mm": round(float(error.max()), 5),
            "covered": round(covered, 4),
            "orders": len(result.search.orders) if result.search else 0,
        }


STUDIES = {
    "ur10_b": ur10_b,
    "lengths": lengths,
    "pandas": pandas,
    "ur5": ur5,
    "simulated": simulated,
    "ur10_a": ur10_a,
}


def shown(rows: pd.DataFrame) -> str:
    """Means over the splits of every set and prior; simulated robots together."""
    drawn = r"^(?:ur5|irb\d+|panda), "
    rows = rows.assign(set=rows["set"].str.replace(drawn, "simulated, ", regex=True))
    order, columns = rows["set"].unique(), [p.name for p in PRIORS if p.name in set(rows["prior"])]
    parts = []
    for value, digits in (("mean_mm", 4), ("max_mm", 2), ("covered", 3), ("orders", 1)):
        table = rows.pivot_table(values=value, index="set", columns="prior", dropna=False)
        parts.append(f"{value}\n{table.loc[order, columns].round(digits).to_string()}")
    return "\n\n".join(parts)


def main() -> None:
    """Writes the rows as they come and prints the means."""
    parser = argparse.ArgumentParser(description="Priors of the unit weights.")
    parser.add_argument("--data", type=Path, default=tables.DATA)
    parser.add_argument("--splits", type=int, default=4)
    parser.add_argument("--only", nargs="*", choices=STUDIES, default=list(STUDIES))
    names = [prior.name for prior in PRIORS]
    parser.add_argument("--priors", nargs="*", choices=names, default=names)
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    rows: list[dict[str, object]] = []
    for name in options.only:
        for case in STUDIES[name](options.data, options.splits):
            for prior in (p for p in PRIORS if p.name in options.priors):
                rows.extend(rows_of(case, prior))
            write_whole(options.out, pd.DataFrame(rows).to_csv(index=False).encode())
    print(shown(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
