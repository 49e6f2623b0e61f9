"""The vector of unknowns of a fit: which they are, their priors, and where they start.

Unknowns of kinematics and clock alone, of the complete model of recordings, and of still poses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import (
    Geometry,
    Parameter,
    ParameterTable,
    parameter_table,
    robot_geometry,
)
from ballbar.ident.corrections.base import Correction
from ballbar.ident.estimator.priors import (
    BASE_POSE,
    belongs_to_recording,
    fixed_names,
    held_names,
    prior_sigma,
    robot_prior,
    shared_names,
)
from ballbar.ident.estimator.unknowns import NOWHERE, Own, Placed, PlacedPoses, Unknowns

POSITION_PRIOR = 1.0  # [m] of the ball-bar's base: the start has found it; keeps the steps finite
TILT_PRIOR = 3e-3  # [rad] of the ball-bar's base (notes/plant, base: 1 mrad)
ENCODER_OFFSET_PRIOR = 1.0  # [rad]
CLOCK_PRIOR = 1.0, 1e-3  # offset [s] and skew [1] around what the start has found
STEP_PRIOR = 1.0  # [s] of a clock step
TENSION_PRIOR = 60.0  # [N] of a knot of an unmeasured rod force (notes/identification sec. 4)
PLACEMENT_PRIOR = 1.0  # [m, rad] of seats and targets about their start: keeps steps finite


@dataclass(frozen=True)
class RecordingStart:
    """Starting values of one recording's unknowns, and how many knots and clock steps it has."""

    encoders: tuple[int, ...]
    geometry: Geometry  # encoder offsets and base position to start from
    clock: Clock | None
    knots: int = 0  # of the tension's spline; 0 where no correction needs loads
    tension_sigma: float = TENSION_PRIOR  # [N] prior of each knot
    clock_steps: int = 0


def kinematic_unknowns(
    start: Geometry, clock: Clock | None, parameters: NDArray[np.intp], sigma: Array | None = None
) -> tuple[Unknowns, Array]:
    """Unknowns of kinematics and clock alone, of one recording; and the vector to start from.

    start : values to start from, means of the priors, and of the parameters that stay fixed.
    parameters : (P,) indices into the table, in any order; the unknowns have the table's. sigma :
    (P,) [m, rad] of their priors; none if not given.
    """
    sigma = np.full(parameters.size, np.inf) if sigma is None else sigma
    in_order = np.argsort(parameters)
    parameters, sigma = parameters[in_order], sigma[in_order]
    every = start.table.names
    own = np.array([belongs_to_recording(every[i]) for i in parameters], dtype=bool)
    build = _Builder()
    for i, s in zip(parameters[~own], sigma[~own], strict=True):
        build.add(every[i], float(start.values[i]), float(s))
    shared = len(build.names)
    names = [every[i] for i in parameters[own]]
    geometry = build.block(names, start.values[parameters[own]], sigma[own])
    clocks = None
    if clock is not None:
        clocks = build.block(("offset", "skew"), (clock.offset, clock.skew), (np.inf, np.inf))
    layout = build.unknowns(
        start,
        parameters[~own],
        slice(shared, shared),
        None,
        [Own(parameters[own], geometry, clocks, None, None)],
    )
    return layout, layout.mean.copy()


def complete_unknowns(
    cell: Cell,
    nominal: Geometry,
    recordings: Sequence[RecordingStart],
    corrections: Sequence[Correction],
    *,
    gain_sigma: float | None,
    rod_sigma: float | None,
    still: PlacedPoses | None = None,
) -> tuple[Unknowns, Array]:
    """Unknowns of the complete model with priors of physical size; and the vector to start from.

    gain_sigma : of the gain of a logged rod force, which is an unknown; None where none was logged.
    rod_sigma : [m] of a measured rod length; None for the catalogue's tolerance. still : poses
    that are fitted together with the recordings.
    """
    build = _Builder()
    table = nominal.table
    fixed = fixed_names(table, held_names(cell))
    shared = [name for name in shared_names(table) if name not in fixed]
    priors = {name: prior_sigma(cell, name, rod_sigma) for name in shared}
    indices, coefficients = build.machine(nominal, priors, corrections)
    gain = None if gain_sigma is None else build.add("force_gain", 0.0, gain_sigma)
    several = len(recordings) > 1
    own = [_own(build, r, f"@{k}" if several else "") for k, r in enumerate(recordings, start=1)]
    placed = NOWHERE if still is None else _placed(build, still)
    layout = build.unknowns(nominal, indices, coefficients, gain, own, placed)
    return layout, layout.mean.copy()


def still_unknowns(
    nominal: Geometry, still: PlacedPoses, corrections: Sequence[Correction]
) -> Unknowns:
    """Unknowns of still poses alone, all with priors.

    The joint offset and offset of the first row are a gauge against the seats, those of the last
    row against the targets, and of two parallel axes only the sum of their offsets moves anything:
    these stay nominal. nominal : geometry about which the parameters have their priors, its last
    row the bare flange.
    """
    build = _Builder()
    priors = {p.name: robot_prior(p) for p in arm_parameters(still.table.robot)}
    shared, coefficients = build.machine(nominal, priors, corrections)
    return build.unknowns(nominal, shared, coefficients, None, (), _placed(build, still))


def arm_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """The robot's parameters without gauge and tool: what other instruments tell from their seats
    and targets.
    """
    table = parameter_table(robot)
    fixed = {*table.gauge, *last_row_names(table)}
    return tuple(p for p in table.parameters if p.side == "robot" and p.name not in fixed)


def last_row_names(table: ParameterTable) -> list[str]:
    """Parameters of the robot's last row, at which the tool sits."""
    names = [f"r{kind}{table.joints}" for kind in ("a", "d", "alpha", "theta", "beta")]
    return [name for name in names if name in table.index]


def bare_flange(robot: Robot) -> tuple[NDArray[np.intp], Array]:
    """Indices into the table of the robot's last row, and its values without a tool."""
    geometry = robot_geometry(robot)
    last = [geometry.table.index[name] for name in last_row_names(geometry.table)]
    return np.array(last, dtype=np.intp), geometry.values[last]


def _placed(build: _Builder, still: PlacedPoses) -> Placed:
    """Adds the unknowns of the seats and targets of still poses."""
    groups = still.table.groups

    def placement(name: str, *, turns: bool) -> slice:
        axes = ("x", "y", "z", "rx", "ry", "rz")[: 6 if turns else 3]
        count = len(axes)
        return build.block([f"{name}.{c}" for c in axes], [0.0] * count, [PLACEMENT_PRIOR] * count)

    framed = {g.seat for g in groups if g.kind.seat_turns}
    whole = {g.target for g in groups if g.kind.target_turns}
    seat_names, target_names = (
        tuple(dict.fromkeys(getattr(g, kind) for g in groups)) for kind in ("seat", "target")
    )
    last_row, flange = bare_flange(still.table.robot)
    motions = {g.motion.name: g.motion for g in groups if g.motion is not None}
    common = {g.common.name: g.common for g in groups if g.common is not None}
    return Placed(
        seats={s: placement(f"seat {s}", turns=s in framed) for s in seat_names},
        targets={t: placement(f"target {t}", turns=t in whole) for t in target_names},
        seat_starts={name: still.seats[name] for name in seat_names},
        target_starts={name: still.targets[name] for name in target_names},
        last_row=last_row,
        flange=flange,
        clocks={
            name: build.block(
                (f"clock {name}.offset", f"clock {name}.skew"),
                (motion.clock.offset, motion.clock.skew),
                CLOCK_PRIOR,
            )
            for name, motion in motions.items()
        },
        common={
            name: build.block(
                [f"{name}.{value}" for value in errors.names],
                np.zeros(len(errors.names)),
                np.ones(len(errors.names)),
            )
            for name, errors in common.items()
        },
    )


def _own(build: _Builder, recording: RecordingStart, tail: str) -> Own:
    start, clock = recording.geometry, recording.clock
    offsets = [f"btheta{joint}" for joint in recording.encoders]
    names = [*offsets, *BASE_POSE]
    means = [*(start[name] for name in (*offsets, *BASE_POSE[:3])), 0.0, 0.0]
    sigmas = [ENCODER_OFFSET_PRIOR] * len(offsets) + [POSITION_PRIOR] * 3 + [TILT_PRIOR] * 2
    geometry = build.block(names, means, sigmas, tail)
    clocks = None
    if clock is not None:
        clocks = build.block(("offset", "skew"), (clock.offset, clock.skew), CLOCK_PRIOR, tail)
    steps = build.numbered("clock_step", recording.clock_steps, STEP_PRIOR, tail)
    knots = build.numbered("tension", recording.knots, recording.tension_sigma, tail)
    indices = np.array([start.table.index[name] for name in names], dtype=np.intp)
    return Own(indices, geometry, clocks, steps, knots)


class _Builder:
    """Collects names, means and sigmas in order."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._mean: list[float] = []
        self._sigma: list[float] = []

    def add(self, name: str, mean: float, sigma: float) -> int:
        self.names.append(name)
        self._mean.append(mean)
        self._sigma.append(sigma)
        return len(self.names) - 1

    def block(
        self,
        names: Sequence[str],
        means: Sequence[float] | Array,
        sigmas: Sequence[float] | Array,
        tail: str = "",
    ) -> slice:
        first = len(self.names)
        for name, mean, sigma in zip(names, means, sigmas, strict=True):
            self.add(name + tail, float(mean), float(sigma))
        return slice(first, len(self.names))

    def machine(
        self, nominal: Geometry, priors: Mapping[str, float], corrections: Sequence[Correction]
    ) -> tuple[NDArray[np.intp], slice]:
        """Parameters with the sigmas of their priors, then coefficients: indices, and places."""
        self.block(list(priors), [nominal[name] for name in priors], list(priors.values()))
        every = [c for correction in corrections for c in correction.coefficients]
        coefficients = self.block(
            [c.name for c in every], [c.mean for c in every], [c.sigma for c in every]
        )
        if twice := [n for i, n in enumerate(self.names) if n in self.names[:i]]:
            raise InputError(f"corrections: two coefficients are called {twice[0]}. Rename one.")
        return np.array([nominal.table.index[name] for name in priors]), coefficients

    def numbered(self, name: str, count: int, sigma: float, tail: str) -> slice | None:
        names = [f"{name}{i + 1}" for i in range(count)]
        return self.block(names, [0.0] * count, [sigma] * count, tail) if count else None

    def unknowns(
        self,
        fixed: Geometry,
        shared: NDArray[np.intp],
        coefficients: slice,
        gain: int | None,
        own: Sequence[Own],
        placed: Placed = NOWHERE,
    ) -> Unknowns:
        return Unknowns(
            names=tuple(self.names),
            mean=np.array(self._mean),
            sigma=np.array(self._sigma),
            fixed=fixed,
            shared=np.asarray(shared, dtype=np.intp),
            coefficients=coefficients,
            gain=gain,
            own=tuple(own),
            placed=placed,
        )
