"""The unknowns of a joint fit of several recordings, as one vector with a Gaussian prior of physical size for each.

Shared by all recordings: the robot's and the ball-bar's geometry, the coefficients of the corrections, the gain of a measured
rod force. Each recording's own: encoder zeros, where the ball-bar's base stands and leans, the clock, and where nothing
measures the rod's tension, its spline. `rd1` and `rtheta1` against the ball-bar's place, and `rd3` against `rd2`, are a pure gauge and stay
fixed; `ra6`, the plate, is the known length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from cell.descriptions import Cell
from cell.geometry import INDEX, NAMES, PARAMETERS, Geometry
from ident.corrections.base import Correction
from ident.estimator.problem import Clock

LENGTH_PRIOR = 5e-3  # [m] deviation of a robot's length from its catalogue; the data say far more (notes/identification sec. 6)
ANGLE_PRIOR = 5e-3  # [rad] likewise
PLACE_PRIOR = (
    1.0  # [m] where the ball-bar stands: the start has found it; this only keeps the steps finite
)
TILT_PRIOR = 3e-3  # [rad] of the ball-bar's base (notes/parameters, base: 1 mrad)
AXIS_OFFSET_PRIOR = 5e-6  # [m] of gimbal and cardan (notes/parameters, joints_mechanical)
AXIS_ANGLE_PRIOR = 5e-5  # [rad] squareness, likewise
ZERO_PRIOR = 1.0  # [rad]
OFFSET_PRIOR, SKEW_PRIOR = 1.0, 1e-3  # [s], [1] around what the start has found
STEP_PRIOR = 1.0  # [s] of a clock step
GAIN_PRIOR = 0.03  # of a measured rod force: two gains of 2 % (notes/identification sec. 1)
TENSION_PRIOR = 60.0  # [N] a knot of an unmeasured rod force (notes/identification sec. 4)
FIXED = ("rd1", "rtheta1", "rd3", "ra6")
PLACE = ("ox", "oy", "oz", "otx", "oty")


@dataclass(frozen=True)
class Own:
    """Where one recording's own unknowns stand."""

    zeros: slice  # btheta of its fitted encoders, in order
    place: slice  # ox oy oz otx oty
    clock: slice | None  # offset, skew
    steps: slice | None  # clock steps [s]
    knots: slice | None  # of the tension's spline [N]


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Names, priors and places of all unknowns of a fit; x is a vector in this order."""

    names: tuple[str, ...]  # those of recording k of several end in `@k`, k from 1
    mean: Array  # (P,) of the prior
    sigma: Array  # (P,)
    nominal: Geometry
    shared: NDArray[np.intp]  # indices into PARAMETERS of the first unknowns
    coefficients: slice  # of the corrections
    gain: int | None  # of the measured rod force
    zero_parameters: tuple[
        NDArray[np.intp], ...
    ]  # indices into PARAMETERS of each recording's zeros
    own: tuple[Own, ...]

    @property
    def count(self) -> int:
        return len(self.names)

    def geometry(self, x: Array, k: int) -> Geometry:
        """The kinematic parameters of recording k."""
        values = self.nominal.values.copy()
        values[self.shared] = x[: self.shared.size]
        values[self.zero_parameters[k]] = x[self.own[k].zeros]
        values[_PLACES] = x[self.own[k].place]
        return Geometry(values)

    def clock(self, x: Array, k: int) -> Clock:
        """The clock of recording k."""
        where = self.own[k].clock
        return Clock(0.0, 0.0) if where is None else Clock(float(x[where][0]), float(x[where][1]))


_PLACES = np.array([INDEX[name] for name in PLACE])


@dataclass(frozen=True)
class RecordingShape:
    """What the vector needs to know of one recording."""

    joints: tuple[int, ...]  # encoders fitted
    start: Geometry  # zeros and place
    clock: Clock | None
    knots: int  # 0 where no correction needs loads
    tension_sigma: float = TENSION_PRIOR  # [N] prior of each knot
    clock_steps: int = 0


def unknowns(
    cell: Cell,
    nominal: Geometry,
    recordings: Sequence[RecordingShape],
    corrections: Sequence[Correction],
    *,
    measured_force: bool,
    rod_sigma: float | None,
) -> tuple[Unknowns, Array]:
    """The layout, and the vector to start from.

    rod_sigma : [m] of a measured rod length; None for the catalogue's tolerance.
    """
    build = _Builder()
    shared = [name for name in NAMES if name not in FIXED and not name.startswith(("btheta", "o"))]
    for name in shared:
        build.add(name, nominal[name], _prior(cell, name, rod_sigma))
    first = len(build.names)
    for correction in corrections:
        for c in correction.coefficients:
            build.add(c.name, c.mean, c.sigma)
    coefficients = slice(first, len(build.names))
    gain = build.add("force_gain", 0.0, GAIN_PRIOR) if measured_force else None
    own = [
        _own(build, recording, f"@{k + 1}" if len(recordings) > 1 else "")
        for k, recording in enumerate(recordings)
    ]
    layout = Unknowns(
        tuple(build.names),
        np.array(build.mean),
        np.array(build.sigma),
        nominal,
        np.array([INDEX[n] for n in shared]),
        coefficients,
        gain,
        tuple(np.array([INDEX[f"btheta{j}"] for j in r.joints], dtype=np.intp) for r in recordings),
        tuple(own),
    )
    return layout, layout.mean.copy()


def _own(build: _Builder, recording: RecordingShape, tail: str) -> Own:
    start, clock = recording.start, recording.clock
    zero_names = [f"btheta{j}" for j in recording.joints]
    zeros = build.block(
        zero_names, tail, [start[n] for n in zero_names], [ZERO_PRIOR] * len(zero_names)
    )
    place = build.block(
        PLACE,
        tail,
        [*(start[n] for n in PLACE[:3]), 0.0, 0.0],
        [PLACE_PRIOR] * 3 + [TILT_PRIOR] * 2,
    )
    clocks = None
    if clock is not None:
        clocks = build.block(
            ("offset", "skew"), tail, [clock.offset, clock.skew], [OFFSET_PRIOR, SKEW_PRIOR]
        )
    steps = build.numbered("clock_step", tail, recording.clock_steps, STEP_PRIOR)
    return Own(
        zeros,
        place,
        clocks,
        steps,
        build.numbered("tension", tail, recording.knots, recording.tension_sigma),
    )


class _Builder:
    def __init__(self) -> None:
        self.names: list[str] = []
        self.mean: list[float] = []
        self.sigma: list[float] = []

    def add(self, name: str, mean: float, sigma: float) -> int:
        self.names.append(name)
        self.mean.append(mean)
        self.sigma.append(sigma)
        return len(self.names) - 1

    def block(
        self, names: Sequence[str], tail: str, means: Sequence[float], sigmas: Sequence[float]
    ) -> slice:
        first = len(self.names)
        for name, mean, sigma in zip(names, means, sigmas, strict=True):
            self.add(name + tail, mean, sigma)
        return slice(first, len(self.names))

    def numbered(self, name: str, tail: str, count: int, sigma: float) -> slice | None:
        return (
            self.block(
                [f"{name}{i + 1}" for i in range(count)], tail, [0.0] * count, [sigma] * count
            )
            if count
            else None
        )


def _prior(cell: Cell, name: str, rod_sigma: float | None) -> float:
    parameter = PARAMETERS[INDEX[name]]
    if name == "bd3":
        return cell.ballbar.length_tolerance if rod_sigma is None else rod_sigma
    if parameter.side == "bar":
        return AXIS_OFFSET_PRIOR if parameter.is_length else AXIS_ANGLE_PRIOR
    return LENGTH_PRIOR if parameter.is_length else ANGLE_PRIOR
