"""A robot in the rerun viewer: its DH rows and frames, each axis moving through its range once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.robot_file.picture import bent_pose, corners, frames_at

APPLICATION, TIMELINE = "ballbar robot", "time"
_STEPS, _STEP = 40, 0.05  # of one axis; [s]
_RADIUS, _AXIS_LENGTH = 0.008, 0.1  # of the robot's reach
_STEEL = (120, 128, 142)
_AXES = ((200, 60, 60), (60, 160, 90), (60, 110, 200))  # x, y, z


def write_view(robot: Robot, path: Path) -> None:
    """Write the view of a robot as an .rrd file."""
    with rr.RecordingStream(APPLICATION, recording_id=robot.name) as stream:
        stream.save(path)
        stream.send_recording_name(robot.title)
        stream.log("robot", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
        for step, axes in enumerate(_motion(robot)):
            stream.set_time(TIMELINE, duration=step * _STEP)
            frames = frames_at(robot, axes)
            line = [corners(robot, frames)]
            shape = rr.LineStrips3D(line, radii=_RADIUS * reach, colors=[_STEEL])
            stream.log("robot/rows", shape)
            directions = np.stack((frames.x, frames.y, frames.z), axis=1)[:, :, :, 0]
            arrows = rr.Arrows3D(
                origins=np.repeat(frames.origin[:, :, 0], 3, axis=0),
                vectors=_AXIS_LENGTH * reach * directions.reshape(-1, 3),
                colors=_AXES * (robot.joints + 1),
                radii=0.3 * _RADIUS * reach,
            )
            stream.log("robot/frames", arrows)


def _motion(robot: Robot) -> Array:
    """(N, J) [rad] from zero each axis to its bent pose and back, one after the other."""
    bent, share = bent_pose(robot), np.sin(np.linspace(0.0, np.pi, _STEPS))
    return np.concatenate(
        [share[:, None] * bent * (np.arange(robot.joints) == i) for i in range(robot.joints)]
    )
