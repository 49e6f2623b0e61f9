"""A path for the controller: RAPID module for ABB, PDL2 program for Comau, and a table that anything reads.

RAPID: MoveAbsJ with the time of each segment (`\\T`), soft servo on all axes (SoftAct, Technical reference manual RAPID instructions,
3HAC050917). PDL2: MOVEFLY JOINT with a speed override a segment (PDL2 Programming Language manual, CR00757508); the soft servo is an
option of the controller whose call depends on its release, so the program pauses where it has to be switched on and off.

Both begin with the limits they were planned within, and ask to be run slowly first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cell.arrays import Array
from cell.descriptions import Robot
from planning.targets import Targets

SOFTNESS = 80  # [%] thesis sec. 5.3
FAR = "9E9"  # RAPID's word for an external axis that is not there
ZONE = "z5"  # [mm] within which a target is passed: less than the distance between two
APPROACH = "v20"  # mm/s and deg/s to the first target
APPROACH_OVERRIDE = 3  # [%]


def header(name: str, robot: Robot, targets: Targets, limits: Sequence[str]) -> list[str]:
    """Lines that say what the program is and what it keeps; without comment marks."""
    low, high = targets.axes.min(axis=0), targets.axes.max(axis=0)
    ranges = ", ".join(
        f"{i + 1}: {a:.1f} to {b:.1f}" for i, (a, b) in enumerate(zip(low, high, strict=True))
    )
    return [
        f"{name}: ball-bar path for {robot.title}, {targets.t[-1]:.0f} s, {len(targets.t)} targets in axis angles [deg]",
        "RUN SLOWLY FIRST: without ball-bar, in manual mode at reduced speed, hand on the enabling device.",
        "Planned on nominal geometry; mount the ball-bar only at the first target, at rest.",
        f"Axis ranges used [deg]: {ranges}",
        *limits,
    ]


def rapid(name: str, robot: Robot, targets: Targets, limits: Sequence[str]) -> str:
    """RAPID module. name : of module and procedure, letters, digits and underscores."""
    count = len(targets.t)
    lines = [f"MODULE {name}", *(f"  ! {line}" for line in header(name, robot, targets, limits))]
    lines += [f"  CONST jointtarget path{{{count}}}:=["]
    for k, axes in enumerate(targets.axes):
        numbers = ",".join(f"{angle:.4f}" for angle in axes)
        lines.append(f"    [[{numbers}],[{','.join([FAR] * 6)}]]{',' if k < count - 1 else ''}")
    lines += ["  ];", f"  CONST num seconds{{{count}}}:=[{_numbers(_segments(targets))}];"]
    lines += [
        f"  CONST num rest{{{count}}}:=[{_numbers(targets.rests)}];",
        "",
        f"  PROC {name}_run()",
    ]
    lines += [
        f"    MoveAbsJ path{{1}}\\NoEOffs,{APPROACH},fine,tool0;",
        "    Stop; ! mount the ball-bar, start both logs, then go on",
    ]
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
        "    Stop; ! take the ball-bar off before the servo gets stiff again",
        "    SoftDeact;",
        "  ENDPROC",
        "ENDMODULE",
    ]
    return "\r\n".join(lines) + "\r\n"


def pdl2(name: str, robot: Robot, targets: Targets, limits: Sequence[str]) -> str:
    """PDL2 program. Joint moves take the time that the override gives them, so the run lasts about as long as planned."""
    overrides = _overrides(robot, targets)
    lines = [f"PROGRAM {name} PROG_ARM = 1, STACK = 2048"]
    lines += [f"-- {line}" for line in header(name, robot, targets, limits)]
    lines += ["BEGIN", f"  $PROG_SPD_OVR := {APPROACH_OVERRIDE}"]
    lines += [
        f"  MOVE JOINT TO {_joints(targets.axes[0])}",
        "  PAUSE -- mount the ball-bar, start both logs, switch the soft servo on",
    ]
    lines += [f"  DELAY {targets.rests[0] * 1e3:.0f}"]
    for axes, rest, override in zip(targets.axes[1:], targets.rests[1:], overrides, strict=True):
        lines.append(f"  $PROG_SPD_OVR := {override}")
        lines.append(
            f"  MOVE JOINT TO {_joints(axes)}"
            if rest > 0.0
            else f"  MOVEFLY JOINT TO {_joints(axes)} ADVANCE"
        )
        if rest > 0.0:
            lines.append(f"  DELAY {rest * 1e3:.0f}")
    lines += ["  PAUSE -- take the ball-bar off, switch the soft servo off", f"END {name}"]
    return "\r\n".join(lines) + "\r\n"


def table(name: str, robot: Robot, targets: Targets, limits: Sequence[str]) -> str:
    """CSV: time, six axis angles, rest; comments start with #."""
    lines = [f"# {line}" for line in header(name, robot, targets, limits)]
    lines.append("time_s," + ",".join(f"axis{i}_deg" for i in range(1, 7)) + ",rest_s")
    for t, axes, rest in zip(targets.t, targets.axes, targets.rests, strict=True):
        lines.append(f"{t:.4f}," + ",".join(f"{angle:.4f}" for angle in axes) + f",{rest:g}")
    return "\n".join(lines) + "\n"


def _segments(targets: Targets) -> Array:
    """(K,) [s] from the target before, without the rest there."""
    return np.concatenate(([0.0], np.diff(targets.t) - targets.rests[:-1]))


def _overrides(robot: Robot, targets: Targets) -> list[int]:
    """[%] of the axes' top speeds on the way to each target but the first."""
    speed = np.radians(np.abs(np.diff(targets.axes, axis=0))) / _segments(targets)[1:, None]
    share = (speed / robot.axis_speed_max).max(axis=1)
    return [max(1, round(100.0 * float(s))) for s in share]


def _numbers(values: Array) -> str:
    return ",".join(f"{value:.4g}" for value in values)


def _joints(axes: Array) -> str:
    return "{" + ", ".join(f"{angle:.4f}" for angle in axes) + "}"
