"""Result of an identification: the machine, each recording's own part, the fit, and a verdict.

An identification always holds a tuple of recordings, also when there is one. What they share,
robot, ball-bar and corrections, stands once; encoder offsets, base pose and clock stand with each,
seats and targets with the still poses, which may stand alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.geometry import Geometry
from ballbar.cell.statistics import rms
from ballbar.ident.corrections import as_in_result, correction_of_result
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.identifiability import DroppedParameter
from ballbar.ident.estimator.noise import ExcessNoise, LogNoise
from ballbar.ident.estimator.uncertainty import Uncertainty
from ballbar.ident.loads.payload import PayloadEstimate
from ballbar.ident.robot.budget import DOUBT, LEFT_OUT_TERMS, Budget, budget
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tcp_uncertainty import TcpUncertainty
from ballbar.ident.robot.tool_covariance import ToolCovariance
from ballbar.ident.signals.steps import StepFault
from ballbar.ident.start.automatic import Start
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.tracker import TrackerCheck
from ballbar.ident.verdict import Verdict


@dataclass(frozen=True)
class CoefficientEstimate:
    """One coefficient of a correction, SI units."""

    name: str
    unit: str
    value: float
    sigma: float
    prior: float
    prior_sigma: float
    information_gain: float  # 0: the prior alone; 1: the data alone


@dataclass(frozen=True)
class CorrectionEstimate:
    """One correction and its coefficients."""

    name: str
    sentence: str
    coefficients: tuple[CoefficientEstimate, ...]


@dataclass(frozen=True, eq=False)
class NamedCovariance:
    """Covariance of kinematic parameters and coefficients; what is not named was taken as exact."""

    names: tuple[str, ...]
    values: Array  # (U, U) SI units
    # (U, U) the same of the priors and of white noise alone, not inflated for autocorrelated
    # residuals and misfit: what a complete model would leave uncertain
    white: Array


@dataclass(frozen=True, eq=False)
class Machine:
    """The machine of a result, fresh or read back: enough to test other recordings."""

    robot: IdentifiedRobot
    nominal: Geometry  # catalogue values; base pose and encoder offsets are zero
    names: tuple[str, ...]  # of the covariance; what is not named was taken as exact
    covariance: Array  # (U, U) SI units, stated, of parameters and coefficients
    excess: ExcessNoise  # of the identification, beyond what its logs show
    tcp_sigma: float  # [m] root mean square of the stated TCP uncertainty


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """The machine that all that was measured shares: robot, ball-bar, corrections."""

    identified: IdentifiedRobot  # without ball-bar, with what is stated and the fitted ranges
    nominal: Geometry  # catalogue values; base pose and encoder offsets are zero
    sigma: dict[str, float]  # [m, rad] of the identified shared parameters
    covariance: NamedCovariance  # of the shared parameters and coefficients
    corrections: tuple[CorrectionEstimate, ...]
    tcp: TcpUncertainty  # stated, over the accuracy grid, or the fitted ranges of still poses
    encoders: tuple[int, ...] = ()  # of the ball-bar that found it, joints 1..5
    dropped: tuple[DroppedParameter, ...] = ()  # parameters left at nominal or prior, and why
    # [m] parts of the root mean square of `tcp.without_scale`: what the data would leave were their
    # residuals white, and by how much it is more; the rest is what priors and masses leave
    tcp_white: float = 0.0
    tcp_widened: float = 0.0
    # Masses that the torque logs show, and that `cell` then has; None where none were logged
    payload: PayloadEstimate | None = None

    @property
    def robot(self) -> Robot:
        return self.identified.robot

    @property
    def cell(self) -> Cell:
        """The cell of a robot that was identified from recordings."""
        return self.identified.cell

    @property
    def geometry(self) -> Geometry:
        """The nominal one with the identified shared parameters."""
        return self.identified.geometry

    @property
    def tool(self) -> ToolCovariance:
        """Covariance of what moves the unloaded tool, of a robot identified from recordings."""
        stated = self.identified.stated
        assert isinstance(stated, ToolCovariance), "a robot of still poses has no such covariance"
        return stated

    @property
    def tcp_sigma(self) -> Array:
        """(G,) [m] stated TCP uncertainty over the poses of `tcp`, with the scale."""
        return self.tcp.sigma


def identified_robot(
    cell: Cell,
    geometry: Geometry,
    encoders: tuple[int, ...],
    corrections: Sequence[CorrectionEstimate],
) -> IdentifiedRobot:
    """A robot with the identified corrections; encoders : of the ball-bar that found them.

    Raises InputError for a correction whose coefficients are not those that this cell has.
    """
    named = ((c.name, [k.name for k in c.coefficients]) for c in corrections)
    made = tuple(
        as_in_result(correction_of_result(name, own, cell, encoders), own, cell.robot)
        for name, own in named
    )
    values = np.array([c.value for correction in corrections for c in correction.coefficients])
    return IdentifiedRobot(cell, geometry, made, values)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Loop-closure error over a recording, where the unmeasured joints leave it visible."""

    t: Array  # (N,) [s] on the ball-bar's clock (the robot's without encoders)
    position: Array  # (N, 3) [m] robot base frame
    angle: Array  # (N, 3) [rad] robot base frame


@dataclass(frozen=True, eq=False)
class RecordingEstimate:
    """Estimates that belong to one recording."""

    name: str
    encoders: tuple[int, ...]
    directions: tuple[int, ...]  # of each encoder against its declared direction
    geometry: Geometry  # of the machine, with this recording's base pose and encoder offsets
    nominal: Geometry  # catalogue values at this recording's base position
    sigma: dict[str, float]  # [m, rad] of its identified base pose and encoder offsets
    clock: Clock | None
    clock_sigma: tuple[float, float]  # [s], [1]; zero without encoders
    noise: LogNoise  # of one row of its logs
    before: Residuals  # nominal robot, ball-bar placed and clock set as well as possible
    after: Residuals
    whitened: Array  # (E, N) residuals in units of their standard deviation
    start: Start
    step_faults: tuple[StepFault, ...] = ()
    tension: Array | None = None  # (N,) [N] of the rod at the samples, where loads were needed
    tension_source: str = ""  # as of Logs.force_source; empty where no loads were needed
    tracker: TrackerCheck | None = None  # None without a tracker, or where it cannot be compared
    # [m] growth of each long link while it lasted, and its standard deviation
    growth: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        return int(self.after.t.size)


@dataclass(frozen=True)
class FitStatistics:
    """How the fit went."""

    converged: bool
    iterations: int  # of the first recording's chosen start and of the fits together
    unknowns: int
    chi2_per_dof: float
    excess: ExcessNoise  # beyond what the logs show
    # of neighbours in the whitened residual, mean over the equations; still poses have none
    autocorrelation: float = 0.0
    rank: int = 0  # directions that the first recording determines, clock included
    condition: float = np.nan  # of its identifiable parameters' whitened columns, at unit length
    coloured: float = 1.0  # as of Uncertainty


@dataclass(frozen=True, eq=False)
class Identification:
    """One robot identified from recordings, from still poses, or from both together."""

    robot: RobotEstimate
    recordings: tuple[RecordingEstimate, ...]
    fit: FitStatistics
    verdict: Verdict
    poses: TableEstimate | None = None
    solved: Fit | None = None  # of the robot as stated; None of one that was copied
    stated: Uncertainty | None = None  # of its unknowns, of recordings; None of one that was copied

    def __getstate__(self) -> dict[str, object]:
        """All but the fit, of which nothing but `budget` is computed."""
        return {**self.__dict__, "solved": None, "stated": None}

    @cached_property
    def budget(self) -> Budget | None:
        """Parts of the stated TCP uncertainty; None of a copy, or where none is stated."""
        sigma = self.robot.tcp.sigma
        if self.solved is None or not sigma.any() or not np.isfinite(sigma).all():
            return None
        robot, layout = self.robot.identified, self.solved.model.unknowns
        if self.stated is None:
            assert self.poses is not None, "a robot of still poses alone"
            _, unknowns = self.poses.stated_of(self.poses.target)
            return budget(self.solved, robot, sigma, unknowns, blocks=self.poses.blocks)
        names = self.robot.tool.names
        unknowns = np.array([layout.names.index(name) for name in names], dtype=np.intp)
        shifts = {LEFT_OUT_TERMS: self.stated.candidates, DOUBT: self.stated.doubt}
        return budget(
            self.solved,
            robot,
            sigma,
            unknowns,
            blocks=self.stated.blocks,
            beyond={name: shift[unknowns] for name, shift in shifts.items()},
        )

    @property
    def model(self) -> Literal["dh", "complete", "poses"]:
        if not self.recordings:
            return "poses"
        return "complete" if self.robot.corrections else "dh"

    @property
    def machine(self) -> Machine:
        """The machine by itself."""
        robot = self.robot
        return Machine(
            robot=robot.identified,
            nominal=robot.nominal,
            names=robot.tool.names,
            covariance=robot.tool.of_names,
            excess=self.fit.excess,
            tcp_sigma=rms(robot.tcp_sigma),
        )

    @property
    def sigma(self) -> dict[str, float]:
        """[m, rad] of the shared parameters and of the first recording's own."""
        return self.robot.sigma | (self.recordings[0].sigma if self.recordings else {})
