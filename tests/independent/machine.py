"""One true machine: the numbers of the files, errors drawn about them, and effects asked for.

Of robot, ball-bar and plate every direction is drawn that the identifier holds for uncertain: all
rows, the axes of the universal joints with row 5, the plate within its sigma, the rod, masses and
centres, stiffness, backlash, and one ripple of an order that no file lists.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tests.independent.screws import Array, Chain, Pose, exponential, homes, shift, turn

CELL = Path(__file__).parents[2] / "cell"
POSITION = np.array([0.70, 0.0, 0.54])  # [m] centre of the sphere
# Standard deviations of what is drawn
LENGTH, ANGLE = 1e-3, 1e-3  # [m, rad] of the robot's rows (thesis Table 3.1)
AXIS_LENGTH, AXIS_ANGLE = 5e-6, 5e-5  # [m, rad] of the ball-bar's axes
TILT = 1e-3  # [rad] of the ball-bar's base
MASS, CENTRE = 0.02, 3e-3  # relative; [m]
SPREAD = 0.3  # of the logarithm of stiffness, backlash and friction
GAIN = 0.02  # of logged torques
BASE_STIFFNESS = 5e7  # [N/m] of the ball-bar's base
# [N m] reducers RV-80E, RV-80E, RV-40E (catalogue, recalled); wrist assumed
RATED = np.array([784.0, 784.0, 412.0, 80.0, 60.0, 40.0])
RESOLVER = 1.5e-3  # [rad] at the motor, 1 and 2 cycles a turn
DEPTH = 0.1  # [rad] of the phase's modulation, once a turn
FEEDER = np.array([0.0, 0.10, 0.15])  # [m] of a wire feeder, frame behind axis 3
UNLISTED = 4e-6  # [rad] of a ripple whose order no file lists
HYSTERESIS, FLANK = 0.002, 0.003  # of the rated torque: half width of the loop, width of the flank
_X, _Y = np.eye(3)[:2]
PLATE_WIDTH = 100.0 / 45.0  # across over along the bending: the box of the plate's file


Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Ripple:
    """Error of one gear: size * sin(order * g + phase + depth * sin(g)), g its angle."""

    gear: int
    order: float  # cycles a turn of the output
    size: float  # [rad]
    phase: float  # [rad]
    depth: float = 0.0  # [rad] of the phase's modulation
    edge: float = 0.0  # steepness of a rectangle in place of a sine; 0: a sine
    power: float = 0.0  # [1/rad] growth of the amplitude with the gear's angle

    def at(self, g: Array) -> Array:
        """(N,) [rad] at gear angles (N,) [rad]."""
        wave = np.sin(self.order * g + self.phase + self.depth * np.sin(g))
        if self.edge:
            wave = np.tanh(self.edge * wave)
        return np.asarray(self.size * (1.0 + self.power * g) * wave)


@dataclass(frozen=True)
class Effects:
    """Effects that the files of no cell state; all absent by default."""

    bearing: tuple[float, ...] = (0.0,) * 6  # [rad/(N m)] x1 y1 x2 y2 x3 y3
    lag: tuple[float, ...] = (0.0,) * 6  # [s] first-order filter of each logged motor
    growth: tuple[float, float] = (0.0, 0.0)  # [m] of a2, d4 over 120 s, or in the end
    growth_time: float = 0.0  # [s] of the exponential; 0: linear, and every recording begins cold
    remount: tuple[float, float] = (0.0, 0.0)  # [m, rad] of the plate before each later recording
    knee: float = 0.0  # share of the rated torque below which a gear is half as stiff
    tool_mass: float = 0.0  # [kg] that the files do not state
    tool_centre: tuple[float, float, float] = (0.08, 0.02, 0.12)  # [m] of it, flange frame
    slope: tuple[float, float] = (0.0, 0.0)  # [rad] of the floor about x and y
    cable: float = 0.0  # [N/m] from the tool to a point above the robot
    sway: tuple[float, float] = (0.0, 0.0)  # [m, Hz] of the ball-bar's base along x
    settling: float = 0.0  # [m] by which that base sinks during a recording
    dropped: float = 0.0  # [m] by which it jumps halfway
    base_stiffness: float = 0.0  # [N/m] of that base; 0: as of every machine
    hysteresis: float = 0.0  # [rad] of all gears, along their load (Bouc & Wen)
    reversal: float = 0.0  # [rad] by which friction at the gears' outputs holds them back
    softer: float = 1.0  # compliance of the gears, times
    wider: float = 1.0  # their backlash, times
    worse_resolver: float = 1.0  # errors of the resolvers, times
    spring: float = 0.0  # [N m] of a balancer on gear 2, along the sine of its angle
    feeder: float = 0.0  # [kg] on the forearm that no file states
    rod_play: float = 0.0  # [m] half of what the balls are loose in their seats
    plate_softer: float = 1.0  # compliance of the plate, times
    further: tuple[Ripple, ...] = ()  # errors of the gears beside those of the files
    unlisted: float = 1.0  # ripple whose order no file lists, and errors of the masses, times


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body with its chain at home."""

    behind: int  # twist that moves it
    mass: float  # [kg]
    centre: Array  # (3,) [m]
    inertia: Array  # (3, 3) [kg m^2] about its centre


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A chain, its joints and its bodies."""

    chain: Chain
    joints: Indices  # (J,) twists that are joints (of a ball-bar its slide too)
    bodies: tuple[Body, ...]


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot that holds a plate and a ball-bar."""

    rows: Array  # (6, 5) DH rows of the robot, as of `homes`
    bar_rows: Array  # (5, 5) the same of the ball-bar
    arm: Mechanism
    bar: Mechanism
    compliance: Array  # (K, K) [rad/(N m), m/N] of the arm's coordinates other than its gears
    grow: tuple[int, int]  # coordinates of a2 and d4
    to_joint: Array  # (6, 6) joints = gears @ to_joint
    ratio: Array  # (6,) gear outputs = ratio * motors
    gravity: Array  # (3,) [m/s^2]
    stiffness: Array  # (6,) [N m/rad] of the gears
    half_width: Array  # (6,) [rad] half of the backlash
    coulomb: Array  # (6,) [N m]
    viscous: Array  # (6,) [N m s/rad]
    stribeck: Array  # (6,) [rad/s]
    rotor: Array  # (6,) [kg m^2] at the output
    servo: Array  # (6,) [N m/rad] proportional gain at the output
    gain: Array  # (6,) of the torque log
    ripples: tuple[Ripple, ...]
    resolvers: tuple[Ripple, ...]  # of motor angles
    rod: float  # [m] length
    rod_stiffness: float  # [N/m]
    rod_half_width: float  # [m] half of its backlash
    bar_friction: float  # [N m]
    base_stiffness: float  # [N/m]
    effects: Effects

    def gears(self, motors: Array) -> Array:
        """(N, 6) [rad] outputs of rigid gears at motor angles (N, 6) [rad]."""
        out = motors * self.ratio
        return out + self.ripple(out)

    def ripple(self, g: Array) -> Array:
        """(N, 6) [rad] error of the gears at nominal outputs g (N, 6) [rad]."""
        return _summed(self.ripples, g)

    def motors(self, rigid: Array) -> Array:
        """(N, 6) [rad] motor angles that turn rigid gears to (N, 6) [rad]."""
        out = rigid
        for _ in range(6):  # the error turns by 5e-3 at most for a unit of the gear
            out = rigid - self.ripple(out)
        return np.asarray(out / self.ratio)

    def read(self, motors: Array) -> Array:
        """(N, 6) [rad] readings of the resolvers at motor angles (N, 6) [rad]."""
        return motors + _summed(self.resolvers, motors)

    def from_readings(self, readings: Array) -> Array:
        """(N, 6) [rad] motor angles at readings (N, 6) [rad]."""
        motors = readings
        for _ in range(6):
            motors = readings - _summed(self.resolvers, motors)
        return np.asarray(motors)


def _summed(ripples: tuple[Ripple, ...], angles: Array) -> Array:
    out = np.zeros_like(angles)
    for r in ripples:
        out[:, r.gear] += r.at(angles[:, r.gear])
    return out


@dataclass(frozen=True, eq=False)
class Files:
    """The numbers of the files."""

    robot: dict[str, Any]
    bar: dict[str, Any]
    plate: dict[str, Any]

    @property
    def transmission(self) -> Array:
        """(6, 6) joints = motors @ transmission."""
        return np.array([[float(Fraction(x)) for x in row] for row in self.robot["motor_to_joint"]])

    @property
    def axis_to_joint(self) -> Array:
        """(6, 6) joints = controller axes @ axis_to_joint."""
        return np.array(self.robot["controller_to_joint"], dtype=float)

    def robot_rows(self) -> Array:
        """(6, 5) rows of the robot, the plate in the last one."""
        rows = _rows(self.robot)
        rows[5, :2] += self.plate["length_m"], self.plate["tool_offset_m"]
        return rows


def files(robot: str = "irb2400", bar: str = "lund_600", plate: str = "plate_250") -> Files:
    """The files of a cell."""
    names = (("robots", robot), ("instruments", bar), ("plates", plate))
    return Files(
        *(_numbers(yaml.safe_load((CELL / d / f"{n}.yaml").read_text())) for d, n in names)
    )


def _numbers(tree: Any) -> Any:
    """The tree with 1.0e7 as a number, which YAML 1.1 takes for text."""
    if isinstance(tree, dict):
        return {key: _numbers(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_numbers(value) for value in tree]
    try:
        return float(tree) if isinstance(tree, str) else tree
    except ValueError:
        return tree


def _rows(file: dict[str, Any]) -> Array:
    return np.array(
        [
            [r["a_m"], r["d_m"], np.deg2rad(r["alpha_deg"]), np.deg2rad(r["theta_deg"]), 0.0]
            for r in file["dh"]
        ]
    )


def nominal(cell: Files) -> Machine:
    """The machine as the files have it, with rigid bearings and plate and without ripple."""
    return _machine(cell, Effects(), None)


def drawn(cell: Files, seed: int, effects: Effects = Effects()) -> Machine:
    """A true machine; the same seed gives the same machine under other effects."""
    return _machine(cell, effects, np.random.default_rng([seed, 15]))


def _machine(cell: Files, effects: Effects, rng: np.random.Generator | None) -> Machine:
    def z(*shape: int) -> Array:
        return np.zeros(shape) if rng is None else rng.standard_normal(shape)

    def of_bodies(*shape: int) -> Array:
        return effects.unlisted * z(*shape)

    real = rng is not None
    gears, plate = cell.robot["gears"], cell.plate
    rows, bar = cell.robot_rows(), _rows(cell.bar)
    known = rows[5, 0] + plate["length_sigma_m"] * float(z(1)[0])
    rows += z(6, 5) * [LENGTH, LENGTH, ANGLE, ANGLE, ANGLE] * _hayati(6, (1, 5))
    rows[5, 0] = known
    rod = bar[2, 1] + 0.5 * cell.bar["length_tolerance_m"] * float(z(1)[0])
    bar += z(5, 5) * [AXIS_LENGTH, AXIS_LENGTH, AXIS_ANGLE, 0.0, 0.0]
    bar[2, 1] = rod
    tilt = TILT * z(2)
    base = Pose(
        exponential(turn(_X, np.zeros(3)), tilt[0]).R
        @ exponential(turn(_Y, np.zeros(3)), tilt[1]).R,
        POSITION + 2e-3 * z(3),
    )
    bodies = [(i, *_body(cell.robot["links"][f"link{i + 1}"], of_bodies)) for i in range(6)]
    flange = homes(_rows(cell.robot), Pose(np.eye(3), np.zeros(3)))[6]
    if effects.feeder:
        forearm = homes(_rows(cell.robot), Pose(np.eye(3), np.zeros(3)))[3]
        own = 0.01 * effects.feeder * np.eye(3)
        bodies.append((2, effects.feeder, forearm.p + forearm.R @ FEEDER, own))
    tools = [_body(plate["body"], of_bodies)]
    if effects.tool_mass:
        size = 0.05 * effects.tool_mass  # [kg m^2] gyration radius of 0.1 m in each direction
        tools.append((effects.tool_mass, np.array(effects.tool_centre), 0.2 * size * np.eye(3)))
    for mass, centre, inertia in tools:
        bodies.append((5, mass, flange.R @ centre + flange.p, flange.R @ inertia @ flange.R.T))
    plate_stiffness = plate["tip_stiffness_N_per_m"] * float(np.exp(0.2 * z(1)[0]))
    arm, compliance, grow = _arm(
        rows,
        bodies,
        effects,
        (plate["length_m"], plate_stiffness / effects.plate_softer if real else np.inf),
    )
    ratio = np.diag(cell.transmission)
    ripples, resolvers = _ripples(cell, ratio, effects, rng) if rng is not None else ((), ())
    return Machine(
        rows=rows,
        bar_rows=bar,
        arm=arm,
        bar=_bar(bar, cell.bar, base, of_bodies),
        compliance=compliance,
        grow=grow,
        to_joint=cell.transmission / ratio[:, None],
        ratio=ratio,
        gravity=_leaning(effects.slope) @ np.array(cell.robot["gravity_m_per_s2"]),
        stiffness=gears["stiffness_N_m_per_rad"] * np.exp(SPREAD * z(6)) / effects.softer,
        half_width=0.5 * effects.wider * np.array(gears["lost_motion_rad"]) * np.exp(SPREAD * z(6)),
        coulomb=gears["friction"]["coulomb_N_m"] * np.exp(SPREAD * z(6)),
        viscous=gears["friction"]["viscous_N_m_s_per_rad"] * np.exp(SPREAD * z(6)),
        stribeck=np.array(gears["friction"]["stribeck_rad_per_s"]),
        rotor=np.array(cell.robot["rotor_inertia_kg_m2"]) / ratio**2 * np.exp(0.1 * z(6)),
        servo=np.array(cell.robot["servo"]["soft"]["kp_N_m_per_rad"]),
        gain=1.0 + GAIN * z(6),
        ripples=(*ripples, *effects.further),
        resolvers=tuple(replace(r, size=effects.worse_resolver * r.size) for r in resolvers),
        rod=rod,
        rod_stiffness=float(np.exp(0.2 * z(1)[0]))
        / sum(1.0 / part for part in cell.bar["axial_stiffness_N_per_m"].values()),
        rod_half_width=0.5 * sum(cell.bar["backlash_m"].values()) + effects.rod_play,
        bar_friction=cell.bar["friction_torque_N_m"],
        base_stiffness=effects.base_stiffness or BASE_STIFFNESS,
        effects=effects,
    )


def _leaning(slope: tuple[float, float]) -> Array:
    """(3, 3) turn of gravity against the robot on a floor that is not level."""
    turns = (
        exponential(turn(a, np.zeros(3)), np.asarray(s)).R
        for a, s in zip((_X, _Y), slope, strict=True)
    )
    first, second = turns
    return first @ second


def _hayati(rows: int, with_beta: tuple[int, ...]) -> Array:
    """(rows, 5) of ones, and zeros for the angle beta of rows whose axes are not parallel."""
    out = np.ones((rows, 5))
    out[[i for i in range(rows) if i not in with_beta], 4] = 0.0
    return out


def _body(link: dict[str, Any], z: Any) -> tuple[float, Array, Array]:
    xx, yy, zz, xy, xz, yz = link["inertia_kg_m2"]
    scale = 1.0 + MASS * float(z(1)[0])
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return link["mass_kg"] * scale, link["com_m"] + CENTRE * z(3), scale * inertia


def _arm(
    rows: Array, bodies: list[Any], effects: Effects, plate: tuple[float, float]
) -> tuple[Mechanism, Array, tuple[int, int]]:
    """The robot's mechanism, the compliance of its coordinates, and those that grow.

    Each joint's bearing tilts about x and y of the frame that the joint turns in; a2 and d4 are
    slides; the plate bends at its tip as a cantilever, in both directions.
    """
    frames = homes(rows, Pose(np.eye(3), np.zeros(3)))
    twists: list[Array] = []
    joints, grow, soft = [], [0, 0], {}
    for i, at in enumerate(frames[:6]):
        if i == 3:
            grow[1] = len(twists)
            twists.append(shift(at.R[:, 2]))
        for axis in (0, 1) if i < 3 else ():
            soft[len(twists)] = effects.bearing[2 * i + axis]
            twists.append(turn(at.R[:, axis], at.p))
        joints.append(len(twists))
        twists.append(turn(at.R[:, 2], at.p))
        if i == 1:
            grow[0] = len(twists)
            twists.append(shift(frames[2].R[:, 0]))
    tip, first = frames[6], len(twists)
    _, y, z = tip.R.T
    twists += [shift(z), turn(y, tip.p), shift(y), turn(z, tip.p)]
    compliance = np.diag([soft.get(k, 0.0) for k in range(len(twists))])
    length, stiffness = plate
    for at_tip, sign, k in ((first, -1.0, stiffness), (first + 2, 1.0, stiffness * PLATE_WIDTH**2)):
        beam = np.array([[1.0, sign * 1.5 / length], [sign * 1.5 / length, 3.0 / length**2]]) / k
        compliance[at_tip : at_tip + 2, at_tip : at_tip + 2] = beam
    placed = tuple(Body(joints[i], *rest) for i, *rest in bodies)
    arm = Mechanism(Chain(tuple(twists), tip), np.array(joints), placed)
    return arm, compliance, (grow[0], grow[1])


def _bar(rows: Array, file: dict[str, Any], base: Pose, z: Any) -> Mechanism:
    """The ball-bar: three hinges, the slide along its rod, two hinges."""
    frames = homes(rows, base)
    hinges = [turn(at.R[:, 2], at.p) for at in frames[:5]]
    hinges.insert(3, shift(frames[2].R[:, 2]))
    behind = (0, 1, 2, 4, 5)  # the links lie on the hinges; most of the rod is before its slide
    bodies = []
    for i, k in enumerate(behind):
        mass, centre, inertia = _body(file["links"][f"link{i + 1}"], z)
        bodies.append(Body(k, mass, base.p + centre, inertia))
    return Mechanism(Chain(tuple(hinges), frames[5]), np.arange(6), tuple(bodies))


def _ripples(
    cell: Files, ratio: Array, effects: Effects, rng: np.random.Generator
) -> tuple[tuple[Ripple, ...], tuple[Ripple, ...]]:
    def ripple(gear: int, order: float, size: float) -> Ripple:
        return Ripple(gear, order, size, rng.uniform(0, 2 * np.pi), rng.uniform(-DEPTH, DEPTH))

    out = []
    for table in cell.robot["gears"]["transmission_error"]:
        for axis in table["axes"]:
            gear = axis - 1
            orders = [*table["cycles_per_turn"], 1.0 / abs(ratio[gear])]
            sizes = [*table["amplitude_rad"], table["input_amplitude_rad"]]
            out += [ripple(gear, n, size) for n, size in zip(orders, sizes, strict=True)]
            out.append(ripple(gear, float(rng.integers(3, 39)), effects.unlisted * UNLISTED))
    resolvers = tuple(ripple(i, float(n), RESOLVER) for i in range(6) for n in (1, 2))
    return tuple(out), resolvers
