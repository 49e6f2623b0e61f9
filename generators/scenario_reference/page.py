"""The page: each section of a scenario as a table of keys, each error source with its picture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ballbar.cell.load import load_cell
from ballbar.scenario import OF_EVERY_RUN, Scenario
from ballbar.sim.settings import OF_BALLBAR, OF_PATH, OF_POSES
from generators.scenario_reference.keys import (
    field_at,
    first_paragraph,
    keys_described,
    models_in,
    plain,
    table,
    value_text,
    values_text,
)
from generators.scenario_reference.plots import Source
from generators.scenario_reference.runs import ROOT
from generators.scenario_reference.sources import GROUPS

PAGE = ROOT / "docs" / "scenario_reference.md"
MACHINES = {"irb2400": "lund_600", "nj220": "lund_900"}

HEAD = """# Scenario reference

Every key of a scenario, with a picture for every error source. Written by
`python -m generators.scenario_reference` from the schema that checks a scenario file and from the
description files in `cell/`; do not edit.

A key carries its unit in its name. Sizes are not negative, and some not 0. Without a source beside
it a default is assumed. An error source is absent unless a scenario names it:
`errors: {joint_compliance: {}}` switches one on at its default size. What does not fit is refused
with the file's line. `extends` and `--set`: [Vary and reuse
files](how_to/run_a_sweep.md#set-a-value-or-extend-a-file).

What differs from unit to unit is drawn from the scenario's seed, each source from a stream of its
own, so switching one on leaves all others bit-identical. z is a standard normal draw, phi a drawn
phase, sigma a standard deviation. `m` motor hinge, `e` elastic deflection, `q = m + e` joint; `g`
output of a gear, `joints = gears @ gear_to_joint` ([conventions](conventions.md)); `L` load on a
gear, `tau` torque of its servo, both at its output; `b` ball-bar angle; `s` elongation of the rod,
or angle of an encoder's shaft; `F` force.

Pictures: an IRB 2400 with the errors of thesis Table 3.1, 600 mm ball-bar, soft servo, 60 s, no
noise; the run with the source minus that without it, unless the axes say otherwise. "Tool, bar -
robot" is the tool by the ball-bar's log minus that by the robot's, with rigid kinematics.
[Largest changes](images/effects/sizes.csv) of every source, in um, urad and N.
"""

ROW = """
### {key}

{what}

![{key}](images/effects/{key}.svg)
{keys}"""

POSES_HEAD = """
## Still poses

With `poses` in place of `path` the robot stands before another instrument; without masses in its
file, and before one that does not pull, the poses are kinematic. A key of another kind of scenario
is refused, unless it states its default.

- With `poses` only: {of_poses}.
- With `path` and a ball-bar with encoders only: {of_ballbar}.
- With `path` only: {of_path}, all other `errors` but {of_both}; of `accept` all but {limits}.
"""


def page_text() -> str:
    """The whole page."""
    keys_described()
    return HEAD + "".join(_sections()) + _still_poses()


def _still_poses() -> str:
    """Which keys belong to a robot that stands still, and which to one that moves."""
    of_path = [key for key in (*OF_PATH, "identify") if not key.startswith("errors.")]
    errors = [f"errors.{name}" for name in models_in(field_at("errors").annotation)[0].model_fields]
    of_both = [key for key in errors if key not in (*OF_PATH, *OF_POSES)]
    names = {
        "of_poses": OF_POSES,
        "of_path": [key for key in of_path if key not in OF_BALLBAR],
        "of_both": of_both,
        "of_ballbar": OF_BALLBAR,
    }
    listed = {k: ", ".join(f"`{key}`" for key in keys) for k, keys in names.items()}
    return POSES_HEAD.format(**listed, limits=", ".join(f"`{key}`" for key in OF_EVERY_RUN))


def _sections() -> Iterator[str]:
    """The keys at the top, then each section: its table, then its sources group by group."""
    yield "\n## At the top\n" + table(plain("", Scenario))
    for section, info in Scenario.model_fields.items():
        for model in models_in(info.annotation):
            yield f"\n## {section}\n\n{first_paragraph(model)}\n{table(plain(section, model))}"
            yield from _pictures(section)
            yield from _without_picture(section, model)


def _without_picture(section: str, model: type[BaseModel]) -> Iterator[str]:
    """Keys of the models below a section that have no picture; keys of one model together."""
    pictured = {source.key for sources in GROUPS.values() for source in sources}
    keys: dict[type[BaseModel], dict[str, FieldInfo]] = {}
    for name, field in model.model_fields.items():
        for inner in models_in(field.annotation):
            if (key := f"{section}.{name}") not in pictured:
                keys.setdefault(inner, {})[key] = field
    for inner, fields in keys.items():
        notes = [
            f"**`{key}`** {field.description or ''}{_many(field)}" for key, field in fields.items()
        ]
        yield "\n" + " ".join((first_paragraph(inner), *notes)) + "\n" + table(inner.model_fields)


def _many(field: FieldInfo) -> str:
    return " A list." if values_text(field).startswith(("list of", "at least")) else ""


def _pictures(section: str) -> Iterator[str]:
    """Group by group, the sources of a section with their pictures."""
    for group, every in GROUPS.items():
        sources = [source for source in every if source.key.split(".")[0] == section]
        if sources:
            yield f"\n**{group}**\n{''.join(map(_row, sources))}"


def _row(source: Source) -> str:
    """Heading, sentences, picture and keys; keys of a model that two sources have stand once."""
    info = field_at(source.key)
    models = models_in(info.annotation)  # none where the key is a row of the section's table
    before = _first_with(models[0], source.key) if models else source.key
    what = first_paragraph(models[0]) if models else ""
    note = f"{info.description or ''}{_many(info)}".strip() if models else ""
    keys = table(models[0].model_fields) if models else ""
    if before != source.key:
        what, keys = f"As `{before}`.", ""
    origin = f"Default: {source.origin}" if source.origin else ""
    what = " ".join(filter(None, (what, source.model, note, _machine(source), origin)))
    return ROW.format(key=source.key, what=what, keys=keys)


def _first_with(model: type[BaseModel], key: str) -> str:
    """The key of the first source, up to one, that has the same model."""
    keys = [source.key for sources in GROUPS.values() for source in sources]
    keys = keys[: keys.index(key) + 1]
    return next(other for other in keys if model in models_in(field_at(other).annotation))


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
    return f"Size: {next(iter(texts.values())) if same else by_robot} ({unit})."


def _numbers(values: ArrayLike) -> str:
    """One value, or the first and the last: the description file has those between."""
    every = np.atleast_1d(np.asarray(values, dtype=float))
    ends = every[[0, -1]] if len(every) > 1 else every
    return " to ".join(value_text(float(f"{value:.3g}")).removesuffix(".0") for value in ends)
