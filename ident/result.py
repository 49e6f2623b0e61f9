"""Result of an identification: the machine, each recording's own part, the fit, and a verdict.

An identification always holds a tuple of recordings, also when there is one. What they share,
robot, ball-bar and corrections, stands once; encoder offsets, base pose and clock stand with each,
seats and targets with the still poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cell.arrays import Array
from cell.clock import Clock
from cell.descriptions import Cell
from cell.geometry import Geometry
from cell.statistics import rms
from ident.corrections import as_in_result, correction_of_result
from ident.estimator.identifiability import DroppedParameter
from ident.estimator.noise import ExcessNoise, LogNoise
from ident.loads.payload import PayloadEstimate
from ident.robot.identified import IdentifiedRobot
from ident.robot.tcp_uncertainty import TcpUncertainty
from ident.robot.tool_covariance import ToolCovariance
from ident.signals.steps import StepFault
from ident.start.automatic import Start
from ident.table_estimate import TableEstimate
from ident.tracker import TrackerCheck
from ident.verdict import Verdict


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
    """The machine that all recordings share: robot, ball-bar, corrections."""

    cell: Cell
    encoders: tuple[int, ...]  # of the ball-bar that found it, joints 1..5
    nominal: Geometry  # catalogue values; base pose and encoder offsets are zero
    geometry: Geometry  # the nominal one with the identified shared parameters
    sigma: dict[str, float]  # [m, rad] of the identified shared parameters
    covariance: NamedCovariance  # of the shared parameters and coefficients
    corrections: tuple[CorrectionEstimate, ...]
    tcp: TcpUncertainty  # stated, over the accuracy grid
    dropped: tuple[DroppedParameter, ...]  # parameters left at nominal or prior, and why
    # [m] parts of the root mean square of `tcp.without_scale`: what the data would leave were their
    # residuals white, and by how much it is more; the rest is what priors and masses leave
    tcp_white: float
    tcp_widened: float
    tool: ToolCovariance  # of what moves the unloaded tool
    lower: Array  # (J,) [rad] least angle of each joint over the fitted samples
    upper: Array  # (J,) [rad]
    # Masses that the torque logs show, and that `cell` then has; None where none were logged
    payload: PayloadEstimate | None = None

    @property
    def tcp_sigma(self) -> Array:
        """(G,) [m] stated TCP uncertainty over the accuracy grid, with the scale."""
        return self.tcp.sigma

    def identified_robot(self) -> IdentifiedRobot:
        """The robot as identified, without ball-bar."""
        robot = identified_robot(self.cell, self.geometry, self.encoders, self.corrections)
        return replace(robot, stated=self.tool, ranges=np.stack((self.lower, self.upper), axis=1))


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
    autocorrelation: float  # of neighbours in the whitened residual, mean over the equations
    excess: ExcessNoise  # beyond what the logs show
    rank: int  # directions that the first recording determines, clock included
    condition: float  # of its identifiable parameters' whitened columns, at unit length


@dataclass(frozen=True, eq=False)
class Identification:
    """One robot identified from one or several recordings."""

    robot: RobotEstimate
    recordings: tuple[RecordingEstimate, ...]
    fit: FitStatistics
    verdict: Verdict
    poses: TableEstimate | None = None  # still poses that were fitted together with them

    @property
    def model(self) -> Literal["dh", "complete"]:
        return "complete" if self.robot.corrections else "dh"

    @property
    def machine(self) -> Machine:
        """The machine by itself."""
        robot = self.robot
        return Machine(
            robot=robot.identified_robot(),
            nominal=robot.nominal,
            names=robot.tool.names,
            covariance=robot.tool.of_names,
            excess=self.fit.excess,
            tcp_sigma=rms(robot.tcp_sigma),
        )

    @property
    def sigma(self) -> dict[str, float]:
        """[m, rad] of the shared parameters and of the first recording's own."""
        return self.robot.sigma | self.recordings[0].sigma
