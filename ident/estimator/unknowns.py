"""The unknowns of a fit as one vector, with a Gaussian prior for each.

Shared by all that was measured are the geometry of robot and ball-bar, the coefficients of the
corrections and the gain of a measured rod force. Each recording has its own encoder offsets, base
pose of the ball-bar, clock, and where nothing measures the rod's tension its spline. Then come the
seats of other instruments and the targets that they measured, which start where `ident.start` found
them; of those whose orientation nothing measures only the position is unknown. An infinite prior
sigma means no prior.

The gauge of the robot's parameters stays fixed: of the IRB 2400 `rd1`, `rtheta1`, `rd3`. The plate
is the known length (thesis Table 3.2, `ra6`): fixed in a fit without priors, else an unknown under
the prior of its file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.clock import Clock
from cell.descriptions import Cell, Robot
from cell.geometry import (
    Geometry,
    Parameter,
    ParameterTable,
    parameter_named,
    parameter_table,
    robot_geometry,
)
from cell.placement import Placement
from cell.poses import PoseTable
from ident.corrections.base import Coefficient, Correction

LENGTH_PRIOR = (
    5e-3  # [m] of a robot's length about its catalogue value (notes/identification sec. 6)
)
ANGLE_PRIOR = 5e-3  # [rad] likewise
POSITION_PRIOR = 1.0  # [m] of the ball-bar's base: the start has found it; keeps the steps finite
TILT_PRIOR = 3e-3  # [rad] of the ball-bar's base (notes/parameters, base: 1 mrad)
AXIS_OFFSET_PRIOR = 5e-6  # [m] of gimbal and universal joint (notes/parameters, joints_mechanical)
AXIS_ANGLE_PRIOR = 5e-5  # [rad] squareness, likewise
ENCODER_OFFSET_PRIOR = 1.0  # [rad]
CLOCK_PRIOR = 1.0, 1e-3  # offset [s] and skew [1] around what the start has found
STEP_PRIOR = 1.0  # [s] of a clock step
GAIN_PRIOR = 0.03  # of a measured rod force: two gains of 2 % (notes/identification sec. 1)
TENSION_PRIOR = 60.0  # [N] of a knot of an unmeasured rod force (notes/identification sec. 4)
MAX_OFFSET_STEP = 3.0  # [s] a longer step leaves the region where the splines say anything
MAX_SKEW = 2e-3  # [1] twenty times the worst free-running clock of notes/log_formats
KNOWN_LENGTH = 1e-5  # [m] standard deviation up to which a length of the cell is taken as exact
# Of a parameter about its catalogue value where still poses alone identify it. UR5, UR10 and Panda:
# from 60 poses on, 5 mrad and 2 mm predict as well; 1 mrad and 0.3 mm are too tight
# (docs/real_robots, priors).
STILL_ANGLE_PRIOR, STILL_LENGTH_PRIOR = 2e-3, 7e-4  # [rad], [m]
PLACEMENT_PRIOR = 1.0  # [m, rad] of seats and targets about their start: keeps steps finite
HELD = 1e-9  # of a prior's sigma: below what data could tell
BASE_POSE = ("ox", "oy", "oz", "otx", "oty")


def belongs_to_recording(name: str) -> bool:
    """Whether a parameter is one recording's own: encoder offset or base pose of the ball-bar."""
    return name.startswith("btheta") or name in BASE_POSE


def shared_names(table: ParameterTable) -> tuple[str, ...]:
    """Parameters that all recordings have in common."""
    return tuple(name for name in table.names if not belongs_to_recording(name))


def declared_names(cell: Cell) -> tuple[str, ...]:
    """Parameters that stay as the files declare them, the lengths that fix the scale among them.

    Of a ball-bar that is the plate. A sensed length fixes the scale itself, so there the plate is
    declared only if its file says that it is known, and bd3 only if the sensor's zero was
    calibrated. What else is in the joints of such a bar its length does not show.
    """
    table, bar = parameter_table(cell.robot), cell.ballbar
    if bar.stroke is None:
        return (table.plate,)
    plate = (table.plate,) if cell.plate.length_sigma <= KNOWN_LENGTH else ()
    zero = ("bd3",) if bar.length_tolerance <= KNOWN_LENGTH else ()
    joints = (n for n in table.names if n.startswith(("ba", "bd", "balpha")) and n != "bd3")
    return (*plate, *zero, *joints)


def scale_sigma(cell: Cell) -> float:
    """Relative standard deviation of the scale, which no data show.

    The plate's length gives it and the universal joint's offset `ba5` along it, equivalent to each
    other; of a bar that measures its length, that to which it was calibrated. A zero of such a bar
    that is not known is among the unknowns.
    """
    bar, plate = cell.ballbar, cell.plate
    if bar.stroke is None:
        return float(np.hypot(plate.length_sigma, AXIS_OFFSET_PRIOR)) / plate.length
    return bar.length_tolerance / bar.length if bar.length_tolerance <= KNOWN_LENGTH else 0.0


def taken_as_exact(cell: Cell, layout: Unknowns) -> NDArray[np.intp]:
    """Indices into the table of the instrument's parameters that a fit took as exact.

    Plate and ball-bar, whose files state how well they are known. Of a bar between two balls there
    is nothing but its length.
    """
    table = parameter_table(cell.robot)
    bar = [n for n in shared_names(table) if n.startswith("b")]
    instrument = (table.plate, *(bar if cell.ballbar.stroke is None else ["bd3"]))
    left = [n for n in instrument if n not in layout.names]
    return np.array([table.index[name] for name in left], dtype=np.intp)


def held_names(cell: Cell) -> tuple[str, ...]:
    """Those of `declared_names` that stay as declared where every unknown has a prior.

    The plate of a ball-bar has the standard deviation of its file: held as exact, it would pass its
    own error on as scale that nobody states.
    """
    if cell.ballbar.stroke is None:
        return ()
    return declared_names(cell)


def fixed_names(table: ParameterTable, declared: Sequence[str] | None = None) -> tuple[str, ...]:
    """Parameters that are never identified: gauge, and those of `declared_names`; default plate."""
    return (*table.gauge, *((table.plate,) if declared is None else declared))


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

    def shifted(self, shift: int) -> Placed:
        """The places after `shift` more unknowns."""
        seats, targets = (
            {name: _further(part, shift) for name, part in places.items()}
            for places in (self.seats, self.targets)
        )
        return replace(self, seats=seats, targets=targets)


NOWHERE = Placed({}, {}, {}, {}, np.zeros(0, dtype=np.intp), np.zeros(0))


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

    def held(self, targets: Iterable[str] = ()) -> Unknowns:
        """The same with robot, coefficients and some targets held at their priors' means."""
        sigma = self.sigma.copy()
        sigma[self.machine] *= HELD
        for name in targets:
            sigma[self.placed.targets[name]] *= HELD
        return replace(self, sigma=sigma)

    def clock(self, x: Array, k: int) -> Clock:
        """The clock of recording k."""
        position = self.own[k].clock
        return Clock(0.0, 0.0) if position is None else Clock(*(float(v) for v in x[position]))

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
            self,
            names=(*self.names[:first], *(c.name for c in coefficients), *self.names[stop:]),
            mean=recast(self.mean, means),
            sigma=recast(self.sigma, [c.sigma for c in coefficients]),
            coefficients=slice(first, stop + shift),
            gain=None if self.gain is None else self.gain + shift,
            own=tuple(own.moved(shift) for own in self.own),
            placed=self.placed.shifted(shift),
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
            self,
            names=tuple(np.insert(np.array(self.names, dtype=object), places, names)),
            mean=np.insert(self.mean, places, values),
            sigma=np.insert(self.sigma, places, np.inf),
            shared=np.insert(self.shared, places, parameters),
            coefficients=slice(old.start + shift, old.stop + shift),
            gain=None if self.gain is None else self.gain + shift,
            own=tuple(own.moved(shift) for own in self.own),
            placed=self.placed.shifted(shift),
        )
        return layout, np.insert(x, places, values)

    def moved(self, x: Array, step: Array) -> Array:
        """(P,) x + step, the clocks kept where the logs' splines say anything."""
        out = x + step
        for own in self.own:
            if own.clock is not None:
                offset, skew = own.clock.start, own.clock.start + 1
                shift = np.clip(step[offset], -MAX_OFFSET_STEP, MAX_OFFSET_STEP)
                out[offset] = x[offset] + shift
                out[skew] = np.clip(out[skew], -MAX_SKEW, MAX_SKEW)
        return out


@dataclass(frozen=True)
class RecordingStart:
    """What the vector needs to know of one recording."""

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
    measured_force: bool,
    rod_sigma: float | None,
    still: PlacedPoses | None = None,
) -> tuple[Unknowns, Array]:
    """Unknowns of the complete model with priors of physical size; and the vector to start from.

    measured_force : whether the rod's force was logged, so that its gain is an unknown.
    rod_sigma : [m] of a measured rod length; None for the catalogue's tolerance. still : poses
    that are fitted together with the recordings.
    """
    build = _Builder()
    table = nominal.table
    fixed = fixed_names(table, held_names(cell))
    shared = [name for name in shared_names(table) if name not in fixed]
    for name in shared:
        build.add(name, nominal[name], _prior(cell, name, rod_sigma))
    first = len(build.names)
    for correction in corrections:
        for c in correction.coefficients:
            build.add(c.name, c.mean, c.sigma)
    coefficients = slice(first, len(build.names))
    gain = build.add("force_gain", 0.0, GAIN_PRIOR) if measured_force else None
    several = len(recordings) > 1
    own = [_own(build, r, f"@{k}" if several else "") for k, r in enumerate(recordings, start=1)]
    indices = np.array([table.index[name] for name in shared])
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
    build, table, robot = _Builder(), nominal.table, still.table.robot
    names = [p.name for p in arm_parameters(robot)]
    for name in names:
        length = parameter_named(name).is_length
        build.add(name, nominal[name], STILL_LENGTH_PRIOR if length else STILL_ANGLE_PRIOR)
    every = [c for correction in corrections for c in correction.coefficients]
    coefficients = build.block(
        [c.name for c in every], [c.mean for c in every], [c.sigma for c in every]
    )
    placed = _placed(build, still)
    shared = [table.index[name] for name in names]
    return build.unknowns(nominal, np.array(shared), coefficients, None, (), placed)


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
    return Placed(
        seats={s: placement(f"seat {s}", turns=s in framed) for s in seat_names},
        targets={t: placement(f"target {t}", turns=t in whole) for t in target_names},
        seat_starts={name: still.seats[name] for name in seat_names},
        target_starts={name: still.targets[name] for name in target_names},
        last_row=last_row,
        flange=flange,
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


def priors(cell: Cell, table: ParameterTable, parameters: NDArray[np.intp]) -> Array:
    """(P,) [m, rad] prior sigma of parameters (P,), indices into the table.

    Infinite for those that belong to a recording.
    """
    names = [table.names[i] for i in parameters]
    return np.array(
        [np.inf if belongs_to_recording(name) else _prior(cell, name, None) for name in names]
    )


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


def _prior(cell: Cell, name: str, rod_sigma: float | None) -> float:
    """[m, rad] prior sigma of one shared parameter."""
    parameter = parameter_named(name)
    if name == parameter_table(cell.robot).plate:
        return cell.plate.length_sigma
    if name == "bd3":
        return cell.ballbar.length_tolerance if rod_sigma is None else rod_sigma
    if parameter.side == "bar":
        return AXIS_OFFSET_PRIOR if parameter.is_length else AXIS_ANGLE_PRIOR
    return LENGTH_PRIOR if parameter.is_length else ANGLE_PRIOR
