"""A board that is no plane, and what a table of poses says of its columns and pictures."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from ballbar.cell.board import BoardFile, board_of
from ballbar.cell.pose_file import PoseTableFile, ReferencePoints

SHAPE = np.array([1e-3, -2e-3, 3e-4, -1e-4, 2e-4])  # relative, and [m]


def test_a_bent_board_is_a_paraboloid_of_its_sags() -> None:
    """Along x twice the second difference over the half size squared is the sag of xx."""
    given = {"schema": "ballbar-board/1", "kind": "checkerboard", "sigma_m": 1e-5}
    size = {"squares_x": 6, "squares_y": 4, "square_m": 0.03}
    board = board_of("board", BoardFile.model_validate(given | size))
    assert np.ptp(board.points, axis=0) == pytest.approx([0.12, 0.06])
    bent, slopes = board.bent(SHAPE)
    assert bent[:, :2] == pytest.approx(board.points * (1.0 + SHAPE[:2]), abs=1e-15)
    assert bent[:, 2].mean() == pytest.approx(0.0, abs=1e-12)
    sag, step = bent[:, 2].reshape(3, 5), 0.03 / 0.06  # of half the size
    np.testing.assert_allclose(np.diff(sag, 2, axis=1) / step**2, 2.0 * SHAPE[2], atol=1e-12)
    np.testing.assert_allclose(np.diff(sag, 2, axis=0) / step**2, 2.0 * SHAPE[4], atol=1e-12)
    both = np.diff(np.diff(sag, axis=0), axis=1)
    np.testing.assert_allclose(both / step**2, SHAPE[3], atol=1e-12)
    flat = np.column_stack((board.points, np.zeros(len(board.points))))
    np.testing.assert_allclose(bent - flat, slopes @ SHAPE, atol=1e-15)


@pytest.mark.parametrize("count", range(6, 15))
def test_reference_points_have_three_columns_each(count: int) -> None:
    columns = {"columns": [f"r{k}" for k in range(count)]}
    if count % 3 == 0 and count >= 9:
        assert len(ReferencePoints.model_validate(columns).columns) == count
    else:
        with pytest.raises(ValidationError, match=f"{count} columns|{count // 3} points"):
            ReferencePoints.model_validate(columns)


def test_each_file_of_corners_has_a_file_of_joints() -> None:
    pictures = {"corners": "corners.csv", "board": "board.yaml"}
    table = {"joints": {"columns": ["q1"]}, "pictures": pictures}
    assert PoseTableFile.model_validate(table | {"files": ["a.csv"]}).pictures is not None
    with pytest.raises(ValidationError, match="one file for each file of corners"):
        PoseTableFile.model_validate(table | {"files": ["a.csv", "b.csv"]})
    for key, value in (
        ("values", {"columns": ["x"]}),
        ("reference", {"columns": list("abcdefghi")}),
    ):
        with pytest.raises(ValidationError, match="leave out values, sigma and reference"):
            PoseTableFile.model_validate(table | {"files": ["a.csv"], key: value})
