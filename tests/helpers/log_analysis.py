"""Forces, gear errors and elastic deflections from the device files of one recording.

Only statics and inverse kinematics are used, as an oracle for the plant, with which nothing is
shared but the kinematics of `cell`. Known beside the files, as after a calibration: clocks, encoder
offsets, kinematic parameters and the rod's stiffness; masses come from the descriptions. Inertia is
left out: the paths are slow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from ballbar.acquisition.recording import read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross, joint_screws
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, bar_frames, nominal_geometry, robot_frames
from ballbar.cell.inverse import refine
from ballbar.cell.load import load_cell
from ballbar.sim.logging.load_logs import ForceSensor
from ballbar.sim.motion import Motion
from ballbar.sim.recording_files import truth_path
from ballbar.sim.truth import load_truth

RIDERS = slice(2, 5)  # links of the ball-bar that the rod's stretch carries along


@dataclass(frozen=True, eq=False)
class Logs:
    """All device files of one recording at the ball-bar's rows, on the clock of the path."""

    cell: Cell
    geometry: Geometry  # known; btheta holds the encoder zeros
    rod_stiffness: float  # [N/m]
    t: Array  # (N,) [s]
    shown: Array  # (N, 6) [rad] joint angles of the logged motor angles
    b: Array  # (N, 5) [rad] encoder angles, their zeros not in them
    torque: Array  # (N, 6) [N m] of the motors, at the gears' outputs
    wrench: Array  # (N, 6) [N, N m] that plate and ball-bar exert on the flange, flange frame

    @cached_property
    def bar(self) -> Frames:
        """Frames of the ball-bar with an unstretched rod."""
        return bar_frames(self.geometry, self.b)

    @cached_property
    def shown_robot(self) -> Frames:
        """Frames of the robot at the joint angles that its motors show."""
        return robot_frames(self.geometry, self.shown)

    @cached_property
    def on_bar(self) -> Array:
        """(6, N) [N, N m] force and moment about the tip from tool on ball-bar, base frame."""
        plate, rotation = self.cell.plate, self.bar.rotation()
        weight = plate.mass * np.einsum("jin,j->ni", rotation, self.cell.robot.gravity)
        force = self.wrench[:, :3] - weight
        moment = self.wrench[:, 3:] - np.cross(plate.body.com, weight) - np.cross(self._tip, force)
        return np.concatenate(
            [np.einsum("ijn,nj->in", rotation, -part) for part in (force, moment)]
        )

    @cached_property
    def on_tool(self) -> Array:
        """(6, N) [N, N m] force and moment about the tip from ball-bar on tool, tool frame."""
        rotation = self.bar.rotation()
        return np.concatenate(
            [
                np.einsum("jin,jn->in", rotation, -part)
                for part in (self.on_bar[:3], self.on_bar[3:])
            ]
        )

    @cached_property
    def rod_force(self) -> Array:
        """(N,) [N] rod force, tension positive: of the tool, and of the weight that rides on it."""
        riding = sum(link.mass for link in self.cell.ballbar.links[RIDERS])
        return np.asarray(
            np.sum(
                (self.on_bar[:3] + riding * self.cell.robot.gravity[:, None]) * self.bar.z[2],
                axis=0,
            )
        )

    @cached_property
    def tip(self) -> Array:
        """(3, N) [m] where the ball-bar holds the tool, its rod stretched by its force."""
        return np.asarray(self.bar.tip + self.rod_force / self.rod_stiffness * self.bar.z[2])

    @cached_property
    def joints(self) -> Array:
        """(N, 6) [rad] joint angles of a rigid robot and plate at the ball-bar's pose."""
        poses = self.bar.poses()
        poses[:, :3, 3] = self.tip.T
        return refine(self.geometry.robot, self.shown, poses)

    @cached_property
    def gears(self) -> Array:
        """(N, 6) [rad] true output angles of the gears."""
        return self.joints @ self.cell.robot.joint_to_gear

    @cached_property
    def shown_gears(self) -> Array:
        """(N, 6) [rad] output angles of the gears that the motors show."""
        return self.shown @ self.cell.robot.joint_to_gear

    @cached_property
    def load(self) -> Array:
        """(N, 6) [N m] static torque at the gears' outputs under links and flange load."""
        frames = robot_frames(self.geometry, self.joints)
        rotation = frames.rotation()
        flange = frames.tip - np.einsum("ijn,j->in", rotation, self._tip)
        pull, twist = (
            np.einsum("ijn,nj->in", rotation, part)
            for part in (self.wrench[:, :3], self.wrench[:, 3:])
        )
        done = np.stack([_work(frames, i, flange, pull, twist) for i in range(6)])
        for i, (mass, com) in enumerate(_link_centres(self.cell, frames)):
            weight = np.tile(mass * self.cell.robot.gravity[:, None], com.shape[1])
            for j in range(i + 1):
                done[j] += _work(frames, j, com, weight, np.zeros_like(com))
        return np.asarray(-done.T @ self.cell.robot.gear_to_joint.T)

    @cached_property
    def bar_load(self) -> Array:
        """(N, 5) [N m] torque about each ball-bar joint that the tool exerts."""
        return np.asarray(np.einsum("jkn,kn->nj", joint_screws(self.bar), self.on_bar))

    @property
    def _tip(self) -> Array:
        """(3,) [m] tool tip in the flange frame."""
        return np.array([self.cell.plate.length, 0.0, self.cell.plate.tool_offset])


def read_logs(folder: Path) -> Logs:
    """The files of a recording with torques and force sensor.

    The truth is opened for clocks, encoder offsets and kinematic parameters.
    """
    recording, truth = read_recording(folder), load_truth(truth_path(folder))
    told, first_rows, robot, bar = (
        recording.description,
        truth.logs.first_rows,
        recording.robot_log,
        recording.ballbar_log,
    )
    assert bar is not None
    assert told.sources.force is not None
    cell = load_cell(told.robot, told.ballbar, told.plate)
    torque = read_table(folder / told.sources.robot.files[0])[:, 7:] / np.diag(
        cell.robot.transmission
    )
    force = read_table(folder / told.sources.force.files[0])
    robot_t = first_rows.robot_s + robot.t
    force_t = first_rows.robot_s + ForceSensor().offset_s + force[:, 0] - force[0, 0]
    t = first_rows.ballbar_s + (1.0 + truth.clock.skew) * bar.t
    inside = (t >= force_t[0]) & (t <= min(robot_t[-1], force_t[-1]))
    b = bar.angles * np.array([truth.directions[f"b{j}"] for j in bar.joints])
    at_rows = [
        CubicSpline(*series)(t[inside])
        for series in ((robot_t, robot.q), (robot_t, torque), (force_t, force[:, 1:]))
    ]
    stiffness = truth.plant.rod_stiffness_N_per_m or np.inf
    return Logs(cell, truth.geometry, stiffness, t[inside], at_rows[0], b[inside], *at_rows[1:])


def read_table(path: Path) -> Array:
    """(N, C) numbers of a device file with commas and one line of names."""
    return np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)


def fit(columns: list[Array], measured: Array) -> Array:
    """(K,) coefficients of columns (N,) that explain `measured` (N,) best."""
    return np.asarray(np.linalg.lstsq(np.stack(columns, axis=1), measured, rcond=None)[0])


def rate(t: Array, values: Array) -> Array:
    """(N, C) time derivative of (N, C)."""
    return np.asarray(np.gradient(values, t, axis=0))


def harmonics(angle: Array, error: Array, orders: list[float]) -> NDArray[np.complex128]:
    """(K,) A exp(i phi) of each `A sin(order * angle + phi)` in an error (N,) of these alone."""
    waves = fit([wave(order * angle) for order in orders for wave in (np.sin, np.cos)], error)
    return np.asarray(waves[0::2] + 1j * waves[1::2])


def settled_direction(values: Array, travel: float) -> Array:
    """(N,) +1 or -1 where `values` (N,) went on by `travel` since its last reversal, else 0."""
    out, low, high = np.zeros(values.size), float(values[0]), float(values[0])
    for k, value in enumerate(values.tolist()):
        if value >= high and value - low >= travel:
            out[k], low = 1.0, value - travel
        elif value <= low and high - value >= travel:
            out[k], high = -1.0, value + travel
        low, high = min(low, value), max(high, value)
    return out


def there_and_back(t: Array, values: Array, end: float) -> Array:
    """(K, C) half the difference of (N, C) between the way out and the way back at the same place.

    For a run of `end` seconds whose way back is its way out in reverse. Weight, elastic load and
    inertia cancel: friction stays.
    """
    spline = CubicSpline(t, values)
    out = t[(t > t[0] + 2.0) & (t < 0.5 * end)]
    return np.asarray(0.5 * (spline(out) - spline(end - out)))


def _work(frames: Frames, joint: int, point: Array, force: Array, moment: Array) -> Array:
    """(N,) [N m] torque about one joint of a force at `point` and a moment, (3, N) each."""
    axis = frames.z[joint]
    return np.asarray(
        np.sum(cross(axis, point - frames.origin[joint]) * force + axis * moment, axis=0)
    )


def _link_centres(cell: Cell, frames: Frames) -> list[tuple[float, Array]]:
    """Mass [kg] and centre of mass (3, N) [m] of links 1 to 6; link i moves with frame i."""
    zero = robot_frames(nominal_geometry(cell, np.zeros(3)), np.zeros((1, 6)))
    out = []
    for i, link in enumerate(cell.robot.links[1:], start=1):
        local = zero.rotation(i)[:, :, 0].T @ (link.com - zero.origin[i, :, 0])
        out.append(
            (link.mass, frames.origin[i] + np.einsum("ijn,j->in", frames.rotation(i), local))
        )
    return out


def force_near_singularity(motion: Motion, bands: Sequence[tuple[float, float]]) -> list[Array]:
    """Rod force [N] while b4 is so far from a multiple of half a turn: largest, and rms above 2 Hz.

    bands : (K, 2) [deg] distances. The first and the last three seconds are left out.
    """
    force, rate = motion.rod_force, 1.0 / (motion.t[1] - motion.t[0])
    fast = sosfiltfilt(butter(4, 2.0, "high", fs=rate, output="sos"), force)
    away = np.degrees(np.abs(np.arcsin(np.sin(motion.b[:, 3]))))
    moving = (motion.t > 3.0) & (motion.t < motion.t[-1] - 3.0)
    inside = [moving & (low <= away) & (away < high) for low, high in bands]
    return [
        np.array([np.abs(force[rows]).max(), np.sqrt(np.mean(fast[rows] ** 2))]) for rows in inside
    ]
