"""Evidence for a verdict: from the loop closure of recordings, each recording, and still poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.ident.result import FitStatistics, RecordingEstimate, RobotEstimate
from ballbar.ident.table_estimate import TableEstimate

# A result must be better than the nominal robot to be of use: by default its stated TCP uncertainty
# is at most this share of what the nominal robot is off, or below what no nominal robot keeps.
WORTHWHILE, ALWAYS_WORTHWHILE = 0.5, 1e-4  # [1], [m]
FEW_BLOCKS = 12  # of time: the spread of fewer tells little of the uncertainty


@dataclass(frozen=True, eq=False)
class ClosureEvidence:
    """Evidence from the loop closure of all recordings of a fit."""

    robot: RobotEstimate
    fit: FitStatistics
    complete: bool  # whether the complete model was fitted
    pulled: tuple[str, ...] = ()  # unknowns further than PULL from their priors
    unphysical: tuple[str, ...] = ()  # stiffness, play or mass that is negative
    impossible: tuple[str, ...] = ()  # what is beyond physical size (ballbar.ident.physical_bounds)
    disagreement: str = ""  # what is not the same in all recordings, or all along one
    ratios: str = ""  # gears that turn otherwise than logged
    # compliance of all gears over the catalogue's, where no torque tells masses
    softer: float = 1.0
    nominal_error: float = 0.0  # [m] mean distance of the nominal tool from the identified one
    accuracy: float | None = None  # [m] stated TCP uncertainty that is asked for
    blocks: int = FEW_BLOCKS  # of time, that the uncertainty of a complete model rests on
    lengths_apart: float = 0.0  # standard deviations by which known lengths contradict each other
    lengths_off: float = 0.0  # [m] by which they do
    lengths_named: tuple[str, ...] = ()  # those of which one may be wrong
    given_up: float = 0.0  # as of Fit

    @property
    def tells(self) -> bool:
        """Whether neighbours in the residual tell what the model lacks.

        The noise of a sensed length, the one residual, takes up what kinematics leaves over.
        """
        return self.complete or self.robot.cell.ballbar.stroke is not None

    @property
    def ratio(self) -> float:
        """Residual over what the noise in the logs explains."""
        return float(np.sqrt(self.fit.chi2_per_dof))

    @property
    def neighbours(self) -> str:
        return f"autocorrelation {self.fit.autocorrelation:.2f}"

    @property
    def largest_sigma(self) -> float:
        """[m] stated TCP uncertainty above which the result is of no use."""
        if self.accuracy is not None:
            return self.accuracy
        return max(WORTHWHILE * self.nominal_error, ALWAYS_WORTHWHILE)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence on one part of a fit: a recording, or the still poses."""

    closure: ClosureEvidence | None = None
    recording: RecordingEstimate | None = None
    table: TableEstimate | None = None
    remarks: tuple[str, ...] = ()  # on the logs of the recording
    # residual of the recording by the machine of the others (ballbar.ident.consistency)
    held_out: float | None = None
    elsewhere: bool = False  # whether the robot was judged elsewhere than where still poses are

    @property
    def judged_by(self) -> TableEstimate | None:
        """Still poses, where there are enough of them to judge the robot by."""
        return self.table if self.table and self.table.judges else None

    @property
    def ended(self) -> tuple[bool, int]:
        """Whether the fit converged, and after how many iterations."""
        of = self.closure or self.table
        assert of is not None, "evidence is of a recording or of still poses"
        return of.fit.converged, of.fit.iterations
