"""Programs of a plan for the controller: RAPID for ABB, PDL2 for Comau, KRL for KUKA.

RAPID: MoveAbsJ, on a path with the time of each segment (`\\T`) and soft servo on all axes
(SoftAct, Technical reference manual RAPID instructions, 3HAC050917). PDL2: MOVE and MOVEFLY JOINT
with a speed override (PDL2 Programming Language manual, CR00757508). KRL: axis-specific PTP moves,
approximated (`C_PTP`) where the robot does not stop, with the share of the axes' top speeds (KUKA
System Software 8.3, Operating and Programming Instructions for System Integrators). An override
gives each segment its time, so a run lasts about as long as planned. In PDL2 and KRL the call of
the soft servo depends on options of the controller, so the program pauses where it has to be
switched on and off. Nothing here was run on a controller.

All begin with the limits that were planned within, and with the advice to run slowly first. For a
telescoping bar and for still poses the servo stays as it is. At each pose the robot waits for the
settling time or, where a person has to attach the instrument, the program stops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import ProgramLanguage, Robot
from ballbar.cell.foreign_text import comment
from ballbar.cell.poses import Measured
from ballbar.planning.pose_plan import PosePlan
from ballbar.planning.trajectory import Targets

# what holds the tool, or is followed on it
BALLBAR, TELESCOPING, TRACKED = "ball-bar", "telescoping bar", "tracked target"
ATTACHED: frozenset[Measured] = frozenset({"length", "socket"})  # a person attaches these
PROGRAM_AXES = 6  # of robots that programs are written for
SUFFIXES: dict[ProgramLanguage, str] = {"rapid": "mod", "pdl2": "pdl", "krl": "src"}
SOFTNESS = 80  # [%] thesis sec. 5.3
FAR = ",".join(["9E9"] * 6)  # RAPID's values of external axes that do not exist
ZONE = "z5"  # [mm] within which a target is passed: less than the distance of two targets
APPROACH, POSE_SPEED = "v20", "v100"  # mm/s and deg/s to the first target, and between poses
APPROACH_OVERRIDE = 3  # [%]
APPROXIMATION = 50  # [%] of half the way to the next target, KRL's $APO.CPTP

# Axis angles (6,) [deg] of a target at which the robot stops, that it passes, and of an
# intermediate pose; share [%] of the top speeds; seconds; what a person does meanwhile.
Step = tuple[Literal["stop", "pass", "intermediate", "speed", "wait", "pause"], Any]


@dataclass(frozen=True, eq=False)
class ProgrammedPath:
    """A path, as a program of it needs it."""

    name: str  # of module and procedure, at most 24 letters, digits and underscores
    robot: Robot
    targets: Targets
    limits: Sequence[str]  # lines of the header
    gauge: str = BALLBAR  # what is mounted: a ball-bar needs a soft servo

    @property
    def soft(self) -> bool:
        """Whether the servo is soft along the path."""
        return self.gauge == BALLBAR

    @property
    def segments(self) -> Array:
        """(K,) [s] from the previous target to each one, without the dwell there."""
        targets = self.targets
        return np.concatenate(([0.0], np.diff(targets.t) - targets.dwells[:-1]))

    @property
    def header(self) -> list[str]:
        """Lines that describe the program, without comment marks."""
        targets, gauge = self.targets, self.gauge
        return [
            f"{self.name}: {gauge} path for {self.robot.title}, {targets.t[-1]:.0f} s, "
            f"{len(targets.t)} targets in axis angles [deg]",
            f"RUN SLOWLY FIRST: without {gauge}, in manual mode at reduced speed, "
            "hand on the enabling device.",
            f"Planned on nominal geometry; mount the {gauge} only at the first target, at rest.",
            _ranges(targets.axes),
            *self.limits,
        ]


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


def path_program(language: ProgramLanguage, path: ProgrammedPath) -> str:
    """Program of a path."""
    if language == "rapid":
        return _rapid(path.name, path.header, _rapid_path(path))
    return _WRITERS[language](path.name, path.header, _path_steps(path))


def pose_program(language: ProgramLanguage, plan: PosePlan) -> str:
    """Program of a plan of still poses."""
    name, header = plan.setup.request.name, _pose_header(plan)
    if language == "rapid":
        return _rapid(name, header, _rapid_poses(plan))
    steps = [step for _, steps in _pose_steps(plan) for step in steps]
    return _WRITERS[language](name, header, steps)


def _pose_header(plan: PosePlan) -> list[str]:
    setup, limits = plan.setup, plan.setup.request.limits
    lines = [
        f"{setup.request.name}: {plan.poses.size} still poses of {setup.robot.title} for "
        f"{setup.instrument.title}, axis angles [deg]",
        "RUN SLOWLY FIRST: without the instrument, in manual mode at reduced speed, hand on the "
        "enabling device.",
        "Planned on nominal geometry; radii of the arm are assumed, tool and cables unknown.",
        _ranges(np.degrees(plan.poses.axes)),
        f"Planned within: {limits.axis_margin_deg:g} deg inside each axis range, clearance "
        f"{limits.clearance_m * 1e3:g} mm.",
    ]
    if plan.route.blocked:
        numbers = ", ".join(str(k + 1) for k in plan.route.blocked)
        lines.append(f"MOVES THAT COME TOO CLOSE lead to poses {numbers}: change them first.")
    return lines


def _ranges(axes: Array) -> str:
    """Line of the header with the ranges of axis angles (K, J) [deg]."""
    ends = enumerate(zip(axes.min(axis=0), axes.max(axis=0), strict=True))
    return "Axis ranges used [deg]: " + ", ".join(
        f"{i + 1}: {a:.1f} to {b:.1f}" for i, (a, b) in ends
    )


def _path_steps(path: ProgrammedPath) -> Iterator[Step]:
    """Steps of a path in PDL2 and KRL."""
    on, off = ((f", switch the soft servo {s}" if path.soft else "") for s in ("on", "off"))
    axes, dwells = path.targets.axes, path.targets.dwells
    yield "stop", axes[0]
    yield "pause", f"mount the {path.gauge}, start both logs{on}"
    yield "wait", dwells[0]
    speed = np.radians(np.abs(np.diff(axes, axis=0))) / path.segments[1:, None]
    shares = (speed / path.robot.axis_speed_max).max(axis=1)
    for angles, dwell, share in zip(axes[1:], dwells[1:], shares, strict=True):
        yield "speed", max(1, round(100.0 * float(share)))
        if dwell > 0.0:
            yield "stop", angles
            yield "wait", dwell
        else:
            yield "pass", angles
    yield "pause", f"take the {path.gauge} off{off}"


def _pose_steps(plan: PosePlan) -> Iterator[tuple[str, list[Step]]]:
    """Name of each target of a program in their order, and the steps there."""
    setup = plan.setup
    measure: Step = ("wait", setup.request.settle_s)
    if setup.instrument.measured in ATTACHED:
        measure = ("pause", "attach the instrument and measure, then go on")
    for k, axes in enumerate(np.degrees(plan.poses.axes)):
        if k in plan.route.passing:
            for letter, middle in zip("ab", np.degrees(plan.route.passing[k]), strict=True):
                yield f"via{k + 1}{letter}", [("intermediate", middle)]
        yield f"p{k + 1}", [("stop", axes), measure]


def _pdl2(name: str, header: Sequence[str], steps: Iterable[Step]) -> str:
    texts: dict[str, Callable[[Any], str]] = {
        "stop": lambda axes: f"MOVE JOINT TO {{{_angles(axes, ', ')}}}",
        "intermediate": lambda axes: f"MOVE JOINT TO {{{_angles(axes, ', ')}}}",
        "pass": lambda axes: f"MOVEFLY JOINT TO {{{_angles(axes, ', ')}}} ADVANCE",
        "speed": lambda share: f"$PROG_SPD_OVR := {share}",
        "wait": lambda seconds: f"DELAY {seconds * 1e3:.0f}",
        "pause": lambda text: f"PAUSE -- {text}",
    }
    return _lines(
        f"PROGRAM {name} PROG_ARM = 1, STACK = 2048",
        *(comment("--", line) for line in header),
        "BEGIN",
        *(f"  {texts[kind](value)}" for kind, value in [("speed", APPROACH_OVERRIDE), *steps]),
        f"END {name}",
    )


def _krl(name: str, header: Sequence[str], steps: Iterable[Step]) -> str:
    def ptp(axes: Array) -> str:
        return f"PTP {{{', '.join(f'A{i + 1} {angle:.4f}' for i, angle in enumerate(axes))}}}"

    texts: dict[str, Callable[[Any], str]] = {
        "stop": ptp,
        "intermediate": lambda axes: f"{ptp(axes)} C_PTP",
        "pass": lambda axes: f"{ptp(axes)} C_PTP",
        "speed": lambda share: f"BAS(#VEL_PTP,{share})",
        "wait": lambda seconds: f"WAIT SEC {seconds:g}",
        "pause": lambda text: f"HALT ; {text}",
    }
    return _lines(
        "&ACCESS RVP",
        f"DEF {name}()",
        *(comment(";", line) for line in header),
        "BAS(#INITMOV,0)",
        f"$APO.CPTP={APPROXIMATION}",
        *(texts[kind](value) for kind, value in [("speed", APPROACH_OVERRIDE), *steps]),
        "END",
    )


_WRITERS = {"pdl2": _pdl2, "krl": _krl}


def _rapid(name: str, header: Sequence[str], lines: Iterable[str]) -> str:
    """RAPID module with the lines of declarations and procedure, without their indentation."""
    begin = [f"MODULE {name}", *(comment("  !", line) for line in header)]
    return _lines(
        *begin, *(f"  {line}" if line else "" for line in lines), "  ENDPROC", "ENDMODULE"
    )


def _rapid_path(path: ProgrammedPath) -> Iterator[str]:
    targets, gauge, count = path.targets, path.gauge, len(path.targets.t)
    yield f"CONST jointtarget path{{{count}}}:=["
    for k, axes in enumerate(targets.axes):
        yield f"  [[{_angles(axes, ',')}],[{FAR}]]{',' if k < count - 1 else ''}"
    yield "];"
    for array, values in (("seconds", path.segments), ("rest", targets.dwells)):
        yield f"CONST num {array}{{{count}}}:=[{','.join(f'{value:.4g}' for value in values)}];"
    yield from ("", f"PROC {path.name}_run()")
    yield f"  MoveAbsJ path{{1}}\\NoEOffs,{APPROACH},fine,tool0;"
    yield f"  Stop; ! mount the {gauge}, start both logs, then go on"
    if path.soft:
        yield from (f"  SoftAct {axis},{SOFTNESS}\\Ramp:=100;" for axis in range(1, 7))
    yield from (
        "  WaitTime rest{1};",
        f"  FOR i FROM 2 TO {count} DO",
        "    IF rest{i}>0 THEN",
        "      MoveAbsJ path{i}\\NoEOffs,v100\\T:=seconds{i},z0,tool0;",
        "      WaitTime rest{i};",
        "    ELSE",
        f"      MoveAbsJ path{{i}}\\NoEOffs,v100\\T:=seconds{{i}},{ZONE},tool0;",
        "    ENDIF",
        "  ENDFOR",
    )
    before = " before the servo gets stiff again" if path.soft else ""
    yield f"  Stop; ! take the {gauge} off{before}"
    if path.soft:
        yield "  SoftDeact;"


def _rapid_poses(plan: PosePlan) -> Iterator[str]:
    steps = list(_pose_steps(plan))
    for name, ((_, axes), *_) in steps:
        yield f"CONST jointtarget {name}:=[[{_angles(axes, ',')}],[{FAR}]];"
    yield from ("", f"PROC {plan.setup.request.name}_run()")
    for name, ((kind, _), *measure) in steps:
        zone = "fine" if kind == "stop" else "z50"
        yield f"  MoveAbsJ {name}\\NoEOffs,{POSE_SPEED},{zone},tool0;"
        for action, value in measure:
            yield f"  Stop; ! {value}" if action == "pause" else f"  WaitTime {value:g};"


def _lines(*lines: str) -> str:
    return "\r\n".join(lines) + "\r\n"


def _angles(axes: Array, separator: str) -> str:
    return separator.join(f"{angle:.4f}" for angle in axes)


def path_table(path: ProgrammedPath) -> str:
    """CSV table of a path with columns time, axis angles and dwell; comments start with #."""
    targets = path.targets
    lines = [comment("#", line) for line in path.header]
    lines.append(f"time_s,{','.join(axis_columns(path.robot))},rest_s")
    for t, axes, dwell in zip(targets.t, targets.axes, targets.dwells, strict=True):
        lines.append(f"{t:.4f},{_angles(axes, ',')},{dwell:g}")
    return "\n".join(lines) + "\n"


def pose_table(plan: PosePlan, columns: Sequence[str]) -> str:
    """CSV table of still poses, with empty columns for what the instrument measures."""
    setup, poses = plan.setup, plan.poses
    lines = [",".join(("pose", "seat", "target", *axis_columns(setup.robot), *columns))]
    for k, axes in enumerate(np.degrees(poses.axes)):
        station = setup.stations[int(poses.station[k])]
        empty = ("",) * len(columns)
        lines.append(
            ",".join((str(k + 1), station.seat, station.target, _angles(axes, ","), *empty))
        )
    return "\n".join(lines) + "\n"


def picture_table(plan: PosePlan) -> str:
    """CSV table of the pictures to take: their names, and the axis angles."""
    axes = [f"J{j + 1} [deg]" for j in range(plan.setup.robot.joints)]
    rows = (f"p{k:03d}.jpg,{_angles(q, ',')}" for k, q in enumerate(np.degrees(plan.poses.axes), 1))
    return "\n".join((",".join(("image", *axes)), *rows)) + "\n"


def axis_columns(robot: Robot) -> list[str]:
    """Names of the columns of the axis angles."""
    return [f"axis{i + 1}_deg" for i in range(robot.joints)]
