"""The identified machine in calibration.yaml: parameters, corrections, masses, ranges, covariance.

All are in SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.payload import LinkDeviation, Payload
from ballbar.cell.schema import LARGEST_OTHER, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.ident.robot.tool_covariance import ToolCovariance

Positive = Annotated[float, Field(gt=0.0)]
ParameterValue = Annotated[float, Field(ge=-1e3, le=1e3)]  # [m] or [rad]
# Least eigenvalue of a correlation that rounding may leave negative; -1e-15 is seen where a
# covariance has lost a direction.
ROUNDING = 1e-6
RESTORE = "Restore the file as it was written, or identify again"


@dataclass(frozen=True)
class From:
    """Mark of a key that is written from an attribute of another name, such as `clock.offset`."""

    attribute: str


class ParameterEntry(Strict):
    """One kinematic parameter; lengths in m, angles in rad."""

    nominal: ParameterValue
    value: ParameterValue
    sigma: float | None = None
    identified: bool


class CoefficientEntry(Strict):
    """One coefficient of a correction, SI units."""

    value: float
    sigma: float
    prior: float
    prior_sigma: float
    information_gain: float  # 0: the prior alone; 1: the data alone
    unit: str


class DroppedEntry(Strict):
    """A parameter left at its nominal value, and why."""

    name: str
    reason: str
    on: tuple[str, ...] = ()


class LinkMassEntry(Strict):
    """How one link deviates from the robot's file, the arm's factor apart."""

    scale: Positive  # of its mass and inertia
    shift_m: tuple[float, float, float]  # of its centre, frame of the robot's file


class MassesEntry(Strict):
    """Masses that the fit took from the torque logs in place of those of the files."""

    tool_kg: Annotated[Positive, From("payload.mass")]
    tool_sigma_kg: Annotated[Positive, From("mass_sigma")]
    tool_stated_kg: Annotated[float, From("stated")]
    # robot flange frame
    tool_com_m: Annotated[tuple[float, float, float], From("payload.com")]
    arm_scale: Annotated[Positive, From("payload.arm")]  # of the masses in the robot's file
    arm_scale_sigma: Annotated[Positive, From("arm_sigma")]
    # of links 1 to J beside that
    links: Annotated[tuple[LinkMassEntry, ...], From("payload.links")] = ()

    @model_validator(mode="after")
    def _is_payload(self) -> MassesEntry:
        _ = self.payload  # which refuses masses that no tool has
        return self

    @property
    def payload(self) -> Payload:
        links = tuple(LinkDeviation(link.scale, np.array(link.shift_m)) for link in self.links)
        return Payload(self.tool_kg, np.array(self.tool_com_m), self.arm_scale, links)


class RangeEntry(Strict):
    """Range of a joint's angle over which the robot was fitted."""

    lower_rad: float
    upper_rad: float

    @model_validator(mode="after")
    def _is_not_reversed(self) -> RangeEntry:
        if self.lower_rad > self.upper_rad:
            raise wrong_key("lower_rad", message=f"expected at most upper_rad, {self.upper_rad:g}")
        return self


class CovarianceEntry(Strict):
    """Stated covariance of the machine, SI units; what is not named was taken as exact."""

    names: tuple[str, ...]  # parameters of robot and instrument, then all coefficients
    # one standard deviation of each direction of masses: mass [kg] and first moment [kg m] of the
    # tool, then mass (relative) and centre [m] of each link
    masses: tuple[tuple[float, ...], ...]
    held: tuple[str, ...] = ()  # parameters of the instrument that the fit took as exact
    lower: tuple[str, ...]  # rows of the lower triangle: names, held, directions of masses
    # standard deviation of each name from one recording of a path to the next, by the noise of the
    # data alone; older files do not state it
    repeated_sigma: tuple[float, ...] = ()

    @model_validator(mode="after")
    def _is_covariance(self) -> CovarianceEntry:
        unknowns = (*self.names, *self.held, *(f"mass {k + 1}" for k in range(len(self.masses))))
        if len(self.lower) != len(unknowns):
            raise wrong_key(
                "lower",
                message=f"expected {len(unknowns)} rows, one for each of names, held and masses, "
                f"found {len(self.lower)}. {RESTORE}",
            )
        if len(self.repeated_sigma) not in (0, len(self.names)):
            expected = f"expected {len(self.names)} numbers, one for each of names"
            raise wrong_key("repeated_sigma", message=f"{expected}. {RESTORE}")
        values = self.covariance.values
        # of what the fit took as exact the files may say that it is
        exact = ~values.any(axis=1) & np.isin(unknowns, self.held)
        for k in np.flatnonzero((np.diag(values) <= 0.0) & ~exact):
            raise wrong_key(
                "lower",
                int(k),
                message=f"expected a variance of {unknowns[k]} above 0 as the last number. "
                f"{RESTORE}",
            )
        scale = np.sqrt(np.where(exact, 1.0, np.diag(values)))
        if not _is_positive(values / np.outer(scale, scale) + ROUNDING * np.eye(len(values))):
            raise wrong_key(
                "lower",
                message="these numbers are no covariance: some combination of the unknowns would "
                f"have a negative variance. {RESTORE}",
            )
        return self

    @cached_property
    def covariance(self) -> ToolCovariance:
        values = np.zeros((len(self.lower), len(self.lower)))
        for k, row in enumerate(self.lower):
            values[k, : k + 1] = values[: k + 1, k] = _numbers_of_row(k, row)
        masses = np.array(self.masses) if self.masses else np.zeros((0, 0))
        repeated = np.array(self.repeated_sigma)
        return ToolCovariance(self.names, masses, values, self.held, repeated)


def _is_positive(matrix: Array) -> bool:
    """Whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _numbers_of_row(k: int, row: str) -> list[float]:
    """The numbers of row k, from 0, of a lower triangle."""
    try:
        numbers = list(map(float, row.split()))
        extremes = (min(numbers), max(numbers), sum(numbers))  # the sum of a NaN is one
    except ValueError:  # also of an empty row
        numbers, extremes = [], (0.0, 0.0, 0.0)
    if len(numbers) != k + 1 or not all(abs(number) <= LARGEST_OTHER for number in extremes):
        raise wrong_key(
            "lower",
            k,
            message=f"expected numbers, {k + 1} finite ones with spaces between. {RESTORE}",
        )
    return numbers


def covariance_entry(covariance: ToolCovariance) -> CovarianceEntry:
    """A covariance as text that reads back bit by bit."""
    rows = [row[: k + 1].tolist() for k, row in enumerate(covariance.values)]
    return CovarianceEntry.model_construct(
        names=covariance.names,
        masses=tuple(tuple(row) for row in covariance.masses.tolist()),
        held=covariance.held,
        lower=tuple(" ".join(map(repr, row)) for row in rows),
        repeated_sigma=tuple(covariance.repeated.tolist()),
    )
