"""The unknowns of a fit as one vector, with a Gaussian prior for each.

Shared by all that was measured are the geometry of robot and ball-bar, the coefficients of the
corrections and the gain of a measured rod force. Each recording has its own encoder offsets, base
pose of the ball-bar, clock, and where nothing measures the rod's tension its spline. Then come the
seats of other instruments and the targets that they measured, which start where
`ballbar.ident.start` found them; of those whose orientation nothing measures only the position is
unknown. An infinite prior sigma means no prior.

The gauge of the robot's parameters stays fixed: of the IRB 2400 `rd1`, `rtheta1`, `rd3`. The plate
is the known length (thesis Table 3.2, `ra6`): fixed in a fit without priors, else an unknown under
the prior of its file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.board import SCALES
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry, Parameter
from ballbar.cell.placement import Placement
from ballbar.cell.poses import CommonErrors, PoseTable
from ballbar.ident.corrections.base import Coefficient

MAX_OFFSET_STEP = 3.0  # [s] a longer step leaves the region where the splines say anything
MAX_SKEW = 2e-3  # [1] twenty times the worst free-running clock of notes/log_formats
HELD = 1e-9  # of a prior's sigma: below what data could tell


@dataclass(frozen=True, eq=False)
class Own:
    """Where one recording's own unknowns stand in the vector."""

    parameters: NDArray[np.intp]  # indices into the table: encoder offsets, base pose
    geometry: slice  # their values
    clock: slice | None  # offset, skew
    steps: slice | None  # clock steps [s]
    knots: slice | None  # of the tension's spline [N]

    def moved(self, shift: int) -> Own:
        """The places after `shift` more unknowns."""
        optional = (self.clock, self.steps, self.knots)
        clock, steps, knots = (None if p is None else _further(p, shift) for p in optional)
        return Own(self.parameters, _further(self.geometry, shift), clock, steps, knots)


@dataclass(frozen=True, eq=False)
class Placed:
    """Where the unknowns of seats and targets stand in the vector, and where they start."""

    seats: dict[str, slice]  # shift [m], and of a whole frame a rotation vector [rad]
    targets: dict[str, slice]
    seat_starts: dict[str, Placement]  # in the robot's base frame
    target_starts: dict[str, Placement]  # in the flange's frame
    last_row: NDArray[np.intp]  # indices into the table of the robot's last row
    flange: Array  # its values where it ends in the bare flange
    # offset [s] and skew of instruments that followed a robot, by the name of their recording
    clocks: dict[str, slice]
    common: dict[str, slice]  # unknowns of unit variance of CommonErrors, by their name

    def shifted(self, shift: int) -> Placed:
        """The places after `shift` more unknowns."""
        seats, targets, clocks, common = (
            {name: _further(part, shift) for name, part in places.items()}
            for places in (self.seats, self.targets, self.clocks, self.common)
        )
        return replace(self, seats=seats, targets=targets, clocks=clocks, common=common)


NOWHERE = Placed(
    seats={},
    targets={},
    seat_starts={},
    target_starts={},
    last_row=np.zeros(0, dtype=np.intp),
    flange=np.zeros(0),
    clocks={},
    common={},
)


def _clock(x: Array, part: slice | None) -> Clock:
    return Clock(0.0, 0.0) if part is None else Clock(*(float(v) for v in x[part]))


def _further(part: slice, shift: int) -> slice:
    return slice(part.start + shift, part.stop + shift)


@dataclass(frozen=True, eq=False)
class PlacedPoses:
    """Still poses, and where their seats and targets are about."""

    table: PoseTable
    seats: Mapping[str, Placement]  # in the robot's base frame
    targets: Mapping[str, Placement]  # in the flange's frame
    # (N,) square root of each pose's robust weight, by group; empty where all count in full
    robust: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Names, priors and positions of the unknowns x (P,) of a fit."""

    names: tuple[str, ...]  # those of recording k of several end in `@k`, k from 1
    mean: Array  # (P,) of the prior
    sigma: Array  # (P,)
    fixed: Geometry  # values of the kinematic parameters that are no unknowns
    shared: NDArray[np.intp]  # indices into the table of the first unknowns, in its order
    coefficients: slice  # of the corrections; they follow the shared parameters
    gain: int | None  # of the measured rod force
    own: tuple[Own, ...]  # of each recording
    placed: Placed = NOWHERE

    @property
    def count(self) -> int:
        return len(self.names)

    @property
    def seats(self) -> dict[str, slice]:
        """Where the unknowns of each seat stand: shift [m], of a whole frame a rotation vector."""
        return self.placed.seats

    @property
    def targets(self) -> dict[str, slice]:
        """Where the unknowns of each target stand, as those of seats."""
        return self.placed.targets

    @property
    def framed(self) -> set[str]:
        """Seats and targets whose orientation is unknown too."""
        places = {**self.seats, **self.targets}
        return {name for name, part in places.items() if part.stop - part.start == 6}

    @property
    def geometric(self) -> slice:
        """The shared parameters among the unknowns."""
        return slice(0, self.shared.size)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The shared parameters."""
        return tuple(self.fixed.table.parameters[i] for i in self.shared)

    @property
    def machine(self) -> NDArray[np.intp]:
        """Indices of the shared parameters and of the coefficients."""
        return np.arange(self.coefficients.stop)

    def geometry(self, x: Array, k: int) -> Geometry:
        """The kinematic parameters of recording k."""
        values = self.fixed.values.copy()
        values[self.shared] = x[: self.shared.size]
        values[self.own[k].parameters] = x[self.own[k].geometry]
        return self.fixed.with_values(values)

    def knots(self, k: int) -> slice | None:
        """The knots of the tension's spline of part k; None where it has none."""
        return self.own[k].knots if k < len(self.own) else None

    def bare(self, x: Array) -> Geometry:
        """The kinematic parameters with the bare flange as the robot's last row."""
        values = self.fixed.values.copy()
        values[self.shared] = x[: self.shared.size]
        values[self.placed.last_row] = self.placed.flange
        return self.fixed.with_values(values)

    def seat(self, x: Array, name: str) -> Placement:
        """A seat in the robot's base frame; turns about the base's axes."""
        change = x[self.placed.seats[name]]
        return self.placed.seat_starts[name].moved(change, about_own_axes=False)

    def target(self, x: Array, name: str) -> Placement:
        """A target in the flange's frame; turns about its own axes."""
        change = x[self.placed.targets[name]]
        return self.placed.target_starts[name].moved(change, about_own_axes=True)

    def common(self, x: Array, errors: CommonErrors | None) -> Array:
        """(U,) unknowns in place of an instrument's common errors; none where it has none."""
        return np.zeros(0) if errors is None else x[self.placed.common[errors.name]]

    @property
    def sizes(self) -> NDArray[np.intp]:
        """Indices of the sizes of boards, which files state as they do the machine."""
        sizes = [i for i, name in enumerate(self.names) if name.endswith(SCALES)]
        return np.array(sizes, dtype=np.intp)

    def held(self, targets: Iterable[str] = ()) -> Unknowns:
        """The same with robot, coefficients and some targets held at their priors' means."""
        sigma = self.sigma.copy()
        sigma[self.machine] *= HELD
        for name in targets:
            sigma[self.placed.targets[name]] *= HELD
        return replace(self, sigma=sigma)

    def clock(self, x: Array, k: int) -> Clock:
        """The clock of recording k."""
        return _clock(x, self.own[k].clock)

    def instrument_clock(self, x: Array, name: str) -> Clock:
        """The clock of the instrument that followed the robot of a recording."""
        return _clock(x, self.placed.clocks[name])

    def with_coefficients(
        self, coefficients: Sequence[Coefficient], x: Array
    ) -> tuple[Unknowns, Array]:
        """The unknowns with other coefficients of corrections, and x (P,) for them.

        Coefficients that were there keep their prior and value, the others begin at their means.
        """
        first, stop = self.coefficients.start, self.coefficients.stop
        place = {name: first + i for i, name in enumerate(self.names[self.coefficients])}
        shift = len(coefficients) - (stop - first)

        def recast(old: Array, new: Sequence[float]) -> Array:
            chosen = [
                old[place[c.name]] if c.name in place else value
                for c, value in zip(coefficients, new, strict=True)
            ]
            return np.concatenate((old[:first], chosen, old[stop:]))

        means = [c.mean for c in coefficients]
        layout = replace(
            self._later(shift),
            names=(*self.names[:first], *(c.name for c in coefficients), *self.names[stop:]),
            mean=recast(self.mean, means),
            sigma=recast(self.sigma, [c.sigma for c in coefficients]),
            coefficients=slice(first, stop + shift),
        )
        return layout, recast(x, means)

    def with_shared(self, parameters: NDArray[np.intp], x: Array) -> tuple[Unknowns, Array]:
        """The unknowns with more shared parameters, without priors; and x (P,) for them.

        parameters : (H,) indices into the table, in its order; they begin at the values that they
        were fixed at.
        """
        places, shift = np.searchsorted(self.shared, parameters), parameters.size
        names = [self.fixed.table.names[i] for i in parameters]
        values, old = self.fixed.values[parameters], self.coefficients
        layout = replace(
            self._later(shift),
            names=tuple(np.insert(np.array(self.names, dtype=object), places, names)),
            mean=np.insert(self.mean, places, values),
            sigma=np.insert(self.sigma, places, np.inf),
            shared=np.insert(self.shared, places, parameters),
            coefficients=_further(old, shift),
        )
        return layout, np.insert(x, places, values)

    def _later(self, shift: int) -> Unknowns:
        """The same with all that follows the machine's unknowns `shift` places further."""
        return replace(
            self,
            gain=None if self.gain is None else self.gain + shift,
            own=tuple(own.moved(shift) for own in self.own),
            placed=self.placed.shifted(shift),
        )

    def moved(self, x: Array, step: Array) -> Array:
        """(P,) x + step, the clocks kept where the logs' splines say anything."""
        out = x + step
        for clock in (*(own.clock for own in self.own), *self.placed.clocks.values()):
            if clock is not None:
                offset, skew = clock.start, clock.start + 1
                shift = np.clip(step[offset], -MAX_OFFSET_STEP, MAX_OFFSET_STEP)
                out[offset] = x[offset] + shift
                out[skew] = np.clip(out[skew], -MAX_SKEW, MAX_SKEW)
        return out
