"""Loads of gears, plate and rod as a linear function of one unknown: the tension F of the rod.

    tau = tau_0 + tau_1 F

is the torque at each gear's output that carries and moves the arm and holds the ball-bar. With
frictionless ball-bar joints five of the six components of the wrench w at the tool follow from the
weight of the ball-bar's links, and the sixth is F: `A' w = g_b + e_rod F`, with A the motions of
the ball-bar's end for its five joints and for the rod's elongation. The robot carries its own links
and plate (mass model of the cell files) and `-w` at the tool.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import bar_bodies, carried_bodies, link_bodies
from ballbar.cell.chain import Frames, cross, joint_screws, screw
from ballbar.cell.descriptions import Cell, Link, Robot
from ballbar.cell.dynamics import joint_moments, joint_torques
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.cell.typical_machine import with_typical

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

TRAVEL = 1e-4  # [rad] over which friction of a ball-bar's joint builds up after a reversal; assumed
SMALL = 10.0  # [kg] of an arm without base that pictures or poses show play of: hobby servos
BEARINGS = 3  # joints, from the base, whose bearings carry moments that tilt them


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of N samples: a known part, and a part per newton of rod tension."""

    gear: Array  # (J, N) [N m] at the gears' outputs: what the motors must exert
    gear_per_newton: Array  # (J, N) [m]
    plate: Array  # (N,) [N m] moment that bends the plate, positive along the tool's y
    plate_per_newton: Array  # (N,) [m]
    # (BEARINGS, 2, N) [N m] moments about x and y of the frame in which each of the first joints
    # turns
    bearing: Array
    bearing_per_newton: Array  # (BEARINGS, 2, N) [m]
    rubbed: Array  # (J, N) [1] at the gears, per newton metre of friction in the ball-bar's joints
    on_bar: Array  # (6, N) [-, m] wrench of the tool on the ball-bar per newton

    def part(self, samples: NDArray[np.intp]) -> Loads:
        """The loads at some of the samples."""
        return Loads(*(getattr(self, field.name)[..., samples] for field in fields(self)))

    def gears(self, tension: Array) -> Array:
        """(J, N) [N m] at a rod tension (N,) [N]."""
        return self.gear + self.gear_per_newton * tension

    def plate_moment(self, tension: Array) -> Array:
        """(N,) [N m] at a rod tension (N,) [N]."""
        return self.plate + self.plate_per_newton * tension

    def over_time(self, t: Array, tension: Array) -> BSpline:
        """(J + 2 BEARINGS,) [N m] of gears and bearings over the times (N,) [s], which increase."""
        from scipy.interpolate import make_interp_spline  # noqa: PLC0415  --help needs none

        bearing = self.bearings(tension).reshape(2 * BEARINGS, -1)
        return make_interp_spline(t, np.concatenate((self.gears(tension), bearing)).T, k=3)

    def bearings(self, tension: Array) -> Array:
        """(BEARINGS, 2, N) [N m] at a rod tension (N,) [N]."""
        return self.bearing + self.bearing_per_newton * tension


@dataclass(frozen=True, eq=False)
class MassModel:
    """Masses of one cell, in the frames that turn with the joints."""

    arm: list[list[Link]]
    bar: list[list[Link]]
    gravity: Array  # (3,) [m/s^2]
    gear_to_joint: Array  # (J, J)
    rod: float | None = None  # [kg] of a rod whose length is sensed; None for a ball-bar
    friction: Array | None = None  # (J,) [N m] that holds a gear of a small arm on either flank


def mass_model(cell: Cell) -> MassModel:
    """The cell files' masses.

    A robot without stated masses has those that are typical of its size
    (ballbar.cell.typical_machine).
    """
    return MassModel(
        carried_bodies(replace(cell, robot=with_typical(cell.robot)[0])),
        [[link] for link in bar_bodies(cell)],
        cell.robot.gravity,
        cell.robot.gear_to_joint,
        None if cell.ballbar.stroke is None else sum(link.mass for link in cell.ballbar.links),
    )


def link_masses(robot: Robot) -> MassModel:
    """The links of a robot alone, whatever it carries. Raises InputError where it states none."""
    links, friction = [[link] for link in link_bodies(robot)], None
    if robot.gears is not None and sum(link.mass for (link,) in links) < SMALL:
        friction = robot.gears.static
    return MassModel(links, [], robot.gravity, robot.gear_to_joint, friction=friction)


def loads(
    masses: MassModel,
    geometry: Geometry,
    *,
    q: Array,
    b: Array,
    speed: Array,
    acceleration: Array,
    frames: tuple[Frames, Frames] | None = None,
) -> Loads:
    """Loads along a motion.

    q, speed, acceleration : (N, J) [rad, rad/s, rad/s^2] of the robot's joints. b : (N, 5) [rad]
    ball-bar angles as the encoders read. masses : of the cell. frames : of robot and ball-bar
    there, if they are known.
    """
    robot, bar = frames or (robot_frames(geometry, q), bar_frames(geometry, b))
    own = joint_moments(
        robot, masses.arm, q, gravity=masses.gravity, speed=speed, acceleration=acceleration
    )
    wrenches = on_ballbar(masses, bar, b)
    weight, per_newton = wrenches
    at_joints, per_newton_at_joints = (_at_joints(robot, wrench) for wrench in wrenches)
    moments = own + at_joints
    hinge = robot.tip - (2.0 / 3.0 * geometry[geometry.table.plate]) * robot.x[-1]
    lever = cross(robot.y[-1], robot.tip - hinge)
    bend, bend_per_newton = (
        -(lever * w[:3]).sum(axis=0) - (robot.y[-1] * w[3:]).sum(axis=0)
        for w in (weight, per_newton)
    )
    return Loads(
        gear=_about_axes(masses, robot, moments),
        gear_per_newton=_about_axes(masses, robot, per_newton_at_joints),
        plate=bend,
        plate_per_newton=bend_per_newton,
        bearing=_across_axes(robot, moments),
        bearing_per_newton=_across_axes(robot, per_newton_at_joints),
        rubbed=np.zeros(q.T.shape),
        on_bar=per_newton,
    )


def rubbed(masses: MassModel, geometry: Geometry, q: Array, b: Array) -> Array:
    """(J, N) [1] loads of the gears per newton metre of friction in each of the ball-bar's joints.

    q (N, J), b (N, 5) : [rad] as of `loads`, in the order of time. Friction is Coulomb's with an
    elastic-plastic bristle of TRAVEL (Dahl 1968): at rest it stays as the motion left it.
    """
    robot, bar, side = robot_frames(geometry, q), bar_frames(geometry, b), np.zeros((len(b), 6))
    side[:, :5] = stop(b.T / TRAVEL).T
    motions = np.concatenate((joint_screws(bar), screw(bar, "d", 2)[None])).transpose(2, 0, 1)
    wrench = np.asarray(np.linalg.solve(motions, side[:, :, None])[:, :, 0].T, dtype=float)
    return _about_axes(masses, robot, _at_joints(robot, wrench))


def stop(x: Array) -> Array:
    """(J, N) what is left of signals (J, N) within a band of -1 to 1 that they drag along."""
    state, out = np.zeros(len(x)), np.zeros_like(x)
    for k, step in enumerate(np.diff(x, axis=1, prepend=x[:, :1]).T):
        state = np.clip(state + step, -1.0, 1.0)
        out[:, k] = state
    return out


def no_loads(joints: int, samples: int) -> Loads:
    """Where no correction asks for any."""
    gears, none = np.zeros((joints, samples)), np.zeros(samples)
    bearings = np.zeros((BEARINGS, 2, samples))
    return Loads(
        gear=gears,
        gear_per_newton=gears,
        plate=none,
        plate_per_newton=none,
        bearing=bearings,
        bearing_per_newton=bearings,
        rubbed=gears,
        on_bar=np.zeros((6, samples)),
    )


def own_weight(
    masses: MassModel,
    geometry: Geometry,
    q: Array,
    speed: Array | None = None,
    acceleration: Array | None = None,
) -> Loads:
    """Loads of the unloaded robot at q (N, J) [rad], without ball-bar.

    speed, acceleration : (N, J) [rad/s, rad/s^2]; None of a robot at rest.
    """
    robot = robot_frames(geometry, q)
    moments = joint_moments(
        robot, masses.arm, q, gravity=masses.gravity, speed=speed, acceleration=acceleration
    )
    return replace(
        no_loads(*q.T.shape),
        gear=_about_axes(masses, robot, moments),
        bearing=_across_axes(robot, moments),
    )


def _at_joints(robot: Frames, wrench: Array) -> Array:
    """(J, 3, N) [N m] moment at each joint's origin of a wrench (6, N) at the tip."""
    arms = robot.tip - robot.origin[:-1]
    return np.stack([cross(arm, wrench[:3]) + wrench[3:] for arm in arms])


def _about_axes(masses: MassModel, robot: Frames, moments: Array) -> Array:
    """(J, N) [N m] at the gears' outputs of moments (J, 3, N) at the joints."""
    return np.asarray(masses.gear_to_joint @ (robot.z[:-1] * moments).sum(axis=1))


def _across_axes(robot: Frames, moments: Array) -> Array:
    """(BEARINGS, 2, N) [N m] about x and y of the frames in which the first joints turn."""
    axes = (robot.x[:BEARINGS], robot.y[:BEARINGS])
    return np.stack([(axis * moments[:BEARINGS]).sum(axis=1) for axis in axes], axis=1)


def on_ballbar(masses: MassModel, bar: Frames, b: Array) -> tuple[Array, Array]:
    """Wrench of the tool on the ball-bar: (6, N) [N, N m] without tension, and per newton of it.

    Moments are about the tip, base frame. A rod whose length is sensed hangs on two balls, so the
    tool carries half of its weight. b : (N, 5) [rad] angles of the ball-bar's frames `bar`.
    """
    if masses.rod is not None:
        none = np.zeros_like(bar.z[2])
        weight = none - 0.5 * masses.rod * masses.gravity[:, None]
        return np.concatenate((weight, none)), np.concatenate((bar.z[2], none))
    motions = np.concatenate((joint_screws(bar), screw(bar, "d", 2)[None]))  # (6, 6, N)
    hinges = joint_torques(bar, masses.bar, b, gravity=masses.gravity)
    riding = sum(link.mass for links in masses.bar[2:] for link in links)
    along = -riding * (masses.gravity @ bar.z[2])
    held = np.concatenate((hinges, along[None])).T
    tension = np.zeros_like(held)
    tension[:, 5] = 1.0
    solved = np.linalg.solve(motions.transpose(2, 0, 1), np.stack((held, tension), axis=2))
    return solved[:, :, 0].T.copy(), solved[:, :, 1].T.copy()
