"""Distances between robot, plate, rod and their surroundings along a path, as capsules and boxes.

MuJoCo's `mj_geomDistance` measures them. The bodies connect frames of the kinematic chains, so
nothing is simulated; MuJoCo only gets their poses, and only of pairs that lower bounds leave in
question. Radii are assumed shares of the upper arm's length, since neither maker publishes hulls.
Neighbours touch and are not compared. An arm without parallel axes 2 and 3 and spherical wrist has
the capsules of ballbar.planning.capsules along its DH rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.closed_form import has_closed_form
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, bar_frames, nominal_chain, robot_frames
from ballbar.planning.capsules import ROD, Links, links_of, segment_distance
from ballbar.planning.request import PlanCell

# Radii as shares of the upper arm's length.
SHARES = {"column": 0.38, "upper arm": 0.14, "forearm": 0.11, "wrist": 0.09}
PEDESTAL = 0.0525  # [m] radius, adapter of thesis sec. 4.5
# [m] cell/plates; the overhang beyond flange axis and universal joint is assumed
PLATE_WIDTH, PLATE_THICKNESS, PLATE_OVERHANG = 0.10, 0.045, 0.05
GIMBAL = 0.10  # [m] between a ball's centre and the beginning of rod or pedestal; assumed
FAR = 0.5  # [m] beyond which distances are not distinguished
TIME_STEP = 1.0  # [s] between the poses of a plan; ballbar.planning.verify takes smaller steps


MOVING = (*SHARES, "rod", "pedestal", "plate")
NEIGHBOURS = {
    ("column", "upper arm"),
    ("upper arm", "forearm"),
    ("forearm", "wrist"),
    ("wrist", "plate"),
    ("rod", "plate"),
    ("rod", "pedestal"),
    ("column", "pedestal"),
}
ON_FLOOR = ("column", "pedestal")
TOUCHING = 0.05  # [m] along the chain beyond both radii up to which bodies always are near


@dataclass(frozen=True)
class Nearest:
    """The smallest distance along a motion."""

    distance: float  # [m] FAR where nothing is closer
    pair: str
    t: float


@dataclass(frozen=True, eq=False)
class Clearance:
    """The bodies of a cell, as geoms of a model without joints."""

    model: mujoco.MjModel
    radii: dict[str, float]
    pairs: tuple[tuple[int, int], ...]
    names: tuple[str, ...]  # of all geoms
    floor: float
    plate_height: float  # [m] of the plate's middle over the flange
    tool_height: float  # [m] of the tool over the flange
    rows: tuple[tuple[int, int], ...] = ()  # DH row, and 0 along d or 1 along a, of each capsule

    def nearest(
        self, geometry: Geometry, q: Array, b: Array, t: Array, *, within: float = FAR
    ) -> Nearest:
        """The smallest distance along a motion, every TIME_STEP seconds.

        q, b : (N, 6), (N, 5) [rad] joint angles at times t (N,) [s]. within : [m] beyond which
        distances are not distinguished.
        """
        rows = _rows_every(TIME_STEP, t)
        robot, bar = robot_frames(geometry, q[rows]), bar_frames(geometry, b[rows])
        return self.nearest_of_runs(robot, bar, t[rows], within=within)[0]

    def distances_along(
        self, geometry: Geometry, q: Array, b: Array, t: Array, *, step: float
    ) -> Array:
        """(K,) [m] smallest distance every `step` seconds; FAR where nothing is closer."""
        rows = _rows_every(step, t)
        robot, bar = robot_frames(geometry, q[rows]), bar_frames(geometry, b[rows])
        instants = self.nearest_of_runs(robot, bar, t[:1], within=FAR)
        return np.array([instant.distance for instant in instants])

    def nearest_of_runs(
        self, robot: Frames, bar: Frames, t: Array, *, within: float
    ) -> list[Nearest]:
        """The smallest distance along each of several motions of equal length, one after the other.

        robot, bar : frames at N instants of all. t : (T,) [s] those of one motion.
        """
        half, centres, axes = self._placed(robot, bar)
        bounds = self._lower_bounds(half, centres, axes).reshape(len(self.pairs), -1, t.size)
        bodies, data = centres.shape[1], mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)  # places floor and boxes
        closest = []
        for run in range(bounds.shape[1]):
            of_run, best = bounds[:, run], Nearest(within, "nothing", 0.0)
            close = np.argwhere(of_run < within)
            for pair, k in close[np.argsort(of_run[tuple(close.T)], kind="stable")]:
                if of_run[pair, k] >= best.distance:
                    break
                i, j = self.pairs[pair]
                instant = run * t.size + int(k)
                self.model.geom_size[: bodies - 1, 1] = half[instant]
                data.geom_xpos[:bodies], data.geom_xmat[:bodies] = centres[instant], axes[instant]
                distance = float(mujoco.mj_geomDistance(self.model, data, i, j, FAR, None))
                if distance < best.distance:
                    best = Nearest(distance, f"{self.names[i]} and {self.names[j]}", float(t[k]))
            closest.append(best)
        return closest

    def _lower_bounds(self, half: Array, centres: Array, axes: Array) -> Array:
        """(pairs, N) [m] below the distances of all pairs at N instants; arguments as `_placed`.

        For two capsules it is the distance itself. The plate stands in a capsule along its length;
        a box that stands in the cell has its distance from a body's centre less the body's extent.
        """
        bodies, plate = centres.shape[1], self.model.geom_size[centres.shape[1] - 1]
        radius = np.append(self.model.geom_size[: bodies - 1, 0], np.hypot(*plate[1:]))
        axis = axes.reshape(*centres.shape, 3)[..., 2].copy()
        axis[:, -1] = axes[:, -1].reshape(-1, 3, 3)[..., 0]  # of the plate
        length = np.column_stack((half, np.full(len(half), plate[0])))
        reach = axis * length[..., None]
        pairs = np.array(self.pairs)
        moving = pairs[:, 1] < bodies
        bounds = np.empty((len(pairs), len(half)))
        i, j = pairs[moving].T
        middle, toward = (v.transpose(1, 2, 0) for v in (centres, reach))  # (bodies, 3, N)
        ends = (v.swapaxes(0, 1) for v in (middle[i], toward[i], middle[j], toward[j]))
        bounds[moving] = segment_distance(*ends) - (radius[i] + radius[j])[:, None]
        for k in np.flatnonzero(~moving):
            i, j = self.pairs[k]
            if self.names[j] == "floor":
                bounds[k] = centres[:, i, 2] - np.abs(reach[:, i, 2]) - radius[i] - self.floor
                continue
            beyond = np.abs(centres[:, i] - self.model.geom_pos[j]) - self.model.geom_size[j]
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
            bounds[k] = outside + np.minimum(beyond.max(axis=1), 0.0) - length[:, i] - radius[i]
        return bounds

    def _placed(self, robot: Frames, bar: Frames) -> tuple[Array, Array, Array]:
        """Half lengths (N, capsules) [m], centres (N, bodies, 3) [m] and axes (N, bodies, 9).

        The bodies are the capsules, then the plate.
        """
        tool_x, tool_z = robot.x[-1], robot.z[-1]
        reach = (tool_x * (robot.tip - robot.origin[-2])).sum(axis=0)
        flange = robot.tip - tool_x * reach - self.tool_height * tool_z  # (3, N) [m] the bare one
        ball, tip = bar.origin[0], bar.tip
        along = (tip - ball) / np.linalg.norm(tip - ball, axis=0)
        base = np.stack([ball[0], ball[1], np.full(ball.shape[1], self.floor)])
        segments = self._row_segments if self.rows else self._arm_segments
        pairs = (
            *segments(robot, flange),
            (ball + GIMBAL * along, tip - GIMBAL * along),
            (base, ball - np.array([[0.0], [0.0], [GIMBAL]])),
        )
        ends = np.stack([np.stack(pair) for pair in pairs]).transpose(3, 0, 1, 2)
        axis = ends[:, :, 1] - ends[:, :, 0]
        length = np.linalg.norm(axis, axis=2)
        z = axis / np.maximum(length, 1e-9)[:, :, None]
        helper = np.where(np.abs(z[:, :, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
        x = np.cross(helper, z)
        x /= np.linalg.norm(x, axis=2)[:, :, None]
        axes = np.stack((x, np.cross(z, x), z), axis=3).reshape(*length.shape, 9)
        plate = flange + 0.5 * reach * tool_x + self.plate_height * tool_z
        plate_axes = robot.rotation().transpose(2, 0, 1).reshape(-1, 1, 9)
        centres = np.concatenate((ends.mean(axis=2), plate.T[:, None]), axis=1)
        return 0.5 * length, centres, np.concatenate((axes, plate_axes), axis=1)

    def _row_segments(self, robot: Frames, flange: Array) -> list[tuple[Array, Array]]:
        """Ends (3, N) [m] of the bodies along the rows; the last row ends at the bare flange."""
        o, ends = robot.origin, []
        for row, part in self.rows:
            following = flange if row == len(robot.x_link) - 1 else o[row + 1]
            corner = o[row] + robot.z[row] * (robot.z[row] * (following - o[row])).sum(axis=0)
            ends.append((corner, following) if part else (o[row], corner))
        return ends

    def _arm_segments(self, robot: Frames, flange: Array) -> list[tuple[Array, Array]]:
        """Ends (3, N) [m] of column, upper arm, forearm and wrist."""
        o = robot.origin
        fore = (o[4] - o[2]) / np.linalg.norm(o[4] - o[2], axis=0)
        foot = np.broadcast_to(np.array([[0.0], [0.0], [self.floor]]), (3, o.shape[2]))
        top = np.maximum(o[1][2] - self.radii["column"], self.floor)
        return [
            (foot, np.array([[0.0], [0.0], [1.0]]) * top),
            (o[1], o[2]),
            (o[2], o[4] - self.radii["forearm"] * fore),  # round end reaches the wrist's centre
            (o[4], flange),
        ]


def _rows_every(step: float, t: Array) -> slice:
    """Rows of times (N,) [s] about every `step` seconds."""
    return slice(None, None, max(1, round(step / float(t[1] - t[0]))))


def clearance(cell: Cell, around: PlanCell) -> Clearance:
    """Bodies of a cell, with floor and keep-out boxes."""
    spec, kind = mujoco.MjSpec(), mujoco.mjtGeom
    world, chain = spec.worldbody, nominal_chain(cell.robot)
    rows: tuple[tuple[int, int], ...] = ()
    radii = {"rod": ROD, "pedestal": PEDESTAL}
    apart: Callable[[str, str], bool] = _compared
    if has_closed_form(chain):
        arm = float(cell.robot.a[1])
        radii = {name: share * arm for name, share in SHARES.items()} | radii
    else:
        links = links_of(chain)
        rows = links.rows
        link_names = [f"link {row + 1} along {'da'[part]}" for row, part in rows]
        radii = dict(zip(link_names, links.radii.tolist(), strict=True)) | radii
        apart = _apart(links, link_names, radii, cell.plate.length)
    for name, radius in radii.items():
        world.add_geom(name=name, type=kind.mjGEOM_CAPSULE, size=[radius, 0.1, 0.0])
    plate = [0.5 * cell.plate.length + PLATE_OVERHANG, 0.5 * PLATE_WIDTH, 0.5 * PLATE_THICKNESS]
    world.add_geom(name="plate", type=kind.mjGEOM_BOX, size=plate)
    floor = [0.0, 0.0, around.floor_m]
    world.add_geom(name="floor", type=kind.mjGEOM_PLANE, size=[5.0, 5.0, 0.1], pos=floor)
    for box in around.keep_out:
        low, high = np.array(box.lower_m), np.array(box.upper_m)
        half, centre = 0.5 * (high - low), 0.5 * (high + low)
        world.add_geom(name=f"box {box.name}", type=kind.mjGEOM_BOX, size=half, pos=centre)
    model = spec.compile()
    names = tuple(model.geom(i).name for i in range(model.ngeom))
    pairs = tuple(
        (i, j)
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if (names[i] in radii or names[i] == "plate") and apart(names[i], names[j])
    )
    return Clearance(
        model=model,
        radii=radii,
        pairs=pairs,
        names=names,
        floor=around.floor_m,
        plate_height=float(cell.plate.body.com[2]),
        tool_height=cell.plate.tool_offset,
        rows=rows,
    )


def _apart(
    links: Links, names: Sequence[str], radii: dict[str, float], plate: float
) -> Callable[[str, str], bool]:
    """Which bodies are compared: those between which the chain is longer than their radii.

    names : of the links. plate : [m] its length.
    """
    end = dict(zip(names, links.end, strict=True))
    begin = dict(zip(names, links.begin, strict=True))
    begin |= {"plate": links.end[-1], "rod": links.end[-1] + plate}
    size = radii | {"plate": 0.5 * PLATE_WIDTH}
    fixed = {name for name, (row, _) in zip(names, links.rows, strict=True) if row == 0}

    def compared(body: str, other: str) -> bool:
        if body in end and other in begin:
            return bool(begin[other] - end[body] > size[body] + size[other] + TOUCHING)
        if body in end:  # pedestal, floor, box
            return body not in fixed
        return _compared(body, other)

    return compared


def _compared(body: str, other: str) -> bool:
    if other in MOVING:
        return (body, other) not in NEIGHBOURS
    return body not in ON_FLOOR if other == "floor" else body != "column"
