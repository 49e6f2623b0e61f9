"""Measured robots: public tables beside the project, where they are there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition.poses import read_poses
from cell.poses import PoseTable
from ident.poses.identify import PoseOptions, identify_poses
from ident.verdict import Status
from tests.helpers import real_robots

pytestmark = pytest.mark.skipif(
    not real_robots.DATA.is_dir(), reason=f"{real_robots.DATA.name}: measured robots are not there"
)


def random_split(table: PoseTable, count: int) -> tuple[PoseTable, PoseTable]:
    chosen = np.random.default_rng(0).permutation(table.size) < count
    return table.part(chosen), table.part(~chosen)


@pytest.mark.slow
def test_a_measured_ur5_is_predicted_where_it_was_not_fitted(tmp_path: Path) -> None:
    """0.056 mm in benchmarks/real_robots; 0.094 without the orders that are found."""
    fitted, judged = random_split(read_poses(real_robots.ur5_grid(tmp_path)), 600)
    result = identify_poses(fitted)
    error = np.linalg.norm(result.errors(judged), axis=1)
    assert result.verdict.status is Status.GOOD
    assert error.mean() < 0.058e-3
    assert 0.93 < result.within(judged).mean() < 0.98
    assert result.cross_validation.mean == pytest.approx(error.mean(), rel=0.1)
    assert result.search is not None
    assert {(0, 13), (0, 14), (1, 26)} & set(result.search.pairs)


@pytest.mark.long
def test_the_seventeen_cycles_of_a_measured_ur10_are_found(tmp_path: Path) -> None:
    """0.10 mm in benchmarks/real_robots; 0.38 without."""
    table = read_poses(real_robots.ur10_a(tmp_path))
    fitted, judged = random_split(table, 1500)
    result = identify_poses(fitted)
    assert np.linalg.norm(result.errors(judged), axis=1).mean() < 0.13e-3
    assert result.search is not None
    assert {(0, 17), (1, 17), (2, 17)} <= set(result.search.pairs)


@pytest.mark.slow
def test_a_measured_panda_is_identified_from_sockets_alone(tmp_path: Path) -> None:
    """8.5 mm with the catalogue's geometry: joint zeros are 13 and 14 mrad off."""
    result = identify_poses(
        read_poses(real_robots.panda(tmp_path, "panda_6")), PoseOptions(search=False)
    )
    assert result.verdict.acceptable
    assert result.residual_nominal.mean() > 5e-3
    assert result.cross_validation.mean < 0.25e-3
    assert any("rtheta3" in warning for warning in result.verdict.warnings)
