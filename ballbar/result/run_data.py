"""Everything that one run produced: what command line, report and replay show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from acquisition import Recording
from ballbar.result.compare import Comparison, Limit
from ballbar.result.iterations import Step
from ballbar.scenario import Scenario
from ident.held_out import HeldOut
from ident.identify import Identification
from sim.simulate import Simulation


@dataclass(frozen=True, eq=False)
class Joined:
    """One of several recordings that were fitted together: the robot is common, the rest is its own."""

    name: str
    folder: Path
    recording: Recording
    identification: Identification


@dataclass(frozen=True, eq=False)
class Validation:
    """A recording that took no part in the identification."""

    folder: Path
    recording: Recording
    outcome: HeldOut


@dataclass(frozen=True, eq=False)
class RunData:
    """One identified recording, or the first of several, with the simulation behind it where there is one."""

    name: str
    folder: Path  # of the recording
    recording: Recording
    identification: Identification
    simulation: Simulation | None = None
    comparison: Comparison | None = None
    limits: tuple[Limit, ...] = ()
    joined: tuple[
        Joined, ...
    ] = ()  # all recordings of a joint fit, the first among them; empty for a single one
    validations: tuple[Validation, ...] = ()
    scenario_file: Path | None = None  # of a simulated run
    scenario: Scenario | None = None
    iterations: tuple[
        Step, ...
    ] = ()  # of the chosen start and of the fits, where they were watched

    @property
    def acceptable(self) -> bool:
        """Whether the fit is trusted, every limit of the scenario is met and every held-out recording explained."""
        met = all(limit.met for limit in self.limits)
        return (
            self.identification.verdict.acceptable
            and met
            and all(one.outcome.acceptable for one in self.validations)
        )

    @property
    def fitted(self) -> tuple[Joined, ...]:
        """Every recording that was fitted, also a single one."""
        return self.joined or (Joined(self.name, self.folder, self.recording, self.identification),)
