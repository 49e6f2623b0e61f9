"""Three public data sets of real robots are read as they are; skipped where they do not lie."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import PoseImport, import_poses
from tests.helpers import real_robots

pytestmark = pytest.mark.skipif(
    not real_robots.DATA.is_dir(), reason=f"{real_robots.DATA}: no data of real robots"
)


def findings(read: PoseImport) -> dict[str, int]:
    return {entry.kind: entry.count for entry in read.report.findings}


@pytest.mark.parametrize(
    ("write", "count"), [(real_robots.ur5_grid, 1000), (real_robots.ur5_random, 20)]
)
def test_the_ur5_of_the_laser_tracker(
    tmp_path: Path, write: Callable[[Path], Path], count: int
) -> None:
    read = import_poses(write(tmp_path))
    (group,) = read.table.groups
    assert (group.size, group.measured) == (count, "point")
    # The target less the difference, first row of the grid by pencil.
    if count == 1000:
        by_pencil = np.array([-430.32784075885013 + 2.144122241149887, -6.2740647628546]) * 1e-3
        np.testing.assert_allclose(group.values[0, 0], by_pencil[0], atol=1e-15)
    assert np.ptp(group.values, axis=0).max() < 1.2  # [m] an arm of 0.85 m in front of it
    np.testing.assert_allclose(np.rad2deg(np.abs(group.q)).max(), 180.0, atol=90.0)
    assert findings(read) == {}


def test_the_ur10_of_july_has_times_and_one_cut_line(tmp_path: Path) -> None:
    read = import_poses(real_robots.ur10_a(tmp_path))
    (group,) = read.table.groups
    assert group.size == 11_910
    assert findings(read) == {
        "unterminated last line": 1,
        "decimal comma": 11_910,
        "repeated pose": 1,
    }
    assert group.time is not None
    np.testing.assert_allclose(group.time[:4], [0.0, 20.0, 29.0, 36.0])
    assert group.temperature is not None
    assert 20.0 < group.temperature.min() < group.temperature.max() < 30.0  # [deg C]
    np.testing.assert_allclose(group.values[0, :3], [2.3619831, -1.3685474, 0.11939713])
    assert np.isin(group.rows, np.arange(2, 11_912)).all()


def test_the_ur10_of_november_has_a_sigma_of_each_value(tmp_path: Path) -> None:
    read = import_poses(real_robots.ur10_b(tmp_path))
    (group,) = read.table.groups
    assert (group.size, group.measured) == (1495, "pose")
    assert findings(read)["time not used"] == 1495
    # 255 poses occur twice; some of them a third time within the repeatability.
    assert 255 <= findings(read)["repeated pose"] <= 300
    np.testing.assert_allclose(group.sigma[0, :3], [3.1674e-5, 1.3252e-5, 3.7622e-6])
    assert group.time is None


@pytest.mark.parametrize(("name", "groups", "poses"), [("panda_3", 12, 387), ("panda_6", 6, 199)])
def test_the_pandas_in_pairs_of_sockets(tmp_path: Path, name: str, groups: int, poses: int) -> None:
    read = import_poses(real_robots.panda(tmp_path, name))
    assert (len(read.table.groups), read.table.size) == (groups, poses)
    assert read.table.q.shape == (poses, 7)
    assert {(d.length, d.sigma) for d in read.table.distances} == {(0.05, 2e-4)}
    first = real_robots.PANDA_SITES[name][0]
    assert read.table.distances[0].seats == (f"{first}/hole_0", f"{first}/hole_1")
    assert findings(read) == {}
    part = import_poses(real_robots.panda(tmp_path / "part", name, [first]))
    assert part.table.seats == (f"{first}/hole_0", f"{first}/hole_1")
