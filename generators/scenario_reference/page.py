"""The page: each section of a scenario as a table of keys, each error source with its picture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.cell.load import load_cell
from ballbar.cell.schema import describe_keys
from ballbar.scenario import OF_EVERY_RUN, Scenario
from ballbar.sim.settings import OF_BALLBAR, OF_PATH, OF_POSES
from generators.scenario_reference.keys import (
    field_at,
    first_paragraph,
    list_item,
    models_in,
    table,
    value_text,
    values_text,
)
from generators.scenario_reference.plots import Source
from generators.scenario_reference.runs import ROOT
from generators.scenario_reference.sources import GROUPS

describe_keys()
PAGE = ROOT / "docs" / "scenario_reference.md"
MACHINES = {"irb2400": "lund_600", "nj220": "lund_900"}

HEAD = """# Scenario reference

Every key of a scenario, with a picture for every error source. Written by
`python -m generators.scenario_reference` from the schema that checks a scenario file and from the
description files in `cell/`; do not edit.

A key carries its unit in its name (`_m`, `_rad`, `_s`, `_N`, `_hz`). A key that is not given takes
its default. An error source is absent unless a scenario names it:
`errors: {{joint_compliance: {{}}}}` switches one on at its default size. An unknown key, a value
out of range or a wrong kind is refused with the file's line.

`extends: FILE` takes over another scenario, and `--set KEY=VALUE` replaces a value on the command
line: [Vary and reuse files](how_to/reuse_files.md).

What differs from unit to unit (phases, spread, deviations) is drawn from the scenario's seed. Each
source draws from a stream of its own, so switching one on leaves all others bit-identical. z is a
standard normal draw, phi a drawn phase.

**Letters.** `m` motor hinge, `e` elastic deflection, `q = m + e` joint; `g` output of a gear,
`joints = gears @ gear_to_joint` ([conventions](conventions.md)); `L` load on a gear and `tau`
torque of its servo, both at its output, at rest `tau = -L`; `b` ball-bar angle; `s` elongation of
the rod, or angle of an encoder's shaft; `F` force.

**Plots.** IRB 2400 with the errors of thesis Table 3.1 on the 600 mm ball-bar, soft servo, 60 s, no
noise. A curve is the run with the source minus the same run without it, unless the axes say
otherwise. Geometry, sensors and clocks are plotted with the kinematic plant. "Tool, bar - robot" is
the tool's position by the ball-bar's log minus that by the robot's log, in the robot's base frame,
with rigid kinematics and the geometry of the run without the source. It is what is left when only
geometry is identified.

{contents}
"""

ROW = """<tr>
<td width="60%" valign="top">

### {key}

{what}

{model}

{keys}

{machine}Enters: {enters}<br>
Default from: {origin}

</td>
<td width="40%" valign="top">

<img src="images/effects/{key}.svg" width="320" height="180" alt="{key}: {label}">

{in_log}

</td>
</tr>
"""

POSES_HEAD = """
## Still poses

A scenario with `poses` in place of `path`: the robot stands before a telescoping ball-bar, a
draw-wire, a tracker or a socket ([instruments](poses.md)). `ballbar run` writes a table of poses,
identifies the robot from it and compares it with the truth. The file of the robot needs no masses:
without them, and before an instrument that does not pull, the poses are kinematic, and the run says
so.

A key that belongs to another kind of scenario is refused, unless it states its default.

- With `poses` only: {of_poses}.
- With `path` only: {of_path}; of `accept` all but {limits}.
- With `path` and a ball-bar with encoders only: {of_ballbar}.
"""

SIZES_HEAD = """
## Sizes of the effects

Largest change of the logs against the same run without the source, with the sizes plotted above,
measured by the same command (`images/effects/sizes.csv`). These are orders of magnitude: they
depend on path, seed and servo. A rod force of - means the kinematic plant: the ball-bar keeps its
path and the robot follows.

| source | tool, bar - robot [um] | robot angle [urad] | ball-bar angle [urad] | rod force [N] |
|---|---:|---:|---:|---:|
"""


def page_text(sizes: list[dict[str, str]]) -> str:
    """The whole page; sizes : rows of sizes.csv."""
    contents = "\n".join(
        f"- {group}: " + ", ".join(f"[{s.key}](#{_anchor(s.key)})" for s in sources)
        for group, sources in GROUPS.items()
    )
    rows = (
        f"| [{r['source']}](#{_anchor(r['source'])}) {r['variant']} | "
        f"{r['tool_um']} | {r['q_urad']} | {r['b_urad']} | {r['rod_N']} |\n"
        for r in sizes
    )
    head, sections = HEAD.format(contents=contents), "".join(_sections())
    return head + sections + _still_poses() + SIZES_HEAD + "".join(rows)


def _still_poses() -> str:
    """Which keys belong to a robot that stands still, and which to one that moves."""
    names = {"of_poses": OF_POSES, "of_path": (*OF_PATH, "identify"), "of_ballbar": OF_BALLBAR}
    listed = {k: ", ".join(f"`{key}`" for key in keys) for k, keys in names.items()}
    return POSES_HEAD.format(**listed, limits=", ".join(f"`{key}`" for key in OF_EVERY_RUN))


def _sections() -> Iterator[str]:
    """The keys at the top, then each section: its table, then its sources group by group."""
    pictured = {source.key for sources in GROUPS.values() for source in sources}
    yield "\n## At the top\n"
    yield from table("", Scenario)
    for section, info in Scenario.model_fields.items():
        for model in models_in(info.annotation):
            yield f"\n## {section}\n\n{first_paragraph(model)}\n"
            yield from table(section, model)
            yield from _pictures(section)
            for name, field in model.model_fields.items():
                if (key := f"{section}.{name}") not in pictured:
                    yield from (
                        _without_picture(key, field, m) for m in models_in(field.annotation)
                    )


def _without_picture(key: str, field: FieldInfo, model: type[BaseModel]) -> str:
    items = "\n".join(list_item(name, each) for name, each in model.model_fields.items())
    many = "A list." if values_text(field).startswith("list of") else ""
    notes = [first_paragraph(model), field.description or "", many]
    return f"\n**`{key}`** {' '.join(note for note in notes if note)}\n\n{items}\n"


def _pictures(section: str) -> Iterator[str]:
    """Group by group, the sources of a section with their pictures."""
    for group, every in GROUPS.items():
        sources = [source for source in every if source.key.split(".")[0] == section]
        if sources:
            yield f"\n**{group}**\n\n<table>\n{''.join(map(_row, sources))}</table>\n"


def _anchor(key: str) -> str:
    return key.replace(".", "")  # as forges form it from the heading


def _row(source: Source) -> str:
    info = field_at(source.key)
    models = models_in(info.annotation)
    what = source.what or (first_paragraph(models[0]) if models else info.description) or ""
    return ROW.format(
        key=source.key,
        what=what,
        model=source.model,
        keys=_keys(source.key, info, models),
        machine=_machine(source),
        enters=source.enters,
        origin=source.origin,
        label=source.plot.axes[1],
        in_log=source.in_log,
    )


def _keys(key: str, info: FieldInfo, models: list[type[BaseModel]]) -> str:
    """The keys of a source as a list, below what its field itself says."""
    if not models:
        return list_item(key, info)
    many = "A list, each with:" if values_text(info).startswith("list of") else ""
    notes = " ".join(note for note in (info.description, many) if note)
    items = [list_item(name, field) for name, field in models[0].model_fields.items()]
    return "\n".join([notes, "", *items] if notes else items)


def _machine(source: Source) -> str:
    if source.of_machine is None:
        return ""
    unit, sizes = source.of_machine
    texts = {
        robot: _numbers(sizes(load_cell(robot, bar, "plate_250")))
        for robot, bar in MACHINES.items()
    }
    same = len(set(texts.values())) == 1
    by_robot = "; ".join(f"{robot} {text}" for robot, text in texts.items())
    return f"Size: {next(iter(texts.values())) if same else by_robot} ({unit})<br>\n"


def _numbers(values: ArrayLike) -> str:
    return ", ".join(
        value_text(float(f"{value:.3g}")).removesuffix(".0")
        for value in np.atleast_1d(np.asarray(values, dtype=float))
    )
