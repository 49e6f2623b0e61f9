"""Tables of still poses to joint angles and measured values in SI units."""

from acquisition.poses.reading import PoseImport as PoseImport
from acquisition.poses.reading import import_poses as import_poses
from acquisition.poses.reading import read_poses as read_poses
