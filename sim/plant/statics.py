"""Static equilibrium of the closed mechanism without MuJoCo, and the force in the rod.

Minimises the energy of servo, gears, plate, base, rod and gravity over motor angles m, gear
deflections e (joints are m + e), plate bending, base shift, ball-bar angles b and rod elongation s,
subject to the closed loop, by Newton steps on the Lagrangian. The Hessian omits the curvature of
the loop and of gravity, a few hundredths of the servo stiffness, so each step gains one to two
digits. Backlash is piecewise linear; within it a spring of a ten-thousandth of the stiffness keeps
the step defined. Friction and hysteresis have no energy and are not included. The MuJoCo model
shares nothing with this one but the descriptions, so that each can check the other (notes/plant
sec. 5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, cross, forward, joint_screws
from ballbar.cell.descriptions import Cell, Link
from ballbar.cell.errors import FailureError
from ballbar.cell.geometry import Geometry, nominal_chain, robot_frames
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.sim.motion import Deflected, deflect, turning
from ballbar.sim.plant.effects import Plant

BAR, ROD, PLATE, BASE = slice(-10, -5), -5, -4, slice(-3, None)  # coordinates behind the robot's
INSIDE_BACKLASH = 1e-4  # stiffness inside a dead band, relative to that outside
_MAX_STEPS = 400
_PATIENCE = 12  # full Newton steps; without backlash ten suffice
_BEYOND = 1e-3  # of the half width of a dead band, by which a step ends beyond its end
_FORCE_TOLERANCE = 1e-8  # [N m, N] remaining generalised force
_CLOSURE_TOLERANCE = 1e-13  # [m, rad]


class NoEquilibriumError(FailureError):
    """No equilibrium was found near the start."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """One held pose."""

    motor: Array  # (J,) [rad] m
    gear: Array  # (J,) [rad] e, joint by joint
    b: Array  # (5,) [rad]
    stretch: float  # [m] of the rod
    plate: float  # [rad] bending
    base: Array  # (3,) [m] shift
    rod_force: float  # [N] tension positive
    in_backlash: bool  # whether a gear or the rod is inside its dead band

    @property
    def q(self) -> Array:
        """(J,) [rad] robot joint angles."""
        return self.motor + self.gear


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where the Newton steps ended."""

    x: Array  # (2 J + 10,)
    multipliers: Array  # (6,)
    rod: float  # [N] force in it
    open: float  # [m, rad] of the loop
    still: bool


@dataclass(frozen=True, eq=False)
class _Machine:
    """Quantities that do not change during the search."""

    plant: Plant
    joint_to_gear: Array  # (J, J)
    command: Array  # (J,) [rad] of the gears
    robot: list[list[Link]]  # of each joint, in the frame that turns with it
    bar: list[list[Link]]
    active: NDArray[np.intp]  # coordinates that can move

    @property
    def motor(self) -> slice:
        """The coordinates m of the motors."""
        return slice(0, self.command.size)

    @property
    def gear(self) -> slice:
        """The coordinates e of the gears."""
        return slice(self.command.size, 2 * self.command.size)

    @property
    def coordinates(self) -> int:
        """Number of coordinates: 2 J of the robot, 10 of ball-bar, plate and base."""
        return 2 * self.command.size + 10

    @property
    def gravity(self) -> Array:
        """(3,) [m/s^2] in the base frame."""
        return self.plant.cell.robot.gravity


def equilibrium(plant: Plant, command: Array, q: Array, b: Array) -> Equilibrium:
    """The equilibrium of the mechanism whose servos hold a command.

    command : (J,) [rad] of the gears. q, b : (J,), (5,) [rad] joint angles to start from, close by.

    Raises NoEquilibriumError when the steps do not converge.
    """
    machine = _machine(plant, command)
    x = np.zeros(machine.coordinates)
    x[machine.motor], x[BAR] = q, b
    solution = _solved(machine, x, np.zeros(6))
    if not solution.still:  # where nothing has play the steps do not jump from flank to flank
        rigid = _machine(replace(plant, effects=plant.effects.without_backlash), command)
        first = _solved(rigid, x, np.zeros(6))
        solution = _solved(machine, first.x, first.multipliers)
    if not solution.still:
        raise NoEquilibriumError(
            f"statics: no equilibrium in {_MAX_STEPS} steps; loop open by {solution.open:.3g}. "
            "Move the pose away from singularities, or start closer to it"
        )
    return _as_equilibrium(machine, solution.x, solution.rod)


def _solved(machine: _Machine, x: Array, multipliers: Array) -> _Solution:
    """Newton steps from x (2 J + 10,) and multipliers (6,) of the loop, until all is still."""
    x, multipliers, active = x.copy(), multipliers.copy(), machine.active
    for k in range(_MAX_STEPS):
        ends = _ends(machine, x)
        closed, columns = _closure(ends), _closure_columns(machine, ends)[:, active]
        force, hessian = _forces(machine, ends, x)
        imbalance = force[active] + columns.T @ multipliers
        gap = float(np.abs(closed).max())
        if gap < _CLOSURE_TOLERANCE and np.abs(imbalance).max() < _FORCE_TOLERANCE:
            rod = float(force[ROD] - _rod_weight(machine, ends))
            return _Solution(x, multipliers, rod, gap, still=True)
        system = np.block(
            [[hessian[np.ix_(active, active)], columns.T], [columns, np.zeros((6, 6))]]
        )
        solution = np.linalg.solve(system, -np.concatenate((force[active], closed)))
        step = np.zeros(machine.coordinates)
        step[active] = np.clip(solution[: active.size], -0.1, 0.1)
        share = 1.0 if k < _PATIENCE else _to_end_of_backlash(machine, x, step)
        x += share * step
        multipliers += share * (solution[active.size :] - multipliers)
    return _Solution(x, multipliers, 0.0, gap, still=False)


def gravity_torque(cell: Cell, geometry: Geometry, q: Array) -> Array:
    """(N, J) [N m] torque that holds the unloaded robot with its plate against gravity.

    q : (N, J) [rad] joint angles.
    """
    frames = robot_frames(geometry, q)
    return _weight(geometry.robot, q, frames, _robot_links(cell), cell.robot.gravity).T


def _machine(plant: Plant, command: Array) -> _Machine:
    effects, cell = plant.effects, plant.loaded
    bar = cell.ballbar
    joints = cell.robot.joints
    movable = np.ones(2 * joints + 10, dtype=bool)
    movable[joints : 2 * joints] = effects.gear_stiffness is not None
    movable[PLATE] = effects.plate_stiffness is not None
    movable[BASE] = effects.base_stiffness is not None
    bar_chain = Chain(bar.a, bar.d, bar.alpha, bar.theta, np.zeros(5))
    return _Machine(
        plant=plant,
        joint_to_gear=plant.cell.robot.joint_to_gear,
        command=command,
        robot=_robot_links(cell),
        bar=_turning_links(bar_chain, bar.links),
        active=np.flatnonzero(movable),
    )


def _robot_links(cell: Cell) -> list[list[Link]]:
    robot, plate = cell.robot, cell.plate.body
    chain = nominal_chain(robot)
    links = _turning_links(chain, robot.required("links")[1:])
    flange = forward(chain, np.zeros((1, chain.rows)))
    on_base = Link(
        plate.mass, flange.tip[:, 0] + flange.rotation()[:, :, 0] @ plate.com, plate.inertia
    )
    links[-1] += _turning_links(chain, (*robot.required("links")[1:-1], on_base))[-1]
    return links


def _turning_links(chain: Chain, links: tuple[Link, ...]) -> list[list[Link]]:
    """Links given in base coordinates at zero angles, in the frames that turn with their joints."""
    frames = forward(chain, np.zeros((1, chain.rows)))
    turned = []
    for i, link in enumerate(links):
        com = frames.rotation(i)[:, :, 0].T @ (link.com - frames.origin[i, :, 0])
        turned.append([Link(link.mass, com, link.inertia)])
    return turned


def _ends(machine: _Machine, x: Array) -> Deflected:
    q = (x[machine.motor] + x[machine.gear])[None]
    return deflect(
        machine.plant.geometry,
        q,
        x[None, BAR],
        stretch=x[[ROD]],
        plate=x[[PLATE]],
        base=x[None, BASE],
    )


def _closure(ends: Deflected) -> Array:
    """(6,) [m, rad] loop-closure error: pose of the ball-bar's end relative to the tool."""
    turned = np.einsum("ikn,jkn->ijn", ends.bar.rotation(), ends.tool_rotation)
    return np.concatenate((ends.bar.tip - ends.tool, rotvec_from_matrix(turned)))[:, 0]


def _closure_columns(machine: _Machine, ends: Deflected) -> Array:
    """(6, 2 J + 10) derivative of the loop-closure error, exact where the loop is closed."""
    columns = np.zeros((machine.coordinates, 6))
    joints = turning(ends.robot.z[:-1], ends.robot.origin[:-1], ends.tool)[:, :, 0]
    columns[machine.motor] = columns[machine.gear] = -joints
    columns[BAR] = joint_screws(ends.bar)[:, :, 0]
    columns[ROD, :3] = ends.bar.z[2, :, 0]
    columns[PLATE] = -turning(ends.robot.y[-1:], ends.hinge[None], ends.tool)[0, :, 0]
    columns[BASE, :3] = np.eye(3)
    return columns.T


def _forces(machine: _Machine, ends: Deflected, x: Array) -> tuple[Array, Array]:
    """Derivative of the energy, and stiffness without the curvature of gravity.

    Shapes are (2 J + 10,) and (2 J + 10, 2 J + 10).
    """
    size, motors, deflections = machine.coordinates, machine.motor, machine.gear
    force, stiffness = np.zeros(size), np.zeros((size, size))
    to_gear, gains, effects = machine.joint_to_gear, machine.plant.gains, machine.plant.effects
    motor = x[motors] @ to_gear
    servo = gains.kp * (motor - effects.transmission_error(motor[None])[0] - machine.command)
    force[motors] = to_gear @ servo
    stiffness[motors, motors] = to_gear @ np.diag(gains.kp) @ to_gear.T
    if effects.gear_stiffness is not None:
        torque, slope = _with_backlash(
            x[deflections] @ to_gear, effects.gear_stiffness, effects.gear_backlash
        )
        force[deflections] = to_gear @ torque
        stiffness[deflections, deflections] = to_gear @ np.diag(slope) @ to_gear.T
    if effects.plate_stiffness is not None:
        # A cantilever under a tip load F deflects by F / k and tilts by 3 F / (2 k L); the lever of
        # the load about the hinge is 2 L / 3.
        geometry = machine.plant.geometry
        length = geometry[geometry.table.plate]
        bending = (2.0 / 3.0 * length) * effects.plate_stiffness / (1.5 / length)
        force[PLATE], stiffness[PLATE, PLATE] = bending * x[PLATE], bending
    if effects.base_stiffness is not None:
        force[BASE] = effects.base_stiffness * x[BASE]
        stiffness[BASE, BASE] = effects.base_stiffness * np.eye(3)
    rod, slope = _with_backlash(
        x[[ROD]], np.array([effects.rod_stiffness]), np.array([effects.rod_backlash])
    )
    force[ROD], stiffness[ROD, ROD] = rod[0], slope[0]
    return force + _weights(machine, ends, x), stiffness


def _with_backlash(deflection: Array, stiffness: Array, backlash: Array) -> tuple[Array, Array]:
    """Force and slope of springs with dead bands of half width `backlash`; arrays of one shape."""
    inside = np.clip(deflection, -backlash, backlash)
    share = np.where((np.abs(deflection) < backlash), INSIDE_BACKLASH, 1.0)
    force = stiffness * (deflection - inside + INSIDE_BACKLASH * inside * (backlash > 0.0))
    return force, stiffness * share


def _weights(machine: _Machine, ends: Deflected, x: Array) -> Array:
    """(2 J + 10,) derivative of the potential energy of all masses."""
    load, geometry, gravity = np.zeros(machine.coordinates), machine.plant.geometry, machine.gravity
    q = (x[machine.motor] + x[machine.gear])[None]
    robot = _weight(geometry.robot, q, ends.robot, machine.robot, gravity)
    load[machine.motor] = load[machine.gear] = robot[:, 0]
    load[BAR] = _weight(geometry.bar, x[None, BAR], ends.bar, machine.bar, gravity)[:, 0]
    load[ROD] = _rod_weight(machine, ends)
    load[BASE] = -sum(link.mass for links in machine.bar for link in links) * machine.gravity
    return load


def _rod_weight(machine: _Machine, ends: Deflected) -> float:
    """[N] generalised weight of all bodies beyond the rod's slide, which its elongation lifts."""
    mass = sum(link.mass for links in machine.bar[2:] for link in links)
    return float(-mass * machine.gravity @ ends.bar.z[2, :, 0])


def _weight(
    chain: Chain, q: Array, frames: Frames, bodies: list[list[Link]], gravity: Array
) -> Array:
    """(J, N) [N m/rad] derivative of a chain's potential energy with respect to its angles q (N,
    J).
    """
    gradient = np.zeros((chain.rows, q.shape[0]))
    cos, sin = np.cos(q.T), np.sin(q.T)
    for i, links in enumerate(bodies):
        x, y, z = frames.x[i], frames.y[i], frames.z[i]
        for link in links:
            com = (
                frames.origin[i]
                + link.com[0] * (cos[i] * x + sin[i] * y)
                + link.com[1] * (cos[i] * y - sin[i] * x)
                + link.com[2] * z
            )
            for j in range(i + 1):
                gradient[j] -= link.mass * gravity @ cross(frames.z[j], com - frames.origin[j])
    return gradient


def _to_end_of_backlash(machine: _Machine, x: Array, step: Array) -> float:
    """Share of a step up to just beyond the first end of a dead band on its way.

    Full steps may alternate between the ends of a dead band without end. Energy falls along each
    step and its slope changes only at these ends, so stopping there converges.
    """
    effects = machine.plant.effects
    backlash = np.append(effects.gear_backlash, effects.rod_backlash)
    start, moved = (np.append(v[machine.gear] @ machine.joint_to_gear, v[ROD]) for v in (x, step))
    beyond = np.sign(moved) * _BEYOND * backlash
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.concatenate([(end + beyond - start) / moved for end in (-backlash, backlash)])
    ahead = shares[(shares > 0.0) & np.tile(backlash > 0.0, 2)]
    return min(1.0, float(ahead.min(initial=1.0)))


def _as_equilibrium(machine: _Machine, x: Array, rod_force: float) -> Equilibrium:
    effects = machine.plant.effects
    inside = np.abs(x[machine.gear] @ machine.joint_to_gear) < effects.gear_backlash
    return Equilibrium(
        motor=x[machine.motor],
        gear=x[machine.gear],
        b=x[BAR],
        stretch=float(x[ROD]),
        plate=float(x[PLATE]),
        base=x[BASE],
        rod_force=rod_force,
        in_backlash=bool(inside.any() or abs(x[ROD]) < effects.rod_backlash),
    )
