"""Quasi-static equilibrium of a machine that holds the ball-bar, or stands unloaded.

Unknown at each sample are the coordinates c of the arm, the ball-bar's angles b with the elongation
of its rod, and the rod's tension F. The servo balances load and friction at a position error, gears
and bearings deflect under the load, the ball-bar reaches the tool:

    rigid gear   r = command - (load + rotor + friction - feed-forward) / servo
    output       g = r - load / k - softening - backlash(load)
    others       e = -C load
    rod          slide(b) = F / k_rod + backlash(F)

Loads follow from virtual work on the screws of each chain, with the weight and inertia of every
body (d'Alembert). The load of a gear depends on F and weakly on the coordinates, so that
coordinates are iterated and F takes Newton steps on the last equation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tests.independent.machine import FLANK, HYSTERESIS, RATED, Body, Machine, Mechanism
from tests.independent.screws import (
    Array,
    Placed,
    Pose,
    cross_matrix,
    power,
    rotation_vector,
    stacked,
    wrench,
)

STEPS, PATIENCE = 60, 6
CLOSED = 1e-10  # [m, rad] largest last step and opening of the loop
# [rad] over which friction builds up after a reversal (Dahl 1968)
TRAVEL = np.array([3e-4, 3e-4, 3e-4, 1e-3, 1e-3, 1e-3])
ROD_FLANK = 2.0  # [N] over which the rod crosses its backlash
YIELD = 0.02  # of the rated torque, over which hysteresis builds up
ANCHOR = np.array([0.0, 0.6, 2.2])  # [m] where a cable hangs
STATIC = 0.15  # of the Coulomb friction, that it rises by towards rest
BAR_SPEED = 0.02  # [rad/s] over which the ball-bar's friction rises


@dataclass(frozen=True, eq=False)
class Command:
    """Motion that the controller commands, on a uniform grid of times."""

    t: Array  # (N,) [s]
    joints: Array  # (N, 6) [rad]
    feed: Array  # (N, 6) [N m] at the gears, of the nominal weight


@dataclass(frozen=True, eq=False)
class Motion:
    """A machine along a command."""

    t: Array  # (N,) [s]
    rigid: Array  # (N, 6) [rad] where rigid gears would be: what the motors show
    bar: Array  # (N, 5) [rad]
    tension: Array  # (N,) [N]
    torque: Array  # (N, 6) [N m] of the motors, at the outputs
    opening: float  # [m, rad] of the loop, largest
    arm: Array  # (K, N) coordinates


@dataclass(frozen=True, eq=False)
class _Inertia:
    """Per body: acceleration (N, 3) [m/s^2], and rate of angular momentum (N, 3) [N m]."""

    acceleration: tuple[Array, ...]
    moment: tuple[Array, ...]


def held(machine: Machine, command: Command, growth: Array, bar: Array, tool: Pose) -> Motion:
    """The machine along a command, its tool held by the ball-bar.

    growth : (2, N) [m] of a2 and d4. bar : (N, 6) [rad, m] near the ball-bar's angles. tool : one
    pose, displacement of the plate in the tool's frame.

    Raises RuntimeError where the equilibrium is not found.
    """
    t, m, n = command.t, machine, command.t.size
    gear = command.joints @ np.linalg.inv(m.to_joint)
    c = np.zeros((len(m.arm.chain.twists), n))
    c[m.arm.joints], c[list(m.grow)] = command.joints.T, growth
    speed, acceleration = CubicSpline(t, gear)(t, 1), CubicSpline(t, gear)(t, 2)
    inertia = _inertia(m.arm, c, t)
    bar_inertia = _inertia(m.bar, bar.T, t)
    drag = friction(m, gear, speed) + m.viscous * speed + m.rotor * acceleration
    rubs = m.bar_friction * np.tanh(CubicSpline(t, bar)(t, 1).T / BAR_SPEED)
    rubs[3] = 0.0
    dry = m.effects.reversal * _turned(gear)
    b, tension, lag = bar.T.copy(), np.zeros(n), np.zeros((6, n))
    pulled, base = np.zeros((n, 3)), _base(m, t)
    for step in range(STEPS):
        arm = m.arm.chain.place(c)
        target = arm.end @ tool
        target = Pose(target.R, target.p - base - pulled / m.base_stiffness)
        reached = m.bar.chain.place(b)
        closing = _closing(reached, target)
        b = b + closing
        known, per_newton = _on_bar(m, reached, bar_inertia, rubs)
        pulled = known[:, 3:] + tension[:, None] * per_newton[:, 3:]
        tied = m.effects.cable * (ANCHOR - arm.end.p)
        load = -_behind(m.arm, arm, m.gravity, inertia)
        load += power(arm.screws, known - wrench(tied, arm.end.p))
        unit = power(arm.screws, per_newton)
        on_gear, unit_gear = (m.to_joint @ x[m.arm.joints] for x in (load, unit))
        on_gear[1] += m.effects.spring * np.sin(gear[:, 1])
        total = on_gear + unit_gear * tension
        if step < PATIENCE:
            lag = _lag(total)
            back = m.effects.hysteresis * _bouc_wen(total) + dry
        give = 1.0 / m.servo[:, None] + _tangent(m, total, lag)
        flank = np.tanh(tension / ROD_FLANK)
        excess = b[3] - tension / m.rod_stiffness - m.rod_half_width * flank
        slope = 1.0 / m.rod_stiffness + m.rod_half_width * (1.0 - flank**2) / ROD_FLANK
        slope = slope + (give * unit_gear**2).sum(axis=0)
        slope = slope + np.einsum("kn,kl,ln->n", unit, m.compliance, unit)
        change = excess / slope
        tension = tension + change
        total = on_gear + unit_gear * tension
        rigid = gear - (total.T + drag - command.feed) / m.servo
        new = -m.compliance @ (load + unit * tension)
        new[m.arm.joints] = ((rigid - (_deflection(m, total, lag) + back).T) @ m.to_joint).T
        new[list(m.grow)] = growth
        moved, c = max(float(np.abs(x).max()) for x in (new - c, closing)), new
        if moved < CLOSED and np.abs(excess).max() < CLOSED and step > PATIENCE:
            break
    else:
        raise RuntimeError(f"no equilibrium: {moved:g}, {np.abs(excess).max():g} m")
    opening = float(np.abs(_closing(m.bar.chain.place(b), target)).max())
    torque = total.T + drag
    return Motion(t, rigid, b[[0, 1, 2, 4, 5]].T, tension, torque, opening, c)


def unloaded(machine: Machine, rigid: Array) -> Array:
    """(N, 3) [m] tool of the robot at rest without ball-bar, rigid gears at (N, 6) [rad]."""
    return machine.arm.chain.place(_resting(machine, rigid)[0]).end.p


def resting_flanks(machine: Machine, rigid: Array) -> Array:
    """(N, 6) flank of each gear's backlash, -1 to 1, of the same robot."""
    load = machine.to_joint @ _resting(machine, rigid)[1][machine.arm.joints]
    return np.tanh(load.T / (FLANK * RATED))


def _resting(machine: Machine, rigid: Array) -> tuple[Array, Array]:
    """Coordinates (K, N) of the robot at rest, and what loads each of them."""
    m = machine
    c = np.zeros((len(m.arm.chain.twists), len(rigid)))
    c[m.arm.joints] = (rigid @ m.to_joint).T
    still = np.zeros((6, len(rigid)))
    for _ in range(12):
        load = -_behind(m.arm, m.arm.chain.place(c), m.gravity, None)
        c = -m.compliance @ load
        on_gear = m.to_joint @ load[m.arm.joints]
        on_gear[1] += m.effects.spring * np.sin(rigid[:, 1])
        bent = _deflection(m, on_gear, still)
        c[m.arm.joints] = ((rigid - bent.T) @ m.to_joint).T
    return c, load


def weight_on_gears(machine: Machine, joints: Array) -> Array:
    """(N, 6) [N m] that the gears hold at rest at joint angles (N, 6) [rad], nothing bent."""
    m = machine
    c = np.zeros((len(m.arm.chain.twists), len(joints)))
    c[m.arm.joints] = joints.T
    load = -_behind(m.arm, m.arm.chain.place(c), m.gravity, None)
    return (m.to_joint @ load[m.arm.joints]).T


def friction(machine: Machine, gear: Array, speed: Array) -> Array:
    """(N, 6) [N m] Coulomb friction that lags each reversal (Dahl 1968), larger near rest."""
    m = machine
    limit = m.coulomb * (1.0 + STATIC / (1.0 + (speed / m.stribeck) ** 2))
    travel = np.diff(gear, axis=0)
    keep, side = np.exp(-np.abs(travel) / TRAVEL), np.sign(travel)
    state = np.zeros(6)
    out = [state]
    for k, s in zip(keep, side, strict=True):
        state = k * state + (1.0 - k) * s
        out.append(state)
    return np.asarray(np.array(out) * limit)


def _turned(gear: Array) -> Array:
    """(6, N) -1 to 1: the way in which each gear (N, 6) [rad] turned last (Dahl 1968)."""
    travel = np.diff(gear, axis=0, prepend=gear[:1])
    state, out = np.zeros(6), []
    for keep, side in zip(np.exp(-np.abs(travel) / TRAVEL), np.sign(travel), strict=True):
        state = keep * state + (1.0 - keep) * side
        out.append(state)
    return np.asarray(out).T


def _bouc_wen(load: Array) -> Array:
    """(6, N) -1 to 1: hysteretic variable of Bouc and Wen, n = 1, along loads (6, N) [N m]."""
    share = load / (YIELD * RATED)[:, None]
    travel = np.diff(share, axis=1, prepend=share[:, :1])
    state, out = np.zeros(6), []
    for x in travel.T:
        state = state * np.exp(-np.abs(x)) + (1.0 - np.exp(-np.abs(x))) * np.sign(x)
        out.append(state)
    return np.asarray(out).T


def _base(m: Machine, t: Array) -> Array:
    """(N, 3) [m] where the base of the ball-bar is, against where it was placed."""
    e, half = m.effects, t > 0.5 * t[-1]
    out = np.zeros((t.size, 3))
    out[:, 0] = e.sway[0] * np.sin(2.0 * np.pi * e.sway[1] * t) + e.dropped * half
    out[:, 2] = -e.settling * t / t[-1]
    return out


def _lag(load: Array) -> Array:
    """(6, N) [N m] by which the backlash's flank lags the load (6, N): a play operator."""
    out = np.empty_like(load)
    for i, half in enumerate(HYSTERESIS * RATED):
        inner = 0.0
        for n, x in enumerate(load[i].tolist()):
            inner = min(max(inner, x - half), x + half)
            out[i, n] = x - inner
    return out


def _deflection(m: Machine, load: Array, lag: Array) -> Array:
    """(6, N) [rad] by which loaded gears (6, N) [N m] fall short."""
    knee = (m.effects.knee * RATED)[:, None]
    flank = np.tanh((load - lag) / (FLANK * RATED)[:, None])
    soft = (load + np.clip(load, -knee, knee)) / m.stiffness[:, None]
    return np.asarray(soft + m.half_width[:, None] * flank)


def _tangent(m: Machine, load: Array, lag: Array) -> Array:
    """(6, N) [rad/(N m)] slope of `_deflection`."""
    knee, width = (m.effects.knee * RATED)[:, None], (FLANK * RATED)[:, None]
    flank = np.tanh((load - lag) / width)
    soft = (1.0 + (np.abs(load) < knee)) / m.stiffness[:, None]
    return np.asarray(soft + m.half_width[:, None] * (1.0 - flank**2) / width)


def _closing(reached: Placed, target: Pose) -> Array:
    """(6, N) Newton step of the ball-bar's angles and slide towards the target."""
    turned = rotation_vector(target.R @ reached.end.R.swapaxes(1, 2))
    w = reached.screws.transpose(1, 2, 0)  # (N, 6, 6)
    arm = reached.end.p
    at_tip = w[:, 3:] - cross_matrix(arm) @ w[:, :3]  # velocity of the tip
    error = np.concatenate((turned, target.p - arm), axis=1)
    whole = np.concatenate((w[:, :3], at_tip), axis=1)
    return np.asarray(np.linalg.solve(whole, error[..., None])[..., 0].T, dtype=np.float64)


def _on_bar(m: Machine, bar: Placed, inertia: _Inertia, rubs: Array) -> tuple[Array, Array]:
    """Wrench (N, 6) of the tool on the ball-bar without tension, and per newton of it."""
    needed = rubs - _behind(m.bar, bar, m.gravity, inertia)
    unit = np.zeros_like(needed)
    unit[3] = 1.0
    screws = bar.screws.transpose(1, 0, 2)  # (N, 6, 6)
    solved = np.linalg.solve(screws, np.stack((needed.T, unit.T), axis=2)).astype(np.float64)
    return solved[..., 0], solved[..., 1]


def _behind(side: Mechanism, placed: Placed, gravity: Array, inertia: _Inertia | None) -> Array:
    """(K, N) work of weight and inertia of all bodies behind each twist, for a unit of it."""
    k, n = placed.screws.shape[:2]
    total = np.zeros((k, n, 6))
    for i, body in enumerate(side.bodies):
        pull, moment = np.broadcast_to(body.mass * gravity, (n, 3)), np.zeros((n, 3))
        if inertia is not None:
            pull, moment = pull - body.mass * inertia.acceleration[i], -inertia.moment[i]
        total[body.behind] += wrench(pull, _centre(body, placed), moment)
    return power(placed.screws, stacked(list(total)))


def _centre(body: Body, placed: Placed) -> Array:
    link = placed.links[body.behind]
    return link.R @ body.centre + link.p


def _inertia(side: Mechanism, c: Array, t: Array) -> _Inertia:
    """Accelerations along the coordinates c (K, N) at times t (N,), by splines."""
    placed = side.chain.place(c)
    rates = CubicSpline(t, c, axis=1)(t, 1)
    turning = np.cumsum(placed.screws[:, :, :3] * rates[:, :, None], axis=0)
    acceleration, moment = [], []
    for body in side.bodies:
        R = placed.links[body.behind].R
        spin = R @ body.inertia @ R.swapaxes(1, 2) @ turning[body.behind][..., None]
        acceleration.append(CubicSpline(t, _centre(body, placed))(t, 2))
        moment.append(CubicSpline(t, spin[..., 0])(t, 1))
    return _Inertia(tuple(acceleration), tuple(moment))
