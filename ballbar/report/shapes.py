"""Shapes of robot, offset plate and ball-bar, each in the DH frame it moves with.

No maker's drawings: round bars, sized by the robot's reach and placed by the DH rows, so they meet
joint to joint for any robot. In frame i the axis of joint i is `(0, sin alpha_i, cos alpha_i)`
through `-(a_i, d_i sin alpha_i, d_i cos alpha_i)`, whatever the joint angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_chain
from ballbar.report.colours import STEEL, Colour

PAINT = (236, 106, 32)  # the orange of many industrial robots
DARK = (62, 65, 70)
CARBON = (116, 120, 128)  # brighter than carbon fibre, to stand out from the background
PLATE_BLUE = (70, 130, 200)
X, Y, Z = np.eye(3)
_WIDTH = 0.042  # of the sum of all DH lengths: radius of the first axis's housing
_TAPER = 0.55  # share of that radius by which the last link is thinner


@dataclass(frozen=True, eq=False)
class Bar:
    """A round bar between two points of a frame; capped with half spheres, or cut off square."""

    start: Array  # (3,) [m]
    end: Array  # (3,) [m]
    radius: float  # [m]; with half spheres it reaches so much further at both ends
    colour: Colour
    capped: bool = False

    @property
    def length(self) -> float:
        """[m] between the two points."""
        return float(np.linalg.norm(self.end - self.start))


Body = Sequence[Bar]  # what moves with one frame


def robot_bodies(chain: Chain, flange: Sequence[Bar] = ()) -> list[Body]:
    """Base in the robot's base frame, then link i in frame i.

    flange : replaces the last link, whose frame may be that of a tool.
    """
    width = _WIDTH * float(np.abs(chain.a).sum() + np.abs(chain.d).sum())
    foot = [
        Bar(np.zeros(3), 0.35 * width * Z, 2.1 * width, DARK),
        Bar(0.35 * width * Z, 1.1 * width * Z, 1.6 * width, PAINT),
    ]
    links = [_link(chain, row, width) for row in range(chain.rows)]
    return [foot, *links[:-1], flange or links[-1]]


def _link(chain: Chain, row: int, widest: float) -> Body:
    """The housing of a joint, and tubes along d and a of its row."""
    width = widest * (1.0 - _TAPER * row / (chain.rows - 1))
    axis = np.array([0.0, np.sin(chain.alpha[row]), np.cos(chain.alpha[row])])
    corner = -chain.a[row] * X
    joint = corner - chain.d[row] * axis
    half = 1.15 * width * axis
    if row == 0:  # it turns on the base, above which its tube begins
        joint = joint + np.clip(chain.d[0], -0.8 * width, 0.8 * width) * axis
    tubes = [
        Bar(begin, end, 0.8 * width, PAINT, capped=True)
        for begin, end in ((joint, corner), (corner, np.zeros(3)))
        if np.linalg.norm(end - begin) > 0.2 * width
    ]
    return [Bar(joint - half, joint + half, width, DARK), *tubes] if row else tubes


def plate_body(cell: Cell) -> Body:
    """Tool changer and offset plate, in the tool frame."""
    top = -0.45 * cell.plate.tool_offset * Z
    hub, thick = top - cell.plate.length * X, 0.012 * Z
    return [
        Bar(_mount(cell), hub + thick, 0.042, DARK),
        Bar(hub, top, 0.02, PLATE_BLUE, capped=True),
        Bar(hub - thick, hub + thick, 0.05, PLATE_BLUE),
        Bar(top - thick, top + thick, 0.03, PLATE_BLUE),
    ]


def _mount(cell: Cell) -> Array:
    """(3,) [m] middle of the flange's face, in the tool frame."""
    return np.asarray(-cell.plate.length * X - cell.plate.tool_offset * Z)


def bar_bodies(cell: Cell, geometry: Geometry) -> list[Body]:
    """Stand in the ball-bar's base frame, then link i of the ball-bar in its frame i.

    geometry : gives the height of the stand, which is a stub where the base is lower than its own
        part, and the length of the rod.
    """
    floor, foot = min(-float(geometry.origin[2]), -0.2) * Z, -float(geometry["bd3"]) * Y
    stand = [Bar(floor, floor + 0.02 * Z, 0.17, DARK), Bar(floor, -0.125 * Z, 0.06, DARK)]
    yoke = [Bar(-0.125 * Y, -0.06 * Y, 0.035, STEEL), *_fork(Z, Y, gap=0.055, depth=0.065)]
    hub = [Bar(-0.066 * Y, 0.066 * Y, 0.014, DARK), Bar(-0.04 * Y, 0.04 * Y, 0.032, PLATE_BLUE)]
    rod = [
        Bar(foot + 0.02 * Y, foot + 0.09 * Y, 0.024, STEEL),
        Bar(foot + 0.09 * Y, -0.09 * Y, 0.014, CARBON),
        Bar(-0.1 * Y, -0.048 * Y, 0.022, STEEL),
        *_fork(Z, Y, gap=0.036, depth=0.05),
    ]
    cross = [Bar(-0.044 * Y, 0.044 * Y, 0.011, DARK), Bar(-0.03 * Z, 0.018 * Z, 0.018, PLATE_BLUE)]
    shaft = [Bar(-0.42 * cell.plate.tool_offset * Z, -0.018 * Z, 0.022, STEEL)]
    return [stand, yoke, hub, rod, cross, shaft]


def _fork(axis: Array, along: Array, *, gap: float, depth: float) -> Body:
    """Two cheeks about `axis` that hold a pin, bridged `depth` below it, against `along`."""
    root, half = -depth * along, gap * axis
    cheeks = [Bar(root + side * half, side * half, 0.014, STEEL, capped=True) for side in (-1, 1)]
    return [*cheeks, Bar(root - half, root + half, 0.014, STEEL, capped=True)]


def cell_bodies(cell: Cell, geometry: Geometry) -> list[Body]:
    """Every body, in the order of `CellMotion.frames`; geometry : as of `bar_bodies`."""
    face, chain = _mount(cell), nominal_chain(cell.robot)
    flange = [Bar(face - max(cell.robot.d[-1], 0.02) * Z, face, 0.04, STEEL)]
    return [*robot_bodies(chain, flange), plate_body(cell), *bar_bodies(cell, geometry)]
