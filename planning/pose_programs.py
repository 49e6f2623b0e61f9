"""Still poses for the controller and `ballbar check`: RAPID, PDL2, KRL, a CSV table, poses.yaml.

RAPID: MoveAbsJ to jointtargets (Technical reference manual RAPID instructions, 3HAC050917). PDL2:
MOVE JOINT (PDL2 Programming Language manual, CR00757508). KRL: as in planning.krl. All are for
six axes. At each pose they wait for the settling time, or, where a person has to attach the
instrument, stop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cell.arrays import Array
from cell.files import portable_name
from cell.foreign_text import comment
from cell.poses import Measured
from planning.export import APPROACH_OVERRIDE, FAR
from planning.krl import program, ptp
from planning.pose_plan import PosePlan
from planning.stations import PoseSetup

SPEED = "v100"  # mm/s and deg/s of the moves
ATTACHED: frozenset[Measured] = frozenset({"length", "socket"})  # a person attaches these
# columns of poses.csv that are filled in, and their keys in poses.yaml
VALUES: dict[Measured, tuple[tuple[str, ...], dict[str, str]]] = {
    "length": (("length_mm",), {"unit": "mm"}),
    "point": (("x_mm", "y_mm", "z_mm"), {"unit": "mm"}),
    "pose": (
        ("x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"),
        {"unit": "mm", "angle_unit": "deg", "rotation": "XYZ"},
    ),
    "socket": ((), {}),
}


@dataclass(frozen=True, eq=False)
class _Stop:
    """A target of a program: a pose, or an intermediate pose before it."""

    name: str
    axes: Array  # (J,) [deg]
    measured: bool


def header(plan: PosePlan) -> list[str]:
    """Lines that describe a program, without comment marks."""
    setup, route = plan.setup, plan.route
    axes = np.degrees(plan.poses.axes)
    limits = setup.request.limits
    ranges = ", ".join(
        f"{i + 1}: {a:.1f} to {b:.1f}"
        for i, (a, b) in enumerate(zip(axes.min(axis=0), axes.max(axis=0), strict=True))
    )
    lines = [
        f"{setup.request.name}: {plan.poses.size} still poses of {setup.robot.title} for "
        f"{setup.instrument.title}, axis angles [deg]",
        "RUN SLOWLY FIRST: without the instrument, in manual mode at reduced speed, hand on the "
        "enabling device.",
        "Planned on nominal geometry; radii of the arm are assumed, tool and cables unknown.",
        f"Axis ranges used [deg]: {ranges}",
        f"Planned within: {limits.axis_margin_deg:g} deg inside each axis range, clearance "
        f"{limits.clearance_m * 1e3:g} mm.",
    ]
    if route.blocked:
        numbers = ", ".join(str(k + 1) for k in route.blocked)
        lines.append(f"MOVES THAT COME TOO CLOSE lead to poses {numbers}: change them first.")
    return lines


def rapid_poses(plan: PosePlan) -> str:
    """RAPID module of a plan."""
    name, stops = plan.setup.request.name, list(_stops(plan))
    lines = [f"MODULE {name}", *(comment("  !", line) for line in header(plan))]
    for stop in stops:
        numbers = ",".join(f"{angle:.4f}" for angle in stop.axes)
        lines.append(f"  CONST jointtarget {stop.name}:=[[{numbers}],[{','.join([FAR] * 6)}]];")
    lines += ["", f"  PROC {name}_run()"]
    for stop in stops:
        zone = "fine" if stop.measured else "z50"
        lines.append(f"    MoveAbsJ {stop.name}\\NoEOffs,{SPEED},{zone},tool0;")
        if stop.measured:
            lines += [f"    {text}" for text in _rest(plan.setup, "Stop; !", "WaitTime {};", 1.0)]
    lines += ["  ENDPROC", "ENDMODULE"]
    return "\r\n".join(lines) + "\r\n"


def pdl2_poses(plan: PosePlan) -> str:
    """PDL2 program of a plan."""
    name = plan.setup.request.name
    lines = [f"PROGRAM {name} PROG_ARM = 1, STACK = 2048"]
    lines += [comment("--", line) for line in header(plan)]
    lines += ["BEGIN", f"  $PROG_SPD_OVR := {APPROACH_OVERRIDE}"]
    for stop in _stops(plan):
        lines.append(f"  MOVE JOINT TO {{{', '.join(f'{angle:.4f}' for angle in stop.axes)}}}")
        if stop.measured:
            lines += [f"  {text}" for text in _rest(plan.setup, "PAUSE --", "DELAY {}", 1e3)]
    lines.append(f"END {name}")
    return "\r\n".join(lines) + "\r\n"


def krl_poses(plan: PosePlan) -> str:
    """KRL program of a plan."""
    lines = []
    for stop in _stops(plan):
        lines.append(ptp(stop.axes) + ("" if stop.measured else " C_PTP"))
        if stop.measured:
            lines += _rest(plan.setup, "HALT ;", "WAIT SEC {}", 1.0)
    return program(plan.setup.request.name, header(plan), lines)


def pose_table(plan: PosePlan) -> str:
    """CSV table of the poses, with empty columns for what the instrument measures."""
    setup, poses = plan.setup, plan.poses
    columns = VALUES[setup.instrument.measured][0]
    lines = [",".join(("pose", "seat", "target", *axis_columns(setup), *columns))]
    for k, axes in enumerate(np.degrees(poses.axes)):
        station = setup.stations[int(poses.station[k])]
        angles = (f"{angle:.4f}" for angle in axes)
        cells = (str(k + 1), station.seat, station.target, *angles, *("" for _ in columns))
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def axis_columns(setup: PoseSetup) -> list[str]:
    """Names of the columns of the axis angles."""
    return [f"axis{i + 1}_deg" for i in range(setup.robot.joints)]


def poses_data(
    setup: PoseSetup, table: str, *, relative_to: Path, folder: Path
) -> dict[str, object]:
    """poses.yaml of the filled table; folder : where it stands, relative_to : the request's.

    Files of one's own are copied into the folder.
    """
    request = setup.request
    columns, keys = VALUES[setup.instrument.measured]
    entry: dict[str, object] = {
        "files": [table],
        "joints": {"columns": axis_columns(setup), "unit": "deg", "angles": "axes"},
    }
    if columns:
        entry["values"] = {"columns": list(columns), **keys}
    entry |= {"seat": {"column": "seat"}, "target": {"column": "target"}}
    data: dict[str, object] = {
        "schema": "ballbar-poses/1",
        "kind": "real",
        "robot": portable_name(request.robot, "robot", relative_to=relative_to, folder=folder),
        "instrument": portable_name(
            request.instrument, "instrument", relative_to=relative_to, folder=folder
        ),
        "tables": [entry],
    }
    if request.distances:
        data["distances"] = [
            d.model_dump(mode="json", exclude_none=True) for d in request.distances
        ]
    data["notes"] = (
        "Planned poses. Fill in what was measured, and replace the angles by those that the "
        "controller showed. Rows without values are left out."
    )
    return data


def _stops(plan: PosePlan) -> Iterator[_Stop]:
    """Targets of a program in their order."""
    for k, axes in enumerate(np.degrees(plan.poses.axes)):
        if k in plan.route.passing:
            for letter, middle in zip("ab", np.degrees(plan.route.passing[k]), strict=True):
                yield _Stop(f"via{k + 1}{letter}", middle, measured=False)
        yield _Stop(f"p{k + 1}", axes, measured=True)


def _rest(setup: PoseSetup, stop: str, wait: str, unit: float) -> list[str]:
    """Lines of the rest at a pose; unit : of the language's waiting time, per second."""
    if setup.instrument.measured in ATTACHED:
        return [f"{stop} attach the instrument and measure, then go on"]
    return [wait.format(f"{setup.request.settle_s * unit:g}")]
