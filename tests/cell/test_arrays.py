"""Arrays of callers are checked, copied and write-protected; rounded poses become rigid."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import (
    Array,
    MatrixJ,
    Vector3,
    VectorJ,
    finite_rows,
    protect_fields,
    read_only,
    rigid_poses,
)
from ballbar.cell.errors import InputError


@dataclass(frozen=True, eq=False)
class Described:
    """Something of J joints."""

    place: Vector3
    gains: VectorJ
    coupling: MatrixJ | None = None

    def __post_init__(self) -> None:
        protect_fields(self)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        (np.zeros((2, 2)), r"points: of shape \(2, 2\). Give an array \(N, 3\) \[m\]"),
        (np.zeros(3), r"of shape \(3,\)"),
        (np.zeros((1, 2, 3)), r"of shape \(1, 2, 3\)"),
        ([[1.0, 2.0, 1j]], "these are no real numbers"),
        ([["a", "b", "c"]], "these are no real numbers"),
        (
            [[0.0, 0.0, 0.0], [0.0, np.inf, 0.0], [np.nan, 0.0, 0.0]],
            r"row 1 of 3 \(counted from 0\)",
        ),
    ],
)
def test_rows_that_are_no_numbers_of_their_shape_are_refused(values: object, why: str) -> None:
    with pytest.raises(InputError, match=why):
        finite_rows(values, (3,), "points", "[m]")  # type: ignore[arg-type]


def test_rows_may_be_few_or_none() -> None:
    assert finite_rows([[1, 2, 3]], (3,), "points", "[m]").dtype == np.float64
    assert finite_rows(np.empty((0, 3)), (3,), "points", "[m]").shape == (0, 3)


def poses(count: int = 20) -> Array:
    rng = np.random.default_rng(1)
    out = np.tile(np.eye(4), (count, 1, 1))
    out[:, :3, :3] = Rotation.random(count, random_state=2).as_matrix()
    out[:, :3, 3] = rng.uniform(-1.0, 1.0, (count, 3))
    return out


def test_poses_rounded_to_four_digits_become_the_nearest_rigid_ones() -> None:
    exact = poses()
    given = np.round(exact, 4)
    rigid = rigid_poses(given)
    rotation = rigid[:, :3, :3]
    assert rotation.transpose(0, 2, 1) @ rotation == pytest.approx(
        np.tile(np.eye(3), (20, 1, 1)), abs=1e-14
    )
    u, _, vt = np.linalg.svd(given[:, :3, :3])
    assert rotation == pytest.approx(u @ vt, abs=1e-13)  # the nearest in the Frobenius norm
    assert np.array_equal(rigid[:, :3, 3], given[:, :3, 3])
    assert np.array_equal(given, np.round(exact, 4))  # the caller's stay as they are


@pytest.mark.parametrize("wrong", ["scaled", "mirrored", "last row"])
def test_what_is_no_pose_is_refused_with_its_row(wrong: str) -> None:
    given = poses()
    if wrong == "scaled":
        given[7, :3, :3] *= 1.001
    elif wrong == "mirrored":
        given[7, :3, 0] *= -1.0
    else:
        given[7, 3, 3] = 2.0
    with pytest.raises(InputError, match=r"poses: row 7 of 20 .* is no rotation and position"):
        rigid_poses(given)


def test_a_protected_copy_is_shared_and_cannot_be_written_to() -> None:
    mine = np.arange(3.0)
    copy = read_only(mine)
    mine[0] = 9.0
    assert copy[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 1.0
    assert read_only(copy) is copy
    view = mine[:]
    view.flags.writeable = False
    assert read_only(view) is not view  # its owner could still write to it
    assert read_only(copy[1:]).base is copy
    assert read_only(copy, np.int64).dtype == np.int64


def test_fields_share_the_number_of_joints() -> None:
    described = Described(np.zeros(3), np.ones(6), np.eye(6))
    assert not described.gains.flags.writeable
    assert Described(np.zeros(3), np.ones(2)).coupling is None
    assert replace(described, place=np.ones(3)).gains is described.gains
    for fields, why in (
        ((np.zeros(2), np.ones(6)), r"Described.place: expected finite numbers of shape \(3,\)"),
        (
            (np.zeros(3), np.ones(6), np.eye(5)),
            r"Described.coupling: .* \(6, 6\), got shape \(5, 5",
        ),
        ((np.zeros(3), np.array([1.0, np.nan])), r"Described.gains: .* \(2,\)"),
    ):
        with pytest.raises(ValueError, match=why):
            Described(*fields)
