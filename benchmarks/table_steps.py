"""Steps of a seat or target in tables of still poses: how many are found, and how many are false.

    python -m benchmarks.table_steps [--data DIR] [--out docs/studies/table_steps.csv]

Steps of 0.1, 0.2 and 0.5 mm of seat or target are put into simulated tables of points and of
lengths, and into tables of measured robots (a UR5, a UR10 in July and in November); tables without
are simulated, or random rows and stretches of measured ones. Whole poses are judged as points, for
their rotation says how a target's step moves the point.
"""

from __future__ import annotations

import argparse
import csv
import io
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.files import write_whole
from ballbar.cell.poses import PoseTable
from ballbar.ident.table_fit import fit_table
from benchmarks import real_robots_tables
from benchmarks.real_robots import as_points, mask, sites_of, with_sites
from tests.helpers.real_robots import DATA
from tests.helpers.still_poses import (
    SEAT,
    TARGET,
    Placement,
    angles,
    group,
    socket_table,
    table_of,
    true_robot,
)

OUT = Path("docs/studies/table_steps.csv")
SIZES = (1e-4, 2e-4, 5e-4)  # [m]
DRAWS = 40  # of every size
ROBOTS = ("ur5", "irb2400", "panda", "irb120", "ur10")
NOISE = 3e-5  # [m]
NEAR = 0.02  # of a table's rows, within which a step is at its place
LENGTH_SEATS = ([1.2, -0.9, 0.1], [-1.1, -0.8, 0.2], [0.2, 1.4, -0.1])  # [m]
REAL: tuple[tuple[str, int, bool], ...] = (  # set, poses, whether they follow each other
    *(("ur5_grid", 1000, True), ("ur5_grid", 300, False), ("ur10_a", 1500, True)),
    *(("ur10_a", 1500, False), ("ur10_b", 1495, True), ("ur10_b", 700, False)),
)
CLEAN = (
    *((name, n, True) for name in ("ur5_grid",) for n in (60, 200, 500, 1000)),
    *((name, n, True) for name in ("ur10_a",) for n in (60, 250, 800, 1500)),
    *((name, n, True) for name in ("ur10_b",) for n in (60, 300, 800, 1495)),
    *(("ur5_grid", 300, False), ("ur10_a", 600, False), ("ur10_b", 700, False)),
)

Kind = Literal["seat", "target"]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A table, and the step that was put into it."""

    table: PoseTable
    kind: Kind | None = None
    row: int = 0


def simulated(measured: str, kind: Kind, size: float, seed: int) -> Drawn:
    """A simulated table of points or lengths whose seat or target steps by a size [m]."""
    rng, name = np.random.default_rng([seed, 10]), ROBOTS[seed % len(ROBOTS)]
    count = int(rng.choice([120, 250, 500]))
    orders = [(1, 3), (0, 13)][: rng.integers(0, 3)]
    true, q = true_robot(name, seed=seed, orders=orders, amplitude=8e-5), angles(name, count, seed)
    at = int(rng.integers(int(0.15 * count), int(0.85 * count)))
    shift, after = _direction(rng) * size, np.arange(count)[:, None] >= at
    moved = Placement(TARGET.rotation, TARGET.origin + shift)
    points = true.positions(q)
    if kind == "target":
        points = np.where(after, true.positions(q, moved), points)
    groups = []
    for k, origin in enumerate([SEAT.origin] if measured == "point" else LENGTH_SEATS):
        away = points - origin - (after * shift if kind == "seat" and k == 0 else 0.0)
        if measured == "length":
            away = np.linalg.norm(away, axis=1)[:, None]
        values = away + rng.normal(0.0, NOISE, away.shape)
        sigma = np.full(values.shape, NOISE)
        groups.append(
            group("point" if measured == "point" else "length", f"s{k}", q, values, sigma)
        )
    return Drawn(PoseTable(name, true.robot, tuple(groups)), kind, at + 2)


def simulated_clean(measured: str, seed: int) -> Drawn:
    """A simulated table without a step."""
    rng, name = np.random.default_rng([seed, 9]), ROBOTS[seed % len(ROBOTS)]
    orders = [(1, 3), (2, 2), (0, 13)][: rng.integers(0, 4)]
    amplitude = float(rng.choice([5e-5, 1.5e-4]))
    true = true_robot(name, seed=seed, orders=orders, amplitude=amplitude)
    if measured == "socket":
        return Drawn(socket_table(true))
    count, noise = int(rng.choice([60, 120, 250, 500])), float(rng.choice([1e-5, NOISE]))
    kind: Literal["point", "pose", "length"] = "point"
    kind = "pose" if measured == "pose" else "length" if measured == "length" else kind
    return Drawn(table_of(true, kind, count=count, noise=noise, seed=seed))


@cache
def measured_robot(name: str, data: Path) -> tuple[PoseTable, Array]:
    """A measured table of points, and (N, 3, 3) the flange's rotation in the frame of its seat."""
    table: PoseTable = getattr(real_robots_tables, name)(data)
    (own,) = table.groups
    if own.measured == "pose":
        return as_points(table), np.asarray(
            Rotation.from_rotvec(own.values[:, 3:].copy()).as_matrix()
        )
    (point,) = fit_table(table).fit.linear.evaluations
    closure = point.target_closure
    turn = np.einsum("ji,jkn->nik", closure.seat.rotation, closure.robot.rotation())
    return table, turn


def measured(
    name: str, count: int, following: bool, seed: int, data: Path, kind: Kind | None, size: float
) -> Drawn:
    """Some rows of a measured table, with a step of a size [m] if a kind is given."""
    table, turn = measured_robot(name, data)
    rng = np.random.default_rng([seed, 77])
    count = min(count, table.size)
    first = int(rng.integers(0, table.size - count + 1))
    rows = np.arange(first, first + count) if following else rng.permutation(table.size)[:count]
    chosen = mask(table, rows)
    (part,) = table.part(chosen).groups
    if kind is None:
        return Drawn(table.part(chosen))
    at, shift = int(rng.integers(int(0.15 * count), int(0.85 * count))), _direction(rng) * size
    after = np.arange(count) >= at
    values = part.values.copy()
    values[after] += shift if kind == "seat" else turn[chosen][after] @ shift
    return Drawn(replace(table, groups=(replace(part, values=values),)), kind, int(part.rows[at]))


def draws(data: Path) -> Iterator[tuple[str, float, Drawn]]:
    """Label, size [m] and table of every draw."""
    kinds: tuple[Kind, Kind] = ("seat", "target")
    for size in SIZES:
        for seed in range(DRAWS):
            kind = kinds[seed // 2 % 2]
            form = ("point", "length")[seed % 2]
            yield f"simulated, {form}", size, simulated(form, kind, size, seed)
        for seed in range(DRAWS if data.is_dir() else 0):
            name, count, following = REAL[seed % len(REAL)]
            kind = kinds[seed // len(REAL) % 2]
            drawn = measured(name, count, following, seed, data, kind, size)
            yield f"measured, {name}", size, drawn
    for form in ("point", "pose", "length", "socket"):
        for seed in range(25):
            yield f"simulated, {form}", 0.0, simulated_clean(form, seed)
    if not data.is_dir():
        return
    for name, count, following in CLEAN:
        for seed in range(1 if count in (1000, 1495) else 7):
            drawn = measured(name, count, following, 100 + seed, data, None, 0.0)
            yield f"measured, {name}", 0.0, drawn
    for name in ("panda_3", "panda_6"):
        table = real_robots_tables.panda(data, name)
        sites = sites_of(table)
        for first in range(len(sites)):
            for several in (1, 2):
                chosen = [sites[(first + k) % len(sites)] for k in range(several)]
                yield f"measured, {name}", 0.0, Drawn(with_sites(table, chosen))


def _direction(rng: np.random.Generator) -> Array:
    drawn = rng.normal(size=3)
    return np.asarray(drawn / np.linalg.norm(drawn))


def main() -> None:
    """Prints and writes a row for every draw, and counts them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("table", "poses", "kind", "size_mm", "row", "found", "false", "steps"))
    counts: dict[tuple[str, float], list[int]] = {}
    for label, size, drawn in draws(arguments.data):
        steps = fit_table(drawn.table).findings.steps
        rows = [int(row) for g in drawn.table.groups for row in g.rows]
        reach = max(10.0, NEAR * (max(rows) - min(rows)))
        right = [s for s in steps if s.kind == drawn.kind and abs(s.row - drawn.row) <= reach]
        found, false = bool(right), len(steps) - len(right)
        said = "; ".join(f"{s.kind} {s.size * 1e3:.3f} mm at {s.row}" for s in steps)
        fields = (label, drawn.table.size, drawn.kind or "", f"{size * 1e3:g}", drawn.row or "")
        table.writerow((*fields, int(found), false, said))
        print(*fields, "found" if found else "", said, flush=True)
        count = counts.setdefault((label.partition(",")[0], size), [0, 0, 0])
        for k, more in enumerate((1, found, false)):
            count[k] += more
    for (kind, size), (tables, found, false) in counts.items():
        print(f"{kind}, {size * 1e3:g} mm: {found} of {tables} found, {false} false steps")
    write_whole(arguments.out, text.getvalue().encode())


if __name__ == "__main__":
    main()
