"""Joint targets of an ABB RAPID module: one row for each, as the module lists them.

    CONST jointtarget p10:=[[0,-15.2,30,0,45,10],[9E9,9E9,9E9,9E9,9E9,9E9]];

Angles are degrees of the controller's axes. Targets of an array and of `MoveAbsJ` are read too,
comments (`! ...`) are not. Source: ABB, Technical reference manual RAPID, jointtarget.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from acquisition.table.text import LogText
from cell.errors import LogError

COLUMNS = tuple(f"rax_{k} [deg]" for k in range(1, 7))
_NUMBER = r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*"
_TARGET = re.compile(rf"\[\s*\[{','.join([_NUMBER] * 6)}\]\s*,\s*\[[^\[\]]*\]\s*\]")
_BEGINS = re.compile(r"\bjointtarget\b|\bMoveAbsJ\b", re.IGNORECASE)
_LIST = re.compile(r"\[\s*\[\s*[-+0-9.]")


def holds_jointtargets(text: LogText) -> bool:
    """Whether a text is RAPID code with joint targets."""
    return any(_BEGINS.search(line) and "[" in line for line in text.lines)


def jointtarget_text(text: LogText) -> LogText:
    """A table of COLUMNS with the axis angles [deg] of every joint target.

    Raises LogError for a target that has not six angles, or one of 9E9 (an axis that is absent).
    """
    code = [line.partition("!")[0] for line in text.lines]
    joined, starts = "\n".join(code), np.cumsum([0, *(len(line) + 1 for line in code[:-1])])
    rows, number = ["\t".join(COLUMNS)], [0]
    for statement in re.finditer(r"[^;]*;?", joined):
        if not _BEGINS.search(statement[0]):
            continue
        targets = list(_TARGET.finditer(statement[0]))
        at = statement.start() + (statement[0].find("[") if "[" in statement[0] else 0)
        if len(targets) != len(_LIST.findall(statement[0])) or not statement[0].endswith(";"):
            line = int(text.number[np.searchsorted(starts, at, side="right") - 1])
            raise LogError(
                f"{text.file}:{line}: expected a jointtarget of six angles and six external axes, "
                "such as [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]. Correct the line; is the file "
                "cut off?"
            )
        for target in targets:
            place = statement.start() + target.start()
            line = int(text.number[np.searchsorted(starts, place, side="right") - 1])
            if any(float(angle) > 8.9e9 for angle in target.groups()):
                raise LogError(
                    f"{text.file}:{line}: 9E9 for a robot axis, which stands for an axis that is "
                    "not there. Remove the target."
                )
            rows.append("\t".join(target.groups()))
            number.append(line)
    if len(rows) == 1:
        raise LogError(
            f"{text.file}: RAPID code without jointtargets that hold angles. Positions of the tool "
            "(robtarget) do not state joint angles: export jointtargets."
        )
    return replace(text, lines=rows, number=np.array(number, dtype=np.int64), quoted=False)
