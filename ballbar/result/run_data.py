"""Everything that one run produced: what command line, report and replay show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.ident.held_out import HeldOut, PoseHeldOut
from ballbar.ident.result import Identification, RecordingEstimate
from ballbar.result.compare import Comparison

if TYPE_CHECKING:  # an identification of recordings does without the simulation
    from ballbar.scenario import Scenario
    from ballbar.sim.simulate import Simulation
    from ballbar.sim.still_poses import PoseSimulation
    from ballbar.truth.limits import Limit


@dataclass(frozen=True, eq=False)
class FittedRecording:
    """One recording that was fitted: as read, and what was identified of its own."""

    name: str
    recording: Recording
    estimate: RecordingEstimate


@dataclass(frozen=True, eq=False)
class Validation:
    """A recording that took no part in the identification."""

    recording: Recording
    outcome: HeldOut


@dataclass(frozen=True, eq=False)
class RunData:
    """An identification with what was measured, and the simulation behind it where there is one."""

    name: str
    recordings: tuple[FittedRecording, ...]
    identification: Identification
    simulation: Simulation | PoseSimulation | None = None
    comparison: Comparison | None = None
    limits: tuple[Limit, ...] = ()
    validations: tuple[Validation, ...] = ()
    scenario_files: tuple[Path, ...] = ()  # of a simulated run: the file, and those it extends
    scenario: Scenario | None = None
    # name and content of tables of still poses that were fitted
    tables: tuple[tuple[str, PoseImport], ...] = ()
    held_out_tables: tuple[tuple[PoseImport, PoseHeldOut], ...] = ()

    @property
    def of_arrays(self) -> bool:
        """Whether logs or poses were given as arrays, with descriptions that no file may have."""
        recordings = any(recording.folder is None for _, recording in self.read)
        return recordings or any(content.file is None for _, content in self.tables)

    @property
    def folder(self) -> Path:
        """The folder from which the names of the robot's and other descriptions are taken."""
        if self.recordings:
            return self.recordings[0].recording.folder or Path()
        return (self.tables[0][1].file or Path("poses.yaml")).parent

    @property
    def acceptable(self) -> bool:
        """Whether verdict, limits, and held-out recordings and tables are all acceptable."""
        met = all(limit.met for limit in self.limits)
        explained = all(outcome.acceptable for outcome in self.outcomes)
        return self.identification.verdict.acceptable and met and explained

    @property
    def outcomes(self) -> list[HeldOut | PoseHeldOut]:
        """How each held-out recording or table is explained."""
        recordings = [validation.outcome for validation in self.validations]
        return [*recordings, *(outcome for _, outcome in self.held_out_tables)]

    @property
    def several(self) -> bool:
        """Whether recordings have to be distinguished by name."""
        return len(self.recordings) > 1

    @property
    def read(self) -> tuple[tuple[str, Recording], ...]:
        """Name and content of every recording, the held-out ones last."""
        fitted = tuple((r.name, r.recording) for r in self.recordings)
        return fitted + tuple((v.outcome.name, v.recording) for v in self.validations)
