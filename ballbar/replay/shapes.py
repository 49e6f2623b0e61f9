"""Shapes of robot, offset plate and ball-bar for the viewer, each in the DH frame it moves with.

No maker's drawings: solids of revolution and rounded plates, sized by the upper arm and placed by
the DH rows, so they meet joint to joint for any robot with an upright column, a parallel upper arm
and a hollow wrist. In frame i the axis of joint i is `(0, sin alpha_i, cos alpha_i)` through
`-(a_i, d_i sin alpha_i, d_i cos alpha_i)`, whatever the joint angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbar.replay.colours import STEEL, Colour
from cell.arrays import Array
from cell.chain import Chain
from cell.closed_form import has_arm_structure
from cell.descriptions import Cell
from cell.geometry import Geometry, nominal_chain

PAINT = (236, 106, 32)  # the orange of many industrial robots
DARK = (62, 65, 70)
CARBON = (116, 120, 128)  # brighter than carbon fibre, to stand out from the background
PLATE_BLUE = (70, 130, 200)
X, Y, Z = np.eye(3)

_SIDES = 48  # of a circle
_EDGE = 0.06  # bevel as a share of the smallest size


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with a normal and a colour at each corner."""

    vertices: Array  # (V, 3) [m]
    normals: Array  # (V, 3)
    triangles: NDArray[np.int64]  # (T, 3)
    colours: NDArray[np.uint8]  # (V, 3)


def joined(parts: Sequence[Mesh]) -> Mesh:
    """One mesh of several."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.triangles + start for part, start in zip(parts, first, strict=False)]),
        np.concatenate([part.colours for part in parts]),
    )


def turned(
    foot: Array, axis: Array, profile: Sequence[tuple[float, float]], colour: Colour
) -> Mesh:
    """Solid of revolution about `axis` (3,), a unit vector, through `foot` (3,) [m].

    profile : (distance along the axis, radius) [m], from bottom to top.
    """
    across = np.cross(axis, Z if abs(axis[2]) < 0.9 else X)
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)[:, None]
    radial = np.cos(turn) * across + np.sin(turn) * np.cross(axis, across)
    outline = [(profile[0][0], 0.0), *profile, (profile[-1][0], 0.0)]
    bands = []
    for (s0, r0), (s1, r1) in pairwise(outline):
        normal = radial * (s1 - s0) - axis * (r1 - r0)
        length = float(np.hypot(s1 - s0, r1 - r0))
        if length > 0.0:
            lower, upper = foot + s0 * axis + r0 * radial, foot + s1 * axis + r1 * radial
            bands.append(_band(lower, upper, normal / length, colour))
    return joined(bands)


def cylinder(
    start: Array, end: Array, radius: float, colour: Colour, *, end_radius: float | None = None
) -> Mesh:
    """Round bar from `start` to `end` (3,) [m], bevelled, tapered where `end_radius` differs."""
    length = float(np.linalg.norm(end - start))
    top = radius if end_radius is None else end_radius
    edge = min(_EDGE * 2.0 * min(radius, top), 0.2 * length)
    profile = [(0.0, radius - edge), (edge, radius), (length - edge, top), (length, top - edge)]
    return turned(start, (end - start) / length, profile, colour)


def ball(centre: Array, radius: float, colour: Colour) -> Mesh:
    """Sphere about `centre` (3,) [m], smoothly shaded."""
    turn = np.linspace(0.0, np.pi, _SIDES)
    profile = [(-radius * np.cos(a), radius * np.sin(a)) for a in turn]
    solid = turned(centre, Z, profile, colour)
    return replace(solid, normals=(solid.vertices - centre) / radius)


def arm(
    start: Array,
    end: Array,
    normal: Array,
    radii: tuple[float, float],
    thickness: float,
    colour: Colour,
) -> Mesh:
    """Bevelled plate with round ends of the given radii [m] about `start` and `end` (3,) [m].

    thickness : [m] along `normal` (3,), a unit vector.
    """
    along = (end - start) / np.linalg.norm(end - start)
    flat = np.stack((along, np.cross(normal, along)))
    tilt = float(np.arccos(np.clip((radii[0] - radii[1]) / np.linalg.norm(end - start), -1.0, 1.0)))
    around_end = np.linspace(-tilt, tilt, _SIDES // 2)
    around_start = np.linspace(tilt, 2.0 * np.pi - tilt, _SIDES // 2)
    angle = np.concatenate((around_end, around_start))[:, None]
    outward = np.hstack((np.cos(angle), np.sin(angle))) @ flat
    centre = np.repeat((end, start), _SIDES // 2, axis=0)
    radius = np.repeat(radii[::-1], _SIDES // 2)[:, None]
    outline = _Outline(centre + radius * outward, outward, 0.5 * (start + end))
    return _extruded(outline, normal, thickness, colour)


def block(
    centre: Array, normal: Array, size: tuple[float, float], thickness: float, colour: Colour
) -> Mesh:
    """Rectangular plate about `centre` (3,) [m], `normal` (3,) a coordinate axis.

    size : [m] along the two axes that follow it in cyclic order.
    """
    u, v = np.roll(normal, 1), np.roll(normal, 2)
    corner = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]).repeat(2, axis=0)
    face = np.array([(1, 0), (0, 1), (0, 1), (-1, 0), (-1, 0), (0, -1), (0, -1), (1, 0)])
    points = centre + 0.5 * size[0] * corner[:, :1] * u + 0.5 * size[1] * corner[:, 1:] * v
    outline = _Outline(points, face[:, :1] * u + face[:, 1:] * v, centre)
    return _extruded(outline, normal, thickness, colour)


def robot_shapes(cell: Cell) -> tuple[Mesh, ...]:
    """Base in the robot's base frame, then link i in frame i.

    The last frame is the tool's, so the last link ends before the plate.
    """
    robot = cell.robot
    chain = nominal_chain(robot)
    if not has_arm_structure(chain):
        return _plain_robot(cell, chain)
    width = 0.13 * float(robot.a[1])  # half the width of the upper arm
    return (
        _base(float(robot.d[0]), width),
        _column(chain, width),
        _upper_arm(chain, width),
        _elbow(chain, width),
        _forearm(chain, width),
        _wrist(chain, width, float(robot.d[5])),
        _flange(cell, width),
    )


def _plain_robot(cell: Cell, chain: Chain) -> tuple[Mesh, ...]:
    """A robot of any structure: a joint's housing and a tube along d and a of each row."""
    width = 0.07 * float(np.abs(chain.a).sum() + np.abs(chain.d).sum()) / 2.0
    foot = cylinder(np.zeros(3), 0.3 * width * Z, 2.0 * width, DARK)
    links = [_plain_link(chain, row, width) for row in range(chain.rows - 1)]
    return foot, *links, _flange(cell, width)


def _plain_link(chain: Chain, row: int, width: float) -> Mesh:
    point, direction = _axis(chain, row)
    corner, half = point + chain.d[row] * direction, 0.8 * width * direction
    parts = [cylinder(point - half, point + half, 0.8 * width, DARK)]
    for begin, end in ((point, corner), (corner, np.zeros(3))):
        if np.linalg.norm(end - begin) > width:
            parts.append(cylinder(begin, end, 0.6 * width, PAINT))
    return joined(parts)


def plate_shape(cell: Cell) -> Mesh:
    """Tool changer and offset plate, in the tool frame."""
    top = -0.45 * cell.plate.tool_offset * Z
    hub = top - cell.plate.length * X
    changer = cylinder(_mount(cell), hub, 0.042, DARK)
    return joined([changer, arm(hub, top, Z, (0.055, 0.032), 0.016, PLATE_BLUE)])


def _mount(cell: Cell) -> Array:
    """(3,) [m] middle of the flange's face, in the tool frame."""
    return np.asarray(-cell.plate.length * X - cell.plate.tool_offset * Z)


def bar_shapes(cell: Cell, geometry: Geometry) -> tuple[Mesh, ...]:
    """Stand in the ball-bar's base frame, then link i of the ball-bar in its frame i.

    geometry : gives the height of the stand and the length of the rod.
    """
    return (
        _stand(float(geometry.origin[2])),
        _gimbal_yoke(),
        _gimbal_hub(),
        _rod(geometry["bd3"]),
        _cross(),
        _universal_shaft(cell.plate.tool_offset),
    )


def cell_shapes(cell: Cell, geometry: Geometry) -> list[Mesh]:
    """Every body's shape, in the order of `CellMotion.frames`; geometry : as of `bar_shapes`."""
    return [*robot_shapes(cell), plate_shape(cell), *bar_shapes(cell, geometry)]


def _base(height: float, width: float) -> Mesh:
    foot = block(0.15 * width * Z, Z, (5.2 * width, 5.2 * width), 0.3 * width, DARK)
    profile = [
        (0.3 * width, 2.3 * width),
        (0.12 * height, 2.2 * width),
        (0.34 * height, 1.75 * width),
    ]
    ring = cylinder(0.34 * height * Z, 0.4 * height * Z, 1.9 * width, DARK)
    return joined([foot, turned(np.zeros(3), Z, profile, PAINT), ring])


def _axis(chain: Chain, row: int) -> tuple[Array, Array]:
    """Point before d and direction of the joint's axis, in the frame that turns with it."""
    direction = np.array([0.0, np.sin(chain.alpha[row]), np.cos(chain.alpha[row])])
    return -chain.d[row] * direction - chain.a[row] * X, direction


def _column(chain: Chain, width: float) -> Mesh:
    foot, up = _axis(chain, 0)
    side, shoulder, height = Z, np.zeros(3), chain.d[0]
    low = foot + 0.62 * height * up
    profile = [
        (0.4 * height, 1.8 * width),
        (0.5 * height, 1.7 * width),
        (0.6 * height, 1.35 * width),
    ]
    half, radii = 1.75 * width * side, (1.35 * width, 1.15 * width)
    parts = [
        turned(foot, up, profile, PAINT),
        cylinder(shoulder - half, shoulder + half, 0.8 * width, DARK),
    ]
    for lateral in (-1.05 * width * side, 1.05 * width * side):  # the upper arm turns between
        parts.append(arm(low + lateral, shoulder + lateral, side, radii, 0.55 * width, PAINT))
    return joined(parts)


def _upper_arm(chain: Chain, width: float) -> Mesh:
    shoulder, side = _axis(chain, 1)
    elbow, half = np.zeros(3), 0.95 * width * side
    beam = arm(shoulder, elbow, side, (width, 0.8 * width), 1.3 * width, PAINT)
    return joined([beam, cylinder(elbow - half, elbow + half, 0.6 * width, DARK)])


def _elbow(chain: Chain, width: float) -> Mesh:
    elbow, side = _axis(chain, 2)
    roll = Z  # of frame 3: the forearm's axis
    radii = (0.95 * width, 0.9 * width)
    front, back = 1.5 * width * roll, -1.7 * width * roll
    parts = [
        cylinder(back, front, 0.95 * width, PAINT),
        cylinder(front, 1.15 * front, 0.85 * width, DARK),
    ]
    for lateral in (-0.85 * width * side, 0.85 * width * side):
        parts.append(arm(elbow + lateral, lateral, side, radii, 0.36 * width, PAINT))
    for turn in np.radians((90.0, 210.0, 330.0)):  # motors of joints 4, 5 and 6
        motor = back + 0.48 * width * (np.cos(turn) * X + np.sin(turn) * Y)
        parts.append(cylinder(motor, motor - width * roll, 0.36 * width, DARK))
    return joined(parts)


def _forearm(chain: Chain, width: float) -> Mesh:
    elbow, along = _axis(chain, 3)
    side, wrist, radii = Z, np.zeros(3), (0.44 * width, 0.44 * width)
    begin, throat = elbow + 1.72 * width * along, wrist - 1.15 * width * along
    parts = [
        cylinder(begin, throat, 0.72 * width, PAINT, end_radius=0.56 * width),
        cylinder(throat, throat + 0.3 * width * along, 0.62 * width, PAINT),
    ]
    for lateral in (-0.5 * width * side, 0.5 * width * side):
        root = throat + 0.2 * width * along + lateral
        parts.append(arm(root, lateral, side, radii, 0.24 * width, PAINT))
    return joined(parts)


def _wrist(chain: Chain, width: float, flange: float) -> Mesh:
    _, side = _axis(chain, 4)
    barrel = cylinder(-0.66 * width * side, 0.66 * width * side, 0.34 * width, DARK)
    return joined([barrel, cylinder(np.zeros(3), 0.75 * flange * Z, 0.32 * width, PAINT)])


def _flange(cell: Cell, width: float) -> Mesh:
    face = _mount(cell)
    return cylinder(face - 0.27 * max(cell.robot.d[-1], 0.1 * width) * Z, face, 0.42 * width, STEEL)


def _stand(height: float) -> Mesh:
    """Post from the floor to below the gimbal; a stub where the base is lower than its own part."""
    top, bottom = -0.125, min(-height, -0.2)
    foot = [(bottom, 0.17), (bottom + 0.015, 0.17), (bottom + 0.02, 0.165)]
    post = [(bottom, 0.07), (top - 0.03, 0.05), (top, 0.05)]
    return joined([turned(np.zeros(3), Z, profile, DARK) for profile in (foot, post)])


def _yoke(axis: Array, along: Array, *, gap: float, depth: float, colour: Colour) -> list[Mesh]:
    """Two cheeks about `axis` that hold a pin, bridged `depth` below it, against `along`."""
    root, half, radii = -depth * along, gap * axis, (0.022, 0.022)
    cheeks = [arm(root + s * half, s * half, axis, radii, 0.012, colour) for s in (-1.0, 1.0)]
    return [*cheeks, arm(root - half, root + half, along, radii, 0.014, colour)]


def _gimbal_yoke() -> Mesh:
    shaft = cylinder(-0.125 * Y, -0.06 * Y, 0.035, STEEL)
    return joined([shaft, *_yoke(Z, Y, gap=0.055, depth=0.065, colour=STEEL)])


def _gimbal_hub() -> Mesh:
    hub = cylinder(-0.04 * Y, 0.04 * Y, 0.032, PLATE_BLUE)
    return joined([cylinder(-0.066 * Y, 0.066 * Y, 0.014, DARK), hub])


def _rod(length: float) -> Mesh:
    foot = -length * Y
    parts = [
        cylinder(foot + 0.02 * Y, foot + 0.09 * Y, 0.024, STEEL),
        cylinder(foot + 0.09 * Y, -0.09 * Y, 0.014, CARBON),
        cylinder(-0.1 * Y, -0.048 * Y, 0.022, STEEL),
    ]
    return joined([*parts, *_yoke(Z, Y, gap=0.036, depth=0.05, colour=STEEL)])


def _cross() -> Mesh:
    pin = cylinder(-0.044 * Y, 0.044 * Y, 0.011, DARK)
    return joined([pin, cylinder(-0.03 * Z, 0.018 * Z, 0.018, PLATE_BLUE)])


def _universal_shaft(tool_offset: float) -> Mesh:
    return cylinder(-0.42 * tool_offset * Z, -0.018 * Z, 0.022, STEEL)


def _band(lower: Array, upper: Array, normal: Array, colour: Colour) -> Mesh:
    """Closed strip between two rings of points, lower and upper (K, 3) [m]; normal (K, 3)."""
    k = len(lower)
    corner, following = np.arange(k), (np.arange(k) + 1) % k
    first = np.stack((corner, following, k + following), axis=1)
    second = np.stack((corner, k + following, k + corner), axis=1)
    return Mesh(
        np.concatenate((lower, upper)),
        np.concatenate((normal, normal)),
        np.concatenate((first, second)),
        np.tile(np.array(colour, dtype=np.uint8), (2 * k, 1)),
    )


@dataclass(frozen=True, eq=False)
class _Outline:
    """Convex outline of a plate."""

    points: Array  # (K, 3) [m]
    outward: Array  # (K, 3) normals
    middle: Array  # (3,) [m]


def _extruded(outline: _Outline, normal: Array, thickness: float, colour: Colour) -> Mesh:
    """Plate of an outline, `thickness` [m] along `normal` (3,), its edges bevelled."""
    points, outward, half = outline.points, outline.outward, 0.5 * thickness
    edge = 2.0 * _EDGE * thickness
    inner = points - edge * outward
    steps = [(inner, -half), (points, edge - half), (points, half - edge), (inner, half)]
    rings = [ring + height * normal for ring, height in steps]
    bevels = np.sqrt(0.5) * (outward - normal), outward, np.sqrt(0.5) * (outward + normal)
    bands = [_band(rings[i], rings[i + 1], n, colour) for i, n in enumerate(bevels)]
    for ring, side in ((rings[0], -1.0), (rings[3], 1.0)):
        hub = np.broadcast_to(outline.middle + side * half * normal, ring.shape)
        bands.append(_band(hub, ring, np.broadcast_to(side * normal, ring.shape), colour))
    return joined(bands)
