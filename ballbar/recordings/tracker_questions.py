"""Questions of `ballbar new` about the log of what followed the tool: columns and units."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, get_args

from ballbar.cell.file_units import METRES, AngleUnit
from ballbar.cell.instruments.base import Instrument
from ballbar.recordings.answers import Answers
from ballbar.recordings.dialect_questions import named_columns
from ballbar.recordings.preview import LogPreview
from ballbar.recordings.proposals import ColumnNames, value_columns
from ballbar.recordings.questions import Ask, answer, one_of


def target_columns(
    log: LogPreview, instrument: Instrument, answers: Answers, ask: Ask
) -> list[str]:
    """Columns of the target's position, and of the rotation of a pose.

    Those whose names say so are proposed if they are the only ones: a table may also hold what the
    controller thinks of its tool, and the robot would fit that too well.
    """
    turns = instrument.kind.target_turns
    seen = value_columns(ColumnNames(tuple(log.columns), counted=False), instrument.kind, ())
    proposal = ", ".join(seen[0]) if len(seen) == 1 else None
    listed = "; or ".join(map(", ".join, seen)) or ", ".join(log.columns)
    what = "x, y, z and the rotation" if turns else "x, y and z"
    question = f"{log.name}: which columns hold {what} of the target? Likely ones: {listed}."
    counts, expected = ((6, 7), "6 or 7") if turns else ((3,), "3")
    check = partial(named_columns, names=log.columns, counts=counts, expected=expected)
    return answer(answers.values, question, proposal, check, ask)


def target_units(
    columns: Sequence[str], unit: str | None, answers: Answers, ask: Ask
) -> dict[str, Any]:
    """Unit of positions, form and unit of rotations, as recording.yaml has them.

    unit : in which the positions spread as the robot's flange does.
    """
    turns = list(columns[3:])
    question = f"unit of {', '.join(columns[:3])}? ({', '.join(METRES)})"
    declared: dict[str, Any] = {
        "unit": answer(answers.value_unit, question, unit, one_of(*METRES), ask)
    }
    if not turns:
        return declared
    named = "quat_" + "".join(name[-1].lower() for name in turns) if len(turns) == 4 else None
    question = f"convention of {', '.join(turns)}? (XYZ and the like, rotvec, quat_wxyz, quat_xyzw)"
    form = answer(answers.rotation, question, named, str, ask)
    declared["rotation"] = {"columns": turns, "form": form}
    if not form.startswith("quat"):
        question = "unit of the rotation's angles? (rad or deg)"
        check = one_of(*get_args(AngleUnit))
        declared["rotation"]["unit"] = answer(answers.angle_unit, question, None, check, ask)
    return declared
