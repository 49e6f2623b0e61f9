"""Identifiability beside thesis Tables 3.2-3.5: docs/identifiability.md.

    python -m generators.identifiability_page

Every entry that differs from a printed one must have its reason in REASON_OF; without one the page
is not written.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.cell.files import write_whole
from ballbar.cell.geometry import bar_frames, parameter_named
from ballbar.cell.inverse import refine
from ballbar.ident.estimator.closure import close_loop
from ballbar.ident.estimator.dependencies import Group, Selection, groups
from ballbar.ident.estimator.thesis_names import shortened, thesis_parameters
from ballbar.ident.thesis.costs import cost_named
from ballbar.ident.thesis.names import ENCODERS_NEEDED, ML, CostName
from ballbar.ident.thesis.tables import (
    MOST,
    REMOVED,
    TABLE_3_2,
    TABLE_3_3,
    TABLE_3_4,
    TABLE_3_5_IDENTIFIED,
    THESIS_COSTS,
)
from ballbar.identifiability import (
    NOISE,
    SAMPLES,
    Influences,
    KinematicLoop,
    Study,
    cost_columns,
    influences,
    nominal_loop,
    reidentified,
    study,
    unit_of,
    vector_text,
)
from ballbar.scenario import load_scenario

ROOT = Path(__file__).parent.parent
SCENARIOS, PAGE = ROOT / "scenarios", ROOT / "docs" / "identifiability.md"
ROBOTS = {"irb2400": "IRB 2400", "nj220": "NJ 220"}
ALL_ENCODERS = (1, 2, 3, 4, 5)
ENCODER_SETS = ((), (1, 2), (1, 2, 4, 5), ALL_ENCODERS)
EQUATIONS = {0: 1, 2: 3, 4: 5, 5: 6}  # of ml a sample, by number of encoders
TURN_DEG = 20.0
THESIS_LIMIT = 1e-6  # absolute, thesis sec. 3.2
THESIS_SAMPLES = 1500  # thesis sec. 3.5; an absolute limit depends on how many there are

INTRODUCTION = """# Identifiability: what each cost determines, beside thesis Tables 3.2 to 3.5

Written by `python -m generators.identifiability_page`; do not edit. The same for any scenario,
cost and encoder set: `ballbar identifiability scenarios/irb2400.yaml --cost all`.

Signed components of each cost on the nominal mechanism along the scenario's path, columns at unit
length. A direction is missing when its singular value is below 1e-6 of the largest; nothing lies
near: the weakest counted has {weakest:.0e}, none that is ignored reaches {strongest:.0e}. `a | b`:
one can be identified, the others must be given. `a + b`: they move together. Numbers in brackets:
differences, explained below.
"""

REASON_OF = {  # (table, parameter, parameter that it moves or ""): key of _reasons
    ("3.2", "ox", ""): "origin",
    ("3.2", "btheta1", ""): "btheta1",
    ("3.2", "ba2", ""): "ba2",
    ("3.2", "btheta2", ""): "ba2",
    ("3.4", "rtheta1", "ox"): "origin",
    ("3.4", "balpha2", "bd3"): "balpha2",
    ("3.4", "ba2", "btheta2"): "ba2",
}
ROUNDING = 1e-12  # what is ignored must stay below: a page that says so is refused otherwise


class Footnotes:
    """Reasons in the order in which differences first ask for them."""

    def __init__(self, reasons: Mapping[str, str]) -> None:
        self.reasons, self.used = reasons, list[str]()

    def mark(self, keys: Sequence[str]) -> str:
        """` [1, 2]` for the reasons of one entry; nothing for none."""
        for key in keys:
            if key not in self.used:
                self.used.append(key)
        return (
            f" [{', '.join(str(n) for n in sorted({self.used.index(key) + 1 for key in keys}))}]"
            if keys
            else ""
        )

    def lines(self) -> Iterator[str]:
        """The numbered list of reasons."""
        yield from (f"{n}. {self.reasons[key]}" for n, key in enumerate(self.used, start=1))


def page_text() -> str:
    """The page. Raises ValueError for a difference from the thesis that nobody has explained."""
    loops = {name: loop_of(name) for name in ROBOTS}
    studies = {
        name: {cost: study(loop, cost, ALL_ENCODERS, complete=False) for cost in THESIS_COSTS}
        for name, loop in loops.items()
    }
    ml: dict[tuple[str, tuple[int, ...]], tuple[Study, Study]] = {
        (name, joints): _ml(loop, joints) for name, loop in loops.items() for joints in ENCODER_SETS
    }
    every = [
        *(s for by_cost in studies.values() for s in by_cost.values()),
        *(s for pair in ml.values() for s in pair),
    ]
    if max(s.spectrum.largest_ignored for s in every) > ROUNDING:
        raise ValueError(
            "a direction that is ignored is no rounding error; look before the page says so"
        )
    weakest = min(s.spectrum.smallest_counted for s in every)
    irb = studies["irb2400"]
    moved = {cost: influences(loops["irb2400"], s) for cost, s in irb.items()}
    notes = Footnotes(_reasons(loops["irb2400"], irb))
    lines = [INTRODUCTION.format(weakest=weakest, strongest=ROUNDING)]
    lines += [
        *_zero_jacobians(irb),
        *dependency_lines(irb, notes),
        *_influences(irb, moved, notes),
        *_kept(irb),
    ]
    lines += [
        "## Where it differs, and why",
        "",
        *notes.lines(),
        "",
        *_recipe(loop_of("irb2400", THESIS_SAMPLES), irb),
    ]
    lines += [*_other_robot(studies), *_maximum_likelihood(ml)]
    return "\n".join(lines) + "\n"


def turned(loop: KinematicLoop, angle: float) -> KinematicLoop:
    """The same motion with the ball-bar carried about the robot's first axis by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = loop.geometry["ox"], loop.geometry["oy"]
    moved = loop.geometry.replaced({"ox": c * x - s * y, "oy": s * x + c * y})
    return replace(
        loop, geometry=moved, q=loop.q + angle * np.eye(1, 6), b=loop.b + angle * np.eye(1, 5)
    )


def missing_and_extra(
    ours: Sequence[Group], printed: Sequence[str]
) -> list[tuple[str, str, list[str]]]:
    """Each group as found and as printed, with the parameters that are in one of them only.

    A group without counterpart stands beside an empty text.
    """
    theirs = {text: _names(text) for text in printed}
    rows = []
    for group in ours:
        members = {name for names in group.members for name in names}
        text, names = next(((t, n) for t, n in theirs.items() if n & members), ("", set[str]()))
        theirs.pop(text, None)
        rows.append((str(group), text, sorted(members ^ names)))
    return rows + [("", text, sorted(names)) for text, names in theirs.items()]


def _names(text: str) -> set[str]:
    """Parameters of a printed group: `rtheta1 | ox,y` as rtheta1, ox, oy."""
    return {
        name for part in text.replace("ox,y", "ox | oy").split(" | ") for name in part.split(" + ")
    }


def loop_of(name: str, samples: int = SAMPLES) -> KinematicLoop:
    """The nominal mechanism of a scenario along its path."""
    return nominal_loop(
        load_scenario(SCENARIOS / f"{name}.yaml"), relative_to=SCENARIOS, samples=samples
    )


def _ml(loop: KinematicLoop, joints: tuple[int, ...]) -> tuple[Study, Study]:
    return study(loop, ML, joints, complete=False), study(loop, ML, joints, complete=True)


def _reasons(loop: KinematicLoop, studies: Mapping[str, Study]) -> dict[str, str]:
    carried = turned(loop, np.radians(TURN_DEG))
    names = thesis_parameters(carried.geometry.table)
    columns = cost_columns(carried, "transform", ALL_ENCODERS, names)
    about_axis_1 = next(g for g in groups(columns, names, carried.geometry) if "rtheta1" in str(g))
    position = studies["position"].selection
    ba2 = next(vector_text(d) for d in position.dependent if d.name == "ba2")
    moved = reidentified(loop, "position", (1, 2), position.selected, "balpha2")
    vector = vector_text(about_axis_1.vectors[0])
    return {
        "origin": "The ball-bar stands at y = 0, so turning it about axis 1 moves it along y "
        f"alone. With everything turned {TURN_DEG:.0f} deg it is `{about_axis_1}`, `{vector}`.",
        "btheta1": "A ball-bar turned about axis 1 turns its own encoder offset along, which Table "
        "3.4 has too.",
        "ba2": f"Not printed, and exact whatever the path: with balpha2 at 90 deg, `{ba2}`, since "
        f"the rod is bd3 = {loop.geometry['bd3']:g} m. The recipe of the thesis finds it (below).",
        "scale": f"The {_scaled(position)} kept lengths that are not zero, of "
        f"{len(position.selected)} parameters kept with C_P: not most of them.",
        "balpha2": f"`bd2` moves by {moved['bd2']:+.3f} mm and `bd3` by {moved['bd3']:+.4f} mm: "
        "second order.",
    }


def by_thesis_recipe(
    loop: KinematicLoop, cost: CostName, *, errors: Mapping[str, float]
) -> dict[str, float]:
    """Diagonal of R for each parameter, last in priority last, by the thesis's recipe (sec. 3.2).

    The recipe takes the printed scalar with nominal parameters and noisy angles.

    errors : [m, rad] of the mechanism that the angles close, by parameter.
    """
    true = loop.geometry.replaced(
        {name: loop.geometry[name] + error for name, error in errors.items()}
    )
    q = refine(true.robot, loop.q, bar_frames(true, loop.b).poses())
    rng = np.random.default_rng(2016)
    noisy = close_loop(
        loop.geometry,
        q + rng.normal(0.0, NOISE, q.shape),
        loop.b + rng.normal(0.0, NOISE, loop.b.shape),
    )
    table = loop.geometry.table
    order = [*(name for name in thesis_parameters(table) if name != table.plate), table.plate]
    columns = (
        cost_named(cost, "thesis")
        .jacobian(noisy, [parameter_named(name) for name in order])
        .reshape(len(order), -1)
    )
    diagonal = np.abs(np.diag(np.linalg.qr(columns.T, mode="r")))
    return dict(zip(order, diagonal.tolist(), strict=True))


def by_recipe_and_here(
    loop: KinematicLoop, cost: CostName, selection: Selection
) -> tuple[set[str], set[str]]:
    """Parameters that the thesis's recipe leaves out of a nominal mechanism, and those left out
    of a selection.
    """
    diagonal = by_thesis_recipe(loop, cost, errors={})
    below = {name for name, r in diagonal.items() if r < THESIS_LIMIT}
    return below, {*selection.without_effect, *(d.name for d in selection.dependent)}


def _recipe(loop: KinematicLoop, studies: Mapping[str, Study]) -> Iterator[str]:
    yield from ("## The thesis's recipe", "")
    differences = []
    for cost in ENCODERS_NEEDED:
        below, left_out = by_recipe_and_here(loop, cost, studies[cost].selection)
        differences.append(f"{THESIS_COSTS[cost]} {_more_or_less(below, left_out)}")
    yield (
        "Printed scalar, nominal parameters, 10 urad of noise on the angles; what has less than "
        f"1e-6 on the diagonal of R is left out. {THESIS_SAMPLES} samples, against the list above: "
        f"{'; '.join(differences)}. The scalars of all but C_l have a Jacobian that vanishes where "
        "the loop closes, so noise makes the absolute limit a loose relative one."
    )
    yield ""


def _reason(table: str, name: str, moved: str = "") -> str:
    key = REASON_OF.get((table, name, moved))
    if key is None:
        raise ValueError(
            f"Table {table}: {name} {moved}differs from the thesis and nobody has said why; add it "
            "to REASON_OF"
        )
    return key


def _zero_jacobians(studies: Mapping[str, Study]) -> Iterator[str]:
    yield from ("## Zero Jacobian (Table 3.3)", "", "|cost|here|thesis|", "|---|---|---|")
    for cost, title in THESIS_COSTS.items():
        ours = studies[cost].selection.without_effect
        if set(ours) != TABLE_3_3[cost]:
            raise ValueError(f"Table 3.3: {cost} differs from the thesis and nobody has said why")
        yield f"|{title}|{_code(shortened(ours)) or 'none'}|the same|"
    yield ""


def dependency_lines(studies: Mapping[str, Study], notes: Footnotes) -> Iterator[str]:
    """Table 3.2 as found and as printed.

    Raises ValueError for a difference without an entry in REASON_OF.
    """
    head = "|here|null vectors|costs|thesis|"
    yield from ("## Dependencies (Table 3.2)", "", head, "|---|---|---|---|")
    rows: dict[tuple[str, str, str], list[str]] = {}
    for cost, title in THESIS_COSTS.items():
        vectors = {
            str(group): "; ".join(map(vector_text, group.vectors)) for group in studies[cost].groups
        }
        for ours, theirs, different in missing_and_extra(studies[cost].groups, TABLE_3_2[cost]):
            printed = "the same" if not different else _cell(theirs) or "not printed"
            mark = notes.mark([_reason("3.2", name) for name in different])
            row = (_cell(ours) or "not found", _cell(vectors.get(ours, "")), f"{printed}{mark}")
            rows.setdefault(row, []).append(title)
    for (ours, vector, printed), costs in rows.items():
        yield f"|{ours}|{vector}|{', '.join(costs)}|{printed}|"
    yield ""
    yield (
        "The inverse kinematics in C_Ptheta are not printed; `ident/thesis/universal_joint.py` has "
        "the reading that gives its row."
    )
    yield ""


def _influences(
    studies: Mapping[str, Study], moved: Mapping[str, Influences], notes: Footnotes
) -> Iterator[str]:
    yield from ("## Influence of what is left out (Table 3.4)", "")
    yield (
        "Each left-out parameter off by 1 mm|mrad, the kept ones identified again from nominal; "
        "those moved by more than 0.05 mm|mrad."
    )
    yield from ("", "|left out|cost|moves here, mm\\|mrad|thesis|", "|---|---|---|---|")
    rows: dict[tuple[str, str, str], list[str]] = {}
    for cost, title in THESIS_COSTS.items():
        for name, moves in moved[cost].items():
            text = ", ".join(f"{other} {x:+.3f}" for other, x in moves.items())
            rows.setdefault((name, text, _printed(name, moves, studies[cost], notes)), []).append(
                title
            )
    for (name, text, printed), costs in sorted(
        rows.items(), key=lambda row: (*REMOVED, "ba2").index(row[0][0])
    ):
        yield f"|`{name}`, {unit_of(name)}|{', '.join(costs)}|{text}|{printed}|"
    yield ""


def _printed(name: str, moves: Mapping[str, float], result: Study, notes: Footnotes) -> str:
    printed = TABLE_3_4.get(name, ())
    if printed == (MOST,):
        return MOST + notes.mark(["scale"])
    applicable = set(printed) - set(result.selection.without_effect)
    different = sorted(moves.keys() ^ applicable)
    text = (
        "the same"
        if not different
        else _code(shortened(n for n in printed if n in applicable)) or "not printed"
    )
    return text + notes.mark([_reason("3.4", name, other) for other in different])


def _kept(studies: Mapping[str, Study]) -> Iterator[str]:
    yield from (
        "## What is kept (sec. 3.3)",
        "",
        "|cost|directions|kept|left out, besides those without effect|",
        "|---|---|---|---|",
    )
    for cost, title in THESIS_COSTS.items():
        s = studies[cost].selection
        yield (
            f"|{title}|{len(s.selected)}|{_code(shortened(s.selected))}|"
            f"{_code(d.name for d in s.dependent)}|"
        )
    removed = {d.name for f in studies.values() for d in f.selection.dependent}
    yield ""
    same = set(studies["length"].selection.selected) == TABLE_3_5_IDENTIFIED
    yield (
        f"Table 3.5 gives numbers for {len(TABLE_3_5_IDENTIFIED)} parameters: "
        f"{'exactly' if same else 'not'} those kept for C_l."
    )
    yield (
        f"Removed in the thesis, all costs together: {_code(REMOVED)}. Here: "
        f"{_more_or_less(removed, set(REMOVED))}."
    )
    yield ""


def _more_or_less(ours: set[str], theirs: set[str]) -> str:
    words = [
        f"{word} {_code(sorted(names))}"
        for word, names in (("also", ours - theirs), ("not", theirs - ours))
        if names
    ]
    return " ".join(words) or "the same"


def _scaled(selection: Selection) -> int:
    return next(len(d.partners) for d in selection.dependent if d.name == "ra6")


def _other_robot(by_robot: Mapping[str, Mapping[str, Study]]) -> Iterator[str]:
    yield from ("## NJ 220", "", "`ballbar identifiability scenarios/nj220.yaml --cost all`", "")
    pairs = [tuple(studies[cost] for studies in by_robot.values()) for cost in THESIS_COSTS]
    same = all(
        list(map(str, nj220.groups)) == list(map(str, irb2400.groups))
        and nj220.selection.selected == irb2400.selection.selected
        for irb2400, nj220 in pairs
    )
    yield (
        f"{'The same' if same else 'Other'} zero Jacobians, groups and kept parameters with all "
        "four costs; null vectors follow its lengths."
    )
    conditions = (
        f"{title} {' and '.join(f'{by_robot[r][cost].spectrum.condition:.0f}' for r in ROBOTS)}"
        for cost, title in THESIS_COSTS.items()
    )
    yield f"Conditions, IRB 2400 and NJ 220: {', '.join(conditions)}."
    yield ""


def _maximum_likelihood(
    pairs: Mapping[tuple[str, tuple[int, ...]], tuple[Study, Study]],
) -> Iterator[str]:
    yield from (
        "## The default cost, ml, with fewer encoders",
        "",
        "`ballbar identifiability SCENARIO --cost ml --encoders LIST [--complete]`",
    )
    yield ""
    yield (
        "Directions of the thesis's 47 parameters, and of the complete 51: Hayati angles `rbeta2`, "
        "`rbeta6` and base tilt `otx,y` added."
    )
    yield from (
        "",
        "|robot|encoders|equations a sample|of 47|of 51|condition (51)|",
        "|---|---|---|---|---|---|",
    )
    for (name, joints), (thesis, complete) in pairs.items():
        counts = (
            f"{EQUATIONS[len(joints)]}|{thesis.spectrum.rank}|{complete.spectrum.rank}|"
            f"{complete.spectrum.condition:.0f}"
        )
        yield f"|{ROBOTS[name]}|{_encoders(joints)}|{counts}|"


def _encoders(joints: Sequence[int]) -> str:
    return ", ".join(f"b{j}" for j in joints) or "none"


def _code(names: Iterator[str] | Sequence[str]) -> str:
    return " ".join(f"`{name}`" for name in names)


def _cell(text: str) -> str:
    """A group or a null vector in a table, where a bar needs its backslash."""
    return f"`{text}`".replace("|", "\\|") if text else ""


if __name__ == "__main__":
    write_whole(PAGE, page_text().encode())
