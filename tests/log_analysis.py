"""What the device files of one recording tell about forces, gears and what gives way: statics and inverse kinematics only.

Known beside the files: clocks, encoder zeros and kinematic geometry, as after a calibration; masses and nominal stiffness of
the descriptions. Nothing here is shared with the plant but the kinematics of `cell`. All runs are slow: inertia is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from acquisition import read_recording
from cell.chain import Array, Frames, joint_screws
from cell.descriptions import Cell, load_cell
from cell.geometry import Geometry, bar_frames, nominal_geometry, robot_frames
from cell.inverse import refine
from sim.simulate import truth_path
from sim.truth import load_truth

FORCE_OFFSET = 0.05  # [s] how long after the robot log the sensor begins, if the scenario says nothing
RIDERS = slice(2, 5)  # links of the ball-bar that the rod's stretch carries along


@dataclass(frozen=True, eq=False)
class Logs:
    """All device files of one recording at the ball-bar's rows, on the clock of the path."""

    cell: Cell
    geometry: Geometry  # known; btheta holds the encoder zeros
    t: Array  # (N,) [s]
    shown: Array  # (N, 6) [rad] joint angles of the logged motor angles
    b: Array  # (N, 5) [rad] encoder angles, without their zeros
    torque: Array  # (N, 6) [N m] of the motors, at the gears' outputs; empty where not logged
    wrench: Array  # (N, 6) [N, N m] that plate and ball-bar exert on the flange, flange frame; empty where not logged

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
        """(6, N) [N, N m] force and moment about the tip that the tool exerts on the ball-bar's end, base coordinates."""
        plate, rotation = self.cell.plate, self.bar.rotation()
        tip = np.array([plate.length, 0.0, plate.tool_offset])
        weight = plate.mass * np.einsum("jin,j->ni", rotation, self.cell.robot.gravity)
        force = self.wrench[:, :3] - weight
        moment = self.wrench[:, 3:] - np.cross(plate.body.com, weight) - np.cross(tip, force)
        turned = [np.einsum("ijn,nj->in", rotation, -part) for part in (force, moment)]
        return np.concatenate(turned)

    @cached_property
    def rod_force(self) -> Array:
        """(N,) [N] tension positive: what the tool exerts along the rod, and the weight of what rides on it."""
        riding = sum(link.mass for link in self.cell.ballbar.links[RIDERS])
        along = self.bar.z[2]
        return np.asarray(np.einsum("in,in->n", self.on_bar[:3] + riding * self.cell.robot.gravity[:, None], along))

    @cached_property
    def joints(self) -> Array:
        """(N, 6) [rad] true joint angles, by inverse kinematics of the pose that the ball-bar holds; its rod stretches by force."""
        poses = self.bar.poses()
        if self.wrench.size:
            poses[:, :3, 3] += (self.rod_force / self.cell.ballbar.axial_stiffness * self.bar.z[2]).T
        return refine(self.geometry.robot, self.shown, poses)

    @property
    def gears(self) -> Array:
        """(N, 6) [rad] true output angles of the gears, axis by axis of their motors."""
        return self.joints @ self.cell.robot.joint_to_gear

    @property
    def shown_gears(self) -> Array:
        """(N, 6) [rad] output angles of the gears that the motors show."""
        return self.shown @ self.cell.robot.joint_to_gear

    @cached_property
    def flange_torque(self) -> Array:
        """(N, 6) [N m] with which the gears hold what hangs on the flange and the links, at rest."""
        frames = robot_frames(self.geometry, self.joints)
        flange = frames.tip - np.einsum("ijn,j->in", frames.rotation(), [self.cell.plate.length, 0.0, self.cell.plate.tool_offset])
        pulled = [np.einsum("ijn,nj->in", frames.rotation(), part) for part in (self.wrench[:, :3], self.wrench[:, 3:])]
        held = np.stack([_power(frames, i, flange, *pulled) for i in range(6)])
        gravity = self.cell.robot.gravity[:, None]
        for i, (mass, com) in enumerate(_link_centres(self.cell, frames)):
            weight = mass * gravity * np.ones_like(com)
            for j in range(i + 1):
                held[j] += _power(frames, j, com, weight, np.zeros_like(com))
        return np.asarray(-held.T @ self.cell.robot.gear_to_joint.T)


def _power(frames: Frames, joint: int, point: Array, force: Array, moment: Array) -> Array:
    """(N,) [N m] generalised force of a joint of a force at `point` and a moment, (3, N) each."""
    lever = np.cross(frames.z[joint], point - frames.origin[joint], axis=0)
    return np.asarray(np.sum(lever * force + frames.z[joint] * moment, axis=0))


def _link_centres(cell: Cell, frames: Frames) -> list[tuple[float, Array]]:
    """Mass [kg] and centre of mass (3, N) [m] of links 1 to 6; each is fixed in the frame behind its joint."""
    zero = robot_frames(nominal_geometry(cell, np.zeros(3)), np.zeros((1, 6)))
    out = []
    for i, link in enumerate(cell.robot.links[1:], start=1):
        local = zero.rotation(i)[:, :, 0].T @ (link.com - zero.origin[i, :, 0])
        out.append((link.mass, frames.origin[i] + np.einsum("ijn,j->in", frames.rotation(i), local)))
    return out


def read_logs(folder: Path) -> Logs:
    """The files of a recording; its truth is opened for clocks, encoder zeros and kinematic parameters."""
    recording, truth = read_recording(folder), load_truth(truth_path(folder))
    description = recording.description
    cell = load_cell(description.robot, description.ballbar, description.plate)
    assert recording.ballbar_log is not None
    starts, robot_log, bar_log = truth.logs.first_rows, recording.robot_log, recording.ballbar_log
    senses = np.array([truth.senses[f"b{j}"] for j in range(1, 6)])
    t = starts.ballbar_s + (1.0 + truth.skew) * bar_log.t
    series = {"shown": (starts.robot_s + robot_log.t, robot_log.q)}
    header, table = read_table(folder / "raw" / "robot.csv")
    if "tau1" in header:
        series["torque"] = (series["shown"][0], table[:, 7:] / np.diag(cell.robot.transmission))
    if description.sources.force:
        _, table = read_table(folder / description.sources.force.files[0])
        series["wrench"] = (starts.robot_s + FORCE_OFFSET + table[:, 0] - table[0, 0], table[:, 1:])
    inside = (t >= max(times[0] for times, _ in series.values())) & (t <= min(times[-1] for times, _ in series.values()))
    at_rows = {name: CubicSpline(times, values)(t[inside]) for name, (times, values) in series.items()}
    none = np.zeros((0, 6))
    return Logs(
        cell,
        truth.geometry,
        t[inside],
        at_rows["shown"],
        bar_log.angles[inside] * senses,
        at_rows.get("torque", none),
        at_rows.get("wrench", none),
    )


def read_table(path: Path) -> tuple[list[str], Array]:
    """Column names and (N, C) numbers of a device file with commas."""
    with path.open() as file:
        return file.readline().strip().split(","), np.loadtxt(file, delimiter=",", ndmin=2)
