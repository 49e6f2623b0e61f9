"""Motion of a robot before an instrument of lengths, which holds no angle of it.

The instrument is a massless ball-bar whose rod telescopes: its angles follow from the tool's pose,
and its rod is as long as tool and seat are apart.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError
from cell.geometry import BAR_ROWS, Geometry
from cell.instrument import Instrument
from cell.inverse import bar_angles
from sim.motion import Motion
from sim.path import ReferencePath
from sim.plant.deflection import deflect
from sim.plant.effects import PlantEffects

BRANCH = (True, True)  # b2 and b4 negative, as in the path files of this project


def run_free(
    robot: Robot, geometry: Geometry, effects: PlantEffects, path: ReferencePath
) -> Motion:
    """Motion of a rigid robot whose motors follow a path; nothing holds its tool."""
    q = effects.gear_outputs(path.q @ robot.joint_to_gear) @ robot.gear_to_joint
    b, stretch = bar_at(geometry, q, np.zeros(1))
    return Motion(
        t=path.t,
        q=q,
        shown=path.q,
        b=b,
        rod_stretch=stretch,
        rod_force=np.zeros(path.t.size),
        geometry=geometry,
    )


def bar_at(
    geometry: Geometry, q: Array, plate: Array, shift: Array | float = 0.0
) -> tuple[Array, Array]:
    """Angles (K, 5) [rad] of the bar, and elongation (K,) [m] of its rod beyond bd3.

    q : (K, J) [rad] joint angles. plate : (K,) or (1,) [rad] bending of the offset plate.
    shift : (K, 3) [m] of the tool, or 0.
    """
    n = len(q)
    ends = deflect(
        geometry,
        q,
        np.zeros((n, BAR_ROWS)),
        stretch=np.zeros(n),
        plate=np.broadcast_to(plate, n),
        base=np.zeros((n, 3)),
    )
    poses = np.zeros((n, 4, 4))
    tool = ends.tool.T + shift
    poses[:, :3, :3], poses[:, :3, 3] = ends.tool_rotation.transpose(2, 0, 1), tool
    b = np.unwrap(bar_angles(poses, geometry.origin, flipped=BRANCH), axis=0)
    distance = np.linalg.norm(tool - geometry.origin, axis=1)
    return b, np.asarray(distance - geometry["bd3"])


def check_stroke(instrument: Instrument, motion: Motion) -> None:
    """Raises InputError where the length that is read leaves the instrument's range."""
    read = instrument.nominal + motion.rod_stretch
    outside = np.maximum(instrument.lower - read, read - instrument.upper)
    k = int(outside.argmax())
    if outside[k] > 0.0:
        raise InputError(
            f"path: {instrument.name} leaves its range at t = {motion.t[k]:.2f} s: "
            f"{read[k] * 1e3:.3f} mm, outside {instrument.lower * 1e3:g}.."
            f"{instrument.upper * 1e3:g} mm. Shorten `rod` in the path file, take smaller errors "
            "of the robot, or an instrument of a longer stroke."
        )
