"""Paths of the robot: splines through joint waypoints, put back on the sphere by Newton steps.

Waypoints are random poses of the ball-bar, reached by the nominal robot's inverse kinematics. Time
stands still at both ends and twice between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tests.independent.machine import POSITION, Files, Machine, nominal
from tests.independent.screws import Array, cross_matrix, rotation_vector
from tests.independent.statics import Command, weight_on_gears

GRID = 0.01  # [s]
DWELL, RAMP = 4.0, 1.5  # [s]
PIECES = 3
WAYPOINTS = 22  # of 120 s


@dataclass(frozen=True)
class Choice:
    """Random waypoints: ball-bar angles centre +- reach, clear of b2 = 0 and b4 = 0, -pi."""

    seed: int
    wrist: int  # sign of axis 5 at the first of them
    centre_deg: tuple[float, ...]  # of b1..b5
    reach_deg: tuple[float, ...]


# Found among a few dozen seeds: wide motions of all joints, the wrist on either side.
FIRST = Choice(7, -1, (-20.0, -54.0, 10.0, -120.0, 145.0), (88.0, 25.0, 50.0, 38.0, 100.0))
SECOND = Choice(3, 1, (-9.0, -54.0, -49.0, -94.0, 180.0), (85.0, 22.0, 22.0, 44.0, 104.0))


@dataclass(frozen=True, eq=False)
class Path:
    """A command and the ball-bar's angles that belong to it, nominal machine."""

    command: Command
    bar: Array  # (N, 6) [rad, m]


def path(cell: Files, choice: Choice, duration: float = 120.0) -> Path:
    """A path of `duration` seconds through chosen waypoints.

    Raises RuntimeError where the robot cannot follow.
    """
    machine, rng = nominal(cell), np.random.default_rng([choice.seed, 120])
    moving = duration - (PIECES + 1) * DWELL
    count = round(WAYPOINTS * moving / (120.0 - (PIECES + 1) * DWELL))
    bar = np.deg2rad(choice.centre_deg + choice.reach_deg * rng.uniform(-1.0, 1.0, (count, 5)))
    q = _waypoints(machine, bar, choice.wrist, rng)
    t: Array = GRID * np.arange(round(duration / GRID) + 1, dtype=np.float64)
    q = CubicSpline(np.linspace(0.0, 1.0, count), q, bc_type="clamped")(_phase(t, duration))
    for _ in range(5):
        q = q - _off_sphere(machine, q)
    angles = _bar_angles(machine, q, bar[0])
    _check(cell, q, angles, t)
    return Path(Command(t, q, weight_on_gears(machine, q)), angles)


def _phase(t: Array, duration: float) -> Array:
    """(N,) 0 to 1, at rest for DWELL at both ends and between the pieces."""
    each = (duration - (PIECES + 1) * DWELL) / PIECES
    out = np.zeros_like(t)
    for k in range(PIECES):
        u = np.clip(t - DWELL - k * (each + DWELL), 0.0, each)
        # speed: a half cosine up, level, a half cosine down
        ends = [_risen(np.minimum(u, RAMP)), _risen(np.minimum(np.maximum(each - u, 0.0), RAMP))]
        level = np.clip(u - RAMP, 0.0, each - 2.0 * RAMP)
        out += (ends[0] + level + 0.5 * RAMP - ends[1]) / (each - RAMP) / PIECES
    return out


def _risen(u: Array) -> Array:
    """Integral of (1 - cos(pi u / RAMP)) / 2."""
    return np.asarray(0.5 * (u - RAMP / np.pi * np.sin(np.pi * u / RAMP)))


def _coordinates(machine: Machine, q: Array) -> Array:
    c = np.zeros((len(machine.arm.chain.twists), len(q)))
    c[machine.arm.joints] = q.T
    return c


def _waypoints(machine: Machine, bar: Array, wrist: int, rng: np.random.Generator) -> Array:
    """(W, 6) [rad] joint angles at ball-bar angles (W, 5), one after the other."""
    q = _first(machine, bar[0], wrist, rng)
    out, at = [q], bar[0]
    for b in bar[1:]:
        for share in np.linspace(0.0, 1.0, 9)[1:]:
            q = _reached(machine, at + share * (b - at), q, steps=3)[0]
        out.append(q)
        at = b
    return np.array(out)


def _first(machine: Machine, b: Array, wrist: int, rng: np.random.Generator) -> Array:
    """(6,) [rad] joint angles that reach the first pose, far from the singularity of the wrist."""
    for _ in range(200):
        guess = rng.uniform([-1, -0.5, -1, -1.5, -1.8, -2.5], [1, 1.0, 1, 1.5, 1.8, 2.5])
        q, error = _reached(machine, b, guess, steps=30)
        inside = np.abs(q) < np.deg2rad([100, 100, 100, 150, 115, 250])
        if error < 1e-9 and inside.all() and wrist * np.sin(q[4]) > 0.3:
            return q
    raise RuntimeError("the first waypoint is out of reach")


def _reached(machine: Machine, b: Array, q: Array, *, steps: int) -> tuple[Array, float]:
    """Newton steps of the inverse kinematics from q (6,), and the error that is left [m, rad]."""
    full = np.insert(b, 3, 0.0)[:, None]
    target = machine.bar.chain.place(full).end
    error = np.inf
    for _ in range(steps):
        placed = machine.arm.chain.place(_coordinates(machine, q[None]))
        turned = rotation_vector(target.R @ placed.end.R.swapaxes(1, 2))[0]
        w = placed.screws[machine.arm.joints, 0].T
        tip = w[3:] - cross_matrix(placed.end.p[0]) @ w[:3]
        off = np.concatenate((turned, (target.p - placed.end.p)[0]))
        error = float(np.abs(off).max())
        q = q + np.clip(np.linalg.lstsq(np.concatenate((w[:3], tip)), off)[0], -0.3, 0.3)
    return q, error


def _off_sphere(machine: Machine, q: Array) -> Array:
    """(N, 6) [rad] smallest change of the joints that ends on the sphere."""
    placed = machine.arm.chain.place(_coordinates(machine, q))
    arm = placed.end.p - POSITION
    distance = np.linalg.norm(arm, axis=1)
    w = placed.screws[machine.arm.joints]
    tip = w[..., 3:] + np.cross(w[..., :3], placed.end.p)
    slope = (tip * (arm / distance[:, None])).sum(axis=2)  # (6, N)
    return np.asarray((slope / (slope**2).sum(axis=0) * (distance - machine.rod)).T)


def _bar_angles(machine: Machine, q: Array, first: Array) -> Array:
    """(N, 6) [rad, m] ball-bar along joint angles (N, 6), continued from the first (5,)."""
    end = machine.arm.chain.place(_coordinates(machine, q)).end
    base = machine.bar.chain.place(np.zeros((6, 1))).end
    R = end.R @ base.R[0].T  # of the bar's last link, from home
    u = (end.p - POSITION) / np.linalg.norm(end.p - POSITION, axis=1)[:, None]
    # rod along u: fork angle b2, gimbal angle b1 (Rz(b1) Ry(.) z = u), then spin and joint behind
    sine = np.hypot(u[:, 0], u[:, 1])
    b2 = -np.arctan2(sine, u[:, 2])
    b1 = np.unwrap(np.arctan2(u[:, 1], u[:, 0]))
    c = np.zeros((6, len(q)))
    c[0], c[1] = b1, b2
    rest = machine.bar.chain.place(c).links[1].R.swapaxes(1, 2) @ R  # Rz(b3) Ry(b4) Rz(b5)
    b4 = -np.arctan2(np.hypot(rest[:, 0, 2], rest[:, 1, 2]), rest[:, 2, 2])
    b3 = np.unwrap(np.arctan2(rest[:, 1, 2], rest[:, 0, 2]))
    b5 = np.unwrap(np.arctan2(rest[:, 2, 1], -rest[:, 2, 0]))
    out = np.stack((b1, b2, b3, np.zeros(len(q)), b4, b5), axis=1)
    turns = np.round((out[0, [0, 2, 5]] - first[[0, 2, 4]]) / (2.0 * np.pi))
    out[:, [0, 2, 5]] -= 2.0 * np.pi * turns
    return out


def _check(cell: Files, q: Array, bar: Array, t: Array) -> None:
    """Raise RuntimeError where the path leaves a range, a speed or comes near a singularity."""
    axes = np.rad2deg(q @ np.linalg.inv(cell.axis_to_joint))
    low, high = (np.array(cell.robot[f"axis_{side}_deg"]) for side in ("lower", "upper"))
    speed = np.abs(np.gradient(q, t, axis=0)).max()
    faults = {
        "axis range": ((axes < low) | (axes > high)).any(),
        "speed": speed > 1.5,
        "wrist": (np.abs(np.sin(q[:, 4])) < 0.15).any(),
        "ball-bar": (np.abs(np.sin(bar[:, [1, 4]])) < 0.25).any(),
    }
    if any(faults.values()):
        raise RuntimeError(f"path: {', '.join(k for k, v in faults.items() if v)}")
