"""Values of poses with the errors that an instrument has in common, and a board that is seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.board import BoardFile, board_of
from ballbar.cell.camera import Camera, Lens
from ballbar.cell.instruments.base import TrueStand, View
from ballbar.cell.poses import PoseGroup

RNG = np.random.default_rng(7)
COUNT = 12


def group(measured: str, by_common: Array | None) -> PoseGroup:
    columns = 6 if measured == "pose" else 3
    values = RNG.uniform(-0.5, 0.5, (COUNT, columns))
    return PoseGroup(
        measured=measured, seat="hall", target="ball", q=np.zeros((COUNT, 6)), values=values,
        sigma=np.full(values.shape, 1e-5), rows=np.arange(COUNT), file="t.csv",
        by_common=by_common,
    )  # fmt: skip


def test_errors_in_common_shift_points() -> None:
    change = RNG.normal(size=(COUNT, 6, 2))
    unknowns = np.array([1e-3, -2e-3])
    each = group("point", change)
    assert each.with_common(unknowns) == pytest.approx(each.values + (change @ unknowns)[:, :3])
    assert each.with_common(np.zeros(2)) is each.values
    assert group("point", None).with_common(unknowns).shape == (COUNT, 3)


def test_errors_in_common_turn_poses_about_the_axes_of_the_seat() -> None:
    change = RNG.normal(size=(COUNT, 6, 2))
    unknowns = np.array([1e-1, -2e-1])
    each = group("pose", change)
    shift = change @ unknowns
    moved = each.with_common(unknowns)
    assert moved[:, :3] == pytest.approx(each.values[:, :3] + shift[:, :3])
    turned = Rotation.from_rotvec(moved[:, 3:]).as_matrix()
    turn, before = (
        Rotation.from_rotvec(v).as_matrix() for v in (shift[:, 3:], each.values[:, 3:].copy())
    )
    assert turned == pytest.approx(turn @ before, abs=1e-12)


def test_arrays_of_a_group_are_its_own_and_have_the_columns_of_their_kind() -> None:
    each = group("point", None)
    assert each.size == COUNT
    assert not each.values.flags.writeable
    with pytest.raises(ValueError, match=r"point: values of shape \(12, 2\)"):
        PoseGroup(
            measured="point", seat="hall", target="ball", q=np.zeros((COUNT, 6)),
            values=np.zeros((COUNT, 2)), sigma=np.zeros((COUNT, 2)), rows=np.arange(COUNT),
            file="t.csv",
        )  # fmt: skip


GRID = np.stack(np.meshgrid(np.arange(7), np.arange(5)), axis=-1).reshape(-1, 2)
BOARD = board_of(
    "board",
    BoardFile.model_validate(
        {"schema": "ballbar-board/1", "kind": "points", "points_m": 0.02 * GRID, "sigma_m": 1e-5}
    ),
)
CAMERA = Camera(
    (1280, 960), Lens("brown", np.array([900.0, 900.0, 640.0, 480.0, *[0.0] * 5])), np.eye(9), 0.1
)
MIDDLE = np.array([0.06, 0.04, 0.0])  # [m] of the board


def stand(distance: float, tilt: float, aside: float = 0.0) -> TrueStand:
    """A board in front of the camera, turned about its middle by a tilt [rad] about x."""
    turn = Rotation.from_rotvec([tilt, 0.0, 0.0]).as_matrix()
    rod = np.array([aside, 0.0, distance]) - turn @ MIDDLE
    return TrueStand(rod[:, None], np.array([np.linalg.norm(rod)]), turn[:, :, None])


def carried(each: TrueStand) -> TrueStand:
    """The same view of a camera that is carried: as the board sees the camera."""
    turn = each.rotation[:, :, 0]
    rod = -turn.T @ each.rod
    return TrueStand(rod, each.distance, turn.T[:, :, None])


def test_a_carried_camera_sees_the_corners_where_one_in_the_cell_does() -> None:
    points = np.column_stack((BOARD.points, np.zeros(len(GRID))))
    each = stand(0.5, 0.4, 0.02)
    expected = points @ each.rotation[:, :, 0].T + each.rod[:, 0]
    for view, seen in ((View(BOARD, False), each), (View(BOARD, True), carried(each))):
        assert view.corners(seen, points)[0] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize(
    ("each", "seen"),
    [
        (stand(0.5, 0.0), True),
        (stand(0.5, np.deg2rad(57.0)), True),
        (stand(0.5, np.deg2rad(-57.0)), True),
        (stand(0.5, np.deg2rad(63.0)), False),
        (stand(0.5, np.pi - 0.1), False),  # from behind
        (stand(0.5, 0.0, 0.33), False),  # half of it beside the picture
        (stand(0.08, 0.0), False),  # larger than the picture
        (stand(5.0, 0.0), False),  # too small to be found
        (stand(-0.5, 0.0), False),
    ],
)
def test_a_board_is_seen_whole_large_and_from_its_front(
    each: TrueStand, moving: bool, seen: bool
) -> None:
    """The board is 0.12 m wide; the field of view at half a metre 0.71 m."""
    shown = carried(each) if moving else each
    assert View(BOARD, moving).seen(CAMERA, shown).tolist() == [seen]
