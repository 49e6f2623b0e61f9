"""Still poses of three public data sets of real robots, which lie beside the project.

Prints what was read of each: python -m benchmarks.real_robots_tables
Sources, commits and licences: tests/helpers/real_robots.py.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from ballbar.acquisition.pose_tables import import_poses, read_poses
from ballbar.acquisition.report import finding_line
from ballbar.cell.poses import PoseTable
from tests.helpers import real_robots
from tests.helpers.real_robots import DATA, PANDA_SITES

Write = Callable[[Path, Path], Path]  # (new folder, data) -> poses.yaml


def ur5_grid(data: Path = DATA) -> PoseTable:
    """1000 poses of a UR5 on a grid, points of a laser tracker."""
    return _read(real_robots.ur5_grid, data)


def ur5_random(data: Path = DATA) -> PoseTable:
    """20 random poses of the same UR5."""
    return _read(real_robots.ur5_random, data)


def ur10_a(data: Path = DATA) -> PoseTable:
    """Series A of a UR10, July 2020: poses of a T-Mac."""
    return _read(real_robots.ur10_a, data)


def ur10_b(data: Path = DATA) -> PoseTable:
    """Series B of the same UR10, November 2020, with a measured sigma of each value."""
    return _read(real_robots.ur10_b, data)


def panda(data: Path = DATA, name: str = "panda_3", sites: tuple[str, ...] = ()) -> PoseTable:
    """A Franka Panda's ball in pairs of sockets; all sites if none is named."""
    return _read(lambda folder, data: real_robots.panda(folder, name, sites, data), data)


def _read(write: Write, data: Path) -> PoseTable:
    with TemporaryDirectory() as folder:
        return read_poses(write(Path(folder), data))


def main() -> None:
    """Prints rows, groups and findings of every set."""
    sets: dict[str, Write] = {
        "ur5_grid": real_robots.ur5_grid,
        "ur5_random": real_robots.ur5_random,
        "ur10_a": real_robots.ur10_a,
        "ur10_b": real_robots.ur10_b,
        **{
            name: lambda folder, data, name=name: real_robots.panda(folder, name, data=data)
            for name in PANDA_SITES
        },
    }
    for name, write in sets.items():
        with TemporaryDirectory() as folder:
            read = import_poses(write(Path(folder), DATA))
        print(f"{name}: {read.table.size} poses in {len(read.table.groups)} groups")
        for entry in read.report.findings:
            print("  ", finding_line(entry).removeprefix(str(DATA)))


if __name__ == "__main__":
    main()
