"""What happened at one instant of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class StepFault:
    """One jump."""

    recording: int  # from 0
    kind: Literal["encoder", "clock"]
    joint: int  # 1..5; 0 for a clock
    time: float  # [s] on the ball-bar's clock
    size: float  # [rad] in the joint's sense, or [s] of the ball-bar's clock against the robot's
    periods: int = 0  # signal periods of the encoder, where the jump is a whole number of them
    removed: float = (
        0.0  # [rad] or [s] of the size that was taken out of the log before anything was fitted
    )

    @property
    def sentence(self) -> str:
        """In words."""
        if self.kind == "clock":
            return f"clock step of {self.size * 1e3:+.1f} ms (ball-bar's against robot's) at t = {self.time:.2f} s; repaired"
        if self.periods:
            some = f"{self.periods:+d} signal period{'s' * (abs(self.periods) > 1)}"
            return f"encoder b{self.joint} slipped {some} at t = {self.time:.2f} s; repaired"
        return f"encoder b{self.joint} jumped by {self.size * 1e3:+.3f} mrad at t = {self.time:.2f} s (slipping coupling?); repaired"
