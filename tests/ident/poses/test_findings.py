"""What the residuals of still poses show: the last moves along which early readings err."""

from __future__ import annotations

import numpy as np
import pytest

from cell.poses import PoseGroup
from ident.poses.findings import last_moves

Q = np.array([[0.0, 0.0], [0.1, 0.2], [0.4, 0.1]])  # three poses [rad]


def group(target: str, q: np.ndarray, rows: list[int], file: str = "a.csv") -> PoseGroup:
    values = np.zeros((len(q), 3))
    return PoseGroup(
        measured="point",
        seat="hall",
        target=target,
        q=q,
        values=values,
        sigma=values + 1e-5,
        rows=np.array(rows),
        file=file,
    )


def test_targets_measured_in_turn_at_one_pose_share_its_last_move() -> None:
    first, second = last_moves([group("r1", Q, [2, 4, 6]), group("r2", Q, [3, 5, 7])])
    expected = np.array([[0.0, 0.0], [0.1, 0.2], [0.3, -0.1]])
    assert first == pytest.approx(expected, abs=1e-12)
    assert second == pytest.approx(expected, abs=1e-12)


def test_where_the_row_before_is_missing_no_move_is_known() -> None:
    (moves,) = last_moves([group("r1", Q, [2, 3, 5])])
    assert moves == pytest.approx(np.array([[0.0, 0.0], [0.1, 0.2], [0.0, 0.0]]), abs=1e-12)


def test_another_file_is_another_measurement() -> None:
    moves = last_moves([group("r1", Q[:1], [2]), group("r1", Q[1:], [3, 4], "b.csv")])
    assert moves[0] == pytest.approx(np.zeros((1, 2)), abs=0.0)
    assert moves[1] == pytest.approx(np.array([[0.0, 0.0], [0.3, -0.1]]), abs=1e-12)
