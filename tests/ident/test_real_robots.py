"""Measured robots: public tables beside the project, where they are there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.poses import PoseTable
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.ident.options import FitOptions
from ballbar.ident.table_fit import fit_table
from ballbar.ident.verdict import Status
from tests.helpers import real_robots
from tests.helpers.still_poses import verdict_of

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
    result = fit_table(fitted)
    error = np.linalg.norm(result.deviations(judged), axis=1)
    assert verdict_of(result).status is Status.GOOD
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
    result = fit_table(fitted)
    assert np.linalg.norm(result.deviations(judged), axis=1).mean() < 0.13e-3
    assert result.search is not None
    assert {(0, 17), (1, 17), (2, 17)} <= set(result.search.pairs)


@pytest.mark.slow
def test_a_measured_panda_is_identified_from_sockets_alone(tmp_path: Path) -> None:
    """8.5 mm with the catalogue's geometry: joint zeros are 13 and 14 mrad off."""
    result = fit_table(
        read_poses(real_robots.panda(tmp_path, "panda_6")), FitOptions(joint_errors="none")
    )
    assert verdict_of(result).acceptable
    assert result.residual_nominal.mean() > 5e-3
    assert result.cross_validation.mean < 0.25e-3
    assert any("rtheta3" in warning for warning in verdict_of(result).warnings)


@pytest.mark.long
def test_three_targets_of_a_measured_ur10_in_three_files_are_those_of_one(tmp_path: Path) -> None:
    """The T-Mac's rotation makes three rigid targets of one; 0.087 and 0.160 mm of an IRB 120."""
    full = read_poses(real_robots.ur10_a(tmp_path))
    rows = np.sort(np.random.default_rng(0).permutation(full.size)[:500])
    own = full.groups[0].part(rows)
    turn = matrix_from_rotvec(own.values[:, 3:].T)
    results = []
    for files in (True, False):
        groups = []
        for k, away in enumerate(([0.0, 0.0, 0.0], [0.12, 0.03, 0.02], [-0.05, 0.11, -0.03])):
            points = own.values[:, :3] + np.einsum("ijn,j->ni", turn, away)
            part = replace(own, measured="point", values=points, sigma=own.sigma[:, :3], time=None)
            name = f"{k}.csv" if files else "all.csv"
            lines = np.arange(500) + 2 if files else 3 * np.arange(500) + k + 2
            groups.append(replace(part, target=f"t{k}", file=name, rows=lines))
        results.append(fit_table(replace(full, groups=tuple(groups))))
    assert [result.findings.steps for result in results] == [(), ()]
    assert results[0].cross_validation.mean == pytest.approx(
        results[1].cross_validation.mean, rel=0.02
    )
