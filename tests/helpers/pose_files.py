"""Tables of still poses of a UR5 as files, with a poses.yaml beside them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError, LogError
from ballbar.cell.load import load_robot
from ballbar.cell.rigid_fit import nominal_frames

ROBOT = load_robot("ur5")
POSES = 40
Q = np.random.default_rng(5).uniform(-2.0, 2.0, (POSES, 6))  # (N, 6) [rad]
_FRAMES = nominal_frames(ROBOT, Q)
_TOOL = np.array([0.02, -0.03, 0.1])  # [m] reflector in the flange's frame
_TURN = Rotation.from_rotvec([0.3, -0.2, 1.1])  # tracker's frame
_FLANGE = _FRAMES.rotation().transpose(2, 0, 1)  # (N, 3, 3)
POINTS = _TURN.apply(_FRAMES.tip.T + _FLANGE @ _TOOL) + np.array([2.0, 1.0, 0.0])  # (N, 3) [m]
ROTATIONS = _TURN * Rotation.from_matrix(_FLANGE) * Rotation.from_rotvec([1.0, 0.4, -0.7])
LENGTHS = np.linalg.norm(POINTS - [1.5, 0.8, -0.4], axis=1)[:, None]  # (N, 1) [m]
JOINTS = [f"q{k}" for k in range(1, 7)]
NAMES = [*JOINTS, "x", "y", "z"]
TABLE = {
    "files": ["poses.csv"],
    "joints": {"columns": JOINTS, "unit": "deg"},
    "values": {"columns": ["x", "y", "z"], "unit": "mm"},
}


def refused(folder: Path, error: type[InputError] = LogError) -> str:
    """The sentence with which the poses of a folder are refused."""
    with pytest.raises(error) as caught:
        read_poses(folder)
    return str(caught.value).replace(str(folder), "FOLDER")


def columns(*, angle: float = 180.0 / np.pi, length: float = 1000.0) -> Array:
    """(N, 9) joint angles [deg] and points [mm], or in other units per rad and m."""
    return np.hstack((Q * angle, POINTS * length))


def lines(
    numbers: Array, names: Sequence[str] = NAMES, separator: str = ",", comma: bool = False
) -> list[str]:
    """Lines of a table; no header if there are no names."""
    rows = [separator.join(f"{value:.9f}" for value in row) for row in numbers.tolist()]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    return [separator.join(names), *rows] if names else rows


def write(
    folder: Path,
    table: str | bytes | Sequence[str] | None = None,
    change: Callable[[dict[str, Any]], None] | None = None,
    *,
    robot: str = "ur5",
    measured_by: str = "tracker_point",
    **keys: Any,
) -> Path:
    """A folder with poses.yaml and poses.csv; keys : of the table instead of those of TABLE.

    change : applied to the whole description at last. measured_by : the instrument of the file.
    """
    content = lines(columns()) if table is None else table
    if isinstance(content, Sequence) and not isinstance(content, str | bytes):
        content = "\n".join(content) + "\n"
    folder.mkdir(parents=True, exist_ok=True)
    raw = content if isinstance(content, bytes) else content.encode()
    (folder / "poses.csv").write_bytes(raw)
    described = {key: value for key, value in {**TABLE, **keys}.items() if value is not None}
    description: dict[str, Any] = {
        "schema": "ballbar-poses/1",
        "kind": "real",
        "robot": robot,
        "instrument": measured_by,
        "tables": [described],
    }
    if change is not None:
        change(description)
    plain = json.loads(json.dumps(description))  # without parts that stand twice, as YAML aliases
    (folder / "poses.yaml").write_text(yaml.safe_dump(plain, sort_keys=False))
    return folder
