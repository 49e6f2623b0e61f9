"""Step faults: encoder slips and clock steps, each at one instant of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class StepFault:
    """One encoder slip or clock step."""

    recording: int  # from 0
    kind: Literal["encoder", "clock"]
    joint: int  # 1..5, of the encoder; 0 for a clock
    time: float  # [s] on the ball-bar's clock
    size: (
        float  # [rad] in the joint's direction, or [s] of the ball-bar's clock against the robot's
    )
    periods: int = 0  # signal periods of the encoder, where the slip is a whole number of them
    removed: float = 0.0  # [rad] or [s] of the size that was taken out of the log before the fit

    @property
    def sentence(self) -> str:
        """The step fault as a sentence."""
        at = f"at t = {self.time:.2f} s"
        if self.kind == "clock":
            step = f"{self.size * 1e3:+.1f} ms (ball-bar's against robot's)"
            return f"clock step of {step} {at}; repaired. Do not set clocks while recording"
        if self.periods:
            slip = f"{self.periods:+d} signal period{'s' * (abs(self.periods) > 1)}"
            return f"encoder b{self.joint} slipped {slip} {at}; repaired. Check its cable and speed"
        jump = f"{self.size * 1e3:+.3f} mrad"
        return (
            f"encoder b{self.joint} jumped by {jump} {at} (slipping coupling?); repaired. Tighten "
            "its coupling"
        )
