"""Identifiability of a cost as text for a terminal, in the thesis's notation, and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ballbar.identifiability.study import Influences, Study
from cell.geometry import parameter_named
from ident.estimator.dependencies import Dependency
from ident.estimator.thesis_names import shortened
from ident.thesis.names import ML

LEGEND = """\
Nominal mechanism along the scenario's path. a | b: one of them can be identified, the others must
be given; a + b: they move together. Kept in the order of thesis sec. 3.3. Null vectors in m and
rad. Left out: the effect of an error in it on those selected, in mm|mrad."""
SHOWN = 8  # parameters named in one line of text: as many as there are lengths in the scale
TITLES = {
    ML: "ml",
    "length": "length (C_l)",
    "position": "position (C_P)",
    "position_angles": "position and angles (C_Ptheta)",
    "transform": "transformation (C_T)",
}


def study_lines(study: Study, changes: Influences) -> Iterator[str]:
    """The tables of one cost as lines of text. changes : result of `influences`."""
    selection, spectrum = study.selection, study.spectrum
    encoders = ", ".join(f"b{j}" for j in study.encoders) or "none"
    count = f"{spectrum.rank} directions of {len(study.parameters)} parameters"
    title = TITLES[study.cost]
    yield f"{title}, encoders {encoders}: {count}, condition {spectrum.condition:.0f}"
    yield from _titled("no effect", [" ".join(shortened(selection.without_effect)) or "none"])
    width = max((len(str(group)) for group in study.groups), default=0)
    groups = [
        f"{group!s:<{width}}   {'; '.join(map(vector_text, group.vectors))}"
        for group in study.groups
    ]
    yield from _titled("dependent", groups)
    yield from _titled(
        f"selected {len(selection.selected)}", [" ".join(shortened(selection.selected))]
    )
    left_out = [f"{d.name:<7}  {_influence_text(d, changes[d.name])}" for d in selection.dependent]
    yield from _titled("left out", left_out)


def study_data(study: Study, changes: Influences) -> dict[str, object]:
    """All of a study as plain data: null vectors in m and rad, `changes` in mm|mrad."""
    selection = study.selection
    left_out: list[dict[str, object]] = [
        {"name": name, "reason": "no effect"} for name in selection.without_effect
    ]
    for d in selection.dependent:
        reason = "scale" if d.is_scale else "depends on"
        on, affected = dict(d.partners), changes[d.name]
        left_out.append({"name": d.name, "reason": reason, "on": on, "affected": affected})
    groups = [
        {
            "text": str(group),
            "members": [list(m) for m in group.members],
            "vectors": {v.name: dict(v.partners) for v in group.vectors},
        }
        for group in study.groups
    ]
    return {
        "cost": study.cost,
        "encoders": list(study.encoders),
        "parameters": list(study.parameters),
        "directions": study.spectrum.rank,
        "condition": study.spectrum.condition,
        "smallest_singular_value": study.spectrum.smallest_counted,
        "largest_ignored_singular_value": study.spectrum.largest_ignored,
        "zero_jacobian": list(selection.without_effect),
        "groups": groups,
        "selected": list(selection.selected),
        "left_out": left_out,
    }


def vector_text(vector: Dependency) -> str:
    """A null vector in one line: `rd1 = -oz`, `rtheta1 = -btheta1 - 0.7 oy`; units m and rad."""
    if vector.is_scale:
        return f"{vector.name} = scale, all lengths together"
    terms = [
        f"{'-' if x < 0 else '+'} {'' if abs(abs(x) - 1.0) < 5e-5 else f'{abs(x):.4g} '}{name}"
        for name, x in vector.partners.items()
    ]
    first, *others = terms
    return f"{vector.name} = {' '.join([first.replace('+ ', '').replace('- ', '-'), *others])}"


def unit_of(name: str) -> str:
    """Display unit of a parameter: `mm` or `mrad`."""
    return f"m{parameter_named(name).unit}"


def _titled(title: str, lines: Sequence[str]) -> Iterator[str]:
    for k, line in enumerate(lines or ("none",)):
        yield f"  {'' if k else title:<10} {line}"


def _influence_text(dependency: Dependency, changes: dict[str, float]) -> str:
    terms = [f"{name} {x:+.3f}" for name, x in changes.items()]
    more = f" and {len(terms) - SHOWN} more" if len(terms) > SHOWN else ""
    verb = "scales" if dependency.is_scale else "moves"
    unit = unit_of(dependency.name)
    return f"+1 {unit:<4} {verb:<6} {', '.join(terms[:SHOWN]) or 'nothing'}{more}"
