"""Every figure and table of the thesis beside ours: docs/thesis_figures.md.

    python -m generators.thesis_figures

Verdicts and numbers are read from docs/claims.md and docs/experiments.md, which their own commands
write; tables of parameters come from the code. Fig. 5.5 is drawn and Table 3.5 computed here.
"""

from __future__ import annotations

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
COMMANDS = {
    "claims": "ballbar claims --out docs/claims.md",
    "identifiability": "python -m generators.identifiability_page",
    "experiments": "python -m generators.thesis_5_3",
    "here": "python -m generators.thesis_figures",
}

HEAD = """# Figures and tables of the thesis, beside ours

Written by `python -m generators.thesis_figures`; do not edit. Verdicts and numbers are those of
[Claims](claims.md) and [Experiments](experiments.md), which say how each is checked. Left out are
drawings, photographs and the pictures of logs (Figs. 1.1 to 2.4, 4.1 to 4.3, 4.5 to 5.4, 5.6, 5.10,
5.11, A.1). The thesis's figures are described and not shown; their curves are not printed as
numbers, so its sentences about them are what can be compared.

| thesis | what | beside ours |
|---|---|---|
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
    theirs: str
    made_by: str  # key of COMMANDS
    topic: str = ""
    claims: Sequence[str] = ()
    images: Sequence[str] = ()
    experiments: Sequence[str] = ()


@dataclass(frozen=True)
class ClaimRow:
    """One sentence on the page of claims."""

    name: str
    anchor: str
    says: str
    result: str
    verdict: str  # holds, differs

    @property
    def line(self) -> str:
        says = f"{self.says} [{self.name}](claims.md#{self.anchor})"
        return f"| {says} | {self.result} | {self.verdict} |"


def main() -> None:
    """Draws Fig. 5.5 and writes the page."""
    write_whole(DOCS / SHIFT_IMAGE, _shift_figure().encode())
    write_whole(PAGE, page_text().encode())


def page_text() -> str:
    """The page. Raises ValueError as `section`."""
    entries = [Entry(**item) for item in yaml.safe_load(LISTED.read_text())]
    made = [section(entry) for entry in entries]
    rows = [
        f"| [{entry.label}](#{_anchor(heading(entry))}) | {entry.title} | {words} |"
        for entry, (words, _) in zip(entries, made, strict=True)
    ]
    return HEAD + "\n".join((*rows, *(f"\n{text}" for _, text in made))) + "\n"


def heading(entry: Entry) -> str:
    """Title of an entry's section."""
    return f"{entry.label}: {entry.title}"


def section(entry: Entry) -> tuple[str, str]:
    """Words for the summary, and the section of an entry.

    Raises ValueError where docs/claims.md or docs/experiments.md lack what it names.
    """
    words, parts = [], [f"## {heading(entry)}", f"Thesis: {entry.theirs}"]
    if entry.label in COMPUTED:
        word, text = COMPUTED[entry.label]()
        words.append(word)
        parts.append(text)
    if entry.experiments:
        rows = [_experiment(start) for start in entry.experiments]
        words.append(f"{rows[0][2]} beside {rows[0][1]}")
        lines = (f"| {' | '.join(row)} |" for row in rows)
        parts.append("\n".join(("| what | thesis | here |", "|---|---|---|", *lines)))
    parts += [f"![{heading(entry)}]({image})" for image in entry.images]
    if entry.topic:
        claims = _claims_of(entry)
        for side, verdict in (("agrees", "holds"), ("differs", "differs")):
            if names := ", ".join(claim.name for claim in claims if claim.verdict == verdict):
                words.append(f"{side}: {names}")
        head = ("| the thesis's sentences | here | verdict |", "|---|---|---|")
        parts.append("\n".join((*head, *(claim.line for claim in claims))))
    parts.append(f"Ours: `{COMMANDS[entry.made_by]}`.")
    return "; ".join(words), "\n\n".join(parts)


def _claims_of(entry: Entry) -> list[ClaimRow]:
    rows = claim_rows()
    if entry.topic not in rows:
        command = COMMANDS["claims"]
        raise ValueError(f"docs/claims.md has no section {entry.topic!r}; run: {command}")
    claims = rows[entry.topic]
    if missing := set(entry.claims) - {row.name for row in claims}:
        raise ValueError(f"docs/claims.md: {entry.topic} has no {', '.join(sorted(missing))}")
    return [row for row in claims if not entry.claims or row.name in entry.claims]


@cache
def claim_rows() -> dict[str, list[ClaimRow]]:
    """The sentences of docs/claims.md by the title of their section."""
    page = (DOCS / "claims.md").read_text()
    listed: dict[str, list[tuple[str, str, str]]] = {}
    for title, anchor, name, verdict in re.findall(
        r"^\| \[(.+?)\]\(#(.+?)\): (\w+) \| .*? \| (\w+) \| ", page, re.MULTILINE
    ):
        listed.setdefault(title, []).append((name, anchor, verdict))
    sections = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    rows = {}
    for title, names in listed.items():
        cells = [_cells(line) for line in re.findall(r'^\| ".*$', sections[title], re.MULTILINE)]
        rows[title] = [
            ClaimRow(name, anchor, says, result, verdict)
            for (name, anchor, verdict), (says, result, *_) in zip(names, cells, strict=True)
        ]
    return rows


def _experiment(start: str) -> list[str]:
    """The row of docs/experiments.md that begins so."""
    page = (DOCS / "experiments.md").read_text()
    (row,) = re.findall(rf"^\| {re.escape(start)}.*$", page, re.MULTILINE)
    return _cells(row)


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


def _anchor(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def parameter_rows(values: Mapping[str, str]) -> str:
    """Parameters by name in the layout of Tables 3.1 and 3.5; empty where there is none."""
    columns = ("ra", "rd", "ralpha", "rtheta", "ba", "bd", "balpha", "btheta")
    lines = [f"| i | {' | '.join((*columns, 'o x, y, z'))} |", f"|{'---|' * 10}"]
    for i in range(6):
        names = [*(f"{kind}{i + 1}" for kind in columns), "oxoyoz"[2 * i : 2 * i + 2]]
        lines.append(f"| {i + 1} | {' | '.join(values.get(name, '') for name in names)} |")
    return "\n".join(lines)


def _table_3_1() -> tuple[str, str]:
    text = (
        "These errors are put into every simulation of ch. 3 here (`static: {table: thesis_3_1}`)."
    )
    table = parameter_rows({name: f"{value:.2f}" for name, value in THESIS_3_1.items()})
    rms = float(np.sqrt(np.mean(np.square(list(THESIS_3_1.values())))))
    words = f"equal: {len(THESIS_3_1)} errors, taken over; rms {rms:.2f} mm\\|mrad"
    return words, f"{text} {words.capitalize()}.\n\n{table}"


def _run(sweep: str, wanted: Mapping[str, object]) -> Scenario:
    """The first run of a sweep behind the claims that has these values."""
    plan = load_sweep(SWEEPS / f"{sweep}.yaml").plan
    runs = (run_of(plan, number) for number in range(plan.runs))
    return next(r.scenario for r in runs if wanted.items() <= r.values.items())


def _table_3_5() -> tuple[str, str]:
    scenario = _run(
        "noise", {"label": "both", "errors.joint_noise.sigma_rad": 1e-5, "identify.cost": "length"}
    )
    row = run_trial(scenario, SCENARIOS)
    errors = {
        name.removeprefix(ERROR): float(value)
        for name, value in row.items()
        if name.startswith(ERROR)
    }
    same = set(errors) == set(TABLE_3_5_IDENTIFIED)
    words = f"{'the same' if same else 'other'} parameters are identified"
    largest = str(row["largest_parameter"])
    words += (
        f", {'the same' if largest == LARGEST_3_5 else 'another'} of them has the largest error"
    )
    size = f"{row['largest_mm_mrad']:.3f} mm\\|mrad"
    text = (
        f"Here: C_l, noise of 10 urad on all angles, seed {scenario.seed}: {words}, {largest}, "
        f"{size}. Cost and noise of theirs are not printed, so sizes cannot be compared."
    )
    table = parameter_rows({name: f"{value:.3f}" for name, value in errors.items()})
    return words, f"{text}\n\n{table}"


def _table_a(name: str) -> tuple[str, str]:
    """The DH rows that the shipped robot has against those printed."""
    robot, differences = load_robot(name), []
    lines = ["| link | a [m] | alpha | d [m] | theta |", "|---|---|---|---|---|"]
    for i, printed in enumerate(TABLES_A[name]):
        quarter = np.pi / 2.0
        ours = (robot.a[i], robot.alpha[i] / quarter, robot.d[i], robot.theta[i] / quarter)
        for symbol, theirs, here in zip(("a", "alpha", "d", "theta"), printed, ours, strict=True):
            if abs(theirs - here) > 1e-9:
                differences.append(
                    f"{symbol}_{i + 1}: printed {90 * theirs:+g} deg, {90 * here:+g}"
                )
        a, alpha, d, theta = ours
        lines.append(
            f"| {i + 1} | {a:.3f} | {90 * alpha:+.0f} deg | {d:.3f} | {90 * theta:+.0f} deg |"
        )
    words = f"differs: {'; '.join(differences)} deg here" if differences else "equal"
    return words, "\n".join((f"As shipped (`cell/robots/{name}.yaml`): {words}.\n", *lines))


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


def _figure_5_5() -> tuple[str, str]:
    scenario, (first, second) = _shift_runs()
    words = f"one minimum; that of the second run at {second.least * MS:.2f} ms"
    return words, (
        f"Here: C_P at the nominal robot, of which 1 mm and 1 mrad are unknown, clocks "
        f"{delay_of(scenario.errors) * MS:.1f} ms apart. One minimum, at {first.least * MS:.1f} "
        f"ms; the second run has its own at {second.least * MS:.2f} ms."
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


# label of an entry -> what is computed here: words for the summary, and Markdown
COMPUTED: Mapping[str, Callable[[], tuple[str, str]]] = {
    "Table 3.1": _table_3_1,
    "Table 3.5": _table_3_5,
    "Fig. 5.5": _figure_5_5,
    "Table A.1": partial(_table_a, "irb2400"),
    "Table A.2": partial(_table_a, "nj220"),
}


if __name__ == "__main__":
    main()
