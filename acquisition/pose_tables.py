"""poses.yaml and its files to still poses: DH joint angles, values in SI units, and the findings.

    files -> lines -> columns -> numbers -> angles [rad], values [m, rad], sigma -> steady seats
    -> groups

A row with an empty field is left out and counted. What contradicts the robot or the declared units
is an error with file and line; what is merely odd is a finding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.acquisition.declared_columns import TableContext
from ballbar.acquisition.pictures import posed
from ballbar.acquisition.pose_rows import FilePoses, file_poses
from ballbar.acquisition.reference_points import steadied
from ballbar.acquisition.report import ImportReport
from ballbar.cell.descriptions import Expansion
from ballbar.cell.errors import DescriptionError
from ballbar.cell.foreign_files import repeated
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.pose_file import PosesFile, known_distances, load_poses_file, pose_file_path
from ballbar.cell.poses import PoseGroup, PoseTable
from ballbar.cell.recording import RecordingFile
from ballbar.cell.temperature import growth_at, temperature_of


@dataclass(frozen=True, eq=False)
class PoseImport:
    """Poses, read."""

    description: PosesFile | RecordingFile
    table: PoseTable
    report: ImportReport
    file: Path | None = None  # that describes them; None of poses that no file describes
    expansion: Expansion | None = None  # of the lengths that were measured with


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
    files, expansions = list[FilePoses](), list[Expansion | None]()
    for k, declared in enumerate(description.tables):
        own = declared.instrument
        measures = load_instrument(own, relative_to=file.parent) if own else instrument
        context = TableContext(file, robot, measures, f"tables[{k}]", declared)
        for key, paths in (("files", declared.files), ("joints.files", declared.joints.files)):
            if twice := repeated(file.parent, paths):
                names = f"{twice[0]!r} and {twice[1]!r}"
                raise context.wrong(key, f"{names} are one file. Name it once.")
        files += [file_poses(context, index) for index in range(len(declared.files))]
        expansions += [_expansion(measures, poses) for poses in files[len(expansions) :]]
    description = _with_temperature(description, files)
    warmth = temperature_of([description], robot=False)
    growths = [growth_at(warmth, expansion) for expansion in expansions]
    files = steadied(posed(robot, [_grown(*p) for p in zip(files, growths, strict=True)]))
    stamps = [poses.stamps for poses in files if poses.stamps is not None]
    start = min((int(each.min()) for each in stamps), default=0)
    groups = tuple(group for poses in files for group in _groups(poses, start))
    try:
        seats = (group.seat for group in groups)
        growth = growth_at(warmth, instrument.expansion)
        distances = known_distances(description.distances, instrument, seats, growth=growth)
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
    stated = next((each for each in expansions if each is not None and warmth), None)
    return PoseImport(description, table, report, file, stated)


def _expansion(instrument: Instrument, poses: FilePoses) -> Expansion | None:
    """Thermal expansion of the board of pictures, else of the instrument."""
    board = None if poses.corners is None else poses.corners.board.file.expansion
    return instrument.expansion if board is None else board.described()


def _with_temperature(description: PosesFile, files: Sequence[FilePoses]) -> PosesFile:
    """The description with the mean of a column of temperatures, where it states none itself."""
    columns = [file.group.temperature for file in files]
    known = [column for column in columns if column is not None]
    if description.temperature_C is not None or len(known) < len(columns):
        return description
    mean = float(np.concatenate(known).mean())
    return description.model_copy(update={"temperature_C": mean})


def _grown(poses: FilePoses, growth: tuple[float, float]) -> FilePoses:
    """Poses whose board, or whose lengths along rod or wire, are longer than stated by a share, and
    its standard uncertainty.
    """
    share, sigma = growth
    if poses.corners is not None:
        board = poses.corners.board.grown(share, sigma)
        return replace(poses, corners=replace(poses.corners, board=board))
    if poses.group.measured == "length":
        values = (1.0 + share) * poses.group.values
        return replace(poses, group=replace(poses.group, values=values))
    return poses


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
