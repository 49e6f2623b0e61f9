"""How large: the largest change of the logs that each source makes, as plotted."""

from __future__ import annotations

import csv

import numpy as np

from cell.arrays import Array
from generators.scenario_reference.figures import PLOTS
from generators.scenario_reference.plots import Plot
from generators.scenario_reference.runs import Changes, View, run
from generators.scenario_reference.sources import SOURCES

SIZES = PLOTS / "sizes.csv"


def measured_sizes() -> list[dict[str, str]]:
    """Largest changes of the logs by every source that changes angles, largest residual first."""
    rows = [
        {"source": source.key, "variant": label, **_sizes(changes, source.plot)}
        for source in SOURCES
        if source.key.startswith(("errors.", "plant.")) or source.key == "encoders.noise_sigma_rad"
        for label, changes in source.plot.on.items()
    ]
    return sorted(rows, key=lambda row: (-float(row["tool_um"]), -float(row["q_urad"])))


def _sizes(changes: Changes, plot: Plot) -> dict[str, str]:
    off, on = run(plot.off), run(changes)
    known, end = off.simulation.motion.geometry, off.settings.path.duration_s
    t = np.arange(1.0, end - 1.0, 0.01)
    a, b = (View(each, t, known, plot.counted) for each in (on, off))
    residual = np.linalg.norm(a.residual - b.residual, axis=1)
    with_forces = on.settings.plant.kind == "mujoco"
    return {
        "tool_um": _largest(residual, 1e6),
        "q_urad": _largest(a.q - b.q, 1e6),
        "b_urad": _largest(a.b - b.b, 1e6),
        "rod_N": _largest(a.rod_force - b.rod_force, 1.0) if with_forces else "-",
    }


def _largest(change: Array, scale: float) -> str:
    """The largest, to two digits."""
    return f"{float(f'{np.abs(change).max() * scale:.2g}'):g}"


def read_sizes() -> list[dict[str, str]]:
    """Rows of the committed sizes.csv."""
    with SIZES.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_sizes(rows: list[dict[str, str]]) -> None:
    """Writes sizes.csv."""
    with SIZES.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
