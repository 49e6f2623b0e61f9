"""poses.yaml and its files to still poses: DH joint angles, values in SI units, and the findings.

    files -> lines -> columns -> numbers -> angles [rad], values [m, rad], sigma -> steady seats
    -> groups

A row with an empty field is left out and counted. What contradicts the robot or the declared units
is an error with file and line; what is merely odd is a finding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.acquisition.declared_columns import TableContext
from ballbar.acquisition.pictures import posed
from ballbar.acquisition.pose_rows import FilePoses, file_poses
from ballbar.acquisition.reference_points import steadied
from ballbar.acquisition.report import ImportReport
from ballbar.cell.errors import DescriptionError
from ballbar.cell.foreign_files import repeated
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.pose_file import PosesFile, known_distances, load_poses_file, pose_file_path
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.recording import RecordingFile


@dataclass(frozen=True, eq=False)
class PoseImport:
    """Poses, read."""

    description: PosesFile | RecordingFile
    table: PoseTable
    report: ImportReport
    file: Path | None = None  # that describes them; None of poses that no file describes


def read_poses(path: Path) -> PoseTable:
    """The still poses that a poses.yaml describes.

    path : the file, or the folder that holds it.
    Raises DescriptionError if poses.yaml is wrong, LogError if a file of it cannot be trusted.
    """
    return import_poses(path).table


def import_poses(path: Path) -> PoseImport:
    """The still poses of a poses.yaml with the import report; raises as `read_poses`."""
    file = pose_file_path(path)
    description = load_poses_file(file)
    robot = load_robot(description.robot, relative_to=file.parent)
    instrument = load_instrument(description.instrument, relative_to=file.parent)
    files = list[FilePoses]()
    for k, declared in enumerate(description.tables):
        own = declared.instrument
        measures = load_instrument(own, relative_to=file.parent) if own else instrument
        context = TableContext(file, robot, measures, f"tables[{k}]", declared)
        for key, paths in (("files", declared.files), ("joints.files", declared.joints.files)):
            if twice := repeated(file.parent, paths):
                names = f"{twice[0]!r} and {twice[1]!r}"
                raise context.wrong(key, f"{names} are one file. Name it once.")
        files += [file_poses(context, index) for index in range(len(declared.files))]
    files = steadied(posed(robot, files))
    stamps = [poses.stamps for poses in files if poses.stamps is not None]
    start = min((int(each.min()) for each in stamps), default=0)
    groups = tuple(group for poses in files for group in _groups(poses, start))
    try:
        seats = (group.seat for group in groups)
        distances = known_distances(description.distances, instrument, seats)
    except DescriptionError as error:
        raise DescriptionError(f"{file}: {error}") from None
    table = PoseTable(
        name=file.absolute().parent.name if file.name == "poses.yaml" else file.stem,
        robot=robot,
        groups=groups,
        distances=distances,
    )
    report = ImportReport(
        files=tuple(summary for poses in files for summary in poses.summaries),
        # Each once: a file that several tables read has them in each.
        findings=tuple(dict.fromkeys(entry for poses in files for entry in poses.findings)),
    )
    return PoseImport(description, table, report, file)


def _groups(poses: FilePoses, start: int) -> Iterator[PoseGroup]:
    """The groups of one file, in the order in which seats and targets first occur.

    start : [ns] earliest stamp of all files.
    """
    pairs = list(zip(poses.seat, poses.target, strict=True))
    group = poses.group
    if poses.stamps is not None:
        group = replace(group, time=np.asarray((poses.stamps - start) * 1e-9, dtype=np.float64))
    for seat, target in dict.fromkeys(pairs):
        chosen = np.array([pair == (seat, target) for pair in pairs], dtype=bool)
        yield replace(group.part(chosen), seat=seat, target=target)
