"""Folders of still poses to an identified robot: one, or several in one fit, and held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from acquisition.pose_tables import PoseImport, import_poses
from ballbar.result.inputs import check_one_robot, distinct_names, holds_poses, joined
from cell.errors import InputError
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
            f"{logs[0]}: holds no poses.yaml. A robot that was identified from still poses alone "
            "is tried on still poses; name the recording among those that are fitted."
        )
    names = distinct_names(every)
    progress("reading the poses")
    read = [import_poses(folder) for folder in every]
    check_one_robot(every, read)
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
