"""The looks of an incomplete or wrong model, and whether the verdict says so.

    python -m benchmarks.incomplete_models    # one IRB 2400, everything on, two paths, torque

Each correction left out in turn, wrong gear harmonics (notes/identification sec. 6), a thin plate,
jittering stamps, and what no data can show. Writes docs/studies/incomplete_models.csv.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from ballbar.cell.descriptions import Cell
from ballbar.cell.files import write_whole
from ballbar.cell.load import load_robot
from ballbar.ident.corrections import supported_corrections
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.truth.compare import identification_against_truth
from tests.helpers.drawn_robots import ROOT, faulty, recorded, scenario_of

SEED, DURATION = 1, 120.0
Harmonics = tuple[tuple[float, float], ...]


def same(cell: Cell) -> Cell:
    """The cell of the files."""
    return cell


def with_harmonics(change: Callable[[float, float], Harmonics]) -> Callable[[Cell], Cell]:
    """A cell with other gear harmonics; change : of (cycles a turn, amplitude) of each."""

    def changed(cell: Cell) -> Cell:
        listed = tuple(
            tuple(new for one in gear for new in change(*one))
            for gear in cell.robot.gears.harmonics
        )
        return replace(
            cell, robot=replace(cell.robot, gears=replace(cell.robot.gears, harmonics=listed))
        )

    return changed


def with_ratio(factor: float) -> Callable[[Cell], Cell]:
    """A cell whose gears have another ratio in the model: motor harmonics at the wrong order."""

    def changed(cell: Cell) -> Cell:
        return replace(
            cell, robot=replace(cell.robot, transmission=cell.robot.transmission / factor)
        )

    return changed


@dataclass(frozen=True)
class Case:
    """One wrong model, or one fault of the data that the model does not know."""

    name: str
    visible: bool  # whether the verdict must say something
    without: tuple[str, ...] = ()  # corrections
    believed: Callable[[Cell], Cell] = same
    simulated: dict[str, object] = field(default_factory=dict)


EVERY = supported_corrections(load_robot("irb2400"))
CASES = (
    Case("complete model", False),
    *(Case(f"without {name}", name != "rod_strain", (name,)) for name in EVERY),
    Case(
        "orders 40 and 80 missing", True,
        believed=with_harmonics(lambda n, a: () if n in (40.0, 80.0) else ((n, a),)),
    ),
    Case(
        "order 40 taken for 41, 80 for 82", True,
        believed=with_harmonics(lambda n, a: ((n * 1.025 if n in (40.0, 80.0) else n, a),)),
    ),
    Case(
        "orders 1 and 2 missing", True,
        believed=with_harmonics(lambda n, a: () if n in (1.0, 2.0) else ((n, a),)),
    ),
    Case("motor turns at 0.995 of their order", False,  # barely, and the stated sigma covers it
          believed=with_ratio(0.995)),
    Case("thin plate, 1.67e6 N/m, not in the model", True, ("plate_bending",),
         simulated={"errors": {"plate_bending": {"tip_stiffness_N_per_m": 1.67e6}}}),
    Case(
        "thin plate in the model", False,
        simulated={"errors": {"plate_bending": {"tip_stiffness_N_per_m": 1.67e6}}},
    ),
    Case("stamps jitter by 0.2 ms", False, simulated={"clocks": {"jitter": {}}}),
)  # fmt: skip


def row(number: int) -> dict[str, object]:
    """Result of one case."""
    case = CASES[number]
    with tempfile.TemporaryDirectory() as folder:
        made = [
            recorded(
                faulty(scenario_of("irb2400", p, SEED, DURATION), case.simulated), Path(folder) / p
            )
            for p in "ab"
        ]
    cell, truth = made[0][0], made[0][2]
    corrections = tuple(name for name in EVERY if name not in case.without)
    options = FitOptions(model="complete", corrections=corrections, force="torque")
    every = [logs for _, logs, _ in made]
    found = identify_together(case.believed(cell), every, options=options)
    compared = identification_against_truth(found, truth)
    return {
        "case": case.name, "visible": case.visible, "status": found.verdict.status,
        "autocorrelation": found.fit.autocorrelation, "chi2": found.fit.chi2_per_dof,
        "tcp_mean_mm": compared.tcp.mean * 1e3, "tcp_max_mm": compared.tcp.maximum * 1e3,
        "stated_sigma_mm": float(np.sqrt((found.robot.tcp_sigma**2).mean())) * 1e3,
        "says": found.verdict.sentence,
    }  # fmt: skip


def main() -> None:
    """Identifies every case and prints whether those that can be seen are."""
    with ProcessPoolExecutor(2) as pool:
        table = pd.DataFrame(list(pool.map(row, range(len(CASES)))))
    write_whole(
        ROOT / "docs" / "studies" / "incomplete_models.csv",
        table.to_csv(index=False, float_format="%.4g").encode(),
    )
    print(table.drop(columns="says").to_string(index=False, float_format=lambda x: f"{x:.4f}"))
    silent = table[table.visible & (table.status == "good")]
    print(f"visible and not said: {', '.join(silent.case) or 'none'}")


if __name__ == "__main__":
    main()
