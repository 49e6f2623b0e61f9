"""`ballbar robot new` and `show`: what is written is the robot of the source, or nothing is."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.chain import Chain, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.robot_file import new_robot
from tests.helpers.command_line import ballbar
from tests.helpers.published_urdf import PUBLISHED, Joint, tip_pose, turn
from tests.helpers.urdf_files import Mass, urdf_text

PNG = b"\x89PNG\r\n\x1a\n"
OFFSETS = (  # 6R with an offset at every joint and skew axes
    Joint((0.02, -0.01, 0.4), (0, 0, 1), (0.0, 0.0, 0.4)),
    Joint((0.1, 0.05, 0.1), (0, 1, 0), (0.3, 0.0, 0.2)),
    Joint((0.0, 0.03, 0.6), (0, 1, 0), (0.0, 0.5, 0.0)),
    Joint((0.2, -0.02, 0.1), (1, 0, 0), (0.4, -0.6, 0.7)),
    Joint((0.3, 0.01, 0.0), (0.0, 0.6, 0.8)),
    Joint((0.1, 0.0, 0.05), (1, 0, 0)),
    Joint((0.08, 0.02, 0.0), None, (0.1, 0.2, 0.3)),
)
CSV = """# UR5
a_mm;d_mm;alpha_deg;theta_deg;lower_deg;upper_deg;speed_deg_per_s
0;89.159;90;0;-360;360;180
-425;0;0;0;-360;360;180
-392.25;0;0;0;-180;180;180
0;109.15;90;0;-360;360;180
0;94.65;-90;0;-360;360;180
0;82.3;0;0;-360;360;180
"""
PANDA = """convention: modified
rows:
  - {a_m: 0, d_m: 0.333, alpha_rad: 0, theta_rad: 0}
  - {a_m: 0, d_m: 0, alpha_deg: -90, theta_deg: 0}
  - {a_m: 0, d_m: 0.316, alpha_deg: 90, theta_deg: 0}
  - {a_m: 0.0825, d_m: 0, alpha_deg: 90, theta_deg: 0}
  - {a_mm: -82.5, d_mm: 384, alpha_deg: -90, theta_deg: 0}
  - {a_m: 0, d_m: 0, alpha_deg: 90, theta_deg: 0}
  - {a_m: 0.088, d_m: 0, alpha_deg: 90, theta_deg: 0}
  - {joint: fixed, a_m: 0, d_m: 0.107, alpha_deg: 0, theta_deg: 0}
"""


def flange(robot: Robot, axes: np.ndarray) -> np.ndarray:
    chain = Chain(robot.a, robot.d, robot.alpha, robot.theta, np.zeros(robot.joints))
    return forward(chain, controller_to_joints(robot, axes)[None]).poses()[0]


def made(folder: Path, joints: tuple[Joint, ...], *words: object, **options: object) -> Robot:
    """The robot that the command makes of a URDF with these joints."""
    urdf = folder / "arm.urdf"
    urdf.write_text(urdf_text(joints, **options))  # type: ignore[arg-type]
    code, _, err = ballbar(
        "robot", "new", "arm", "--urdf", urdf, "--out", folder / "arm.yaml", *words
    )
    assert code == 0, err
    return load_robot(str(folder / "arm.yaml"))


@pytest.mark.parametrize("name", ["ur10e", "kr210", "m20ia", "gp25", "panda"])
def test_a_urdf_becomes_a_robot_with_the_same_flange(name: str, tmp_path: Path) -> None:
    joints = PUBLISHED[name].joints
    robot = made(tmp_path, joints)
    for axes in np.random.default_rng(1).uniform(-3.0, 3.0, (3, robot.joints)):
        # 1e-6: angles printed with seven digits are taken as quarter turns
        np.testing.assert_allclose(flange(robot, axes), tip_pose(joints, axes), atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(robot.axis_lower[0]), np.rad2deg(-2.0), atol=1e-3)
    np.testing.assert_allclose(robot.axis_speed_max, 3.0, rtol=1e-5)
    assert (tmp_path / "arm.png").read_bytes().startswith(PNG)


def test_a_general_base_and_tool_are_stated_and_complete_the_pose(tmp_path: Path) -> None:
    wall = (Joint((0.1, 0.2, 0.9), (0, 0, 1), (0.0, np.pi / 2, 0.3)), *OFFSETS[1:])
    urdf, file = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    urdf.write_text(urdf_text(wall))
    code, out, err = ballbar("robot", "new", "arm", "--urdf", urdf, "--out", file, "--json")
    assert code == 0, err
    data, robot = json.loads(out), load_robot(str(file))
    assert data["largest_difference_m"] < 1e-9
    assert data["largest_difference_rad"] < 1e-9
    axes = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
    pose = np.array(data["T_base_dh"]) @ flange(robot, axes) @ np.array(data["T_flange_tip"])
    np.testing.assert_allclose(pose, tip_pose(wall, axes), atol=1e-10)
    text = file.read_text()
    assert "# T_base_dh, pose of the frame of row 1" in text
    assert "# T_flange_tip, pose of the source's tip" in text
    # upright in the URDF's base: axis 1 is horizontal, so gravity is square to it
    np.testing.assert_allclose(np.linalg.norm(robot.gravity), 9.81)
    assert abs(robot.gravity[2]) < 1e-9


def test_what_is_printed_names_the_check_and_all_that_is_missing(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf_text(OFFSETS, limits=False))
    code, out, _ = ballbar("robot", "new", "arm", "--urdf", urdf, "--out", tmp_path / "arm.yaml")
    assert code == 0
    assert "Check: largest difference to the source at 100 random poses" in out
    assert "T_flange_tip: rotation and m" in out
    for missing in ("limits of axis 1, 2, 3, 4, 5, 6", "axis_speed_max", "links (masses)", "gears"):
        assert missing in out
    assert "ballbar robot show" in out
    robot = load_robot(str(tmp_path / "arm.yaml"))
    np.testing.assert_allclose(robot.axis_upper, np.pi)
    assert np.isinf(robot.axis_speed_max).all()


def test_masses_of_a_urdf_are_in_the_robot_base_frame(tmp_path: Path) -> None:
    mass = Mass(3.0, (0.02, -0.03, 0.04), (0.02, 0.03, 0.04), rpy=(0.1, 0.2, 0.3))
    wall = Joint((0.1, 0.2, 0.9), (0, 0, 1), (0.0, np.pi / 2, 0.0))
    joints = (wall, *PUBLISHED["irb120"].joints[1:])
    robot = made(tmp_path, joints, masses=[mass] * 8)
    links = robot.required("links")
    # com of link 1 in the URDF's base, then in the frame of row 1: here by the text's own matrix
    in_base = tip_pose(joints[:1], [0.0]) @ [*mass.com, 1.0]
    rows = [line for line in (tmp_path / "arm.yaml").read_text().splitlines() if "#   [" in line]
    T_base_dh = np.array([json.loads(line[1:]) for line in rows[:3]])
    com = T_base_dh[:, :3].T @ (in_base[:3] - T_base_dh[:, 3])
    np.testing.assert_allclose(links[1].com, com, atol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(links[1].inertia), [0.02, 0.03, 0.04], atol=1e-9)
    assert links[6].mass == 6.0  # link 6 and the flange frame
    # gravity pulls along the same direction of the body as in the URDF
    np.testing.assert_allclose(T_base_dh[:, :3] @ robot.gravity, [0.0, 0.0, -9.81], atol=1e-9)


def test_the_name_of_a_joint_cannot_end_the_comment_it_stands_in(tmp_path: Path) -> None:
    """PyYAML, too, ends a line at U+2028; what followed stood in the file as a key."""
    urdf, file = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    text = urdf_text(PUBLISHED["irb120"].joints, name="arm &#10;dh: 3")
    urdf.write_text(text.replace('name="joint1"', 'name="j&#8232;title: x&#10;links: 3"'))
    code, _, err = ballbar("robot", "new", "arm", "--urdf", urdf, "--out", file)
    assert code == 0, err
    assert load_robot(str(file)).title == "arm dh: 3"


@pytest.mark.parametrize(("text", "name"), [(CSV, "ur5"), (PANDA, "panda")])
def test_a_table_of_standard_or_modified_rows(text: str, name: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    code, _, err = ballbar("robot", "new", "mine", *_table(tmp_path, text), "--out", file)
    assert code == 0, err
    robot, shipped = load_robot(str(file)), load_robot(name)
    for key in ("a", "d", "alpha", "theta"):
        np.testing.assert_allclose(getattr(robot, key), getattr(shipped, key), atol=1e-15)
    for key in ("axis_lower", "axis_upper", "axis_speed_max") if name == "ur5" else ():
        np.testing.assert_allclose(getattr(robot, key), getattr(shipped, key), atol=1e-15)


def test_first_modified_row_and_a_tilted_flange_stay_outside_the_rows(tmp_path: Path) -> None:
    table, file = tmp_path / "t.yaml", tmp_path / "mine.yaml"
    first, flange_row = "a_m: 0, d_m: 0.333, alpha_rad: 0", "d_m: 0.107, alpha_deg: 0, theta_deg: 0"
    text = PANDA.replace(first, "a_m: 0.05, d_m: 0.333, alpha_rad: 0.2")
    table.write_text(text.replace(flange_row, "d_m: 0.107, alpha_deg: 30, theta_deg: 45"))
    code, out, err = ballbar("robot", "new", "mine", "--dh", table, "--out", file, "--json")
    assert code == 0, err
    data, robot = json.loads(out), load_robot(str(file))
    assert data["largest_difference_m"] < 1e-12
    quarter = np.pi / 2
    rows = [(0.05, 0.2, 0.333), (0, -quarter, 0), (0, quarter, 0.316), (0.0825, quarter, 0)]
    rows += [(-0.0825, -quarter, 0.384), (0, quarter, 0), (0.088, quarter, 0)]
    joints = [
        joint
        for a, alpha, d in rows
        for joint in (Joint((a, 0, 0), None, (alpha, 0, 0)), Joint((0, 0, d), (0, 0, 1)))
    ]
    end = turn((1, 0, 0), np.pi / 6) @ turn((0, 0, 1), np.pi / 4)
    end[:3, 3] += 0.107 * end[:3, 2]
    axes = np.linspace(-0.6, 0.7, 7)
    pose = np.array(data["T_base_dh"]) @ flange(robot, axes) @ np.array(data["T_flange_tip"])
    np.testing.assert_allclose(pose, tip_pose(joints, axes) @ end, atol=1e-12)


def _urdf(folder: Path, text: str) -> list[object]:
    file = folder / "bad.urdf"
    file.write_text(text)
    return ["--urdf", file]


def _table(folder: Path, text: str) -> list[object]:
    file = folder / ("bad.yaml" if text.startswith(("convention", "rows", "-")) else "bad.csv")
    file.write_text(text)
    return ["--dh", file]


HEAD = "a_mm,d_mm,alpha_deg,theta_deg\n"
ROWS = HEAD + "0,100,90,0\n" * 6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot", "not valid XML"),
        (urdf_text(OFFSETS[:4]), "4 turning joints; a robot has 5 to 8"),
        (urdf_text((*OFFSETS[:6], *OFFSETS[:3])), "9 turning joints; a robot has 5 to 8"),
        (urdf_text((*OFFSETS, Joint((9.0, 0, 0), None))), "d of row 6 is .* m, beyond 5 m"),
        (
            urdf_text((*OFFSETS[:2], Joint((0, 0, 0.6), (0, 1, 1e-3)), *OFFSETS[3:])),
            "axes 2 and 3 are 0.0573 deg from parallel",
        ),
        (
            urdf_text((Joint((0, 0, 1), (0, 0, 1), (0, 0, 0.05)), *PUBLISHED["irb120"].joints[1:])),
            "theta of row 1 is 2.86479 deg. Nominal angles below 7 deg are refused",
        ),
    ],
)
def test_a_urdf_that_has_no_description_writes_nothing(
    text: str, message: str, tmp_path: Path
) -> None:
    _refused(tmp_path, _urdf(tmp_path, text), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the table is empty"),
        (HEAD, "the table has no rows"),
        (ROWS.replace("a_mm", "a"), r"bad\.csv:2: unknown column a\."),
        (ROWS.replace("a_mm", "d_mm"), r"bad\.csv:1: a column stands here twice"),
        (ROWS.replace(",theta_deg", ",d_m"), r"bad\.csv:2: d_m and d_mm state the same"),
        (ROWS.replace(",theta_deg", ",joint"), r"bad\.csv:2: no theta_deg or theta_rad"),
        (ROWS.replace("0,100,90,0", "0,1e2,90", 1), r"bad\.csv:2: 3 values below 4 columns"),
        (ROWS.replace("0,100,90,0", "0,ten,90,0", 1), r"bad\.csv:2: d_mm = 'ten' is no number"),
        (ROWS.replace("0,100,90,0", "0,inf,90,0", 1), r"bad\.csv:2: d_mm = 'inf' is no number"),
        (ROWS.replace("_mm", "_m"), "d of row 1 is 100 m, beyond 5 m"),
        (ROWS.replace("90,0", "1.5708,0"), "alpha of row 1 is 1.5708 deg"),
        ("convention: craig\nrows:\n  - {a_m: 0, d_m: 0, alpha_deg: 0, theta_deg: 0}\n",
         "convention craig; expected one of standard, modified"),
        ("rows: 3\n", "expected `rows:` with one line"),
        ("rows:\n  - 3\n", "expected `rows:` with one line"),
        ("convention: modified\ntable: 3\n", r"bad\.yaml:2: unknown key table"),
        (PANDA.replace("{a_m: 0, d_m: 0.333", "{joint: fixed, a_m: 0, d_m: 0.333"),
         r"bad\.yaml:3: only the last row may be fixed"),
        (PANDA.replace("alpha_deg: -90", "alpha_deg: true", 1), r"yaml:4: .*True is no number"),
    ],
)  # fmt: skip
def test_a_wrong_table_is_refused_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    _refused(tmp_path, _table(tmp_path, text), message)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "name one source: --urdf FILE"),
        (["--urdf", "no.urdf"], "no.urdf: no such file"),
        (["--urdf", "."], "it is no regular file"),
        (["--urdf", "a.urdf", "--dh", "a.csv"], "name one source"),
        (["--dh", "a.csv", "--tip", "tool0"], "name one source"),
    ],
)
def test_wrong_words_are_refused(words: list[str], message: str, tmp_path: Path) -> None:
    _refused(tmp_path, words, message)


def _refused(folder: Path, words: list[object], message: str) -> None:
    file = folder / "arm.yaml"
    code, _, err = ballbar("robot", "new", "arm", "--out", file, *words)
    assert code == 2
    assert re.search(message, err.replace("\n", " ")), err
    assert not file.exists()
    assert not file.with_suffix(".png").exists()


def test_a_pipe_is_no_urdf(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.urdf"
    os.mkfifo(pipe)
    _refused(tmp_path, ["--urdf", pipe], "it is no regular file")


def test_a_file_that_is_too_large_or_not_text_is_refused(tmp_path: Path) -> None:
    large = tmp_path / "large.urdf"
    large.write_bytes(b" " * 10_000_001)
    _refused(tmp_path, ["--urdf", large], "larger than 10 MB. Name the URDF")
    large.write_bytes(b"<robot>\n\xff\xfe</robot>")
    _refused(tmp_path, ["--urdf", large], r"large\.urdf:2: byte 0xff is not UTF-8")


def test_a_file_that_exists_is_not_replaced(tmp_path: Path) -> None:
    made(tmp_path, OFFSETS)
    before = (tmp_path / "arm.yaml").read_bytes()
    words = ["robot", "new", "arm", "--urdf", tmp_path / "arm.urdf", "--out"]
    code, _, err = ballbar(*words, tmp_path / "arm.yaml")
    assert (code, "exists already" in err) == (2, True)
    (tmp_path / "other.png").write_bytes(b"mine")
    code, _, err = ballbar(*words, tmp_path / "other.yaml")
    assert (code, "other.png: exists already" in err) == (2, True)
    assert (tmp_path / "arm.yaml").read_bytes() == before
    code, _, err = ballbar(*words, tmp_path / "arm.txt")
    assert (code, "ends in .yaml" in err) == (2, True)
    code, _, err = ballbar("robot", "new", "../arm", "--urdf", tmp_path / "arm.urdf")
    assert (code, "use letters, digits" in err) == (2, True)


def test_a_description_that_differs_from_its_source_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(new_robot, "difference", lambda *_: (2e-9, 0.0))
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf_text(OFFSETS))
    code, _, err = ballbar("robot", "new", "arm", "--urdf", urdf, "--out", tmp_path / "arm.yaml")
    assert code == 1
    assert "differs from its source by 2e-09 m" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.urdf"]


@pytest.mark.parametrize("name", ["panda", "irb2400"])
def test_a_robot_is_shown_as_a_replay_file(name: str, tmp_path: Path) -> None:
    file = tmp_path / "robot.rrd"
    code, _, err = ballbar("robot", "show", name, "--save", file)
    assert code == 0, err
    assert file.stat().st_size > 10_000
    assert file.read_bytes()[:3] == b"RRF"
    code, _, err = ballbar("robot", "show", "pandora")
    assert (code, "unknown robot 'pandora'. Did you mean" in err) == (2, True)
