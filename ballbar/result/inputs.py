"""Folders of logs and tables of still poses that one identification is given."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from acquisition.pose_tables import PoseImport
from cell.errors import InputError
from cell.foreign_text import printable
from cell.poses import KnownDistance, PoseGroup, PoseTable


def holds_poses(path: Path) -> bool:
    """Whether a folder or file is a table of still poses rather than a recording.

    Raises InputError for a folder that holds both.
    """
    if not path.is_dir():
        return path.suffix == ".yaml" and path.name != "recording.yaml"
    poses = (path / "poses.yaml").exists()
    if poses and (path / "recording.yaml").exists():
        raise InputError(
            f"{path}: holds poses.yaml and recording.yaml. Name {path / 'poses.yaml'}, or move the "
            "recording into a folder of its own."
        )
    return poses


def distinct_names(folders: Sequence[Path]) -> list[str]:
    """Each folder's last part, or as many parts from the end as tell it from the others, printable.

    Raises InputError when one of them is given twice.
    """
    whole = [folder.resolve() for folder in folders]
    if twice := [str(folders[i]) for i, path in enumerate(whole) if path in whole[:i]]:
        raise InputError(
            f"{twice[0]}: given twice. A recording counts once, and what was fitted proves nothing "
            "as held out."
        )
    names = [""] * len(whole)
    for parts in range(1, max(len(path.parts) for path in whole) + 1):
        tails = [printable("/".join(path.parts[-parts:]), allowed="") for path in whole]
        count = Counter(tails)
        names = [
            name or (tail if count[tail] == 1 else "")
            for name, tail in zip(names, tails, strict=True)
        ]
    return names


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


def check_one_robot(folders: Sequence[Path], read: Sequence[PoseImport]) -> None:
    """Raises InputError where tables are of unlike robots."""
    first = read[0].table.robot
    for folder, content in zip(folders[1:], read[1:], strict=True):
        if content.table.robot.title != first.title:
            raise InputError(
                f"{folder}: is of robot {content.table.robot.title}, {folders[0]} of {first.title}"
                ". Tables that belong together must be of one robot."
            )
