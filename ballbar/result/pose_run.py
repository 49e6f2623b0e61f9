"""Folders of still poses to an identified robot: one, or several in one fit, and held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from acquisition.pose_tables import PoseImport, import_poses
from ballbar.result.run_recordings import distinct_names
from cell.errors import InputError
from cell.pose_file import pose_file_path
from cell.poses import KnownDistance, PoseGroup, PoseTable
from ident.held_out_poses import PoseHeldOut, held_out_poses
from ident.identify_poses import PoseOptions, Progress, identify_poses
from ident.pose_result import PoseIdentification


@dataclass(frozen=True, eq=False)
class PoseRun:
    """An identification from still poses, with what was read."""

    name: str
    folders: tuple[tuple[str, Path, PoseImport], ...]  # name, folder and content, as fitted
    identification: PoseIdentification
    held_out: tuple[tuple[Path, PoseImport, PoseHeldOut], ...] = ()

    @property
    def acceptable(self) -> bool:
        """Whether verdict and held-out tables are acceptable."""
        explained = all(outcome.acceptable for _, _, outcome in self.held_out)
        return self.identification.verdict.acceptable and explained


def holds_poses(folder: Path) -> bool:
    """Whether a path is a table of still poses: a poses.yaml, or a folder that holds one."""
    return pose_file_path(folder).is_file()


def identify_pose_folders(
    folders: Sequence[Path],
    validate: Sequence[Path] = (),
    *,
    options: PoseOptions = PoseOptions(),  # noqa: B008  frozen
    progress: Progress = lambda _: None,
) -> PoseRun:
    """One robot from one or several tables of still poses, tried on the held-out ones.

    Raises InputError for bad files, for tables of unlike robots and for logs among them.
    """
    every = [*folders, *validate]
    if logs := [folder for folder in every if not holds_poses(folder)]:
        raise InputError(
            f"{logs[0]}: holds no poses.yaml. Still poses and logs of a moving robot cannot be "
            "identified together; identify each by itself and compare the results."
        )
    names = distinct_names(every)
    progress("reading the poses")
    read = [import_poses(folder) for folder in every]
    _check_one_robot(every, read)
    count = len(folders)
    fitted = tuple(zip(names[:count], folders, read[:count], strict=True))
    result = identify_poses(joined(fitted), options, progress)
    held = []
    for name, folder, content in zip(names[count:], validate, read[count:], strict=True):
        table = replace(content.table, name=name)
        held.append((folder, content, held_out_poses(result, table)))
    elsewhere = any(outcome.elsewhere and outcome.acceptable for _, _, outcome in held)
    result = replace(result, elsewhere=elsewhere)
    return PoseRun(" + ".join(names[:count]), fitted, result, tuple(held))


def joined(tables: Sequence[tuple[str, Path, PoseImport]]) -> PoseTable:
    """Several tables as one: each has seats of its own, targets of one name are one target."""
    if len(tables) == 1:
        name, _, content = tables[0]
        return replace(content.table, name=name)
    groups: list[PoseGroup] = []
    distances: list[KnownDistance] = []
    for name, _, content in tables:
        groups += [replace(g, seat=f"{name}/{g.seat}") for g in content.table.groups]
        distances += [
            replace(d, seats=(f"{name}/{d.seats[0]}", f"{name}/{d.seats[1]}"))
            for d in content.table.distances
        ]
    return PoseTable(
        " + ".join(name for name, _, _ in tables),
        tables[0][2].table.robot,
        tuple(groups),
        tuple(distances),
    )


def _check_one_robot(folders: Sequence[Path], read: Sequence[PoseImport]) -> None:
    first = read[0].table.robot
    for folder, content in zip(folders[1:], read[1:], strict=True):
        if content.table.robot.title != first.title:
            raise InputError(
                f"{folder}: is of robot {content.table.robot.title}, {folders[0]} of {first.title}"
                ". Tables that belong together must be of one robot."
            )
