"""Seats and targets of still poses: of a camera, the hand-eye transform and where its board is."""

from __future__ import annotations

import numpy as np
import yaml

from ballbar.cell.errors import InputError
from ballbar.cell.rotation import quat_wxyz
from ballbar.export.result import Result, noted_text
from ballbar.result.recording_entries import PlacementEntry


def hand_eye(result: Result) -> str:
    """YAML: pose of each target in the flange's frame and of each seat in the robot's base frame.

    Raises InputError for a result of logs, which has neither.
    """
    file = result.calibration.file
    if result.calibration.of_logs:
        raise InputError("hand-eye needs a result of still poses, such as of a camera.")
    content = {
        "flange": {name: _place(entry) for name, entry in file.targets.items()},
        "base": {name: _place(entry) for name, entry in file.seats.items()},
    }
    text = yaml.safe_dump(content, sort_keys=False, width=1000)
    head = [
        "Poses of what stands on the flange, in its frame, and of what stands in the cell, in the",
        "robot's base frame: a camera's z along its optical axis and x along u; a board's x along",
        "a row. Quaternion x, y, z, w; sigma: standard deviation along and about each axis.",
    ]
    return noted_text(result, "#", head, text.splitlines())


def _place(entry: PlacementEntry) -> dict[str, object]:
    place = entry.placement
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = place.rotation, place.origin
    out: dict[str, object] = {
        "xyz_m": place.origin.tolist(),
        "sigma_xyz_m": list(entry.position_sigma_m),
    }
    if entry.turned:
        w, *xyz = quat_wxyz(place.rotation).tolist()
        out["quaternion_xyzw"] = [*xyz, w]
        if entry.rotation_sigma_rad is not None:
            out["sigma_rotation_rad"] = list(entry.rotation_sigma_rad)
        out["matrix"] = matrix.tolist()
    return out
