"""Programs for KUKA controllers (KRL, a .src file).

Axis-specific PTP moves, approximated (`C_PTP`) where the path does not stop. `BAS(#VEL_PTP, ...)`
sets the share of the axes' top speeds for each segment, so a run lasts about as long as planned.
Soft servo control depends on the options of the controller, so the program halts where it has to be
switched on and off. Nothing here was run on a controller.

Source: KUKA System Software 8.3, Operating and Programming Instructions for System Integrators.
"""

from __future__ import annotations

from collections.abc import Sequence

from cell.arrays import Array
from cell.descriptions import Robot
from cell.foreign_text import comment
from planning.export import APPROACH_OVERRIDE, BALLBAR, header, speed_shares
from planning.targets import Targets

APPROXIMATION = 50  # [%] of half the way to the next target, $APO.CPTP


def krl(
    name: str, robot: Robot, targets: Targets, limits: Sequence[str], gauge: str = BALLBAR
) -> str:
    """KRL program of a path; arguments as of `planning.export.rapid`."""
    on, off = (
        (f", switch the soft servo {state}" if gauge == BALLBAR else "") for state in ("on", "off")
    )
    lines = [
        ptp(targets.axes[0]),
        f"HALT ; mount the {gauge}, start both logs{on}",
        wait(targets.dwells[0]),
    ]
    shares = speed_shares(robot, targets)
    for axes, dwell, share in zip(targets.axes[1:], targets.dwells[1:], shares, strict=True):
        lines.append(f"BAS(#VEL_PTP,{share})")
        lines += [ptp(axes), wait(dwell)] if dwell > 0.0 else [f"{ptp(axes)} C_PTP"]
    lines.append(f"HALT ; take the {gauge} off{off}")
    return program(name, header(name, robot, targets, limits, gauge), lines)


def program(name: str, comments: Sequence[str], lines: Sequence[str]) -> str:
    """A program that approaches slowly; name : at most 24 letters, digits and underscores."""
    begin = [
        "&ACCESS RVP",
        f"DEF {name}()",
        *(comment(";", line) for line in comments),
        "BAS(#INITMOV,0)",
        f"$APO.CPTP={APPROXIMATION}",
        f"BAS(#VEL_PTP,{APPROACH_OVERRIDE})",
    ]
    return "\r\n".join([*begin, *lines, "END"]) + "\r\n"


def ptp(axes: Array) -> str:
    """A move to axis angles (6,) [deg]."""
    return f"PTP {{{', '.join(f'A{i + 1} {angle:.4f}' for i, angle in enumerate(axes))}}}"


def wait(seconds: float) -> str:
    """A pause."""
    return f"WAIT SEC {seconds:g}"
