"""Distances between robot, plate, rod and their surroundings as capsules and boxes.

MuJoCo's `mj_geomDistance` measures them. The bodies connect frames of the kinematic chains, so
nothing is simulated; MuJoCo only gets their poses. Radii are assumed shares of the upper arm's
length, since neither maker publishes hulls. Neighbours touch and are not compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from cell.arrays import Array
from cell.chain import Frames
from cell.descriptions import Cell
from cell.geometry import Geometry, bar_frames, robot_frames
from planning.request import PlanCell

COLUMN, ARM, FOREARM, WRIST = 0.38, 0.14, 0.11, 0.09  # radii, shares of the upper arm's length
ROD, PEDESTAL = 0.02, 0.0525  # [m] radii: tube assumed, adapter of thesis sec. 4.5
# [m] cell/plates; the overhang beyond flange axis and universal joint is assumed
PLATE_WIDTH, PLATE_THICKNESS, PLATE_OVERHANG = 0.10, 0.045, 0.05
GIMBAL = 0.10  # [m] between a ball's centre and the beginning of rod or pedestal; assumed
FAR = 0.5  # [m] beyond which distances are not distinguished
TIME_STEP = 1.0  # [s] between the poses of a plan; planning.verify takes smaller steps


@dataclass(frozen=True, eq=False)
class Clearance:
    """The bodies, as geoms of a model without joints."""

    model: mujoco.MjModel
    radii: dict[str, float]
    pairs: tuple[tuple[int, int], ...]
    names: tuple[str, ...]  # of all geoms
    floor: float
    plate_height: float  # [m] of the plate's middle over the flange
    tool_height: float  # [m] of the tool over the flange


@dataclass(frozen=True)
class Nearest:
    """The smallest distance along a motion."""

    distance: float  # [m] FAR where nothing is closer
    pair: str
    t: float


CAPSULES = ("column", "upper arm", "forearm", "wrist", "rod", "pedestal")
MOVING = (*CAPSULES, "plate")
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


def clearance(cell: Cell, around: PlanCell) -> Clearance:
    """Bodies of a cell, with floor and keep-out boxes."""
    spec, arm, kind = mujoco.MjSpec(), float(cell.robot.a[1]), mujoco.mjtGeom
    world = spec.worldbody
    sizes = (COLUMN * arm, ARM * arm, FOREARM * arm, WRIST * arm, ROD, PEDESTAL)
    radii = dict(zip(CAPSULES, sizes, strict=True))
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
        if names[i] in MOVING and _compared(names[i], names[j])
    )
    return Clearance(
        model=model,
        radii=radii,
        pairs=pairs,
        names=names,
        floor=around.floor_m,
        plate_height=float(cell.plate.body.com[2]),
        tool_height=cell.plate.tool_offset,
    )


def _compared(body: str, other: str) -> bool:
    if other in MOVING:
        return (body, other) not in NEIGHBOURS
    return body not in ON_FLOOR if other == "floor" else body != "column"


def nearest(of: Clearance, geometry: Geometry, q: Array, b: Array, t: Array) -> Nearest:
    """The smallest distance along a motion, every TIME_STEP seconds.

    q, b : (N, 6), (N, 5) [rad] joint angles at times t (N,) [s].
    """
    best = Nearest(FAR, "nothing", 0.0)
    for at, i, j, distance in _distances(of, geometry, q, b, t, TIME_STEP):
        if distance < best.distance:
            best = Nearest(distance, f"{of.names[i]} and {of.names[j]}", at)
    return best


def distances_along(
    of: Clearance, geometry: Geometry, q: Array, b: Array, t: Array, *, step: float
) -> Array:
    """(K,) [m] smallest distance every `step` seconds; FAR where nothing is closer."""
    smallest: dict[float, float] = {}
    for at, _, _, distance in _distances(of, geometry, q, b, t, step):
        smallest[at] = min(smallest.get(at, FAR), distance)
    return np.array(list(smallest.values()))


def _distances(
    of: Clearance, geometry: Geometry, q: Array, b: Array, t: Array, step: float
) -> Iterator[tuple[float, int, int, float]]:
    """Time [s], two geoms and their distance [m], of all pairs every `step` seconds."""
    rows = slice(None, None, max(1, round(step / float(t[1] - t[0]))))
    robot, bar = robot_frames(geometry, q[rows]), bar_frames(geometry, b[rows])
    half, centres, turned = _placed(of, robot, bar)
    bodies = centres.shape[1]
    data = mujoco.MjData(of.model)
    mujoco.mj_kinematics(of.model, data)  # places floor and boxes
    for k, at in enumerate(t[rows]):
        of.model.geom_size[: bodies - 1, 1] = half[k]
        data.geom_xpos[:bodies], data.geom_xmat[:bodies] = centres[k], turned[k]
        for i, j in of.pairs:
            yield float(at), i, j, float(mujoco.mj_geomDistance(of.model, data, i, j, FAR, None))


def _segments(of: Clearance, robot: Frames, bar: Frames) -> Array:
    """(N, capsules, 2, 3) [m] ends of the capsules' axes."""
    o = robot.origin
    n = o.shape[2]
    flange = _flange(of, robot)
    ball, tip = bar.origin[0], bar.tip
    along = (tip - ball) / np.linalg.norm(tip - ball, axis=0)
    fore = (o[4] - o[2]) / np.linalg.norm(o[4] - o[2], axis=0)
    foot = np.broadcast_to(np.array([[0.0], [0.0], [of.floor]]), (3, n))
    top = np.maximum(o[1][2] - of.radii["column"], of.floor)
    column_top = np.array([[0.0], [0.0], [1.0]]) * top
    base = np.stack([ball[0], ball[1], np.full(n, of.floor)])
    ends: Sequence[tuple[Array, Array]] = (
        (foot, column_top),
        (o[1], o[2]),
        (o[2], o[4] - of.radii["forearm"] * fore),  # its round end reaches the wrist's centre
        (o[4], flange),
        (ball + GIMBAL * along, tip - GIMBAL * along),
        (base, ball - np.array([[0.0], [0.0], [GIMBAL]])),
    )
    return np.stack([np.stack(pair) for pair in ends]).transpose(3, 0, 1, 2)


def _flange(of: Clearance, robot: Frames) -> Array:
    """(3, N) [m] centre of the bare flange."""
    tool, x, z = robot.tip, robot.x[6], robot.z[6]
    return np.asarray(tool - x * (x * (tool - robot.origin[5])).sum(axis=0) - of.tool_height * z)


def _placed(of: Clearance, robot: Frames, bar: Frames) -> tuple[Array, Array, Array]:
    """Half lengths (N, capsules) [m], centres (N, bodies, 3) [m] and axes (N, bodies, 9).

    The bodies are the capsules, then the plate.
    """
    ends = _segments(of, robot, bar)
    axis = ends[:, :, 1] - ends[:, :, 0]
    length = np.linalg.norm(axis, axis=2)
    z = axis / np.maximum(length, 1e-9)[:, :, None]
    helper = np.where(np.abs(z[:, :, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=2)[:, :, None]
    turned = np.stack((x, np.cross(z, x), z), axis=3).reshape(*length.shape, 9)
    tool_x, tool_z = robot.x[6], robot.z[6]
    reach = (tool_x * (robot.tip - robot.origin[5])).sum(axis=0)
    plate = _flange(of, robot) + 0.5 * reach * tool_x + of.plate_height * tool_z
    plate_axes = robot.rotation().transpose(2, 0, 1).reshape(-1, 1, 9)
    centres = np.concatenate((ends.mean(axis=2), plate.T[:, None]), axis=1)
    return 0.5 * length, centres, np.concatenate((turned, plate_axes), axis=1)
