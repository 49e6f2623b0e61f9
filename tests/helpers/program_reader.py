"""Reads back what ballbar.planning.programs writes: RAPID, PDL2 and KRL of a path, nothing else."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array

NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"


@dataclass(frozen=True, eq=False)
class Program:
    """The moves and rests that a controller would make."""

    axes: Array  # (K, 6) [deg]
    rests: Array  # (K,) [s]
    seconds: Array  # (K,) [s] on the way to each target; PDL2 and KRL: 0
    overrides: Array  # (K,) [%] PDL2 and KRL; RAPID: 0
    softness: dict[int, float]  # [%] by axis
    comments: list[str]


def read_rapid(text: str) -> Program:
    """Raises ValueError for a line that is not understood."""
    lines = [line.strip() for line in text.split("\r\n")]
    comments = [line[1:].strip() for line in lines if line.startswith("!")]
    code = [line.split("!")[0].strip() for line in lines if line and not line.startswith("!")]
    name = re.fullmatch(r"MODULE (\w+)", code[0])
    if not name or code[-1] != "ENDMODULE":
        raise ValueError("no module")
    joined = "\n".join(code)
    targets = re.findall(rf"\[\[((?:{NUMBER},){{5}}{NUMBER})\],\[(?:9E9,){{5}}9E9\]\]", joined)
    axes = np.array([[float(x) for x in t.split(",")] for t in targets])
    count = re.search(r"CONST jointtarget path\{(\d+)\}:=\[", joined)
    assert count
    assert int(count[1]) == len(axes)
    lists = {
        key: np.array([float(x) for x in _list(joined, key, len(axes))])
        for key in ("seconds", "rest")
    }
    known = (
        r"MODULE \w+", r"ENDMODULE", r"PROC \w+\(\)", r"ENDPROC", r"CONST .*", r"\[\[.*", r"\];",
        r"MoveAbsJ .*;", r"Stop;", r"WaitTime rest\{\w+\};", r"SoftAct \d,\d+\\Ramp:=\d+;",
        r"SoftDeact;", rf"FOR i FROM 2 TO {len(axes)} DO", r"ENDFOR", r"IF rest\{i\}>0 THEN",
        r"ELSE", r"ENDIF",
    )  # fmt: skip
    for line in code:
        if not any(re.fullmatch(pattern, line) for pattern in known):
            raise ValueError(f"not RAPID as we write it: {line}")
    for move in re.findall(r"MoveAbsJ (.*);", joined):
        if not re.fullmatch(
            r"path\{(?:1|i)\}\\NoEOffs,v\d+(?:\\T:=seconds\{i\})?,(?:fine|z\d+),tool0", move
        ):
            raise ValueError(move)
    softness = {int(a): float(s) for a, s in re.findall(r"SoftAct (\d),(\d+)", joined)}
    return Program(axes, lists["rest"], lists["seconds"], np.zeros(len(axes)), softness, comments)


def _list(text: str, key: str, count: int) -> list[str]:
    found = re.search(rf"CONST num {key}\{{{count}\}}:=\[([^\]]*)\];", text)
    assert found, key
    return found[1].split(",")


def read_pdl2(text: str) -> Program:
    """Raises ValueError for a line that is not understood."""
    lines = [line.strip() for line in text.split("\r\n") if line.strip()]
    name = re.fullmatch(r"PROGRAM (\w+) PROG_ARM = 1, STACK = \d+", lines[0])
    if not name or lines[-1] != f"END {name[1]}":
        raise ValueError("no program")
    comments, axes, rests, overrides, override = [], [], [], [], 0.0
    for line in lines[1:-1]:
        if line.startswith("--"):
            comments.append(line[2:].strip())
            continue
        code = line.split("--")[0].strip()
        if move := re.fullmatch(
            rf"(MOVE|MOVEFLY) JOINT TO \{{((?:{NUMBER}, ){{5}}{NUMBER})\}}( ADVANCE)?", code
        ):
            assert (move[1] == "MOVEFLY") == bool(move[3])
            axes.append([float(x) for x in move[2].split(", ")])
            rests.append(0.0)
            overrides.append(override)
        elif delay := re.fullmatch(r"DELAY (\d+)", code):
            rests[-1] = float(delay[1]) * 1e-3
        elif changed := re.fullmatch(r"\$PROG_SPD_OVR := (\d+)", code):
            override = float(changed[1])
        elif code not in ("BEGIN", "PAUSE"):
            raise ValueError(f"not PDL2 as we write it: {line}")
    return Program(
        np.array(axes), np.array(rests), np.zeros(len(axes)), np.array(overrides), {}, comments
    )


def read_krl(text: str) -> Program:
    """Raises ValueError for a line that is not understood."""
    lines = [line.strip() for line in text.split("\r\n") if line.strip()]
    if lines[0] != "&ACCESS RVP" or not re.fullmatch(r"DEF \w{1,24}\(\)", lines[1]):
        raise ValueError("no program")
    if lines[-1] != "END":
        raise ValueError("no end")
    comments, axes, rests, overrides, override, exact = [], [], [], [], 0.0, False
    for line in lines[2:-1]:
        if line.startswith(";"):
            comments.append(line[1:].strip())
            continue
        code = line.split(";")[0].strip()
        target = ", ".join(rf"A{axis} ({NUMBER})" for axis in range(1, 7))
        if move := re.fullmatch(rf"PTP \{{{target}\}}( C_PTP)?", code):
            axes.append([float(x) for x in move.groups()[:6]])
            rests.append(0.0)
            overrides.append(override)
            exact = not move[7]
        elif delay := re.fullmatch(rf"WAIT SEC ({NUMBER})", code):
            assert exact, "a target that is passed is not waited at"
            rests[-1] = float(delay[1])
        elif changed := re.fullmatch(r"BAS\(#VEL_PTP,(\d+)\)", code):
            override = float(changed[1])
            assert 1 <= override <= 100
        elif code not in ("BAS(#INITMOV,0)", "$APO.CPTP=50", "HALT"):
            raise ValueError(f"not KRL as we write it: {line}")
    return Program(
        np.array(axes), np.array(rests), np.zeros(len(axes)), np.array(overrides), {}, comments
    )
