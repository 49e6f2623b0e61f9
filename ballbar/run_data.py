"""Everything that one run produced: what command line, report and replay show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from acquisition import Recording
from ballbar.compare import Comparison, Limit
from ident.identify import Identification
from sim.simulate import Simulation


@dataclass(frozen=True, eq=False)
class RunData:
    """One identified recording, with the simulation behind it where there is one."""

    name: str
    folder: Path  # of the recording
    recording: Recording
    identification: Identification
    simulation: Simulation | None = None
    comparison: Comparison | None = None
    limits: tuple[Limit, ...] = ()

    @property
    def acceptable(self) -> bool:
        """Whether the fit is trusted and every limit of the scenario is met."""
        return self.identification.verdict.acceptable and all(limit.met for limit in self.limits)
