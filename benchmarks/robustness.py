"""The cost of gross faults: outliers, a slipped signal period, a clock that was set.

    python -m benchmarks.robustness       # 8 IRB 2400, everything on, two paths each; five minutes

Each drawn robot is identified from the same two recordings with and without each fault in the first
one; the ratio of the TCP errors says what the fault costs, more sharply that of the errors with the
scale known, which plate and ball-bar axes both leave open. Writes docs/studies/robustness.csv, a
row for each robot and fault.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd

from ballbar.cell.descriptions import Cell
from ballbar.cell.files import write_whole
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.sim.truth import Truth
from ballbar.truth.compare import identification_against_truth
from tests.helpers.drawn_robots import (
    ROOT,
    SLIP_S,
    STEP_S,
    faulty,
    recorded,
    scenario_of,
    study_options,
)

FAULTS: dict[str, dict[str, object]] = {
    "none": {},
    "outliers": {"errors": {"outliers": {}}},
    "slipped period": {"errors": {"slipped_periods": [{"encoder": 2, "at_s": SLIP_S}]}},
    "clock step": {"clocks": {"step": {"at_s": STEP_S, "step_s": 0.05}}},
    "all three": {
        "errors": {"outliers": {}, "slipped_periods": [{"encoder": 2, "at_s": SLIP_S}]},
        "clocks": {"step": {"at_s": STEP_S, "step_s": 0.05}},
    },
}


def robot_rows(seed: int, duration: float) -> list[dict[str, object]]:
    """All faults of one drawn robot."""
    with tempfile.TemporaryDirectory() as folder:
        second = recorded(scenario_of("irb2400", "b", seed, duration), Path(folder) / "b")
        rows: list[dict[str, object]] = []
        for number, (fault, changes) in enumerate(FAULTS.items()):
            cell, logs, truth = recorded(
                faulty(scenario_of("irb2400", "a", seed, duration), changes),
                Path(folder) / str(number),
            )
            rows.append(row(seed, fault, cell, [logs, second[1]], truth))
    for ratio, kind in (("ratio", "tcp"), ("scale_known_ratio", "scale_known")):
        clean = rows[0][f"{kind}_mean_mm"]
        for each in rows:
            each[ratio] = each[f"{kind}_mean_mm"] / clean  # type: ignore[operator]
    return rows


def row(seed: int, fault: str, cell: Cell, logs: list[Logs], truth: Truth) -> dict[str, object]:
    """Figures of one identification."""
    options = FitOptions(model="complete", force="torque")
    found = identify_together(cell, logs, options=options)
    compared = identification_against_truth(found, truth)
    return {
        "seed": seed, "fault": fault, "status": found.verdict.status,
        "tcp_mean_mm": compared.tcp.mean * 1e3, "tcp_max_mm": compared.tcp.maximum * 1e3,
        "scale_known_mean_mm": float(compared.tcp.error_without_scale.mean()) * 1e3,
        "clock_us": np.nan if compared.offset is None else compared.offset * 1e6,
        **events_of(found, truth),
        "remarks": "; ".join(found.verdict.warnings),
    }  # fmt: skip


def events_of(found: Identification, truth: Truth) -> dict[str, object]:
    """The reported faults, with how far its time is from the truth [s]."""
    start = truth.logs.first_rows.ballbar_s
    told = [fault for recording in found.recordings for fault in recording.step_faults]
    slips = [event for event in told if event.kind == "encoder"]
    steps = [event for event in told if event.kind == "clock"]
    return {
        "events": len(told),
        "slip_found_s": slips[0].time + start - SLIP_S if len(slips) == 1 else np.nan,
        "slip_periods": slips[0].periods if len(slips) == 1 else 0,
        "step_found_s": steps[0].time + start - STEP_S if len(steps) == 1 else np.nan,
        "step_ms": steps[0].size * 1e3 if len(steps) == 1 else np.nan,
    }


def main() -> None:
    """Draws, identifies, writes the rows and prints medians and worst cases."""
    options = study_options(__doc__)
    with ProcessPoolExecutor(2) as pool:
        jobs = [
            pool.submit(robot_rows, seed, options.duration) for seed in range(1, options.robots + 1)
        ]
        table = pd.DataFrame([each for job in jobs for each in job.result()])
    write_whole(
        ROOT / "docs" / "studies" / "robustness.csv",
        table.to_csv(index=False, float_format="%.6g").encode(),
    )
    for fault, rows in table.groupby("fault", sort=False):
        print(
            f"{fault}: TCP error {rows.tcp_mean_mm.median():.4f} mm, "
            f"{rows.ratio.median():.2f} times the clean one "
            f"(worst {rows.ratio.max():.2f}), scale known {rows.scale_known_ratio.median():.2f} "
            f"(worst {rows.scale_known_ratio.max():.2f}), events {sorted(rows.events)}"
        )
    slips, steps = ("slip_found_s", "slip_periods"), ("step_found_s", "step_ms")
    columns = ["seed", "fault", "status", "ratio", *slips, *steps]
    print(table[columns].to_string(index=False))


if __name__ == "__main__":
    main()
