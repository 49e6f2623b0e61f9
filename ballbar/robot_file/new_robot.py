"""A new robot: description file and picture, written only if they agree with their source.

The tip poses of both are compared at random joint angles, of the description as it is read back.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import FailureError, InputError
from ballbar.cell.files import write_new
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.robot_file.draft import RobotDraft
from ballbar.robot_file.picture import robot_picture
from ballbar.robot_file.text import description_text

POSES = 100
LARGEST = 1e-9  # [m, rad] allowed; rounding of the written decimals gives 1e-12
_SEED = 2
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


@dataclass(frozen=True, eq=False)
class NewRobot:
    """Description and picture that were written."""

    robot: Robot
    draft: RobotDraft
    position: float  # [m] largest difference of the tip poses to those of the source
    angle: float  # [rad]
    file: Path
    picture: Path


def target_file(name: str, out: Path | None) -> Path:
    """The file of a new robot: `out`, or NAME.yaml in the working directory.

    Raises InputError if the name cannot be one, the file does not end in .yaml, or it or the
    picture beside it exists.
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"name {name!r}: use letters, digits, _ and -, as in my_robot. A folder: with --out."
        )
    file = out or Path(f"{name}.yaml")
    if file.suffix != ".yaml":
        raise InputError(f"--out {file}: a robot's file ends in .yaml. Write {file}.yaml.")
    for path in (file, picture_of(file)):
        if path.exists():
            what = "exists already; nothing was written."
            raise InputError.at(path, what, "Name another file with --out.")
    return file


def picture_of(file: Path) -> Path:
    """The picture beside a description."""
    return file.with_suffix(".png")


def write_robot(draft: RobotDraft, file: Path) -> NewRobot:
    """Write description and picture of a draft.

    Raises FailureError, and writes nothing, if the description as it is read back differs from its
    source by more than LARGEST; DescriptionError if it is no description.
    """
    text = description_text(draft).encode()
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / f"{draft.name}.yaml"
        trial.write_bytes(text)
        robot = load_robot(str(trial))
    position, angle = difference(robot, draft)
    if max(position, angle) > LARGEST:
        raise FailureError(
            f"the description differs from its source by {position:.3g} m and {angle:.3g} rad at "
            f"{POSES} random poses, more than {LARGEST:g}. Nothing was written. Report this with "
            "the source: it is a fault of the conversion."
        )
    picture = robot_picture(robot)
    write_new(file, text)
    write_new(picture_of(file), picture)
    return NewRobot(robot, draft, position, angle, file, picture_of(file))


def difference(robot: Robot, draft: RobotDraft) -> tuple[float, float]:
    """[m] and [rad] by which a description, as it is read back, differs from its source."""
    axes = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (POSES, robot.joints))
    chain = nominal_chain(robot)
    flange = forward(chain, controller_to_joints(robot, axes)).poses()
    poses = draft.form.T_base_dh @ flange @ draft.form.T_flange_tip
    expected = draft.tip_poses(axes)
    shift = np.linalg.norm(poses[:, :3, 3] - expected[:, :3, 3], axis=1)
    turn = np.einsum("nik,njk->ijn", poses[:, :3, :3], expected[:, :3, :3])
    angle = np.linalg.norm(rotvec_from_matrix(turn), axis=0)
    return float(shift.max()), float(angle.max())
