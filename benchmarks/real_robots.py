"""Identification of real robots from public measurements: the table of docs/real_robots.md.

    python -m benchmarks.real_robots --data ../shared/real_robots [--splits 4] [--only NAME ...]
        [--figures docs/images/real_robots]

Errors are of poses that were not fitted, in mm, mean (95 %), mean over the splits. The data are not
part of the project; docs/real_robots.md says where they come from.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.files import write_whole
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.ident.estimator.regions import joint_regions
from ballbar.ident.held_machine import placed
from ballbar.ident.options import FitOptions, JointErrors
from ballbar.ident.robot.accuracy import position_error
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.table_fit import fit_table
from ballbar.report.line_plot import Distribution, cumulative, order_spectra
from benchmarks import real_robots_tables as tables

MM = 1e3
# what a figure in the report has from its page
ALONE = 'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif"'
JUDGED = 3000  # poses, of series A, that were not fitted
SEATS = np.array([[0.9, -0.7, -0.2], [-0.9, -0.7, 0.1], [0.1, 1.1, 0.4]])  # [m] from the middle
GAP = 0.15  # [rad] between the angles that were fitted and those that are judged
SAG_ONLY = FitOptions(joint_errors="none")


@dataclass(frozen=True)
class Line:
    """One row of the table."""

    name: str
    what: str
    measured: str
    target: str


@dataclass(frozen=True)
class Data:
    """The folder with the data, and how many splits are drawn."""

    folder: Path
    splits: int


def ur5(data: Data) -> Iterator[Line]:
    """600 grid poses fitted; the other 400, and 20 random ones."""
    grid, random = tables.ur5_grid(data.folder), tables.ur5_random(data.folder)
    groups = tuple(replace(g, seat=grid.seats[0], target=grid.targets[0]) for g in random.groups)
    random = replace(random, groups=groups)
    other, twenty, covered, seen = [], [], [], []
    for seed in range(data.splits):
        fitted, judged = split(grid, 600, seed)
        result = fit_table(fitted)
        other.append(norms(result, judged))
        twenty.append(norms(result, random))
        covered.append(result.within(judged).mean())
        seen.append(result.within(random).mean())
    yield Line("UR5", "600 grid poses fitted; 20 random poses", shown(twenty), "0.067")
    yield Line("UR5", "the other 400", shown(other), "0.058")
    yield Line("UR5", "95 % region holds, grid; random", shares(covered, seen), "93 to 98 %")
    yield from few(grid, "UR5", data)


def ur10_a(data: Data) -> Iterator[Line]:
    """1500 poses of series A fitted, 3000 judged; halves of the time; regions left out."""
    table = tables.ur10_a(data.folder)
    errors, sag, covered, seconds, found = [], [], [], [], []
    for seed in range(data.splits):
        fitted, judged = split(table, 1500, seed, JUDGED)
        began = time.perf_counter()
        result = fit_table(fitted)
        seconds.append(time.perf_counter() - began)
        errors.append(norms(result, judged))
        covered.append(result.within(judged).mean())
        found.append(len(result.search.orders) if result.search else 0)
        sag.append(norms(fit_table(fitted, SAG_ONLY), judged))
    yield Line("UR10 A", "1500 fitted, 3000 judged", shown(errors), "0.12, each below 0.13")
    yield Line("UR10 A", "largest mean of a split", f"{max(e.mean() for e in errors):.3f}", "0.13")
    yield Line("UR10 A", "the same with sag alone", shown(sag), "")
    yield Line("UR10 A", "orders found", f"{min(found)} to {max(found)}", "")
    yield Line("UR10 A", "95 % region holds", shares(covered), "93 to 98 %")
    yield Line("UR10 A", "seconds, 1500 poses, everything", f"{np.median(seconds):.1f}", "6")
    first = np.arange(table.size) < table.size // 2
    halves, sag = [], []
    for seed in range(data.splits):
        fitted = drawn(table.part(first), 1500, seed)
        judged = drawn(table.part(~first), JUDGED, seed)
        halves.append(norms(fit_table(fitted), judged))
        sag.append(norms(fit_table(fitted, SAG_ONLY), judged))
    yield Line("UR10 A", "first half of the time fitted", shown(halves), "0.21")
    yield Line("UR10 A", "the same with sag alone", shown(sag), "")
    regions = joint_regions(table.q)
    left, sag = [], []
    for region in range(8):
        fitted = drawn(table.part(regions != region), 1500, region)
        judged = drawn(table.part(regions == region), JUDGED, region)
        left.append(norms(fit_table(fitted), judged))
        sag.append(norms(fit_table(fitted, SAG_ONLY), judged))
    yield Line("UR10 A", "one of 8 regions left out", shown(left), "0.18")
    yield Line("UR10 A", "the same with sag alone", shown(sag), "")
    yield from few(table, "UR10 A", data)


def ur10_b(data: Data) -> Iterator[Line]:
    """Series B split by pose: 255 of its poses occur twice."""
    table = tables.ur10_b(data.folder)
    errors, covered = [], []
    for seed in range(data.splits):
        fitted, judged = split_by_pose(table, table.size // 2, seed)
        result = fit_table(fitted)
        errors.append(norms(result, judged))
        covered.append(result.within(judged).mean())
    yield Line("UR10 B", "half fitted, half judged, split by pose", shown(errors), "0.14")
    yield Line("UR10 B", "95 % region holds", shares(covered), "93 to 98 %")
    yield from few(table, "UR10 B", data)


def transfer(data: Data) -> Iterator[Line]:
    """Joint errors learned on A; base, target, geometry and sag refitted on B."""
    a, b = tables.ur10_a(data.folder), tables.ur10_b(data.folder)
    for count, target in ((b.size // 2, "0.31"), (60, "0.34")):
        kept, without = [], []
        for seed in range(data.splits):
            fitted, judged = split_by_pose(b, count, seed)
            options = FitOptions(joint_errors=learned(drawn(a, 1500, seed)))
            kept.append(norms(fit_table(fitted, options), judged))
            without.append(norms(fit_table(fitted, SAG_ONLY), judged))
        yield Line("UR10 A to B", f"{count} poses of B refitted", shown(kept), target)
        yield Line("UR10 A to B", "the same without what A taught", shown(without), "")


def lengths(data: Data) -> Iterator[Line]:
    """Distances of a target to three seats, judged as points."""
    table = as_points(tables.ur10_b(data.folder))
    ratios, errors = [], []
    for seed in range(data.splits):
        fitted, judged = split_by_pose(table, table.size // 2, seed)
        points = norms(fit_table(fitted), judged)
        by_length = fit_table(as_lengths(fitted))
        measured = judged.groups[0].values
        tip = by_length.identified_robot().frames(judged.q).tip
        aligned = position_error(tip.T, measured).error * MM
        ratios.append(float(aligned.mean() / points.mean()))
        errors.append(aligned)
    yield Line("UR10 B", "lengths to three seats, judged as points", shown(errors), "")
    each = ", ".join(f"{r:.2f}" for r in ratios)
    yield Line(
        "UR10 B", "the same over the fit to points", f"{np.mean(ratios):.2f} ({each})", "1.15"
    )
    table, stated = tables.ur5_grid(data.folder), []
    for seed in range(data.splits):
        fitted, judged = split(table, 300, seed)
        arm = fit_table(as_lengths(fitted)).identified_robot()
        q = judged.groups[0].q[arm.covered(judged.groups[0].q)]
        measured = judged.groups[0].values[arm.covered(judged.groups[0].q)]
        error = position_error(arm.frames(q).tip.T, measured).error
        stated.append(float(np.sqrt((arm.sigma(q) ** 2).mean() / (error**2).mean())))
    each = ", ".join(f"{r:.2f}" for r in stated)
    yield Line(
        "UR5",
        "lengths to three seats of 300 poses: stated over true",
        f"{np.mean(stated):.2f} ({each})",
        "0.8 to 1.25",
    )


def pandas(data: Data) -> Iterator[Line]:
    """Sockets: some sites fitted, the others judged by the distance to the socket's own point."""
    table = tables.panda(data.folder, "panda_3")
    sites = sites_of(table)
    errors, covered = [], []
    for parity in (0, 1):
        result = fit_table(with_sites(table, sites[parity::2]))
        held = with_sites(table, sites[1 - parity :: 2])
        error, inside = judged_sockets(result, held)
        errors.append(error)
        covered.append(inside)
    yield Line("panda_3", "every second site fitted", shown(errors), "0.17")
    yield Line("panda_3", "95 % region holds", shares(covered), "93 to 98 %")
    table = tables.panda(data.folder, "panda_6")
    sites, errors = sites_of(table), []
    for site in sites:
        result = fit_table(with_sites(table, [site]))
        errors.append(judged_sockets(result, with_sites(table, [s for s in sites if s != site]))[0])
    yield Line("panda_6", "one site fitted, mean of the three", shown(errors), "0.25")
    for name in ("panda_3", "panda_6"):
        table, covered = tables.panda(data.folder, name), []
        sites = sites_of(table)
        for site in sites:
            result = fit_table(with_sites(table, [s for s in sites if s != site]))
            covered.append(judged_sockets(result, with_sites(table, [site]))[1])
        yield Line(name, "95 % region holds at a site left out", shares(covered), "90 %, each 75 %")


def nothing(data: Data) -> Iterator[Line]:
    """Orders found where there is none: white noise on the angles of UR5 and UR10."""
    found = 0
    for seed in range(20):
        table = (tables.ur5_grid if seed % 2 else tables.ur10_a)(data.folder)
        fitted = drawn(table, 600, seed)
        result = fit_table(fitted, SAG_ONLY)
        noise = np.random.default_rng([seed, 7])
        group = as_points(fitted).groups[0]
        seat = result.fit.model.unknowns.seat(result.fit.x, group.seat)
        exact = (result.identified_robot().frames(group.q).tip.T - seat.origin) @ seat.rotation
        values = exact + noise.normal(0.0, 5e-5, exact.shape)
        again = fit_table(replace(fitted, groups=(replace(group, values=values),)))
        found += len(again.search.orders) if again.search else 0
    yield Line("white noise", "orders found in 20 draws where there is none", str(found), "0")


def outside(data: Data) -> Iterator[Line]:
    """Poses beyond the fitted range of an axis."""
    table = tables.ur10_a(data.folder)
    for joint in range(3):
        off = table.q[:, joint] - np.median(table.q[:, joint])
        result = fit_table(drawn(table.part(off < -GAP), 1500, joint))
        judged = drawn(table.part(off > GAP), JUDGED, joint)
        errors = norms(result, judged)
        arm = result.identified_robot()
        told = float(np.isinf(arm.sigma(judged.q)).mean())
        yield Line(
            "UR10 A",
            f"axis {joint + 1} beyond its fitted range; said to be unknown",
            f"{errors.mean():.2f}; {told:.0%}",
            "no confident sigma",
        )


def few(table: PoseTable, name: str, data: Data) -> Iterator[Line]:
    """From 60 poses."""
    errors, covered = [], []
    for seed in range(2 * data.splits):
        fitted, judged = split_by_pose(table, 60, seed)
        judged = drawn(judged, JUDGED, seed)
        result = fit_table(fitted)
        errors.append(norms(result, judged))
        covered.append(result.within(judged).mean())
    yield Line(name, "60 poses fitted", shown(errors), "")
    yield Line(name, "95 % region holds, from 60 poses", shares(covered), "93 to 98 %")


def learned(table: PoseTable) -> JointErrors:
    """The joint errors of an identification."""
    result = fit_table(table)
    orders = result.search.pairs if result.search else []
    layout, x = result.fit.model.unknowns, result.fit.x
    names = [f"joint{j + 1}_{n}_{wave}" for j, n in orders for wave in ("cos", "sin")]
    return JointErrors(tuple(orders), tuple(float(x[layout.names.index(n)]) for n in names))


def split(
    table: PoseTable, count: int, seed: int, judged: int | None = None
) -> tuple[PoseTable, PoseTable]:
    """So many random poses, and the others, or some of them."""
    order = np.random.default_rng(seed).permutation(table.size)
    last = None if judged is None else count + judged
    return table.part(mask(table, order[:count])), table.part(mask(table, order[count:last]))


def split_by_pose(table: PoseTable, count: int, seed: int) -> tuple[PoseTable, PoseTable]:
    """About so many poses and the others; equal poses stay together."""
    pose = np.unique(table.q.round(4), axis=0, return_inverse=True)[1].ravel()
    rank = np.random.default_rng(seed).permutation(pose.max() + 1)
    fitted = rank[pose] < count / table.size * rank.size
    return table.part(fitted), table.part(~fitted)


def drawn(table: PoseTable, count: int, seed: int) -> PoseTable:
    """So many random poses of a table, or all where there are fewer."""
    order = np.random.default_rng([seed, 1]).permutation(table.size)
    return table.part(mask(table, order[:count]))


def mask(table: PoseTable, chosen: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(N,) whether a pose is among the chosen ones."""
    out = np.zeros(table.size, dtype=bool)
    out[chosen] = True
    return out


def norms(result: TableEstimate, table: PoseTable) -> Array:
    """(N,) [mm] errors of poses of the result's own seats."""
    return np.asarray(np.linalg.norm(result.deviations(table), axis=1) * MM)


def as_points(table: PoseTable) -> PoseTable:
    """The positions of whole poses."""
    groups = tuple(
        replace(g, measured="point", values=g.values[:, :3], sigma=g.sigma[:, :3])
        for g in table.groups
    )
    return replace(table, groups=groups)


def as_lengths(table: PoseTable) -> PoseTable:
    """The distances of measured points to three fixed seats, which nobody knows."""
    groups: list[PoseGroup] = []
    for g in table.groups:
        seats = g.values.mean(axis=0) + SEATS
        for k, seat in enumerate(seats):
            away = np.linalg.norm(g.values - seat, axis=1)[:, None]
            groups.append(
                replace(
                    g, measured="length", seat=f"seat {k + 1}", values=away, sigma=g.sigma[:, :1]
                )
            )
    return replace(table, groups=tuple(groups))


def sites_of(table: PoseTable) -> list[str]:
    """Names of the sites of a table of socket pairs."""
    return sorted({seat.rpartition("/")[0] for seat in table.seats})


def with_sites(table: PoseTable, sites: Sequence[str]) -> PoseTable:
    """The sockets of some sites."""
    groups = tuple(g for g in table.groups if g.seat.rpartition("/")[0] in sites)
    distances = tuple(d for d in table.distances if d.seats[0].rpartition("/")[0] in sites)
    return replace(table, groups=groups, distances=distances)


def judged_sockets(result: TableEstimate, table: PoseTable) -> tuple[Array, float]:
    """(N,) [mm] distances to each socket's own point; share within the stated 95 % regions."""
    arm, layout = result.identified_robot(), result.fit.model.unknowns
    known = {name: layout.target(result.fit.x, name) for name in layout.targets}
    fit = placed(arm, table, known)
    errors = np.concatenate([p.closure.error[:3].T for p in fit.linear.evaluations])
    away = np.linalg.norm(errors, axis=1) * MM
    everywhere = replace(arm, ranges=np.add(arm.ranges, [-9.0, 9.0]))
    return away, float(everywhere.within(table.q, errors).mean())


def shown(errors: Sequence[Array]) -> str:
    """Mean (95 %), range of the means of the splits."""
    means = [float(e.mean()) for e in errors]
    high = np.mean([np.quantile(e, 0.95) for e in errors])
    return f"{np.mean(means):.3f} ({high:.3f}), {min(means):.3f} to {max(means):.3f}"


def shares(*each: Sequence[float]) -> str:
    """Mean and range of shares."""
    return "; ".join(f"{np.mean(s):.1%} ({min(s):.1%} to {max(s):.1%})" for s in each)


STUDIES: dict[str, Callable[[Data], Iterator[Line]]] = {
    "ur5": ur5,
    "ur10_a": ur10_a,
    "ur10_b": ur10_b,
    "transfer": transfer,
    "lengths": lengths,
    "pandas": pandas,
    "nothing": nothing,
    "outside": outside,
}


def write_figures(data: Data, folder: Path) -> None:
    """Spectrum of the joint errors of series A, and the errors of poses that were not fitted."""
    fitted, judged = split(tables.ur10_a(data.folder), 1500, 0, JUDGED)
    result, sag = fit_table(fitted), fit_table(fitted, SAG_ONLY)
    assert result.search is not None  # searched by default
    spectra = order_spectra(result.search.spectrum_before, result.search.spectrum_after)
    nominal = replace(result.nominal.model, table=judged).at_rest(result.nominal.x)
    before = np.concatenate([np.linalg.norm(p.closure.error[:3], axis=0) for p in nominal])
    curves = [
        Distribution("nominal robot", before, BEFORE),
        Distribution("geometry and sag", norms(sag, judged) / MM, PURPLE),
        Distribution("and joint errors found by evidence", norms(result, judged) / MM, AFTER),
    ]
    folder.mkdir(parents=True, exist_ok=True)
    named = {"ur10_orders": spectra, "ur10_errors": cumulative(curves, label="error of a pose")}
    for name, svg in named.items():
        text = str(svg).replace("<svg ", f"<svg {ALONE} ", 1)
        write_whole(folder / f"{name}.svg", text.encode())


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Identification of real robots.")
    parser.add_argument("--data", type=Path, default=tables.DATA)
    parser.add_argument("--splits", type=int, default=4)
    parser.add_argument("--only", nargs="*", choices=STUDIES, default=list(STUDIES))
    parser.add_argument("--figures", type=Path, help="Folder to write two figures to.")
    options = parser.parse_args()
    data = Data(options.data, options.splits)
    print("| data | what | measured | target |\n|---|---|---|---|", flush=True)
    for name in options.only:
        for line in STUDIES[name](data):
            print(f"| {line.name} | {line.what} | {line.measured} | {line.target} |", flush=True)
    if options.figures is not None:
        write_figures(data, options.figures)


if __name__ == "__main__":
    main()
