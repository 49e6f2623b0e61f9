"""The two clocks of a recording: the affine map between the ball-bar's stamps and the robot's.

`t_robot = offset + (1 + skew) * t_ballbar`, both counted from the first row of their own log. The
clock offset is the robot's time at the first row of the ball-bar's log; the skew is the rate error
of the ball-bar's clock, in seconds that the robot's clock gains in each second of the ball-bar's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from ballbar.cell.arrays import Array

Time = TypeVar("Time", float, Array)

SAME_OFFSET, SAME_SKEW = 2e-5, 1e-7  # [s], [1]
# [s] standard deviation of a clock offset from which it is not determined: of ten simulated robots
# that change a length by 0.2 mm it scattered by two stated deviations or more. It is as long as one
# to three rows of a controller's log (4 to 12 ms), and 2.5 mm of a tool at 0.25 m/s.
UNSEEN_OFFSET = 0.01
# [1] the same for a clock skew: the worst free-running clock of notes/log_formats is off by as
# much, so a larger deviation tells nothing that was not known before the recording.
UNSEEN_SKEW = 1e-4


@dataclass(frozen=True)
class Clock:
    """Clock offset and skew of a recording."""

    offset: float  # [s]
    skew: float  # [1]

    def robot_time(self, t_ballbar: Time) -> Time:
        """Time [s] on the robot's clock, in the shape of `t_ballbar` [s]."""
        return self.offset + (1.0 + self.skew) * t_ballbar

    def ballbar_time(self, t_robot: Time) -> Time:
        """Time [s] on the ball-bar's clock, in the shape of `t_robot` [s]."""
        return (t_robot - self.offset) / (1.0 + self.skew)

    def alike(self, other: Clock) -> bool:
        """Whether both clocks agree to within what the ripple of a gear could resolve."""
        return (
            abs(self.offset - other.offset) < SAME_OFFSET
            and abs(self.skew - other.skew) < SAME_SKEW
        )
