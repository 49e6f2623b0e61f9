"""Joint offsets alone and hand-eye transforms, as other programs read them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ballbar.cell.errors import InputError
from ballbar.cell.files import write_yaml
from ballbar.export.hand_eye import hand_eye
from ballbar.export.joint_offsets import joint_offsets, offsets_into
from ballbar.export.result import Result, load_result
from tests.helpers.pose_results import write_pose_result

ARMS = ["so101", "ur5e", "panda"]
AXES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


def result_of(folder: Path, robot: str, *, zeros: float = 0.0) -> Result:
    """A result with errors of 1 mrad, or of zeros alone [rad], alternating, from joint 2 on."""
    file = write_pose_result(folder / "calibration.yaml", robot, seed=3)
    if zeros:
        data = yaml.safe_load(file.read_text())
        data["corrections"], data["orders"] = {}, []
        for name, entry in data["parameters"].items():
            row = int(name[-1])
            sign = zeros * (-1.0) ** row if name.startswith("rtheta") else 0.0
            entry["value"] = entry["nominal"] + sign
        write_yaml(file, data)
    return load_result(file)


@pytest.mark.parametrize("robot", ARMS)
def test_offsets_of_a_robot_that_has_nothing_else_are_its_zeros(robot: str, tmp_path: Path) -> None:
    result = result_of(tmp_path, robot, zeros=0.05)
    offsets, joints = joint_offsets(result), result.robot.joints
    expected = np.array([0.0, *(0.05 * (-1.0) ** row for row in range(2, joints)), 0.0])
    np.testing.assert_allclose(offsets.axes, expected @ result.robot.joint_to_axis, atol=1e-6)
    assert offsets.nominal > 1e-3
    assert offsets.left < 1e-6


@pytest.mark.parametrize("robot", ARMS)
def test_offsets_leave_what_they_cannot_correct_and_say_so(robot: str, tmp_path: Path) -> None:
    offsets = joint_offsets(result_of(tmp_path, robot))
    assert 1e-5 < offsets.left < offsets.nominal
    assert f"{offsets.left * 1e3:.3f} mm in place of" in offsets.sentence


def lerobot(folder: Path, **changes: int) -> Path:
    motors = {
        name: {"id": k + 1, "drive_mode": 0, "homing_offset": 100 * k, "range_min": 800,
               "range_max": 3200} | changes
        for k, name in enumerate(AXES)
    }  # fmt: skip
    file = folder / "arm.json"
    file.write_text(json.dumps(motors))
    return file


def degrees(motor: dict[str, int], actual: int) -> float:
    """Angle that LeRobot shows at a motor's actual position: sense of motors_bus.py."""
    present = actual - motor["homing_offset"]
    return (present - (motor["range_min"] + motor["range_max"]) / 2) * 360 / 4095


def test_lerobot_shows_angles_with_the_offsets(tmp_path: Path) -> None:
    result, file = result_of(tmp_path, "so101", zeros=0.05), lerobot(tmp_path)
    content, lines = offsets_into(result, file, [])
    old, new = json.loads(file.read_text()), json.loads(content)
    for name, angle in zip(AXES, [*joint_offsets(result).axes, 0.0], strict=True):
        change = degrees(new[name], 2000) - degrees(old[name], 2000)
        assert change == pytest.approx(np.rad2deg(angle), abs=0.05)  # half a tick
        assert old[name]["range_min"] <= new[name]["range_min"] < new[name]["range_max"]
    assert "TCP error" in lines[0]


def test_offsets_of_robot_calibration_add_up(tmp_path: Path) -> None:
    result, file = result_of(tmp_path, "panda", zeros=0.02), tmp_path / "offsets.yaml"
    names = [f"panda_joint{k}" for k in range(1, 8)]
    file.write_text("head_camera_x: 0.01\n" + "".join(f"{name}: 0.001\n" for name in names))
    content, _ = offsets_into(result, file, names)
    read = dict(line.split(": ") for line in content.decode().splitlines())
    assert read["head_camera_x"] == "0.01"
    np.testing.assert_allclose(
        [float(read[name]) for name in names], joint_offsets(result).axes + 0.001, atol=1e-12
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [("[", "not JSON"), ('{"a": 1}', "not a calibration of LeRobot"), ("{}", "name the 5 axes")],
)
def test_another_file_is_refused(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "arm.json"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        offsets_into(result_of(tmp_path, "so101"), file, [])


def test_an_offset_that_a_motor_does_not_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Mount its horn again"):
        offsets_into(
            result_of(tmp_path, "so101", zeros=0.05), lerobot(tmp_path, homing_offset=2040), []
        )


def test_hand_eye_is_the_pose_of_the_target_on_the_flange(tmp_path: Path) -> None:
    text = hand_eye(result_of(tmp_path, "ur5e"))
    read = yaml.safe_load(text)
    frame = read["flange"]["frame"]
    turn = Rotation.from_rotvec([0.3, -0.2, 0.1])
    np.testing.assert_allclose(np.array(frame["matrix"])[:3, :3], turn.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(frame["quaternion_xyzw"], turn.as_quat(), atol=1e-12)
    assert frame["sigma_xyz_m"] == [1e-5, 1e-5, 1e-5]
    assert "matrix" not in read["flange"]["big ball"]
    assert "tracker" in read["base"]


def test_an_offset_that_is_no_number_is_named_with_what_stands_there(tmp_path: Path) -> None:
    result, file = result_of(tmp_path, "panda", zeros=0.02), tmp_path / "offsets.yaml"
    file.write_text("".join(f"j{k}: {'zero' if k == 3 else 0.0}\n" for k in range(1, 8)))
    with pytest.raises(InputError, match=r"j3: expected an offset, found zero\."):
        offsets_into(result, file, [])
