"""The MJCF files of sim/models: they open, keep the loop closed, and match the descriptions."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

from ballbar.cell.geometry import bar_frames, nominal_geometry, robot_frames
from ballbar.cell.load import load_cell
from ballbar.sim.plant.mjcf import BAR_JOINTS, ROBOT_JOINTS
from generators.model_files import MODELS, VIEWS, model_xml


def words(text: str) -> list[tuple[str, str, list[str]]]:
    return [
        (e.tag, key, value.split())
        for e in ET.fromstring(text).iter()
        for key, value in sorted(e.attrib.items())
    ]


@pytest.mark.parametrize("robot", list(VIEWS))
def test_the_file_is_the_one_that_the_descriptions_give(robot: str) -> None:
    kept, made = words((MODELS / f"{robot}.xml").read_text()), words(model_xml(robot))
    assert [(tag, key) for tag, key, _ in kept] == [(tag, key) for tag, key, _ in made], (
        "run: python -m generators.model_files"
    )
    for (tag, key, old), (_, _, new) in zip(kept, made, strict=True):
        try:
            same = np.allclose(
                np.array(old, dtype=float), np.array(new, dtype=float), rtol=1e-9, atol=1e-12
            )
        except ValueError:
            same = old == new
        assert same, (
            f"{tag} {key}: file {old}, descriptions {new}; run: python -m generators.model_files"
        )


@pytest.mark.parametrize("robot", list(VIEWS))
def test_the_file_opens_with_the_loop_closed_and_stands_still(robot: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(MODELS / f"{robot}.xml"))
    data = mujoco.MjData(model)
    start = data.qpos.copy()
    for _ in range(500):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    assert np.abs(data.qpos - start).max() < 1e-9
    assert np.linalg.norm(data.site("tool").xpos - data.site("bar_end").xpos) < 1e-9


@pytest.mark.parametrize("robot", list(VIEWS))
def test_joint_values_in_the_file_are_dh_angles(robot: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(MODELS / f"{robot}.xml"))
    model.site_sameframe[:] = 0
    data = mujoco.MjData(model)
    bar, position, _ = VIEWS[robot]
    geometry = nominal_geometry(load_cell(robot, bar, "plate_250"), np.array(position))
    rng = np.random.default_rng(2)
    q, b = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 5)
    for name, value in zip((*ROBOT_JOINTS[:6], *BAR_JOINTS), (*q, *b), strict=True):
        data.joint(name).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    assert np.abs(data.site("tool").xpos - robot_frames(geometry, q[None]).tip[:, 0]).max() < 1e-12
    assert np.abs(data.site("bar_end").xpos - bar_frames(geometry, b[None]).tip[:, 0]).max() < 1e-12
