"""`ballbar new` of one table that holds a robot's log and that of what followed its tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ballbar.acquisition.recording import Recording, read_recording
from tests.helpers.command_line import ballbar, output, refusal
from tests.helpers.followed_robot import FollowedRobot
from tests.helpers.terminal import at_the_terminal

EPOCH = 1_720_702_091 * 10**9  # [ns]
SECONDS = 5.0
JOINTS = [f"joint_{k}" for k in range(1, 7)]
TARGET = [f"pv_{c}" for c in "xyz"] + [f"ov_{c}" for c in "xyzw"]
OWN = [f"ps_{c}" for c in "xyz"] + [f"os_{c}" for c in "xyzw"]  # the controller's own pose
COLUMNS = ["timestamp", "sec", "nanosec", *TARGET, *OWN, *JOINTS]
SAID = ["--robot", "ur10e", "--instrument", "tracker_pose", "--yes"]


def table(
    file: Path,
    robot: FollowedRobot,
    *,
    seconds: float = SECONDS,
    unit: float = 1e-3,
    own: bool = True,
) -> Path:
    """A table whose rows fill the columns of one signal each, in the order of their arrival.

    unit : [m] of positions. own : whether the controller's pose is among the signals.
    """
    t = np.arange(round(seconds * 250.0)) / 250.0
    logged = np.rad2deg(robot.logged(t))
    rows = [(EPOCH + round(s * 1e9), JOINTS, q) for s, q in zip(t, logged, strict=True)]
    if own:
        rows += [(at + 300_000, OWN, np.append(q[:3], [0, 0, 0, 1])) for at, _, q in rows]
    t = np.arange(round((seconds - 1.0) * 200.0)) / 200.0
    pose = robot.measured(t, pose=True)
    values = np.hstack((pose[:, :3] / unit, Rotation.from_rotvec(pose[:, 3:]).as_quat()))
    stamps = EPOCH + 17 * 10**9 + np.rint(t * 1e9).astype(np.int64)
    for stamp, value in zip(stamps.tolist(), values, strict=True):
        own_stamp = [f"{stamp // 10**9}.0", f"{stamp % 10**9}.0", *value]
        rows.append((stamp - 17 * 10**9 + 1_700_000, ["sec", "nanosec", *TARGET], own_stamp))
    lines = [",".join(COLUMNS)]
    for at, names, cells in sorted(rows, key=lambda row: row[0]):
        filled = dict(zip(names, cells, strict=True), timestamp=at)
        lines.append(",".join(str(filled.get(name, "")) for name in COLUMNS))
    file.write_text("\n".join(lines) + "\n")
    return file


@pytest.fixture(scope="module")
def robot() -> FollowedRobot:
    return FollowedRobot(seed=2)


@pytest.fixture(scope="module")
def log(robot: FollowedRobot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return table(tmp_path_factory.mktemp("log") / "cell.csv", robot)


def tracked(recording: Recording) -> np.ndarray:
    assert recording.tracker_log is not None
    return recording.tracker_log.values


def test_three_options_make_a_folder_that_reads_as_two_plain_tables_do(
    robot: FollowedRobot, log: Path, tmp_path: Path
) -> None:
    made = tmp_path / "made"
    out = output("new", made, log, *SAID, "--values", ",".join(TARGET))
    assert "unit of pv_x, pv_y, pv_z? (m, cm, mm, um, inch) mm" in out
    sources = yaml.safe_load((made / "recording.yaml").read_text())["sources"]
    assert [one["files"] for one in sources.values()] == [["raw/cell.csv"]] * 2
    assert sources["tracker"]["rotation"] == {"columns": TARGET[3:], "form": "quat_xyzw"}
    dialects = [yaml.safe_load((made / one["dialect"]).read_text()) for one in sources.values()]
    times = [dialect["time"] for dialect in dialects]
    assert times == [
        {"column": "timestamp", "forms": ["unix-ns"]},
        {"column": "sec", "nanoseconds": "nanosec", "forms": ["unix-ns"]},
    ]
    read, plain = (
        read_recording(made),
        read_recording(robot.write(tmp_path / "plain", seconds=SECONDS, pose=True)),
    )
    np.testing.assert_allclose(read.robot_log.q, plain.robot_log.q, atol=1e-8)
    np.testing.assert_allclose(read.robot_log.t, plain.robot_log.t, atol=1e-9)
    np.testing.assert_allclose(tracked(read), tracked(plain), atol=1e-8)


def test_the_controllers_own_pose_is_not_taken_for_the_target(log: Path, tmp_path: Path) -> None:
    """Two signals look like poses: neither is proposed."""
    err = refusal("new", tmp_path / "made", log, *SAID)
    assert f"Likely ones: {', '.join(TARGET)}; or {', '.join(OWN)}." in " ".join(err.split())
    assert not (tmp_path / "made").exists()


def test_what_alone_looks_like_a_pose_is_proposed(robot: FollowedRobot, tmp_path: Path) -> None:
    log = table(tmp_path / "cell.csv", robot, unit=1.0, own=False)
    log.write_text(log.read_text().replace("ps_", "ps").replace("os_", "os"))
    out = output("new", tmp_path / "made", log, *SAID)
    assert "unit of pv_x, pv_y, pv_z? (m, cm, mm, um, inch) m\n" in out


def test_columns_of_both_signals_may_be_named(log: Path, tmp_path: Path) -> None:
    words = [*SAID, "--values", ",".join(TARGET)]
    for joints, message in (
        (",".join(JOINTS[:4]), "4 columns; expected one for each axis, 5 to 8"),
        (",".join([*JOINTS[:5], "joint_7"]), "'joint_7' is no column"),
    ):
        assert message in refusal("new", tmp_path / "made", log, *words, "--joints", joints)
    words += ["--joints", ",".join(JOINTS), "--value-unit", "mm"]
    assert "degrees" in refusal("new", tmp_path / "rad", log, *words, "--joint-unit", "rad")
    output("new", tmp_path / "made", log, *words, "--joint-unit", "deg")


def test_columns_of_a_target_are_no_option_of_a_ball_bar(log: Path, tmp_path: Path) -> None:
    words = ["--robot", "ur10e", "--ballbar", "lund_600", "--yes", "--values", "pv_x,pv_y,pv_z"]
    assert "they are of a tracker, and lund_600 held the tool" in refusal(
        "new", tmp_path / "made", log, log, *words
    )


def test_a_point_and_another_order_of_the_quaternion_are_asked_for(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned = [*TARGET[:3], TARGET[6], *TARGET[3:6]]
    replies = {"which columns hold x": ", ".join(turned), "unit of": "mm"}

    def reply(question: str, _proposal: str | None) -> str | None:
        return next((a for part, a in replies.items() if part in question), None)

    at_the_terminal(monkeypatch, reply)
    output("new", tmp_path / "pose", log, *SAID[:-1])
    sources = yaml.safe_load((tmp_path / "pose/recording.yaml").read_text())["sources"]
    assert sources["tracker"]["rotation"] == {"columns": turned[3:], "form": "quat_wxyz"}
    replies["which columns hold x"] = ", ".join(TARGET[:3])
    output("new", tmp_path / "point", log, *SAID[:2], "--instrument", "tracker_point")
    sources = yaml.safe_load((tmp_path / "point/recording.yaml").read_text())["sources"]
    assert "rotation" not in sources["tracker"]


@pytest.mark.long
def test_the_folder_is_checked_aligned_and_identified(robot: FollowedRobot, tmp_path: Path) -> None:
    made, log = tmp_path / "made", table(tmp_path / "cell.csv", robot, seconds=20.0)
    output("new", made, log, *SAID, "--values", ",".join(TARGET))
    assert "tracker log: 3800 samples" in output("check", made)
    words = ["--source-a", "robot", "--source-b", "tracker"]
    assert ballbar("align", made, made, *words)[0] in (0, 1)
    output("identify", made, "--out", tmp_path / "out")
    assert (tmp_path / "out/calibration.yaml").exists()
