"""A path for the controller: RAPID module for ABB, PDL2 program for Comau, and a CSV table.

Programs for KUKA: planning.krl.

RAPID: MoveAbsJ with the time of each segment (`\\T`), soft servo on all axes (SoftAct, Technical
reference manual RAPID instructions, 3HAC050917). PDL2: MOVEFLY JOINT with a speed override per
segment (PDL2 Programming Language manual, CR00757508). The soft servo is an option of the
controller whose call depends on its release, so the program pauses where it has to be switched on
and off.

Both begin with the limits that the path was planned within, and with the advice to run it slowly
first. For a telescoping bar the servo stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cell.arrays import Array
from cell.descriptions import ProgramLanguage, Robot
from cell.foreign_text import comment
from planning.targets import Targets

BALLBAR, TELESCOPING = "ball-bar", "telescoping bar"  # what holds the tool
PROGRAM_AXES = 6  # of robots that programs are written for
SUFFIXES: dict[ProgramLanguage, str] = {"rapid": "mod", "pdl2": "pdl", "krl": "src"}
SOFTNESS = 80  # [%] thesis sec. 5.3
FAR = "9E9"  # RAPID's value of an external axis that does not exist
ZONE = "z5"  # [mm] within which a target is passed: less than the distance of two targets
APPROACH = "v20"  # mm/s and deg/s to the first target
APPROACH_OVERRIDE = 3  # [%]


def program_files(name: str) -> frozenset[str]:
    """Names of the programs that a plan of this name may have."""
    return frozenset(f"{name}.{suffix}" for suffix in SUFFIXES.values())


def without_program(robot: Robot) -> str:
    """Why no program is written for a robot; empty where one is."""
    if robot.joints != PROGRAM_AXES:
        return f"no program is written: {robot.name} has {robot.joints} axes, programs are for six"
    if robot.program_language is None:
        return (
            f"no program is written: the file of robot {robot.name} states no `program_language` "
            f"({', '.join(SUFFIXES)})"
        )
    return ""


def header(
    name: str, robot: Robot, targets: Targets, limits: Sequence[str], gauge: str = BALLBAR
) -> list[str]:
    """Lines that describe a program and its limits, without comment marks.

    gauge : what holds the tool.
    """
    low, high = targets.axes.min(axis=0), targets.axes.max(axis=0)
    ranges = ", ".join(
        f"{i + 1}: {a:.1f} to {b:.1f}" for i, (a, b) in enumerate(zip(low, high, strict=True))
    )
    return [
        f"{name}: {gauge} path for {robot.title}, {targets.t[-1]:.0f} s, {len(targets.t)} targets "
        "in axis angles [deg]",
        f"RUN SLOWLY FIRST: without {gauge}, in manual mode at reduced speed, "
        "hand on the enabling device.",
        f"Planned on nominal geometry; mount the {gauge} only at the first target, at rest.",
        f"Axis ranges used [deg]: {ranges}",
        *limits,
    ]


def rapid(
    name: str, robot: Robot, targets: Targets, limits: Sequence[str], gauge: str = BALLBAR
) -> str:
    """RAPID module of a path.

    name : of module and procedure, of letters, digits and underscores. limits : lines of the
        header. gauge : what holds the tool: a ball-bar needs a soft servo.
    """
    count = len(targets.t)
    lines = [
        f"MODULE {name}",
        *(comment("  !", line) for line in header(name, robot, targets, limits, gauge)),
    ]
    soft = gauge == BALLBAR
    lines += [f"  CONST jointtarget path{{{count}}}:=["]
    for k, axes in enumerate(targets.axes):
        numbers = ",".join(f"{angle:.4f}" for angle in axes)
        lines.append(f"    [[{numbers}],[{','.join([FAR] * 6)}]]{',' if k < count - 1 else ''}")
    lines += ["  ];", f"  CONST num seconds{{{count}}}:=[{_numbers(_segments(targets))}];"]
    lines += [
        f"  CONST num rest{{{count}}}:=[{_numbers(targets.dwells)}];",
        "",
        f"  PROC {name}_run()",
    ]
    lines += [
        f"    MoveAbsJ path{{1}}\\NoEOffs,{APPROACH},fine,tool0;",
        f"    Stop; ! mount the {gauge}, start both logs, then go on",
    ]
    if soft:
        lines += [f"    SoftAct {axis},{SOFTNESS}\\Ramp:=100;" for axis in range(1, 7)]
    lines += [
        "    WaitTime rest{1};",
        f"    FOR i FROM 2 TO {count} DO",
        "      IF rest{i}>0 THEN",
        "        MoveAbsJ path{i}\\NoEOffs,v100\\T:=seconds{i},z0,tool0;",
        "        WaitTime rest{i};",
        "      ELSE",
        f"        MoveAbsJ path{{i}}\\NoEOffs,v100\\T:=seconds{{i}},{ZONE},tool0;",
        "      ENDIF",
        "    ENDFOR",
    ]
    if soft:
        lines += ["    Stop; ! take the ball-bar off before the servo gets stiff again"]
        lines += ["    SoftDeact;"]
    else:
        lines += [f"    Stop; ! take the {gauge} off"]
    lines += ["  ENDPROC", "ENDMODULE"]
    return "\r\n".join(lines) + "\r\n"


def pdl2(
    name: str, robot: Robot, targets: Targets, limits: Sequence[str], gauge: str = BALLBAR
) -> str:
    """PDL2 program of a path; arguments as of `rapid`.

    Joint moves take the time that the override gives them, so a run lasts about as long as planned.
    """
    overrides, soft = speed_shares(robot, targets), gauge == BALLBAR
    lines = [f"PROGRAM {name} PROG_ARM = 1, STACK = 2048"]
    lines += [comment("--", line) for line in header(name, robot, targets, limits)]
    lines += ["BEGIN", f"  $PROG_SPD_OVR := {APPROACH_OVERRIDE}"]
    lines += [
        f"  MOVE JOINT TO {_joints(targets.axes[0])}",
        f"  PAUSE -- mount the {gauge}, start both logs"
        + (", switch the soft servo on" if soft else ""),
    ]
    lines += [f"  DELAY {targets.dwells[0] * 1e3:.0f}"]
    for axes, dwell, override in zip(targets.axes[1:], targets.dwells[1:], overrides, strict=True):
        lines.append(f"  $PROG_SPD_OVR := {override}")
        lines.append(
            f"  MOVE JOINT TO {_joints(axes)}"
            if dwell > 0.0
            else f"  MOVEFLY JOINT TO {_joints(axes)} ADVANCE"
        )
        if dwell > 0.0:
            lines.append(f"  DELAY {dwell * 1e3:.0f}")
    off = ", switch the soft servo off" if soft else ""
    lines += [f"  PAUSE -- take the {gauge} off{off}", f"END {name}"]
    return "\r\n".join(lines) + "\r\n"


def table(
    name: str, robot: Robot, targets: Targets, limits: Sequence[str], gauge: str = BALLBAR
) -> str:
    """CSV table of a path with columns time, axis angles and dwell; comments start with #."""
    lines = [comment("#", line) for line in header(name, robot, targets, limits, gauge)]
    axes_deg = (f"axis{i + 1}_deg" for i in range(robot.joints))
    lines.append(f"time_s,{','.join(axes_deg)},rest_s")
    for t, axes, dwell in zip(targets.t, targets.axes, targets.dwells, strict=True):
        lines.append(f"{t:.4f}," + ",".join(f"{angle:.4f}" for angle in axes) + f",{dwell:g}")
    return "\n".join(lines) + "\n"


def _segments(targets: Targets) -> Array:
    """(K,) [s] from the previous target to each one, without the dwell there."""
    return np.concatenate(([0.0], np.diff(targets.t) - targets.dwells[:-1]))


def speed_shares(robot: Robot, targets: Targets) -> list[int]:
    """Share [%] of the axes' top speeds on the way to each target but the first, at least 1."""
    speed = np.radians(np.abs(np.diff(targets.axes, axis=0))) / _segments(targets)[1:, None]
    share = (speed / robot.axis_speed_max).max(axis=1)
    return [max(1, round(100.0 * float(s))) for s in share]


def _numbers(values: Array) -> str:
    return ",".join(f"{value:.4g}" for value in values)


def _joints(axes: Array) -> str:
    return "{" + ", ".join(f"{angle:.4f}" for angle in axes) + "}"
