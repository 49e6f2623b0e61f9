"""Histories of robots over 24 months: are wear, collisions and gears named, and nothing else?

    python -m benchmarks.history                # 200 drawn histories, 40 of each kind; a minute
    python -m benchmarks.history --real KIND    # one of whole identifications: REAL

Drawn histories: an IRB 2400 with everything on is identified once; the estimates of 24 months are
drawn with the deviations of a repetition that it states, their correlations, and what an unchanged
axis wanders by. Real ones are simulated, and identified from their files, month by month: a UR10e
before a tracker over 24 months, and an IRB 2400 on a ball-bar with everything on over 8. There the
zero of an axis moves by what is added to the logged angles: no setting of the simulator knows of
it.

A change is named where a finding has its axis, its kind, and dates that hold the true one, and no
finding has another axis. Writes a row for each history to docs/studies/history.csv or
docs/studies/history_real.csv.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pandas as pd

import ballbar
from ballbar.cell.arrays import Array
from ballbar.cell.load import load_robot
from ballbar.history.history import History, history_of, read_history
from ballbar.history.results import MONTH, DatedResult
from ballbar.ident.least_sizes import WANDER_ZERO
from ballbar.result.calibration import Calibration
from benchmarks.study import STUDIES, study_parser, write_table

MONTHS, RUNS = 24, 40
FIRST = date(2024, 1, 15)
WEAR, CRASH = 2e-5, 2e-4  # [rad a month], [rad]
GEAR_RIPPLE, GEAR_BACKLASH = 5e-5, 3e-5  # [rad] of a changed gear
ZEROS = ("rtheta2", "rtheta3", "rtheta4", "rtheta5")
BACKLASH = ("backlash1", "backlash2", "backlash4", "backlash5", "backlash6")
NOISE_MM = 0.02  # of each coordinate of a tracker a few metres away
# scenario, months, kind, axis, month from which on a zero moves
REAL = {
    "quiet": ("ur10e_tracker", MONTHS, "quiet", 0, 0),
    "wear": ("ur10e_tracker", MONTHS, "wear", 3, 0),
    "crash": ("ur10e_tracker", MONTHS, "crash", 2, 13),
    "logs": ("irb2400_full", 8, "crash", 2, 4),
}

Change = Callable[[str, int], float]


@dataclass(frozen=True)
class Made:
    """A change of a robot, with its axis and month."""

    kind: str
    axis: int
    month: int  # the first that shows a step, or the last before a drift
    change: Change = lambda _name, _month: 0.0


def day_of(month: int) -> date:
    """The day of a month's measurement."""
    return FIRST + timedelta(days=round(month * MONTH))


def made(kind: str, rng: np.random.Generator) -> Made:
    """A change of a kind, drawn; quiet ones have none."""
    if kind == "wear":
        name, month = str(rng.choice([*ZEROS, *BACKLASH])), int(rng.integers(0, 9))
        return Made(kind, int(name[-1]), month, lambda n, k: WEAR * max(0, k - month) * (n == name))
    axis, month = int(rng.integers(2, 6)), int(rng.integers(3, 22))
    if kind == "crash":
        sign = float(rng.choice([-1.0, 1.0]))
        zero = f"rtheta{axis}"
        return Made(kind, axis, month, lambda n, k: sign * CRASH * (k >= month) * (n == zero))
    if kind == "gear":

        def change(name: str, k: int) -> float:
            ripple = name.startswith(f"ripple{axis}_") and "_1_" not in name and "_2_" not in name
            backlash = name == f"backlash{axis}"
            return (k >= month) * (GEAR_RIPPLE * ripple + GEAR_BACKLASH * backlash)

        return Made(kind, axis, month, change)
    return Made(kind, 0, 0)


def row(kind: str, seed: int, true: Made, history: History) -> dict[str, object]:
    """The row of a history: whether its change was named, and how many findings are others."""
    sought = {"crash": "collision"}.get(true.kind, true.kind)
    right = [f for f in history.findings if f.axes == (true.axis,) and f.kind == sought]
    named = [f for f in right if f.begin <= day_of(true.month) <= f.end]
    days, count = [(f.end - f.begin).days for f in named], len(history.results)
    differ = sum(len(history.changes(a, k)) for k in range(1, count) for a in (0, k - 1))
    return {
        **{"kind": kind, "seed": seed, "axis": true.axis, "month": true.month},
        **{"findings": len(history.findings), "named": int(bool(named))},
        "other": sum(true.axis not in f.axes or len(f.axes) > 1 for f in history.findings),
        "months_wide": days[0] / MONTH if days else np.nan,
        "table_entries": differ,
        "scatter": float(np.median([(f.sigma / f.series.sigma)[0] for f in history.fits])),
    }


def drawn(result: Calibration, kind: str, seed: int) -> dict[str, object]:
    """A history whose estimates are drawn."""
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    true, understated = made(kind, rng), 2.0 if kind == "quiet, twice" else 1.0
    stated = result.file.covariance
    assert stated is not None
    whole = stated.covariance.of_names
    scale = np.array(stated.repeated_sigma) / np.sqrt(np.diag(whole))
    root = np.linalg.cholesky(whole * np.outer(scale, scale))
    results = []
    for month in range(MONTHS):
        off = dict(zip(stated.names, root @ rng.standard_normal(len(root)), strict=True))
        values = {n: understated * x + true.change(n, month) for n, x in off.items()}
        results.append(DatedResult(day_of(month), True, moved(result, values, rng)))
    return row(kind, seed, true, history_of(tuple(results), np.zeros(MONTHS)))


def moved(result: Calibration, off: dict[str, float], rng: np.random.Generator) -> Calibration:
    """The result with estimates that are off by so much, and axes that wander."""
    parameters = {
        name: entry.model_copy(
            update={"value": entry.value + off.get(name, 0.0) + WANDER_ZERO * rng.standard_normal()}
        )
        for name, entry in result.file.parameters.items()
    }
    corrections = {
        correction: {
            name: c.model_copy(update={"value": c.value + off.get(name, 0.0)})
            for name, c in entries.items()
        }
        for correction, entries in result.file.corrections.items()
    }
    update = {"parameters": parameters, "corrections": corrections}
    return replace(result, file=result.file.model_copy(update=update))


def identified(scenario: str, folder: Path, month: int, zero: Array) -> Path:
    """The result of one month; zero : (J,) [rad] added to the logged joint angles."""
    data, still = folder / f"data{month}", scenario == "ur10e_tracker"
    # a table of still poses has the noise that is added here, new every month
    changes = ["errors.instrument_noise=null"] if still else [f"recording={month + 1}"]
    ballbar.simulate(scenario, data, overrides=changes)
    name, file = ("poses.yaml", "poses.csv") if still else ("recording.yaml", "raw/robot.csv")
    table = pd.read_csv(data / file, dtype={0: str})
    if still:
        table[[f"A{k} [deg]" for k in range(1, 7)]] += np.rad2deg(zero)
        noise = np.random.default_rng([7, month]).normal(0.0, NOISE_MM, (len(table), 3))
        table[["x [mm]", "y [mm]", "z [mm]"]] += noise
    else:
        motors = zero @ np.linalg.inv(load_robot("irb2400").transmission)
        table[[f"m{k}" for k in range(1, 7)]] += motors
    table.to_csv(data / file, index=False, float_format="%.12g")
    described = (data / name).read_text()
    (data / name).write_text(f"{described}measured_on: '{day_of(month)}'\n")
    ballbar.identify(data).save(folder / f"m{month}")
    return folder / f"m{month}"


def real(name: str, keep: Path | None) -> dict[str, object]:
    """A history of whole identifications; keep : where their results stay."""
    scenario, months, kind, axis, month = REAL[name]
    with tempfile.TemporaryDirectory() as temporary:
        folders = []
        for k in range(months):
            zero = np.zeros(6)
            if kind != "quiet":
                zero[axis - 1] = CRASH * (k >= month) if kind == "crash" else WEAR * k
            folders.append(identified(scenario, keep or Path(temporary), k, zero))
        return row(name, 1, Made(kind, axis, month), read_history(folders))


def main() -> None:
    """Makes the histories, writes their rows and prints how many were named."""
    parser = study_parser(__doc__)
    parser.add_argument("--real", choices=list(REAL))
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    path = STUDIES / ("history_real.csv" if options.real else "history.csv")
    if options.real:
        rows = [real(options.real, options.keep)]
        before = pd.read_csv(path).to_dict("records") if path.exists() else []
        others = [r for r in before if r["kind"] != options.real]
        rows = sorted([*others, *rows], key=lambda r: str(r["kind"]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            ballbar.simulate("irb2400_full", Path(folder) / "data")
            result = ballbar.identify(Path(folder) / "data")
        kinds = ("quiet", "quiet, twice", "wear", "crash", "gear")
        rows = [drawn(result, kind, seed) for kind in kinds for seed in range(1, RUNS + 1)]
    write_table(path, rows, ".4g")
    table = pd.DataFrame(rows)
    columns = ["findings", "named", "other", "table_entries"]
    print(table.groupby("kind", sort=False)[columns].sum().to_string())
    print(table.groupby("kind", sort=False)[["months_wide", "scatter"]].median().to_string())


if __name__ == "__main__":
    main()
