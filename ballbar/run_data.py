"""Everything that one run produced: what report and replay show."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition import Recording
from ballbar.compare import Comparison
from ident.identify import Identification
from sim.simulate import Simulation


@dataclass(frozen=True, eq=False)
class RunData:
    """One identified recording, with the simulation behind it where there is one."""

    name: str
    recording: Recording
    identification: Identification
    simulation: Simulation | None = None
    comparison: Comparison | None = None
