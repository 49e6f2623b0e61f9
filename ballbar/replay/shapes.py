"""Shapes of robot, offset plate and ball-bar for the viewer, each in the DH frame it moves with.

No maker's drawings: solids turned about an axis and rounded plates, sized by the upper arm and placed by the DH rows, so
they meet joint to joint for any robot with an upright column, a parallel upper arm and a hollow wrist. In frame i the
axis of joint i is `(0, sin alpha_i, cos alpha_i)` through `-(a_i, d_i sin alpha_i, d_i cos alpha_i)`, whatever the joint angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbar.replay.entities import Colour
from cell.arrays import Array
from cell.chain import Chain
from cell.descriptions import Cell
from cell.geometry import Geometry

PAINT = (236, 106, 32)  # the orange of many industrial robots
DARK = (62, 65, 70)
STEEL = (178, 184, 192)
CARBON = (116, 120, 128)  # brighter than carbon fibre, to stand out from the background
PLATE_BLUE = (70, 130, 200)

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
    """Solid of revolution about `axis` (unit) through `foot`; profile : (distance along the axis, radius) [m], from bottom to top."""
    across = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)[:, None]
    radial = np.cos(turn) * across + np.sin(turn) * np.cross(axis, across)
    outline = [(profile[0][0], 0.0), *profile, (profile[-1][0], 0.0)]
    bands = []
    for (s0, r0), (s1, r1) in pairwise(outline):
        normal = radial * (s1 - s0) - axis * (r1 - r0)
        length = float(np.hypot(s1 - s0, r1 - r0))
        if length > 0.0:
            bands.append(
                _band(
                    foot + s0 * axis + r0 * radial,
                    foot + s1 * axis + r1 * radial,
                    normal / length,
                    colour,
                )
            )
    return joined(bands)


def cylinder(
    start: Array, end: Array, radius: float, colour: Colour, *, end_radius: float | None = None
) -> Mesh:
    """Round bar from `start` to `end`, bevelled, tapered where `end_radius` differs."""
    length = float(np.linalg.norm(end - start))
    top = radius if end_radius is None else end_radius
    edge = min(_EDGE * 2.0 * min(radius, top), 0.2 * length)
    profile = [(0.0, radius - edge), (edge, radius), (length - edge, top), (length, top - edge)]
    return turned(start, (end - start) / length, profile, colour)


def ball(centre: Array, radius: float, colour: Colour) -> Mesh:
    """Sphere, smoothly shaded."""
    turn = np.linspace(0.0, np.pi, _SIDES)
    solid = turned(
        centre,
        np.array([0.0, 0.0, 1.0]),
        [(-radius * np.cos(a), radius * np.sin(a)) for a in turn],
        colour,
    )
    return replace(solid, normals=(solid.vertices - centre) / radius)


def arm(
    start: Array,
    end: Array,
    normal: Array,
    radii: tuple[float, float],
    thickness: float,
    colour: Colour,
) -> Mesh:
    """Plate with round ends of the given radii about `start` and `end`, `thickness` along `normal` (unit), bevelled."""
    along = (end - start) / np.linalg.norm(end - start)
    flat = np.stack((along, np.cross(normal, along)))
    tilt = float(np.arccos(np.clip((radii[0] - radii[1]) / np.linalg.norm(end - start), -1.0, 1.0)))
    around_end = np.linspace(-tilt, tilt, _SIDES // 2)
    around_start = np.linspace(tilt, 2.0 * np.pi - tilt, _SIDES // 2)
    angle = np.concatenate((around_end, around_start))[:, None]
    outward = np.hstack((np.cos(angle), np.sin(angle))) @ flat
    centre = np.repeat((end, start), _SIDES // 2, axis=0)
    radius = np.repeat(radii[::-1], _SIDES // 2)[:, None]
    return _extruded(
        centre + radius * outward, outward, 0.5 * (start + end), normal, thickness, colour
    )


def block(
    centre: Array, normal: Array, size: tuple[float, float], thickness: float, colour: Colour
) -> Mesh:
    """Rectangular plate, `size` along the two axes that follow `normal` (a coordinate axis) in cyclic order."""
    u, v = np.roll(normal, 1), np.roll(normal, 2)
    corner = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]).repeat(2, axis=0)
    face = np.array([(1, 0), (0, 1), (0, 1), (-1, 0), (-1, 0), (0, -1), (0, -1), (1, 0)])
    points = centre + 0.5 * size[0] * corner[:, :1] * u + 0.5 * size[1] * corner[:, 1:] * v
    return _extruded(points, face[:, :1] * u + face[:, 1:] * v, centre, normal, thickness, colour)


def robot_shapes(cell: Cell) -> tuple[Mesh, ...]:
    """Base in the robot's base frame, then link i in frame i; frame 6 is the tool's, so link 6 ends before the plate."""
    robot = cell.robot
    chain = Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(6))
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


def plate_shape(cell: Cell) -> Mesh:
    """Tool changer and offset plate, in the tool frame."""
    normal, top = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -0.45 * cell.plate.tool_offset])
    mount = np.array([-cell.plate.length, 0.0, -cell.plate.tool_offset])
    hub = top + np.array([-cell.plate.length, 0.0, 0.0])
    changer = cylinder(mount, hub, 0.042, DARK)
    return joined([changer, arm(hub, top, normal, (0.055, 0.032), 0.016, PLATE_BLUE)])


def bar_shapes(cell: Cell, geometry: Geometry) -> tuple[Mesh, ...]:
    """Stand in the ball-bar's base frame, then the ball-bar's link i in its frame i; the rod is as long as `geometry` says."""
    return (
        _stand(float(geometry.origin[2])),
        _gimbal_yoke(),
        _gimbal_hub(),
        _rod(geometry["bd3"]),
        _cross(),
        _cardan_shaft(cell.plate.tool_offset),
    )


def _base(height: float, width: float) -> Mesh:
    up = np.array([0.0, 0.0, 1.0])
    foot = block(0.15 * width * up, up, (5.2 * width, 5.2 * width), 0.3 * width, DARK)
    pedestal = turned(
        np.zeros(3),
        up,
        [(0.3 * width, 2.3 * width), (0.12 * height, 2.2 * width), (0.34 * height, 1.75 * width)],
        PAINT,
    )
    return joined(
        [foot, pedestal, cylinder(0.34 * height * up, 0.4 * height * up, 1.9 * width, DARK)]
    )


def _axis(chain: Chain, row: int) -> tuple[Array, Array]:
    """Point before d and direction of the joint's axis, in the frame that turns with it."""
    direction = np.array([0.0, np.sin(chain.alpha[row]), np.cos(chain.alpha[row])])
    return -chain.d[row] * direction - np.array([chain.a[row], 0.0, 0.0]), direction


def _column(chain: Chain, width: float) -> Mesh:
    foot, up = _axis(chain, 0)
    side, shoulder, height = np.array([0.0, 0.0, 1.0]), np.zeros(3), chain.d[0]
    low = foot + 0.62 * height * up
    parts = [
        turned(
            foot,
            up,
            [
                (0.4 * height, 1.8 * width),
                (0.5 * height, 1.7 * width),
                (0.6 * height, 1.35 * width),
            ],
            PAINT,
        ),
        cylinder(shoulder - 1.75 * width * side, shoulder + 1.75 * width * side, 0.8 * width, DARK),
    ]
    for lateral in (-1.05 * width, 1.05 * width):  # the upper arm turns between two cheeks
        parts.append(
            arm(
                low + lateral * side,
                shoulder + lateral * side,
                side,
                (1.35 * width, 1.15 * width),
                0.55 * width,
                PAINT,
            )
        )
    return joined(parts)


def _upper_arm(chain: Chain, width: float) -> Mesh:
    shoulder, side = _axis(chain, 1)
    elbow = np.zeros(3)
    parts = [arm(shoulder, elbow, side, (width, 0.8 * width), 1.3 * width, PAINT)]
    parts.append(
        cylinder(elbow - 0.95 * width * side, elbow + 0.95 * width * side, 0.6 * width, DARK)
    )
    return joined(parts)


def _elbow(chain: Chain, width: float) -> Mesh:
    elbow, side = _axis(chain, 2)
    roll = np.array([0.0, 0.0, 1.0])  # z of frame 3 is the forearm's axis
    front, back = 1.5 * width * roll, -1.7 * width * roll
    parts = [
        cylinder(back, front, 0.95 * width, PAINT),
        cylinder(front, 1.15 * front, 0.85 * width, DARK),
    ]
    for lateral in (-0.85 * width, 0.85 * width):
        parts.append(
            arm(
                elbow + lateral * side,
                lateral * side,
                side,
                (0.95 * width, 0.9 * width),
                0.36 * width,
                PAINT,
            )
        )
    for turn in np.radians((90.0, 210.0, 330.0)):  # motors of joints 4, 5 and 6
        place = back + 0.48 * width * (
            np.cos(turn) * np.array([1.0, 0.0, 0.0]) + np.sin(turn) * np.array([0.0, 1.0, 0.0])
        )
        parts.append(cylinder(place, place - 1.0 * width * roll, 0.36 * width, DARK))
    return joined(parts)


def _forearm(chain: Chain, width: float) -> Mesh:
    elbow, along = _axis(chain, 3)
    side, wrist = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    throat = wrist - 1.15 * width * along
    parts = [
        cylinder(
            elbow + 1.72 * width * along, throat, 0.72 * width, PAINT, end_radius=0.56 * width
        ),
        cylinder(throat, throat + 0.3 * width * along, 0.62 * width, PAINT),
    ]
    for lateral in (-0.5 * width, 0.5 * width):
        root = throat + 0.2 * width * along + lateral * side
        parts.append(
            arm(root, lateral * side, side, (0.44 * width, 0.44 * width), 0.24 * width, PAINT)
        )
    return joined(parts)


def _wrist(chain: Chain, width: float, flange: float) -> Mesh:
    _, side = _axis(chain, 4)
    out = np.array([0.0, 0.0, 1.0])
    barrel = cylinder(-0.66 * width * side, 0.66 * width * side, 0.34 * width, DARK)
    return joined([barrel, cylinder(np.zeros(3), 0.75 * flange * out, 0.32 * width, PAINT)])


def _flange(cell: Cell, width: float) -> Mesh:
    face = np.array([-cell.plate.length, 0.0, -cell.plate.tool_offset])
    return cylinder(face - np.array([0.0, 0.0, 0.27 * cell.robot.d[5]]), face, 0.42 * width, STEEL)


def _stand(height: float) -> Mesh:
    """Post from the floor to below the gimbal; a stub where the ball-bar stands lower than its own base part."""
    top, bottom = -0.125, min(-height, -0.2)
    up = np.array([0.0, 0.0, 1.0])
    foot = turned(
        np.zeros(3), up, [(bottom, 0.17), (bottom + 0.015, 0.17), (bottom + 0.02, 0.165)], DARK
    )
    return joined(
        [foot, turned(np.zeros(3), up, [(bottom, 0.07), (top - 0.03, 0.05), (top, 0.05)], DARK)]
    )


def _yoke(axis: Array, along: Array, *, gap: float, depth: float, colour: Colour) -> list[Mesh]:
    """Two cheeks about `axis` that hold a pin, and the bridge between them `depth` down against `along`."""
    root = -depth * along
    cheeks = [
        arm(root + s * gap * axis, s * gap * axis, axis, (0.022, 0.022), 0.012, colour)
        for s in (-1.0, 1.0)
    ]
    return [
        *cheeks,
        arm(root - gap * axis, root + gap * axis, along, (0.022, 0.022), 0.014, colour),
    ]


def _gimbal_yoke() -> Mesh:
    up, side = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    shaft = cylinder(-0.125 * up, -0.06 * up, 0.035, STEEL)
    return joined([shaft, *_yoke(side, up, gap=0.055, depth=0.065, colour=STEEL)])


def _gimbal_hub() -> Mesh:
    side = np.array([0.0, 1.0, 0.0])
    hub = cylinder(-0.04 * side, 0.04 * side, 0.032, PLATE_BLUE)
    return joined([cylinder(-0.066 * side, 0.066 * side, 0.014, DARK), hub])


def _rod(length: float) -> Mesh:
    along, side = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    foot = -length * along
    parts = [
        cylinder(foot + 0.02 * along, foot + 0.09 * along, 0.024, STEEL),
        cylinder(foot + 0.09 * along, -0.09 * along, 0.014, CARBON),
        cylinder(-0.1 * along, -0.048 * along, 0.022, STEEL),
    ]
    return joined([*parts, *_yoke(side, along, gap=0.036, depth=0.05, colour=STEEL)])


def _cross() -> Mesh:
    side, across = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return joined(
        [
            cylinder(-0.044 * side, 0.044 * side, 0.011, DARK),
            cylinder(-0.03 * across, 0.018 * across, 0.018, PLATE_BLUE),
        ]
    )


def _cardan_shaft(tool_offset: float) -> Mesh:
    out = np.array([0.0, 0.0, 1.0])
    return cylinder(-0.42 * tool_offset * out, -0.018 * out, 0.022, STEEL)


def _band(lower: Array, upper: Array, normal: Array, colour: Colour) -> Mesh:
    """Closed strip between two rings of K points."""
    k = len(lower)
    here, there = np.arange(k), (np.arange(k) + 1) % k
    triangles = np.concatenate(
        (np.stack((here, there, k + there), axis=1), np.stack((here, k + there, k + here), axis=1))
    )
    colours = np.tile(np.array(colour, dtype=np.uint8), (2 * k, 1))
    return Mesh(
        np.concatenate((lower, upper)), np.concatenate((normal, normal)), triangles, colours
    )


def _extruded(
    outline: Array, outward: Array, middle: Array, normal: Array, thickness: float, colour: Colour
) -> Mesh:
    """Plate of a convex outline (K, 3) with `outward` normals, `thickness` along `normal`, its edges bevelled."""
    half = 0.5 * thickness
    edge = 2.0 * _EDGE * thickness
    inner = outline - edge * outward
    steps = [(inner, -half), (outline, edge - half), (outline, half - edge), (inner, half)]
    tilted = np.sqrt(0.5) * (outward + normal), np.sqrt(0.5) * (outward - normal)
    rings = [ring + height * normal for ring, height in steps]
    bands = [
        _band(rings[i], rings[i + 1], n, colour)
        for i, n in enumerate((tilted[1], outward, tilted[0]))
    ]
    for height, ring, sense in ((-half, rings[0], -1.0), (half, rings[3], 1.0)):
        hub = np.broadcast_to(middle + height * normal, ring.shape)
        bands.append(_band(hub, ring, np.broadcast_to(sense * normal, ring.shape), colour))
    return joined(bands)
