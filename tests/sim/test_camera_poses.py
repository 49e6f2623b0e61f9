"""Simulated pictures: corners by formulas of their own, and poses that see the board."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.errors import InputError
from ballbar.cell.instruments.base import TrueStand
from ballbar.cell.load import load_instrument, load_robot
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.corners import view_of
from ballbar.sim.recording_files import write_poses
from ballbar.sim.settings import ErrorSettings, PictureSettings
from ballbar.sim.still_poses import PoseSimulation, simulate_poses
from ballbar.sim.true_robot import true_arm
from tests.helpers.pictures import brown

SCENARIOS = ("so101_phone", "ur5e_camera", "panda_camera")


def simulated(name: str, **pictures: float) -> tuple[Scenario, PoseSimulation]:
    """Ten poses of a scenario without any error but noise of the corners."""
    data = load_scenario(name).model_dump()
    data["poses"] |= {"count": 10, "pictures": data["poses"]["pictures"] | pictures}
    scenario = Scenario.model_validate(data | {"errors": {"instrument_noise": {}}})
    return scenario, simulate_poses(scenario, relative_to=Path())


@pytest.mark.parametrize("name", SCENARIOS)
def test_corners_are_where_a_lens_images_them(name: str) -> None:
    """Without errors; the robot by its rows, the lens by the formulas of Brown."""
    scenario, simulation = simulated(name, lens_scale=0.0, sigma_m=1e-9)
    robot, camera = simulation.robot, simulation.instrument.camera
    pictures = scenario.needed_poses.pictures
    assert camera is not None
    assert pictures is not None
    flange = true_arm(robot, ErrorSettings(), 1).flange(
        simulation.rows.axes @ robot.controller_to_joint + robot.controller_offset
    )
    (seat,), (target,) = simulation.truth.seats.values(), simulation.truth.targets.values()
    lens = dict(zip(("fx", "fy", "cx", "cy"), camera.lens.values, strict=False))
    lens |= dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0)
    square = pictures.square_m
    board = [[square * x, square * y, 0.0] for y in range(1, pictures.squares_y)
             for x in range(1, pictures.squares_x)]  # fmt: skip
    for n, pixels in enumerate(simulation.rows.values):
        turn, origin = flange.rotation()[:, :, n], flange.tip[:, n]
        on_flange = np.array(board) if pictures.camera == "cell" else np.zeros((1, 3))
        placed = (on_flange @ target.rotation.T + target.position) @ turn.T + origin
        if pictures.camera == "cell":
            seen = (placed - seat.position) @ seat.rotation
        else:
            points = np.array(board) @ seat.rotation.T + seat.position
            seen = (points - placed) @ (turn @ target.rotation)
        # a board is not flat: the sag of half a millimetre is drawn
        np.testing.assert_allclose(pixels, brown(seen, lens), atol=6.0)
        assert np.median(np.abs(pixels - brown(seen, lens))) < 1.5


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_table_of_pictures_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    scenario, simulation = simulated(name)
    write_poses(simulation, scenario, tmp_path / "table")
    table = read_poses(tmp_path / "table")
    assert [g.size for g in table.groups] == [10]
    axes = table.groups[0].q @ table.robot.joint_to_axis
    np.testing.assert_allclose(axes, simulation.rows.axes, atol=1e-9)


def test_a_board_that_is_tilted_too_far_cut_off_or_seen_from_behind_is_not_seen() -> None:
    view, camera = view_of(PictureSettings()), load_instrument("webcam_720p").camera
    assert camera is not None

    def seen(x: float, z: float, tilt: float) -> bool:
        turn = np.array(
            [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
        )
        rod = np.array([[x - 0.11], [-0.09], [z]])
        return bool(view.seen(camera, TrueStand(rod, np.ones(1), turn[..., None]))[0])

    assert seen(0.0, 0.6, 0.0)
    assert not seen(0.5, 0.6, 0.0)  # beside the picture
    assert not seen(0.0, -0.6, 0.0)  # behind the camera
    assert not seen(0.0, 3.0, 0.0)  # too small
    assert not seen(0.0, 0.6, np.radians(70.0))
    assert not seen(0.0, 0.6, np.pi)  # its back


def test_play_lies_where_the_weight_presses_it_and_else_where_the_joint_came_from() -> None:
    robot = load_robot("so101")
    errors = ErrorSettings.model_validate({"joint_compliance": {}, "gear_backlash": {}})
    rigid = ErrorSettings.model_validate({"joint_compliance": {}})
    stretched = np.zeros((3, 5))
    stretched[:, 1] = np.radians(90.0)  # the arm hangs to one side, and is not turned by pan
    stretched[1, 0], stretched[2, 0] = 0.3, 0.1
    arms = (true_arm(robot, e, 1) for e in (errors, rigid))
    with_play, without = (arm.joints(stretched) for arm in arms)
    moved, half = with_play - without, 0.5 * 0.0152
    np.testing.assert_allclose(moved[:, 0], [0.0, -half, half], atol=1e-4)
    np.testing.assert_allclose(np.abs(moved[:, 1]), half, atol=1e-3)


def test_pictures_need_a_camera() -> None:
    data = load_scenario("ur10e_tracker").model_dump()
    data["poses"]["pictures"] = {}
    with pytest.raises(InputError, match=r"poses\.pictures"):
        simulate_poses(Scenario.model_validate(data), relative_to=Path())
