"""Uses of a result of still poses: exports, a changed URDF, correct, verify, compare.

The result is made without a fit: catalogue rows with drawn errors, joint errors, sag, two targets.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ballbar import load
from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.geometry import nominal_chain
from ballbar.export.formats import exported
from ballbar.export.into_urdf import into_file
from ballbar.export.result import Result, load_result
from ballbar.export.ur_kinematics import LINKS, ur_chain
from ballbar.ident.robot.inverse_calibration import corrected_targets
from ballbar.result.compare import compare, is_notable
from ballbar.robot_file.urdf import parse_urdf
from ballbar.robot_file.urdf_chain import chain_between
from tests.helpers.command_line import ballbar
from tests.helpers.dh_tables import along_table, table
from tests.helpers.drawn_pose_tables import drawn_robot, point_table
from tests.helpers.pose_results import write_pose_result, write_pose_table
from tests.helpers.published_urdf import PUBLISHED, PublishedUrdf
from tests.helpers.simulated_recordings import Recorded

SHIPPED = Path(__file__).parents[2] / "cell" / "robots"
ROBOTS = ("ur10", "panda", "irb2400", "irb1600")
EXACT = 1e-9  # [m, rad]


@pytest.fixture(scope="module", params=ROBOTS)
def result(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp(request.param)
    write_pose_result(folder / "calibration.yaml", request.param, seed=1)
    return load_result(folder)


def angles(result: Result, count: int = 200) -> Array:
    return np.random.default_rng(2).uniform(-1.5, 1.5, (count, result.robot.joints))


def flange_of(result: Result, q: Array) -> Array:
    return forward(result.chain, q).poses()


def target_of(result: Result, q: Array, name: str) -> Array:
    place = result.calibration.targets[name]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = place.rotation, place.origin
    return np.asarray(flange_of(result, q) @ pose)


def read_urdf(text: str, q: Array, link: str) -> Array:
    urdf = parse_urdf(text, "urdf")
    chain = chain_between(urdf, "base_link", link)
    return chain.tip_poses(q)


def read_mjcf(text: str, q: Array, site: str) -> Array:
    model = mujoco.MjModel.from_xml_string(text)
    data, out = mujoco.MjData(model), np.tile(np.eye(4), (len(q), 1, 1))
    for k in range(len(q)):
        data.qpos[:] = q[k]
        mujoco.mj_kinematics(model, data)
        out[k, :3, :3] = data.site(site).xmat.reshape(3, 3)
        out[k, :3, 3] = data.site(site).xpos
    return out


@pytest.mark.parametrize("read", [read_urdf, read_mjcf])
def test_models_have_flange_and_targets_where_the_identified_robot_has_them(
    read: Callable[[str, Array, str], Array], result: Result
) -> None:
    q = angles(result)
    text = exported(result, "urdf" if read is read_urdf else "mjcf")
    assert np.abs(read(text, q, "flange") - flange_of(result, q)).max() < EXACT
    for name in result.calibration.targets:
        frame = f"target_{name.replace(' ', '_')}"
        assert np.abs(read(text, q, frame) - target_of(result, q, name)).max() < EXACT


@pytest.mark.parametrize(("to", "order"), [("hayati", "zZXxy"), ("dh", "zZXxy"), ("mdh", "xXzZy")])
def test_tables_end_at_the_flange(to: str, order: str, result: Result) -> None:
    q = angles(result)
    if to != "hayati" and result.robot.name != "panda":  # parallel axes, and a significant angle
        with pytest.raises(InputError, match=r"joints 2 and 3 are .* Export with --to hayati"):
            exported(result, to)  # type: ignore[arg-type]
        return
    text = exported(result, to)  # type: ignore[arg-type]
    found = along_table(text.replace("\nflange,", "\ntool,"), q, order)
    assert np.abs(found - flange_of(result, q)).max() < EXACT
    assert re.search(r"targets on it: big ball at \(.*\) m; frame at .* rotation vector", text)


def test_screws_and_rapid_data_are_of_every_axis(result: Result) -> None:
    screws = table(exported(result, "poe"))
    assert [row["row"] for row in screws][:-3] == [str(j + 1) for j in range(result.robot.joints)]
    data = dict(re.findall(r"CONST dnum (\w+)\{\d\} := \[(.*)\];", exported(result, "abb")))
    assert {len(values.split(",")) for values in data.values()} == {result.robot.joints}


def test_every_format_states_fitted_ranges_and_what_it_leaves_out(result: Result) -> None:
    for to in ("urdf", "mjcf", "hayati", "poe", "abb"):
        text = exported(result, to)  # type: ignore[arg-type]
        assert "outside the fitted range of a joint the error is unknown" in text
        assert "joint 1: -114.6 to 114.6 deg (-2.0000 to 2.0000 rad)" in text
        assert "sag of the joints under the arm's weight (unit_weights, identified)" in text
        assert "joint errors that repeat with each turn (joint_harmonics, identified)" in text
        assert re.search(r"rd1 = [\d.]+ m, NOMINAL: not identified", text)
    data = json.loads(exported(result, "json"))
    assert data["fitted_ranges"][0] == {"lower_rad": -2.0, "upper_rad": 2.0}
    assert data["orders"][0]["order"] == 17
    assert data["cross_validation"]["region_factor"] == 1.1
    assert set(data["corrections"]) == {"unit_weights", "joint_harmonics"}


def test_masses_are_written_only_where_the_robots_file_has_them(result: Result) -> None:
    urdf, mjcf = exported(result, "urdf"), exported(result, "mjcf")
    known = result.robot.links is not None
    assert ("<inertial>" in urdf) == ("<inertial" in mjcf) == known
    assert ("the robot's file states none, so none are in this file" in urdf) == (not known)
    assert ("the model serves kinematics, not dynamics" in mjcf) == (not known)


def urdf_of(published: PublishedUrdf) -> str:
    """The published joints, with comments and odd spaces, and a branch beside the chain."""
    lines = ['<?xml version="1.0"?>', "<robot name='x'><!-- mine -->", '<link name="l0"/>']
    for i, joint in enumerate(published.joints):
        xyz, rpy = (" ".join(map(repr, v)) for v in (joint.xyz, joint.rpy))
        kind = "revolute" if joint.axis else "fixed"
        axis = f"<axis xyz='{' '.join(map(str, joint.axis))}'/>" if joint.axis else ""
        origin = f"<origin\n   rpy = '{rpy}'  xyz=\"{xyz}\" />"
        if joint.xyz == (0, 0, 0) and joint.rpy == (0.0, 0.0, 0.0):
            origin = ""
        lines.append(
            f'<link name="l{i + 1}"/><joint type="{kind}" name="j{i + 1}">{axis}'
            f'<parent link="l{i}"/> <child link="l{i + 1}"/>{origin} <!-- <origin xyz="9 9 9"/> -->'
            "</joint>"
        )
    lines.append('<transmission name="t"><joint name="j1"><x/></joint></transmission>')
    return "\n".join([*lines, "</robot>", ""])


@pytest.mark.parametrize("name", ["ur10", "panda", "irb1600", "kr10_r1100", "iiwa14", "gp25"])
def test_an_existing_urdf_has_the_identified_kinematics_and_keeps_the_rest(
    name: str, tmp_path: Path
) -> None:
    """Axes of either sign, along x, y or z, and fixed joints behind the flange."""
    write_pose_result(tmp_path / "calibration.yaml", name, seed=3)
    result, file = load_result(tmp_path), tmp_path / "robot.urdf"
    file.write_text(urdf_of(PUBLISHED[name]))
    changed = into_file(result, file)
    assert changed.error < EXACT
    before, after = file.read_text(), changed.content.decode()
    numbers = r"<origin[^>]*/>"
    assert re.sub(numbers, "", before) == re.sub(numbers, "", after)
    assert after.count('<!-- <origin xyz="9 9 9"/> -->') == before.count("9 9 9")

    tips = [chain_between(parse_urdf(t, "x"), "l0") for t in (before, after)]
    count, rng = result.robot.joints, np.random.default_rng(4)
    u = rng.uniform(-1.5, 1.5, (100, count))
    old, new = (chain.tip_poses(u) for chain in tips)
    sign = np.sign(np.diag(result.robot.controller_to_joint))
    nominal = forward(nominal_chain(result.robot), u * sign).poses()
    identified = forward(result.chain, u * sign).poses()
    # base and tool are constants that hold nominally; here they follow from the first pose
    flange_to_tip = np.linalg.inv(nominal) @ np.linalg.inv(_base(old, nominal)) @ old
    assert np.ptp(flange_to_tip, axis=0).max() < 1e-5, "digits of the published file"
    expected = _base(old, nominal) @ identified @ flange_to_tip[0]
    assert np.abs(new - expected).max() < 1e-5
    assert 1e-4 < np.abs(new - old)[:, :3, 3].max() < 2e-2
    assert changed.shift.max() < 5e-3, "links stay near their places"
    assert changed.turn.max() < 1e-2
    ends = np.sort(sign * np.rad2deg(result.calibration.ranges).T, axis=0).T
    stated = [f"  j{k}: {low:.1f} to {high:.1f} deg (" for k, (low, high) in enumerate(ends, 1)]
    joints = [line for line in changed.ranges if line.startswith("  ")]
    assert [line[: len(s)] for line, s in zip(joints, stated, strict=True)] == stated


def _base(tips: Array, rows: Array) -> Array:
    """Pose of the rows' base in the file's base link: of all presets a turn about z, or none."""
    for turn in (0.0, np.pi, np.pi / 2, -np.pi / 2):
        for flip in (0.0, np.pi):
            base = np.eye(4)
            base[:3, :3] = Rotation.from_euler("ZX", [turn, flip]).as_matrix()
            tool = np.linalg.inv(rows) @ np.linalg.inv(base) @ tips
            if np.ptp(tool, axis=0).max() < 1e-5:
                return base
    raise AssertionError("no base found")


def test_a_xacro_is_changed_where_numbers_stand_and_refused_at_expressions(tmp_path: Path) -> None:
    write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=3)
    result, file = load_result(tmp_path), tmp_path / "robot.urdf.xacro"
    text = urdf_of(PUBLISHED["ur10"]).replace("<robot name='x'>", XACRO)
    text = text.replace("</robot>", "</xacro:macro></robot>")
    text = re.sub(r'name="(j\d)"', r'name="${prefix}\1"', text)
    file.write_text(text)
    changed = into_file(result, file)
    assert changed.joints[0] == "${prefix}j1"
    assert changed.content.decode().startswith(text[:200])
    named = into_file(result, file, ["j1", "j2", "j3", "j4", "j5", "j6"])
    assert named.content == changed.content
    file.write_text(text.replace("0.163941", "${d4}"))
    with pytest.raises(InputError, match=r"joint \$\{prefix\}j4: xyz = .* is an expression"):
        into_file(result, file)


XACRO = (
    '<robot xmlns:xacro="http://wiki.ros.org/xacro" name="x">\n'
    '<xacro:property name="d4" value="0.163941"/>\n<xacro:macro name="arm" params="prefix">'
)


def test_a_file_of_another_robot_is_refused(tmp_path: Path) -> None:
    write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=3)
    result, file = load_result(tmp_path), tmp_path / "robot.urdf"
    file.write_text(urdf_of(PUBLISHED["ur5"]))
    with pytest.raises(InputError, match="its geometry is not that of the nominal robot ur10"):
        into_file(result, file)
    file.write_text(urdf_of(PUBLISHED["panda"]))
    with pytest.raises(InputError, match=r"no chain of 6 .*|its geometry is not"):
        into_file(result, file)
    with pytest.raises(InputError, match=r"there is no joint elbow. Joints that turn: j1, j2"):
        into_file(result, file, ["elbow"])
    with pytest.raises(InputError, match=r"j7 are not all joints that move from l0 .* are j1"):
        into_file(result, file, ["j1", "j2", "j4", "j5", "j6", "j7"])
    file.write_text("<!DOCTYPE robot><robot/>")
    with pytest.raises(InputError, match="holds <!DOCTYPE>, which is refused"):
        into_file(result, file)


def test_the_kinematics_of_ur_description_are_the_identified_ones(tmp_path: Path) -> None:
    write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=3)
    result = load_result(tmp_path)
    content = yaml.safe_load(exported(result, "ur-kinematics"))["kinematics"]
    assert content.pop("hash").startswith("calib_")
    assert list(content) == list(LINKS)
    origins = [
        (tuple(v[k] for k in "xyz"), tuple(v[k] for k in ("roll", "pitch", "yaw")))
        for v in content.values()
    ]
    q = np.random.default_rng(5).uniform(-3.0, 3.0, (100, 6))
    found = ur_chain(origins).tip_poses(q)
    assert np.abs(found - forward(result.chain, q).poses()).max() < EXACT
    assert content["forearm"]["x"] == pytest.approx(-0.612, abs=2e-3)
    assert content["wrist_1"]["z"] == pytest.approx(0.163941, abs=2e-3)
    write_pose_result(tmp_path / "p" / "calibration.yaml", "panda", seed=3)
    with pytest.raises(InputError, match="is the format of Universal Robots' arms"):
        exported(load_result(tmp_path / "p"), "ur-kinematics")


def test_the_command_writes_a_new_file_and_names_the_ranges(tmp_path: Path) -> None:
    write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=3)
    file, new = tmp_path / "robot.urdf", tmp_path / "new.urdf"
    file.write_text(urdf_of(PUBLISHED["ur10"]))
    code, said, _ = ballbar("export", tmp_path, "--into", file, "--out", new)
    assert code == 0
    assert re.search(r"j4: 0\.\d+ mm, \d\.\d+ mrad", said)
    assert "outside the fitted range of a joint" in said
    code, _, error = ballbar("export", tmp_path, "--into", file, "--to", "dh")
    assert (code, "give either --to FORMAT or --into FILE" in error) == (2, True)


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_corrected_targets_reach_the_nominal_poses(name: str, tmp_path: Path) -> None:
    write_pose_result(tmp_path / "calibration.yaml", name, seed=1)
    result = load_result(tmp_path)
    arm = result.calibration.identified_robot()
    q = np.array([[0.3, -0.7, 0.9, -1.1, 0.8, 0.6, 0.2]])[:, : result.robot.joints]
    if name == "panda":
        q[0, 5] = 1.6
    done = corrected_targets(arm, result.nominal, q)
    wanted = forward(nominal_chain(arm.robot), q)
    reached = forward(arm.chain, arm.joints(done.q))
    assert np.abs(reached.poses() - wanted.poses()).max() < EXACT
    assert done.position_before[0] > 1e-4
    header = ",".join(f"q{j + 1}" for j in range(result.robot.joints))
    far = q.copy()
    far[0, 0] = 2.4  # fitted to 2.0
    rows = [",".join(map(str, row)) for row in (*q, *far)]
    (tmp_path / "t.csv").write_text("\n".join([header, *rows, ""]))
    code, said, _ = ballbar("correct", tmp_path / "t.csv", "--with", tmp_path)
    assert code == 0
    assert "targets of line 3 are outside the fitted range of axis 1 (-114.6 to 114.6 deg)" in said
    written = np.loadtxt(tmp_path / "t-corrected.csv", delimiter=",", skiprows=1)
    assert np.abs(written[0] - done.q[0]).max() < 1e-12


def test_a_prediction_outside_the_fitted_range_warns_and_has_no_finite_sigma(
    result: Result,
) -> None:
    arm = result.calibration.identified_robot()
    q = np.zeros((2, result.robot.joints))
    q[1, 0] = 2.4
    with pytest.warns(UserWarning, match=r"outside the fitted range of axis 1 \(-114.6 to 114.6"):
        position = arm.tool(q)
    assert np.isfinite(position).all()
    assert arm.sigma(q)[1] == np.inf
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.tool(q[:1])
    with pytest.raises(InputError, match="target 'none': the result has big ball, frame"):
        result.calibration.identified_robot("none")


EDITED: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no target": (lambda d: d["targets"].clear(), "targets: expected at least 1 items, found 0"),
    "no seat": (lambda d: d["seats"].clear(), "seats: expected at least 1 items, found 0"),
    "target renamed": (
        lambda d: d["recordings"][0].update(target="big bal"),
        "recordings[0].target = 'big bal': not in `targets`. Did you mean big ball?",
    ),
    "no error": (
        lambda d: d["cross_validation"].update(sigma_m=0.0, mean_m=0.0),
        "cross_validation.mean_m = 0.0: expected more than 0",
    ),
    "parameter missing": (
        lambda d: d["parameters"].pop("rtheta3"),
        "parameters.rtheta3: missing of robot ur10",
    ),
    "parameter unknown": (
        lambda d: d["parameters"].update(ra7=d["parameters"]["ra2"].copy()),
        "parameters.ra7: no parameter that still poses tell of robot ur10",
    ),
    "range reversed": (
        lambda d: d["ranges"][0].update(lower_rad=2.0, upper_rad=-2.0),
        "ranges[0].lower_rad = 2.0: expected at most upper_rad, -2",
    ),
    "ranges too few": (lambda d: d["ranges"].pop(), "ranges of 5 joints, robot ur10 has 6"),
    "correction unknown": (
        lambda d: d["corrections"].update(magic={}),
        "corrections.magic: no correction of still poses. Valid names: gear_backlash, ",
    ),
}


@pytest.mark.parametrize(("edit", "said"), EDITED.values(), ids=EDITED.keys())
def test_a_result_that_was_edited_wrongly_is_refused_by_name(
    edit: Callable[[dict[str, Any]], Any], said: str, tmp_path: Path
) -> None:
    """Empty targets were a StopIteration, errors of 0 a division by zero."""
    file = write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=1)
    data = yaml.safe_load(file.read_text())
    edit(data)
    file.write_text(yaml.safe_dump(data, sort_keys=False))
    with pytest.raises(DescriptionError, match=re.escape(said)) as refusal:
        load(file)
    assert str(refusal.value).startswith(str(file))


def test_a_result_says_what_it_has_and_refuses_what_it_has_not(
    tmp_path: Path, result: Result
) -> None:
    loaded = load(result.file.parent)
    assert loaded.sigma.keys() == set(loaded.file.identified)
    assert loaded.ranges.shape == (loaded.robot.joints, 2)
    assert load(str(result.file)).targets.keys() == loaded.targets.keys()
    code, _, _ = ballbar("compare", tmp_path / "none", result.file)
    assert code == 2
    for use in (lambda: loaded.geometry, loaded.cell, lambda: loaded.encoders):
        with pytest.raises(InputError, match="is the result of still poses; here one of logs"):
            use()
    with pytest.raises(InputError, match="leave payload and tool out"):
        loaded.kinematics(tool=np.eye(4))


def test_joint_errors_that_were_kept_from_another_result_are_read_back(tmp_path: Path) -> None:
    """`identify --joint-errors RESULT` ended with a result that its reader refused."""
    first = load(write_pose_result(tmp_path / "a.yaml", "ur10", seed=1))
    data = yaml.safe_load(first.path.read_text())
    data["corrections"]["learned_harmonics"] = data["corrections"].pop("joint_harmonics")
    (tmp_path / "b.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    second = load(tmp_path / "b.yaml")
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 6))
    assert np.array_equal(second.identified_robot().tool(q), first.identified_robot().tool(q))
    assert second.joint_errors() == first.joint_errors()


def test_two_results_of_one_robot_are_compared_where_both_were_fitted(tmp_path: Path) -> None:
    first = load(write_pose_result(tmp_path / "a.yaml", "ur10", seed=1))
    same = compare(first, first)
    assert same.tcp.maximum < EXACT
    assert not any(same.z.values())
    changed = yaml.safe_load((tmp_path / "a.yaml").read_text())
    changed["parameters"]["rtheta4"]["value"] += 1e-3
    changed["ranges"][2] |= {"lower_rad": -0.5, "upper_rad": 0.2}
    (tmp_path / "b.yaml").write_text(yaml.safe_dump(changed, sort_keys=False))
    code, said, _ = ballbar("compare", tmp_path / "a.yaml", tmp_path / "b.yaml")
    assert code == 0
    assert "rtheta4 -1.0000 mrad (z -35.4)" in said, "1 mrad over sqrt(2) times 20 urad"
    assert "less than half of the fitted range is common: axes 3" in said
    second = load(tmp_path / "b.yaml")
    tcp = compare(first, second).tcp
    assert 2e-5 < tcp.mean < 1e-3
    code, said, _ = ballbar("compare", tmp_path / "a.yaml", tmp_path / "b.yaml", "--json")
    assert json.loads(said)["tcp_difference"]["mean_m"] == pytest.approx(tcp.mean)
    other = load(write_pose_result(tmp_path / "c.yaml", "ur5", seed=1))
    with pytest.raises(InputError, match="Compare calibrations of the same robot"):
        compare(first, other)


def result_and_poses(folder: Path, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A stored result of a ur10, angles (N, 6) [rad] and the table measured of it unchanged."""
    rng = np.random.default_rng(6)
    result = load_result(write_pose_result(folder / "calibration.yaml", "ur10", seed=1))
    arm = result.calibration.identified_robot("big ball")
    drawn = replace(drawn_robot("ur10", rng), chain=arm.chain)
    q = rng.uniform(-1.5, 1.5, (count, 6))
    return q, point_table(drawn, arm.joints(q), 3e-5, rng, target=arm.target.origin)


@pytest.mark.parametrize(
    ("name", "difference", "z", "notable"),
    [
        ("ra2", 4e-6, 30.0, False),
        ("ra2", 6e-6, 3.1, True),
        ("ra2", 6e-4, 2.9, False),
        ("rtheta3", -2e-5, -30.0, False),
        ("rtheta3", -3e-5, -3.1, True),
    ],
)
def test_parameters_differ_by_deviations_and_by_a_size_that_matters(
    name: str, difference: float, z: float, notable: bool
) -> None:
    assert is_notable(name, difference, z) == notable


def test_the_command_verifies_with_an_exit_code(tmp_path: Path) -> None:
    q, table = result_and_poses(tmp_path / "r", 10)
    write_pose_table(tmp_path / "same", table, "ur10", q, "big ball")
    code, said, _ = ballbar("verify", tmp_path / "r", tmp_path / "same")
    assert (code, said.startswith("Holds: 10 poses to 0.0")) == (0, True), said
    q[:, 3] -= 2e-3
    write_pose_table(tmp_path / "changed", table, "ur10", q, "big ball")
    code, said, _ = ballbar("verify", tmp_path / "r", tmp_path / "changed", "--json")
    data = json.loads(said)
    assert code == 1
    assert data["sentence"].startswith("Changed since: zero of axis 4 by +")
    assert data["causes"][0]["size"][0] == pytest.approx(2e-3, abs=1e-4)
    write_pose_table(tmp_path / "other", table, "ur5", q, "big ball")
    code, _, error = ballbar("verify", tmp_path / "r", tmp_path / "other")
    assert (code, "is of robot" in error) == (2, True)
    own = tmp_path / "same" / "mine.yaml"  # of the same title; 50 mm of a link made no difference
    own.write_text((SHIPPED / "ur10.yaml").read_text().replace("-0.612,", "-0.662,"))
    described = tmp_path / "same" / "poses.yaml"
    described.write_text(described.read_text().replace("robot: ur10", "robot: mine.yaml"))
    code, _, error = ballbar("verify", tmp_path / "r", tmp_path / "same")
    assert (code, "is of robot mine.yaml" in error) == (2, True)


def test_verifying_says_which_poses_were_left_out_and_doubts_a_misfit(tmp_path: Path) -> None:
    """A row without its position was left out, and not a word said of it."""
    q, table = result_and_poses(tmp_path / "r", 11)
    folder = write_pose_table(tmp_path / "t", table, "ur10", q, "big ball")
    (poses,) = folder.glob("*.csv")
    lines = poses.read_text().splitlines()
    lines[3] = lines[3].rsplit(",", 1)[0] + ",nan"
    poses.write_text("\n".join(lines) + "\n")
    code, said, error = ballbar("verify", tmp_path / "r", folder, "--json")
    data = json.loads(said)
    assert (code, data["poses"]) == (0, 10), error
    assert "row left out" in data["warnings"][-1]
    file = tmp_path / "r" / "calibration.yaml"
    file.write_text(re.sub(r"status: \w+", "status: misfit", file.read_text()))
    code, said, error = ballbar("verify", tmp_path / "r", folder)
    assert (code, said.split(";")[0]) == (
        2,
        'Not comparable: the stored result\'s own verdict is "misfit", so identify the robot again',
    )


def test_identify_writes_a_replay_where_it_is_requested(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    drawn = drawn_robot("ur10", rng)
    q = drawn.angles(60, rng)
    folder = write_pose_table(tmp_path / "t", point_table(drawn, q, 3e-5, rng), "ur10", q, "ball")
    words = ("identify", folder, "--joint-errors", "none", "--rerun", "--out")
    for name in ("a", "b"):
        code, _, error = ballbar(*words, tmp_path / name)
        assert code == 0, error
    first = (tmp_path / "a" / "run.rrd").stat().st_size
    assert first > 50_000
    copy = tmp_path / "copy.rrd"
    code, _, _ = ballbar("replay", tmp_path / "a", "--save", copy)
    assert code == 0
    assert copy.stat().st_size == first


def test_an_option_that_is_not_of_what_is_fitted_is_refused(
    recorded: Recorded, tmp_path: Path
) -> None:
    drawn = drawn_robot("ur10", rng := np.random.default_rng(7))
    q = drawn.angles(60, rng)
    poses = write_pose_table(tmp_path / "t", point_table(drawn, q, 3e-5, rng), "ur10", q, "ball")
    out = ("--out", tmp_path / "out")
    code, _, error = ballbar("identify", poses, "--model", "dh", "--samples", 300, *out)
    assert code == 2
    assert f"{poses}: gives poses, and these settings are of a ball-bar's logs: model, sam" in error
    for folders in ([recorded.folder], [poses, recorded.folder]):
        code, _, error = ballbar("identify", *folders, "--joint-errors", "none", *out)
        assert code == 2
        assert (
            "recording: is a recording, and joint errors are chosen for still poses alone" in error
        )
    assert not (tmp_path / "out").exists()


def test_the_drawn_arm_runs_along_the_rows_of_the_robot(result: Result) -> None:
    from ballbar.report.shapes import robot_bodies  # noqa: PLC0415

    chain = result.chain
    base, *links = robot_bodies(chain)
    assert len(links) == chain.rows
    assert base[0].start.tolist() == [0.0, 0.0, 0.0]
    for row, link in enumerate(links[1:], start=1):  # the first begins above the base
        along = [bar.length for bar in link if bar.capped]
        expected = [length for length in np.abs([chain.d[row], chain.a[row]]) if length > 0.02]
        assert along[: len(expected)] == pytest.approx(expected, abs=EXACT)
        ends = [bar.end for bar in link if bar.capped]
        assert not ends or np.abs(ends[-1]).max() < EXACT or abs(chain.a[row]) < 0.02


def test_a_replay_is_asked_for_what_there_is(tmp_path: Path) -> None:
    write_pose_result(tmp_path / "calibration.yaml", "ur10", seed=1)
    code, _, error = ballbar("replay", tmp_path)
    assert code == 2
    assert "no replay file" in error
