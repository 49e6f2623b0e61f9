"""The page: words around the sources, and what the settings say of each."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cell.load import load_cell
from generators.effects_page.parameters import (
    choices_of,
    description,
    field_at,
    models_in,
    parameter_text,
    value_text,
)
from generators.effects_page.runs import ROOT
from generators.effects_page.sources import GROUPS, SOURCES, Source
from sim.settings import SimulationSettings

PAGE = ROOT / "docs" / "effects.md"
MACHINES = {"irb2400": "lund_600", "nj220": "lund_900"}

HEAD = """# Effects: every error source of a scenario

Written by `python -m generators.effects_page`; do not edit. Defaults and descriptions are those of the settings themselves
(`sim/`), sizes per machine those of the description files (`cell/`).

Every source is absent unless a scenario names it: `errors: {{joint_compliance: {{}}}}` switches one on at its default size. The
heading of a row is the key, the list in it the parameters with default and unit. What differs from unit to unit (phases, spread,
deviations) is drawn from the scenario's seed, one stream a source, so that switching one on leaves all others bit-identical. z is a
standard normal draw, phi a drawn phase.

Letters: `m` motor hinge, `e` elastic deflection, `q = m + e` joint; `g` output of a gear, `joints = gears @ gear_to_joint`
([conventions](conventions.md)); `L` load on a gear and `tau` torque of its servo, both at its output, at rest `tau = -L`; `b` ball-bar
angle; `s` stretch of the rod, or angle of an encoder's shaft; `F` force.

Plots: the IRB 2400 with the errors of thesis Table 3.1 on the 600 mm ball-bar, soft servo, 60 s, no noise; the run with the source minus
the same run without it, unless the axes say otherwise. Geometry, sensors and clocks are plotted with the kinematic plant. "Tool, bar -
robot" is the tool's position by the ball-bar's log minus that by the robot's, in the robot's base, with rigid kinematics and the geometry
of the run without the source: what is left when only geometry is identified.

{contents}
"""

ROW = """<tr>
<td width="60%" valign="top">

### {key}

{what}

{model}

{parameters}

{machine}Enters: {enters}<br>
Default from: {origin}

</td>
<td width="40%" valign="top">

<img src="images/effects/{key}.svg" width="320" height="180" alt="{key}: {label}">

{in_log}

</td>
</tr>
"""

SIZES_HEAD = """## How large

Largest change of what the logs say against the same run without the source, sizes as plotted above, measured by the same command
(`images/effects/sizes.csv`). Orders of magnitude: they depend on path, seed and servo. A rod force of - means the kinematic plant: the
ball-bar keeps its path and the robot follows.

| source | tool, bar - robot [um] | robot angle [urad] | ball-bar angle [urad] | rod force [N] |
|---|---:|---:|---:|---:|
"""

OTHER_HEAD = """
## Settings that are no error source

| key | default | |
|---|---|---|
"""


def page_text(sizes: list[dict[str, str]]) -> str:
    """The whole page; sizes : rows of sizes.csv."""
    contents = "\n".join(
        f"- {group}: " + ", ".join(f"[{s.key}](#{_anchor(s.key)})" for s in GROUPS[group])
        for group in GROUPS
    )
    groups = "".join(
        f"\n## {group}\n\n<table>\n{''.join(map(_row, sources))}</table>\n"
        for group, sources in GROUPS.items()
    )
    table = "".join(
        f"| [{r['source']}](#{_anchor(r['source'])}) {r['variant']} | {r['tool_um']} | {r['q_urad']} | {r['b_urad']} | {r['rod_N']} |\n"
        for r in sizes
    )
    return (
        HEAD.format(contents=contents)
        + groups
        + "\n"
        + SIZES_HEAD
        + table
        + OTHER_HEAD
        + "".join(_other_rows())
    )


def _anchor(key: str) -> str:
    return key.replace(".", "")  # as forges form it from the heading


def _row(source: Source) -> str:
    info = field_at(source.key)
    models = models_in(info.annotation)
    what = source.what or (inspect.getdoc(models[0]) if models else info.description) or ""
    return ROW.format(
        key=source.key,
        what=what.replace("\n", " "),
        model=source.model,
        parameters=_parameters(source.key, info, models),
        machine=_machine(source),
        enters=source.enters,
        origin=source.origin,
        label=source.plot.axes[1],
        in_log=source.in_log,
    )


def _parameters(key: str, info: FieldInfo, models: list[type[BaseModel]]) -> str:
    if not models:
        return "- " + parameter_text(key, info)
    notes = [
        note
        for note in (info.description, "A list, each with:" if info.default == () else "")
        if note
    ]
    lines = [" ".join(notes), ""] if notes else []
    return "\n".join(
        lines
        + [f"- {parameter_text(name, field)}" for name, field in models[0].model_fields.items()]
    )


def _machine(source: Source) -> str:
    if source.of_machine is None:
        return ""
    unit, sizes = source.of_machine
    texts = {
        robot: _numbers(sizes(load_cell(robot, bar, "plate_250")))
        for robot, bar in MACHINES.items()
    }
    first, *others = texts.values()
    shown = (
        first
        if all(other == first for other in others)
        else "; ".join(f"{robot} {text}" for robot, text in texts.items())
    )
    return f"Size: {shown} ({unit})<br>\n"


def _numbers(values: ArrayLike) -> str:
    return ", ".join(
        value_text(float(f"{value:.3g}")).removesuffix(".0")
        for value in np.atleast_1d(np.asarray(values, dtype=float))
    )


def _other_rows() -> Iterator[str]:
    shown = {source.key for source in SOURCES}
    for section, info in SimulationSettings.model_fields.items():
        models = models_in(info.annotation)
        if not models:
            yield _other(section, info)
        for model in models:
            for name, inner in model.model_fields.items():
                if f"{section}.{name}" not in shown:
                    yield _other(f"{section}.{name}", inner)


def _other(key: str, info: FieldInfo) -> str:
    default = "required" if info.is_required() else f"`{value_text(info.default)}`"
    return f"| `{key}` | {default} | {' '.join([description(info), *([' or '.join(c)] if (c := choices_of(info.annotation)) else [])])} |\n"
