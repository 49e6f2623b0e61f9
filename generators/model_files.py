"""The nominal cells as MJCF files for MuJoCo's viewer: sim/models/irb2400.xml and nj220.xml.

    python -m generators.model_files        writes them again
    python -m mujoco.viewer --mjcf sim/models/irb2400.xml

The files hold the plant's kinematics, masses and loop closure, with shapes to look at. For a
viewer, springs instead of servos hold the joints near a closed pose, weights are balanced, and the
weld is soft enough to be pulled at with the mouse. Joint values are DH angles: the bodies stand in
the closed pose, whose angles are `ref`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import robot_branches
from ballbar.cell.descriptions import Cell
from ballbar.cell.files import write_whole
from ballbar.cell.geometry import bar_frames, nominal_geometry
from ballbar.cell.load import load_cell
from ballbar.sim.plant.effects import Plant, PlantEffects
from ballbar.sim.plant.mjcf import BAR_JOINTS, ROBOT_JOINTS, ROD_JOINT, plant_spec

MODELS = Path(__file__).parents[1] / "sim" / "models"
# Of each robot: ball-bar, its position [m], and a pose in the middle of the path as ball-bar
# angles [rad].
VIEWS = {
    "irb2400": ("lund_600", (0.70, 0.0, 0.54), (-0.4, -0.95, 0.36, -2.26, 2.4)),
    "nj220": ("lund_900", (1.50, 0.0, 0.70), (-0.4, -0.80, 0.36, -2.26, 2.4)),
}
_HOLD = 0.02  # of the servo stiffness: springs that a mouse can overcome
_TIMESTEP = 2e-3  # [s]
_ORANGE, _STEEL, _CARBON, _GLASS = (
    (0.93, 0.45, 0.13, 1),
    (0.7, 0.72, 0.75, 1),
    (0.15, 0.15, 0.17, 1),
    (0.3, 0.55, 0.9, 0.08),
)
_LINK_RADIUS = {
    "irb2400": (0.16, 0.10, 0.11, 0.075, 0.055, 0.045),
    "nj220": (0.28, 0.19, 0.20, 0.14, 0.11, 0.09),
}  # [m] to look at


def model_xml(robot: str) -> str:
    """The MJCF text of one nominal cell, numbers at full precision."""
    bar, position, pose = VIEWS[robot]
    cell = load_cell(robot, bar, "plate_250")
    geometry = nominal_geometry(cell, np.array(position))
    b = np.array(pose)
    q = robot_branches(geometry.robot, bar_frames(geometry, b[None]).poses())[0, 0]
    plant = Plant(cell, geometry, PlantEffects(), cell.robot.required("servo")["soft"])
    spec = plant_spec(plant, timestep=_TIMESTEP)
    _hold_at(spec, cell, q, b)
    _add_shapes(spec, cell)
    spec.compile()
    return _with_full_precision(spec)


def _hold_at(spec: mujoco.MjSpec, cell: Cell, q: Array, b: Array) -> None:
    for element in (*spec.actuators, *spec.tendons):
        spec.delete(element)
    stiffness = np.concatenate((_HOLD * cell.robot.required("servo")["soft"].kp, np.zeros(5)))
    for name, angle, spring in zip(
        (*ROBOT_JOINTS[: q.size], *BAR_JOINTS), np.concatenate((q, b)), stiffness, strict=True
    ):
        joint = spec.joint(name)
        body = joint.parent
        body.quat = _turned(np.array(body.quat), float(angle))
        joint.ref, joint.springref = float(angle), float(angle)
        joint.stiffness[0] = float(spring)
        # half a second to settle
        joint.damping[0] = max(float(joint.damping[0]), float(spring) * 0.5)
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    spec.equalities[0].solref = (2.0 * _TIMESTEP, 1.0)
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def _turned(quat: Array, angle: float) -> Array:
    out = np.zeros(4)
    mujoco.mju_mulQuat(out, quat, np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)]))
    return out


def _add_shapes(spec: mujoco.MjSpec, cell: Cell) -> None:
    world = spec.worldbody
    world.add_light(pos=[1.5, -2.0, 3.5], dir=[-0.3, 0.5, -1.0])
    world.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[3, 3, 0.1], rgba=[0.92, 0.93, 0.94, 1]
    )
    radii = _LINK_RADIUS[cell.robot.name]
    names = [*(f"link{i + 1}" for i in range(6))]
    for name, child, radius in zip(names[:-1], names[1:], radii, strict=False):
        end = np.array(spec.body(child).pos)
        _capsule(spec.body(name), np.zeros(3), end, radius, _ORANGE)
    _capsule(
        world, np.zeros(3), np.array([0.0, 0.0, 0.6 * cell.robot.d[0]]), radii[0] * 1.2, _ORANGE
    )
    plate = cell.plate
    middle = np.array([0.5 * plate.length, 0.0, 0.5 * plate.tool_offset])
    spec.body("link6").add_geom(
        name="plate",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=middle,
        size=[0.5 * plate.length + 0.05, 0.05, 0.0225],
        rgba=_STEEL,
    )
    _capsule(
        spec.body("bar3"), np.zeros(3), np.array([0.0, 0.0, cell.ballbar.length]), 0.012, _CARBON
    )
    _ball(spec.body("bar1"), 0.035, _STEEL)
    _ball(spec.body("bar4"), 0.03, _STEEL)
    _ball(spec.body("bar1"), cell.ballbar.length, _GLASS)


def _capsule(
    body: mujoco.MjsBody, start: Array, end: Array, radius: float, colour: tuple[float, ...]
) -> None:
    if np.linalg.norm(end - start) < 1e-3:
        _ball(body, radius, colour)
    else:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            size=[radius, 0, 0],
            rgba=colour,
        )


def _ball(body: mujoco.MjsBody, radius: float, colour: tuple[float, ...]) -> None:
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], rgba=colour)


def _with_full_precision(spec: mujoco.MjSpec) -> str:
    """XML of a model with poses and angles in full; MuJoCo writes six digits, 1 urad of error."""
    root = ET.fromstring(spec.to_xml())
    for element in root.iter("body"):
        body = spec.body(element.get("name", ""))
        element.set("pos", _numbers(body.pos))
        element.set("quat", _numbers(body.quat))
    for element in root.iter("site"):
        site = spec.site(element.get("name", ""))
        element.set("pos", _numbers(site.pos))
        element.set("quat", _numbers(site.quat))
    for element in root.iter("joint"):
        joint = spec.joint(element.get("name", ""))
        if joint.name != ROD_JOINT:
            element.set("ref", _numbers([joint.ref]))
            element.set("springref", _numbers([joint.springref]))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _numbers(values: Array | list[float]) -> str:
    return " ".join(repr(round(float(v), 15) + 0.0) for v in values)


def main() -> None:
    """Writes the files of all robots."""
    for robot in VIEWS:
        write_whole(MODELS / f"{robot}.xml", model_xml(robot).encode())


if __name__ == "__main__":
    main()
