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
from matplotlib.figure import Figure

from ballbar.claims.table import ERROR
from ballbar.figure_style import BLUE, FRAME, ORANGE, QUIET, svg_text, to_hundredths
from ballbar.scenario import Scenario
from ballbar.sweep.check import load_sweep
from ballbar.sweep.plan import run_of
from ballbar.trial.sample_trial import trial_samples
from ballbar.trial.trial import run_trial
from ballbar.units import MM, MS
from cell.arrays import Array
from cell.files import write_whole
from cell.load import load_robot
from ident.thesis.cost_shift import REACH, best_shift, cost_of_shift, with_matched_offsets
from ident.thesis.costs import cost_named
from ident.thesis.paired_samples import through_samples
from ident.thesis.tables import TABLE_3_5_IDENTIFIED
from sim.errors.sample_errors import delay_of
from sim.errors.static_errors import THESIS_3_1

ROOT = Path(__file__).parent.parent
DOCS, SWEEPS = ROOT / "docs", ROOT / "scenarios" / "claims" / "sweeps"
SCENARIOS = SWEEPS.parent / "scenarios"  # that the sweeps vary
PAGE, SHIFT_IMAGE = DOCS / "thesis_figures.md", "images/cost_of_shift.svg"
CLAIMS = "ballbar claims --out docs/claims.md"
IDENTIFIABILITY = "python -m generators.identifiability_page"
EXPERIMENTS = "python -m generators.thesis_5_3"
HERE = "python -m generators.thesis_figures"

HEAD = """# Figures and tables of the thesis, beside ours

Written by `python -m generators.thesis_figures`; do not edit. Verdicts and numbers are those of
[Claims](claims.md) and [Experiments](experiments.md), which say how each is checked. Left out are
drawings, photographs and the pictures of logs (Figs. 1.1 to 2.4, 4.1 to 4.3, 4.5 to 5.4, 5.6, 5.10,
5.11, A.1). The thesis's figures are described and not shown; their curves are not printed as
numbers, so its sentences about them are what can be compared.

| thesis | what | beside ours |
|---|---|---|
"""

LARGEST_3_5 = ("rd2", 0.60)  # of Table 3.5 [mm]
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
    """One figure or table of the thesis."""

    label: str  # `Fig. 3.1`
    title: str
    theirs: str  # what it shows
    command: str  # that makes ours
    topic: str = ""  # section of docs/claims.md, by its title
    claims: tuple[str, ...] = ()  # names in that section that are about it; all of them if empty
    images: tuple[str, ...] = ()  # from docs/
    experiments: tuple[
        str, ...
    ] = ()  # rows of the table of docs/experiments.md, by their beginning
    ours: Callable[[], tuple[str, str]] | None = None  # words for the summary, and Markdown


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
    made = [section(entry) for entry in ENTRIES]
    rows = [
        f"| [{entry.label}](#{_anchor(heading(entry))}) | {entry.title} | {words} |"
        for entry, (words, _) in zip(ENTRIES, made, strict=True)
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
    if entry.ours is not None:
        word, text = entry.ours()
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
        words.append(_agreement(claims))
        head = ("| the thesis's sentences | here | verdict |", "|---|---|---|")
        parts.append("\n".join((*head, *(claim.line for claim in claims))))
    parts.append(f"Ours: `{entry.command}`.")
    return "; ".join(words), "\n\n".join(parts)


def _agreement(claims: Sequence[ClaimRow]) -> str:
    sides = {"agrees": "holds", "differs": "differs"}
    named = {
        side: ", ".join(claim.name for claim in claims if claim.verdict == word)
        for side, word in sides.items()
    }
    return "; ".join(f"{side}: {names}" for side, names in named.items() if names)


def _claims_of(entry: Entry) -> list[ClaimRow]:
    rows = claim_rows()
    if entry.topic not in rows:
        raise ValueError(f"docs/claims.md has no section {entry.topic!r}; run: {CLAIMS}")
    own = rows[entry.topic]
    if missing := set(entry.claims) - {row.name for row in own}:
        raise ValueError(f"docs/claims.md: {entry.topic} has no {', '.join(sorted(missing))}")
    return [row for row in own if not entry.claims or row.name in entry.claims]


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
        f", {'the same' if largest == LARGEST_3_5[0] else 'another'} of them has the largest error"
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


_COMAU_ALL = ("errors_are_large", "two_paths_disagree", "same_path_agrees")
_IRB_ANGLES = (
    "angles_smaller",
    "some_improvement",
    "larger_than_expected",
    "paths_disagree",
    "speeds_disagree",
)
_BARS = (
    "Bars of identified minus nominal for each parameter, {} with {}; no bar is stated as a number."
)
_TURIN = _BARS.format("three recordings of two paths of the NJ 220", "{}")
_LUND = _BARS.format("three recordings of two paths of the IRB 2400, one at two speeds,", "{}")

ENTRIES = (
    Entry(
        label="Table 3.1",
        title="static errors",
        theirs="28 errors, drawn once with a standard deviation of 1 mm or 1 mrad and put into "
        "every simulation; of the ball-bar only rod, encoder offsets and origin deviate.",
        command=HERE,
        ours=_table_3_1,
    ),
    Entry(
        label="Table 3.2",
        title="dependencies of parameters",
        theirs="Four to six groups for each cost, of which one parameter can be identified.",
        command=IDENTIFIABILITY,
        topic="Identifiability",
        claims=("dependencies",),
    ),
    Entry(
        label="Table 3.3",
        title="parameters without effect",
        theirs="The parameters whose Jacobian is zero, for each cost; none with C_T.",
        command=IDENTIFIABILITY,
        topic="Identifiability",
        claims=("zero_jacobians",),
    ),
    Entry(
        label="Table 3.4",
        title="what a parameter left out moves",
        theirs="An error of 1 mm or 1 mrad in each parameter that is not identified, and the "
        "identified ones that it moves by more than 0.05.",
        command=IDENTIFIABILITY,
        topic="Identifiability",
        claims=("influences", "removed"),
    ),
    Entry(
        label="Table 3.5",
        title="example of the errors of one simulation",
        theirs="23 errors, identified minus true, with dashes for the parameters that are not "
        f"identified; the largest is {LARGEST_3_5[0]}, {LARGEST_3_5[1]:.2f} mm\\|mrad.",
        command=HERE,
        ours=_table_3_5,
    ),
    Entry(
        label="Fig. 3.1",
        title="number of points",
        theirs="Distance and largest error over the number of samples, noise of 10 urad on all "
        "angles; 1500 points are chosen.",
        command=CLAIMS,
        topic="Number of points",
        images=("images/claims/points.svg",),
    ),
    Entry(
        label="Fig. 3.2",
        title="noise on all angles",
        theirs="Distance and largest error over the noise of robot and ball-bar, each cost.",
        command=CLAIMS,
        topic="Noise on the joint angles",
        claims=("c_l_most_sensitive", "c_l_beyond_introduced", "aim_for_small_noise_only"),
        images=("images/claims/noise.svg",),
    ),
    Entry(
        label="Fig. 3.3",
        title="gear error, sinusoidal gear error and noise",
        theirs="Distance and largest error over the size of three errors, with C_l and C_T.",
        command=CLAIMS,
        topic="Gear error, sinusoidal gear error and noise",
        images=("images/claims/gear_errors.svg", "images/claims/gear_errors_2.svg"),
    ),
    Entry(
        label="Fig. 3.4",
        title="synchronization error",
        theirs="Distance and largest error over the delay of one log, each cost.",
        command=CLAIMS,
        topic="Synchronization error",
        images=("images/claims/synchronisation.svg",),
    ),
    Entry(
        label="Fig. 3.5",
        title="ball-bar backlash",
        theirs="Distance and largest error over the deviation of the rod's length, each cost.",
        command=CLAIMS,
        topic="Ball-bar backlash and sphere deviation",
        images=("images/claims/rod_deviation.svg",),
    ),
    Entry(
        label="Fig. 3.6",
        title="truncated ball-bar angles",
        theirs="Distance and largest error over encoder step, beside noise of that size.",
        command=CLAIMS,
        topic="Truncated ball-bar angles",
        images=("images/claims/truncation.svg",),
    ),
    Entry(
        label="Fig. 4.4",
        title="deflection of the offset plate",
        theirs="Deflection at 100 N and weight over the thickness of steel and aluminium plates; "
        "45 mm of aluminium stay below 10 urad.",
        command=CLAIMS,
        topic="Deflection of the offset plate",
        images=("images/claims/plate.svg",),
    ),
    Entry(
        label="Fig. 5.5",
        title="cost over the shift between the logs",
        theirs="One minimum within 200 ms. The second run, after the log was shifted, has its "
        "minimum at 8 ms.",
        command=HERE,
        topic="Log synchronization by least cost",
        images=(SHIFT_IMAGE, "images/claims/clock_by_cost.svg"),
        ours=_figure_5_5,
    ),
    Entry(
        label="Fig. 5.7",
        title="force along a path",
        theirs="Force on the ball-bar over time, IRB 2400 under SoftServo of 80 %, on a path with "
        "many points near singularities.",
        command=EXPERIMENTS,
        experiments=("force along a path", "the same, everything on"),
        images=("images/path_force.svg",),
    ),
    Entry(
        label="Fig. 5.8",
        title="strain of rod and joints, and movement of the base",
        theirs="Movement over force up to 150 N: less than 5 um of the rod and of each joint, "
        "within what the optical system resolves.",
        command=EXPERIMENTS,
        experiments=("rod and two joints", "deviation from a sphere"),
        topic="Strain and backlash of the ball-bar",
        images=("images/pull_push.svg",),
    ),
    Entry(
        label="Fig. 5.9",
        title="backlash of the joints",
        theirs="Movement as the force changes its direction: less than 5 um a joint.",
        command=EXPERIMENTS,
        experiments=("backlash at force reversal",),
        images=("images/pull_push.svg",),
    ),
    Entry(
        label="Fig. 5.12",
        title="NJ 220, identified with C_l",
        theirs=_TURIN.format("C_l"),
        command=CLAIMS,
        topic="Experiment with the Comau NJ 220",
        claims=(*_COMAU_ALL, "rod_error_is_large", "c_l_suffers"),
        images=("images/claims/comau_2016.svg",),
    ),
    Entry(
        label="Fig. 5.13",
        title="NJ 220, identified with C_P",
        theirs=_TURIN.format("C_P"),
        command=CLAIMS,
        topic="Experiment with the Comau NJ 220",
        claims=(*_COMAU_ALL, "angles_bring_nothing", "stopped_after_500"),
        images=("images/claims/comau_2016_2.svg",),
    ),
    Entry(
        label="Fig. 5.14",
        title="NJ 220, identified with C_Ptheta",
        theirs=_TURIN.format("C_Ptheta"),
        command=CLAIMS,
        topic="Experiment with the Comau NJ 220",
        claims=(*_COMAU_ALL, "angles_bring_nothing", "stopped_after_500"),
        images=("images/claims/comau_2016_3.svg",),
    ),
    Entry(
        label="Fig. 5.15",
        title="IRB 2400, identified with C_l",
        theirs=_LUND.format("C_l"),
        command=CLAIMS,
        topic="Experiment with the ABB IRB 2400",
        claims=("c_l_larger_than_comau", "some_improvement"),
        images=("images/claims/irb_2016.svg",),
    ),
    Entry(
        label="Fig. 5.16",
        title="IRB 2400, identified with C_P",
        theirs=_LUND.format("C_P"),
        command=CLAIMS,
        topic="Experiment with the ABB IRB 2400",
        claims=_IRB_ANGLES,
        images=("images/claims/irb_2016_2.svg",),
    ),
    Entry(
        label="Fig. 5.17",
        title="IRB 2400, identified with C_Ptheta",
        theirs=_LUND.format("C_Ptheta"),
        command=CLAIMS,
        topic="Experiment with the ABB IRB 2400",
        claims=_IRB_ANGLES,
        images=("images/claims/irb_2016_3.svg",),
    ),
    Entry(
        label="Table A.1",
        title="DH parameters of the IRB 2400",
        theirs="Six rows; lengths in m.",
        command=HERE,
        ours=partial(_table_a, "irb2400"),
    ),
    Entry(
        label="Table A.2",
        title="DH parameters of the NJ 220",
        theirs="Six rows; lengths in m.",
        command=HERE,
        ours=partial(_table_a, "nj220"),
    ),
    Entry(
        label="Fig. B.1",
        title="noise on one side",
        theirs="Distance and largest error over noise on the robot's angles alone and on the "
        "ball-bar's alone.",
        command=CLAIMS,
        topic="Noise on the joint angles",
        claims=("either_side_alike", "both_little_more"),
        images=("images/claims/noise_2.svg",),
    ),
    Entry(
        label="Table B.1",
        title="five largest errors",
        theirs="The five parameters with the largest errors with C_T in each of 20 simulations; "
        "oy, btheta5, rtheta6, bd3 and ra1 most often, each around 100 urad.",
        command=CLAIMS,
        topic="Largest errors",
        images=("images/claims/largest_errors.svg",),
    ),
)


if __name__ == "__main__":
    main()
