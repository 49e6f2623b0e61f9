"""Exports of an identified robot, read back by other means and compared with our kinematics.

Tolerance 1e-9 m and rad (what is asked for); the files hold every digit, so what is left is
rounding.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, nominal_geometry, robot_frames
from ballbar.cell.robot_angles import controller_to_joints, joints_to_axes
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.export.formats import FORMATS, exported
from ballbar.export.result import Result, load_result
from ballbar.export.rows import standard_rows
from tests.helpers.calibrations import GEARS, corrections_of, write_calibration_of
from tests.helpers.command_line import ballbar
from tests.helpers.dh_tables import along_table, shift, table, turn
from tests.helpers.simulated_recordings import perturbed

POSES = 1000
TOLERANCE = 1e-9
PLAIN = ("rbeta2", "rbeta6", "rd1", "rtheta1")


@pytest.fixture(scope="module", params=["plain", "hayati"])
def result(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    cell: Cell,
    nominal: Geometry,
) -> Result:
    rng = np.random.default_rng(5)
    left = PLAIN if request.param == "plain" else ("rd1",)
    folder = tmp_path_factory.mktemp(request.param)
    corrections = corrections_of(cell, GEARS, rng)
    return load_result(
        write_calibration_of(
            folder / "calibration.yaml",
            nominal,
            perturbed(nominal, rng),
            left=left,
            corrections=corrections,
        )
    )


@pytest.fixture(scope="module")
def angles(cell: Cell) -> Array:
    robot = cell.robot
    share = np.random.default_rng(6).random((POSES, 6))
    return controller_to_joints(
        robot, robot.axis_lower + share * (robot.axis_upper - robot.axis_lower)
    )


def assert_same_poses(found: Array, result: Result, q: Array) -> None:
    frames = robot_frames(result.calibration.geometry, q)
    assert np.abs(found[:, :3, 3] - frames.tip.T).max() < TOLERANCE
    turned = np.einsum("nik,jkn->ijn", found[:, :3, :3], frames.rotation())
    assert np.linalg.norm(rotvec_from_matrix(turned), axis=0).max() < TOLERANCE


def read_dh(text: str, q: Array) -> Array:
    assert all(float(row["beta_rad"]) == 0.0 for row in table(text)[:-1]), (
        "a standard table has no Hayati angle in its rows"
    )
    return along_table(text, q, "zZXxy")


def read_modified(text: str, q: Array) -> Array:
    return along_table(text, q, "xXzZy")


def read_hayati(text: str, q: Array) -> Array:
    assert float(table(text)[1]["d_m"]) == 0.0
    return along_table(text, q, "zZXxy")


def read_poe(text: str, q: Array) -> Array:
    rows = {
        row["row"]: [float(v) for k, v in row.items() if k != "row" and v] for row in table(text)
    }
    home = np.vstack([rows["M1"], rows["M2"], rows["M3"], [0.0, 0.0, 0.0, 1.0]])
    pose: Array = np.eye(4)[None]
    for i in range(6):
        w, v = np.array(rows[str(i + 1)][:3]), np.array(rows[str(i + 1)][3:])
        step = np.tile(np.eye(4), (len(q), 1, 1))
        step[:, :3, :3] = Rotation.from_rotvec(q[:, i, None] * w).as_matrix()
        step[:, :3, 3] = (np.eye(3) - step[:, :3, :3]) @ np.cross(
            w, v
        )  # exponential of a screw without pitch, |w| = 1
        pose = pose @ step
    return np.asarray(pose @ home)


def rapid_data(text: str) -> dict[str, list[float]]:
    found = re.findall(r"^ +CONST dnum (\w+)(?:\{6\})? := \[?([^\];]*)\]?;$", text, re.MULTILINE)
    return {name: [float(v) for v in values.split(",")] for name, values in found}


def along_rows(rows: dict[str, list[float]], q: Array) -> Array:
    pose: Array = np.eye(4)[None]
    for i in range(6):
        pose = pose @ turn("z", rows["theta"][i] + q[:, i]) @ shift("z", rows["d"][i])
        pose = pose @ shift("x", rows["a"][i]) @ turn("x", rows["alpha"][i])
        pose = pose @ turn("y", rows["beta"][i])
    return np.asarray(pose)


def read_rapid(text: str, q: Array) -> Array:
    data = rapid_data(text)
    rows = {key: (np.array(data[f"dh_{key}_mm"]) / 1e3).tolist() for key in "ad"}
    for key in ("alpha", "theta", "beta"):
        rows[key] = np.radians(data[f"dh_{key}_deg"]).tolist()
    return along_rows(rows, q) @ turn("y", np.radians(data["dh_tool_beta_deg"][0]))


def read_json(text: str, q: Array) -> Array:
    return along_rows(json.loads(text)["rows"], q)


def in_mujoco(
    model: mujoco.MjModel, q: Array, place: Callable[[mujoco.MjData], tuple[Array, Array]]
) -> Array:
    data = mujoco.MjData(model)
    pose = np.tile(np.eye(4), (len(q), 1, 1))
    where = [int(model.joint(f"joint_{i + 1}").qposadr[0]) for i in range(6)]
    for k in range(len(q)):
        data.qpos[where] = q[k]
        mujoco.mj_kinematics(model, data)
        rotation, pose[k, :3, 3] = place(data)
        pose[k, :3, :3] = rotation.reshape(3, 3)
    return pose


def read_urdf(text: str, q: Array) -> Array:
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False  # or the tool's frame melts into link 6
    return in_mujoco(
        spec.compile(), q, lambda data: (data.body("tool0").xmat, data.body("tool0").xpos)
    )


def read_mjcf(text: str, q: Array) -> Array:
    return in_mujoco(
        mujoco.MjModel.from_xml_string(text),
        q,
        lambda data: (data.site("tool").xmat, data.site("tool").xpos),
    )


READERS: dict[str, Callable[[str, Array], Array]] = {
    "urdf": read_urdf,
    "mjcf": read_mjcf,
    "dh": read_dh,
    "mdh": read_modified,
    "hayati": read_hayati,
    "poe": read_poe,
    "abb": read_rapid,
    "json": read_json,
}


def test_every_format_has_a_reader_here() -> None:
    """That of UR's arms has one in test_pose_results: the robot here is of another maker. Poses of
    cameras and boards, which are no kinematics, are read in test_offsets_export.
    """
    assert {*READERS, "ur-kinematics", "hand-eye"} == set(FORMATS)


def is_refused(to: str, result: Result) -> bool:
    """A table of rows without Hayati's angle, of a robot that has a significant one."""
    return to in ("dh", "mdh") and result.chain.beta[1] != 0.0


@pytest.mark.parametrize("to", READERS)
def test_every_format_read_back_puts_the_tool_where_our_kinematics_does(
    to: str, result: Result, angles: Array
) -> None:
    if is_refused(to, result):
        with pytest.raises(InputError, match=r"their common normal lies \d+ m .* --to hayati"):
            exported(result, to)
        return
    assert_same_poses(READERS[to](exported(result, to), angles), result, angles)


@pytest.mark.parametrize("to", READERS)
def test_every_format_says_what_it_leaves_out_and_what_stayed_nominal(
    to: str, result: Result
) -> None:
    if is_refused(to, result):
        return
    text = exported(result, to)
    if to == "json":
        data = json.loads(text)
        assert any("gear_backlash" in line for line in data["not_in_rows"])
        assert data["parameters"]["rd1"]["identified"] is False
        assert data["parameters"]["rd1"]["reason"] == "gauge -- held"
        assert data["parameters"]["ra2"]["sigma"] == 2e-6
        assert set(data["corrections"]) == set(GEARS)
        return
    for said in (
        "NOT in this file",
        "compliance of the gears under the robot's own weight",
        "backlash of the gears",
        "transmission error",
    ):
        assert said in text
    assert re.search(r"rd1 = 0\.615 m, NOMINAL: not identified", text)
    assert re.search(r"ra2 = [\d.]+ m, sigma 2e-06 m \(nominal 0\.705\)", text)
    assert result.sha256 in text
    assert str(result.file.parent) not in text, "no path of this computer"


def test_urdf_and_mjcf_carry_the_weight_of_arm_and_plate(
    result: Result, angles: Array, nominal: Geometry
) -> None:
    from ballbar.sim.plant.statics import gravity_torque  # noqa: PLC0415

    model = mujoco.MjModel.from_xml_string(exported(result, "mjcf"))
    data = mujoco.MjData(model)
    expected = gravity_torque(result.cell, result.calibration.geometry, angles[:20])
    for k in range(20):
        data.qpos[:] = angles[k]
        mujoco.mj_forward(model, data)
        assert data.qfrc_bias == pytest.approx(expected[k], abs=1e-6)
    spec = mujoco.MjSpec.from_string(exported(result, "urdf"))
    assert spec.compile().body_mass.sum() == pytest.approx(model.body_mass.sum(), rel=1e-12)


def test_motor_offsets_turn_the_nominal_joints_by_the_identified_offsets(
    result: Result, cell: Cell
) -> None:
    data = rapid_data(exported(result, "abb"))
    offsets = result.chain.theta - result.calibration.nominal.robot.theta
    assert np.array(data["motor_offset_rad"]) @ cell.robot.transmission == pytest.approx(
        offsets, abs=1e-12
    )
    change = joints_to_axes(cell.robot, offsets) - joints_to_axes(cell.robot, np.zeros(6))
    assert np.radians(data["axis_change_deg"]) == pytest.approx(change, abs=1e-12)
    assert data["sigma_d_mm"][0] == -1.0, "rd1 was not identified"


def test_an_angle_below_its_sigma_is_dropped_from_a_table_and_kept_by_hayati(
    tmp_path: Path, nominal: Geometry
) -> None:
    """Axes parallel to rounding have no common normal; the sigma of the file is 2e-6 rad."""
    bent = nominal.replaced({"rbeta2": 1e-8})
    result = load_result(write_calibration_of(tmp_path / "calibration.yaml", nominal, bent))
    assert isinstance(result, Result)
    text = exported(result, "dh")
    assert "DROPPED: rbeta2 = 1e-08 rad, below its sigma of 2e-06 rad" in text
    assert max(abs(float(row["d_m"])) for row in table(text)) < 2.0
    q = np.random.default_rng(7).uniform(-1.0, 1.0, (50, 6))
    assert_same_poses(read_hayati(exported(result, "hayati"), q), result, q)


@pytest.mark.parametrize("seed", range(4))
def test_standard_rows_move_as_those_with_hayati_angles_within_a_quarter_turn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, d, alpha, theta = rng.uniform(-1.0, 1.0, (4, 6)) * [[0.8], [0.5], [np.pi], [3.0]]
    alpha = np.where(np.abs(np.sin(alpha)) < 0.3, np.pi / 2, alpha)
    chain = Chain(a, d, alpha, theta, rng.normal(0.0, 0.02, 6))
    rows = standard_rows(chain)
    assert not rows.beta.any()
    assert np.abs(rows.theta - theta).max() < np.pi / 2
    q = rng.uniform(-np.pi, np.pi, (20, 6))
    poses = forward(Chain(rows.a, rows.d, rows.alpha, rows.theta, rows.beta), q).poses()
    assert poses @ turn("y", rows.tool_beta) == pytest.approx(forward(chain, q).poses(), abs=1e-12)


def test_axes_that_are_parallel_to_rounding_have_no_standard_row(nominal: Geometry) -> None:
    bent = nominal.replaced({"rbeta2": 1e-8}).robot
    with pytest.raises(
        InputError, match=r"joints 2 and 3 are parallel within 1e-08 rad .* Export with --to hayati"
    ):
        standard_rows(bent)


def test_names_in_a_result_cannot_end_a_comment_or_begin_a_line(
    tmp_path: Path, nominal: Geometry, cell: Cell
) -> None:
    """A robot file of one's own may have any title of one line."""
    source = (Path(__file__).parents[2] / "cell" / "robots" / "irb2400.yaml").read_text()
    robot = tmp_path / "my -- robot.yaml"
    robot.write_text(source.replace("title: ABB IRB 2400/16", 'title: "x ---> <a/> MODULE evil"'))
    result = load_result(
        write_calibration_of(tmp_path / "calibration.yaml", nominal, nominal, robot=robot.name)
    )
    assert result.name == "my____robot"
    mujoco.MjModel.from_xml_string(exported(result, "mjcf"))
    for to in ("dh", "abb"):
        assert not [
            line for line in exported(result, to).splitlines() if line.startswith("MODULE evil")
        ]


def test_the_larger_robot_is_exported_alike(tmp_path: Path) -> None:
    from ballbar.cell.load import load_cell  # noqa: PLC0415

    nominal = nominal_geometry(
        load_cell("nj220", "lund_600", "plate_250"), np.array([1.5, 0.0, 0.7])
    )
    true = perturbed(nominal, np.random.default_rng(8))
    result = load_result(
        write_calibration_of(
            tmp_path / "calibration.yaml", nominal, true, left=PLAIN, robot="nj220"
        )
    )
    q = np.random.default_rng(9).uniform(-2.0, 2.0, (100, 6))
    for to, read in READERS.items():
        assert_same_poses(read(exported(result, to), q), result, q)


@pytest.mark.slow
def test_export_prints_or_writes_a_new_file(tmp_path: Path, result: Result) -> None:
    code, said, _ = ballbar("export", result.file.parent, "--to", "hayati")
    assert code == 0
    assert said == exported(result, "hayati")
    file = tmp_path / "robot.urdf"
    code, said, _ = ballbar("export", result.file, "--to", "urdf", "--out", file, "--json")
    assert code == 0
    summary = json.loads(said)
    assert summary["file"] == str(file)
    assert summary["format"] == "urdf"
    assert len(summary["left_out"]) == 3
    assert file.read_text() == exported(result, "urdf")
    code, _, error = ballbar("export", result.file, "--to", "mjcf", "--out", file)
    assert code == 2
    assert "exists already; nothing was written" in error
    assert file.read_text() == exported(result, "urdf")
    code, _, error = ballbar("export", tmp_path / "none", "--to", "dh")
    assert code == 2
    assert "no such file. Name a calibration.yaml" in error
