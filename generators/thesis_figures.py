"""Every figure and table of the thesis beside ours, and its experiments: docs/thesis_figures.md.

    python -m generators.thesis_figures

Verdicts are read from docs/claims.md, numbers of experiments from docs/studies/experiments.csv,
which their own commands write. Fig. 5.5 is drawn and Table 3.5 computed here.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
import yaml
from matplotlib.figure import Figure

from ballbar.cell.arrays import Array
from ballbar.cell.files import write_whole
from ballbar.cell.load import load_robot
from ballbar.claims.table import ERROR
from ballbar.figure_style import BLUE, FRAME, ORANGE, QUIET, svg_text, to_hundredths
from ballbar.ident.thesis.cost_shift import REACH, best_shift, cost_of_shift, with_matched_offsets
from ballbar.ident.thesis.costs import cost_named
from ballbar.ident.thesis.paired_samples import through_samples
from ballbar.ident.thesis.tables import TABLE_3_5_IDENTIFIED
from ballbar.scenario import Scenario
from ballbar.sim.errors.sample_errors import delay_of
from ballbar.sim.errors.static_errors import THESIS_3_1
from ballbar.sweep.check import load_sweep
from ballbar.sweep.plan import run_of
from ballbar.trial.sample_trial import trial_samples
from ballbar.trial.trial import run_trial
from ballbar.units import MM, MS

ROOT = Path(__file__).parent.parent
DOCS, SWEEPS = ROOT / "docs", ROOT / "scenarios" / "claims" / "sweeps"
SCENARIOS = SWEEPS.parent / "scenarios"  # that the sweeps vary
PAGE, SHIFT_IMAGE = DOCS / "thesis_figures.md", "images/cost_of_shift.svg"
LISTED = Path(__file__).with_suffix(".yaml")  # all figures and tables
HEAD = """# Figures, tables and experiments of the thesis, beside ours

Written by `python -m generators.thesis_figures`; do not edit. Verdicts are those of
[Claims](claims.md), where our figures stand too; those on Tables 3.2 to 3.4 are explained on
[Identifiability](identifiability.md). Left out are drawings, photographs and the pictures of logs.
The curves of the thesis are not printed as numbers, so its sentences about them are compared. A
number counts the claims of a whole section.

|thesis|what|beside ours|
|---|---|---|
"""
EXPERIMENTS = """
## Experiments of sec. 5.3

Simulated by `python -m generators.thesis_5_3` with `scenarios/irb2400_push_pull.yaml`,
`irb2400.yaml` and `irb2400_full.yaml` ([rows](studies/experiments.csv)).

|what|thesis|here|
|---|---|---|
{rows}

Pull and push at one pose: a soft servo moves 12 mm to and fro along the rod. The tracker follows
the centre of the universal joint; a slow error of it, which is not simulated, would stand in its
row in full. Near singularities the bearings of the ball-bar turn fast and change direction, so the
force oscillates, but it is not larger; stick and slip, ripple and backlash of the gears make 2 to
3 N rms at any distance.

![Elongation of the rod and base movement against force](images/pull_push.svg)
![Rod force over time](images/path_force.svg)
![Deviation from the sphere over time](images/sphere_deviation.svg)
![Cost over the shift between the logs](images/cost_of_shift.svg)
"""

LARGEST_3_5 = "rd2"  # parameter with the largest error in Table 3.5
# Tables A.1 and A.2 as printed: a [m], alpha [pi/2], d [m], theta [pi/2] beside the joint's angle
TABLES_A: Mapping[str, tuple[tuple[float, float, float, float], ...]] = {
    "irb2400": (
        (0.100, 1, 0.615, 0),
        (0.705, 0, 0.0, -1),
        (0.135, -1, 0.0, 0),
        (0.0, 1, 0.755, 2),
        (0.0, -1, 0.0, 0),
        (0.0, 0, 0.085, 0),
    ),
    "nj220": (
        (0.400, -1, 0.830, 0),
        (1.175, 0, 0.0, -1),
        (0.250, -1, 0.0, 0),
        (0.0, -1, 1.125, 2),
        (0.0, 1, 0.0, 0),
        (0.0, 0, 0.230, 0),
    ),
}


@dataclass(frozen=True)
class Entry:
    """One figure or table of the thesis: an item of LISTED, whose head explains its keys."""

    label: str  # `Fig. 3.1`
    title: str
    topic: str = ""
    claims: Sequence[str] = ()
    experiments: Sequence[str] = ()


def main() -> None:
    """Draws Fig. 5.5 and writes the page."""
    write_whole(DOCS / SHIFT_IMAGE, _shift_figure().encode())
    write_whole(PAGE, page_text().encode())


def page_text() -> str:
    """The page. Raises ValueError where the pages and tables that it reads lack what it names."""
    entries = [Entry(**item) for item in yaml.safe_load(LISTED.read_text())]
    rows = [f"|{entry.label}|{entry.title}|{beside(entry)}|\n" for entry in entries]
    lines = "\n".join(f"|{'|'.join(row)}|" for row in _experiments())
    return HEAD + "".join(rows) + EXPERIMENTS.format(rows=lines)


def beside(entry: Entry) -> str:
    """Computed words, experiments and verdicts on the claims that are about an entry.

    Raises ValueError where docs/claims.md or docs/studies/experiments.csv lack what it names.
    """
    words = [COMPUTED[entry.label]()] if entry.label in COMPUTED else []
    for start in entry.experiments:
        if not any(row[0].startswith(start) for row in _experiments()):
            raise ValueError(f"docs/studies/experiments.csv has no row {start!r}")
    if entry.experiments:
        words.append("[below](#experiments-of-sec-53)")
    if entry.topic:
        claims = _claims_of(entry)
        for verdict in ("holds", "differs"):
            names = [name for name, word in claims.items() if word == verdict]
            said = ", ".join(names) if entry.claims else str(len(names))  # of a whole section
            if names:
                words.append(f"[{verdict}](claims.md#{_anchor(entry.topic)}): {said}")
    return "; ".join(words)


def _claims_of(entry: Entry) -> dict[str, str]:
    """Name and verdict of each claim that is about an entry."""
    sections = claim_sections()
    if entry.topic not in sections:
        raise ValueError(
            f"docs/claims.md has no section {entry.topic!r}; write it with ballbar claims --out"
        )
    claims = sections[entry.topic]
    if missing := set(entry.claims) - set(claims):
        raise ValueError(f"docs/claims.md: {entry.topic} has no {', '.join(sorted(missing))}")
    return {name: word for name, word in claims.items() if not entry.claims or name in entry.claims}


@cache
def claim_sections() -> dict[str, dict[str, str]]:
    """Name and verdict of every claim of docs/claims.md, by the title of their section."""
    page = (DOCS / "claims.md").read_text()
    sections = re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    row = re.compile(r"^\|`(\w+)`: .*\|(holds|differs)\b[^|]*\|$", re.MULTILINE)
    return {title: dict(row.findall(text.replace("\\|", "/"))) for title, text in sections}


@cache
def _experiments() -> list[list[str]]:
    with (DOCS / "studies" / "experiments.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))[1:]


def _anchor(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _table_3_1() -> str:
    rms = float(np.sqrt(np.mean(np.square(list(THESIS_3_1.values())))))
    return (
        f"equal: {len(THESIS_3_1)} errors, put into every simulation of ch. 3 "
        f"(`static: {{table: thesis_3_1}}`); rms {rms:.2f} mm\\|mrad"
    )


def _run(sweep: str, wanted: Mapping[str, object]) -> Scenario:
    """The first run of a sweep behind the claims that has these values."""
    plan = load_sweep(SWEEPS / f"{sweep}.yaml").plan
    runs = (run_of(plan, number) for number in range(plan.runs))
    return next(r.scenario for r in runs if wanted.items() <= r.values.items())


def _table_3_5() -> str:
    scenario = _run(
        "noise", {"label": "both", "errors.joint_noise.sigma_rad": 1e-5, "identify.cost": "length"}
    )
    row = run_trial(scenario, SCENARIOS)
    errors = {name.removeprefix(ERROR) for name in row if name.startswith(ERROR)}
    same = "the same" if errors == TABLE_3_5_IDENTIFIED else "other"
    largest = str(row["largest_parameter"])
    worst = "the same" if largest == LARGEST_3_5 else "another"
    return (
        f"C_l, 10 urad on all angles, seed {scenario.seed}: {same} {len(errors)} parameters are "
        f"identified, {worst} of them, {largest}, has the largest error, "
        f"{row['largest_mm_mrad']:.3f} mm\\|mrad beside 0.60 of unknown cost and noise"
    )


def _table_a(name: str) -> str:
    """The DH rows that the shipped robot has against those printed."""
    robot, differences = load_robot(name), []
    for i, printed in enumerate(TABLES_A[name]):
        quarter = np.pi / 2.0
        ours = (robot.a[i], robot.alpha[i] / quarter, robot.d[i], robot.theta[i] / quarter)
        for symbol, theirs, here in zip(("a", "alpha", "d", "theta"), printed, ours, strict=True):
            if abs(theirs - here) > 1e-9:
                differences.append(
                    f"{symbol}_{i + 1}: printed {90 * theirs:+g} deg, {90 * here:+g}"
                )
    words = f"differs: {'; '.join(differences)} deg here" if differences else "equal"
    return f"`cell/robots/{name}.yaml`: {words}"


@dataclass(frozen=True, eq=False)
class _ShiftRun:
    """One move of a log to the least cost (thesis Fig. 5.5)."""

    shifts: Array  # (K,) [s]
    rms: Array  # (K,) [m] of C_P over the samples
    least: float  # [s] shift of least cost


@cache
def _shift_runs() -> tuple[Scenario, list[_ShiftRun]]:
    """Two moves after each other at the nominal robot, of the first run of `clock_by_cost`."""
    scenario = _run("clock_by_cost", {"label": "C_P, nominal"})
    samples = trial_samples(scenario, SCENARIOS)
    cost, nominal = cost_named("position", "vector"), samples.nominal
    bar = through_samples(samples.t, samples.b).spline
    ends = samples.t[0] + 2 * REACH, samples.t[-1] - 2 * REACH
    inside = (samples.t >= ends[0]) & (samples.t <= ends[1])
    t, q, runs = samples.t[inside], samples.q[inside], []
    shifts = np.linspace(-REACH, REACH, 201)
    for _ in range(2):
        geometry = with_matched_offsets(nominal, q, bar(t), cost)
        cost_at = cost_of_shift(cost, geometry, t, q, bar)
        least = best_shift(cost, geometry, t, q, bar)
        runs.append(_ShiftRun(shifts, np.sqrt([cost_at(x) / t.size for x in shifts]), least))
        t = t + least
    return scenario, runs


def _figure_5_5() -> str:
    scenario, (first, second) = _shift_runs()
    return (
        f"C_P at the nominal robot, clocks {delay_of(scenario.errors) * MS:.1f} ms apart: one "
        f"minimum, at {first.least * MS:.1f} ms; that of the second run at "
        f"{second.least * MS:.2f} ms beside 8"
    )


def _shift_figure() -> str:
    """Cost over the shift, first and second run, as SVG."""
    with mpl.rc_context({**FRAME, "svg.hashsalt": "thesis_figures", "font.size": 9.0}):
        figure = Figure(figsize=(5.8, 3.0), layout="constrained")
        axes = figure.subplots()
        titles = (("first run", BLUE), ("second run", ORANGE))
        for run, (title, colour) in zip(_shift_runs()[1], titles, strict=True):
            label = f"{title}, least at {run.least * MS:.1f} ms"
            axes.plot(run.shifts * MS, run.rms * MM, color=colour, label=label)
            axes.axvline(run.least * MS, color=QUIET, linewidth=0.7, linestyle=":")
        axes.set_xlabel("shift of the ball-bar's log [ms]")
        axes.set_ylabel("C_P, rms over the samples [mm]")
        axes.legend()
        return to_hundredths(svg_text(figure))


# label of an entry -> words of what is computed here
COMPUTED: Mapping[str, Callable[[], str]] = {
    "Table 3.1": _table_3_1,
    "Table 3.5": _table_3_5,
    "Fig. 5.5": _figure_5_5,
    "Table A.1": partial(_table_a, "irb2400"),
    "Table A.2": partial(_table_a, "nj220"),
}


if __name__ == "__main__":
    main()
