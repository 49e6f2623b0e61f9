"""Evidence for a verdict: from the loop closure of recordings, each recording, and still poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.descriptions import Cell
from cell.geometry import Geometry
from ident.start.automatic import Start
from ident.table_estimate import TableEstimate

# A result must be better than the nominal robot to be of use: by default its stated TCP uncertainty
# is at most this share of what the nominal robot is off, or below what no nominal robot keeps.
WORTHWHILE, ALWAYS_WORTHWHILE = 0.5, 1e-4  # [1], [m]
FEW_BLOCKS = 12  # of time: the spread of fewer tells little of the uncertainty


@dataclass(frozen=True, eq=False)
class ClosureEvidence:
    """Evidence from the loop closure of all recordings of a fit."""

    cell: Cell
    nominal: Geometry  # catalogue geometry of the cell
    converged: bool
    iterations: int
    chi2_per_dof: float
    autocorrelation: float  # of neighbours in the whitened residual
    geometry: Geometry
    identified: tuple[str, ...]
    complete: bool  # whether the complete model was fitted
    pulled: tuple[str, ...] = ()  # unknowns further than PULL from their priors
    unphysical: tuple[str, ...] = ()  # stiffness, play or mass that is negative
    impossible: tuple[str, ...] = ()  # what is beyond physical size (ident.physical_bounds)
    disagreement: str = ""  # what is not the same in all recordings, or all along one
    ratios: str = ""  # gears that turn otherwise than logged
    # compliance of all gears over the catalogue's, where no torque tells masses
    softer: float = 1.0
    tcp_sigma: float = 0.0  # [m] stated, rms over the workspace, with the scale
    nominal_error: float = 0.0  # [m] mean distance of the nominal tool from the identified one
    accuracy: float | None = None  # [m] stated TCP uncertainty that is asked for
    blocks: int = FEW_BLOCKS  # of time, that the uncertainty of a complete model rests on
    lengths_apart: float = 0.0  # standard deviations by which known lengths contradict each other
    lengths_off: float = 0.0  # [m] by which they do
    rod_sigma: float = 0.0  # [m] stated, of the identified rod

    @property
    def tells(self) -> bool:
        """Whether neighbours in the residual tell what the model lacks.

        The noise of a sensed length, the one residual, takes up what kinematics leaves over.
        """
        return self.complete or self.cell.ballbar.stroke is not None

    @property
    def ratio(self) -> float:
        """Residual over what the noise in the logs explains."""
        return float(np.sqrt(self.chi2_per_dof))

    @property
    def neighbours(self) -> str:
        return f"autocorrelation {self.autocorrelation:.2f}"

    @property
    def largest_sigma(self) -> float:
        """[m] stated TCP uncertainty above which the result is of no use."""
        if self.accuracy is not None:
            return self.accuracy
        return max(WORTHWHILE * self.nominal_error, ALWAYS_WORTHWHILE)


@dataclass(frozen=True, eq=False)
class RecordingEvidence:
    """Evidence from one recording."""

    name: str
    start: Start
    encoders: tuple[int, ...]
    samples: int
    remarks: tuple[str, ...] = ()
    clock_sigma: float = 0.0  # [s] of the clock offset
    held_out: float | None = None  # its residual by the machine of the others (ident.consistency)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence on one part of a fit: a recording, or the still poses."""

    closure: ClosureEvidence | None = None
    recording: RecordingEvidence | None = None
    table: TableEstimate | None = None
    elsewhere: bool = False  # whether the robot was judged elsewhere than where still poses are

    @property
    def ended(self) -> tuple[bool, int]:
        """Whether the fit converged, and after how many iterations."""
        fit = self.closure or (self.table.fit if self.table else None)
        assert fit is not None, "evidence is of a recording or of still poses"
        return fit.converged, fit.iterations
