"""What was repaired in the logs of a recording or left out of them, in words."""

from __future__ import annotations

from collections.abc import Sequence

from ident.signals.smooth_log import Outliers, SmoothLog
from ident.signals.step_fault import StepFault


def log_remarks(
    robot: SmoothLog, bar: SmoothLog | None, joints: tuple[int, ...], events: Sequence[StepFault]
) -> tuple[str, ...]:
    """A sentence for each event, each further repair, and the outliers of each log; joints : encoders of the ball-bar."""
    remarks = [event.sentence for event in events]
    for one in robot.breaks:
        if one.channel is not None:
            remarks.append(
                f"robot joint {one.channel + 1} jumped by {one.size * 1e3:+.3f} mrad at row {one.row} of its log; taken out of it"
            )
        elif bar is None:
            remarks.append(
                f"the robot's clock stepped by {one.size * 1e3:+.1f} ms at row {one.row} of its log; taken out of it"
            )
    remarks += _left_out("robot", robot.outliers, [f"joint {j}" for j in range(1, 7)])
    if bar is not None:
        remarks += _left_out("ball-bar", bar.outliers, [f"b{j}" for j in joints])
    return tuple(remarks)


def _left_out(log: str, outliers: Outliers, channels: Sequence[str]) -> list[str]:
    if outliers.rows == 0:
        return []
    first = int(outliers.times.argmin())
    rows = f"{outliers.rows:_} of {outliers.of:_} {log} rows".replace("_", " ")
    verb = "is an outlier and was" if outliers.rows == 1 else "are outliers and were"
    return [
        f"{rows} {verb} left out: {channels[outliers.channels[first]]} first at t = {outliers.times[first]:.2f} s"
    ]
