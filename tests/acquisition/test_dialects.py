"""Dialects of the user's own: columns by name, expression or number, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import DescriptionError, LogError
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.cell.selectors import find, spread, why_not
from tests.helpers.device_logs import ROBOT, ROBOT_T, joint_trajectory, put, write

AXES_DEG = np.rad2deg(joints_to_axes(ROBOT, joint_trajectory(ROBOT_T)))
OWN = {
    "schema": "ballbar-dialect/1",
    "source": "robot",
    "separators": [";"],
    "time": {"column": "t", "type": "float", "unit": "ms"},
    "axes": [f"A{k}" for k in range(1, 7)],
    "angle_unit": "deg",
    "period_s": [0.001, 0.1],
}


def own(tmp_path: Path, lines: list[str], **changes: object) -> Path:
    """A recording whose robot log is read by its own dialect file."""
    folder = write(
        tmp_path, robot=lines, change=put("sources", "robot", "dialect", value="logger.yaml")
    )
    (folder / "logger.yaml").write_text(yaml.safe_dump(OWN | changes, sort_keys=False))
    return folder


def rows(
    separator: str, *, comma: bool = False, order: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
) -> list[str]:
    table = np.column_stack((ROBOT_T * 1e3, AXES_DEG[:, order]))
    lines = [separator.join(f"{value:.12f}" for value in row) for row in table.tolist()]
    return [line.replace(".", ",") for line in lines] if comma else lines


def assert_read(folder: Path) -> None:
    log = read_recording(folder).robot_log
    np.testing.assert_allclose(log.q, joint_trajectory(ROBOT_T), atol=1e-12)
    np.testing.assert_allclose(log.t, ROBOT_T, atol=1e-9)


def test_columns_by_name_with_decimal_commas(tmp_path: Path) -> None:
    assert_read(own(tmp_path, ["t;A1;A2;A3;A4;A5;A6", *rows(";", comma=True)], decimal="comma"))
    lines = ["t;A1;A2;A3;A4;A5;A6", *rows(";")]
    with pytest.raises(
        LogError, match=r"raw/robot.csv: column t has decimal points .*declares decimal commas"
    ):
        read_recording(
            own(
                tmp_path,
                [*lines[:9], lines[9].replace(";", ";9,", 1), *lines[10:]],
                decimal="comma",
            )
        )


def test_six_columns_by_one_expression_in_the_order_of_their_names(tmp_path: Path) -> None:
    head = "t;" + ";".join(f"Robot/Axis {k} position [deg]" for k in (2, 1, 3, 6, 5, 4))
    lines = [head, *rows(";", order=(1, 0, 2, 5, 4, 3))]
    assert_read(own(tmp_path, lines, axes=[r"re:Axis \d position"]))
    with pytest.raises(LogError, match=r"raw/robot.csv:1: re:Axis .* finds 3 columns, not 6"):
        read_recording(own(tmp_path, lines, axes=["re:Axis [123] position"]))


def test_columns_by_number_need_no_header(tmp_path: Path) -> None:
    changes = {
        "time": {"column": "#1", "type": "float", "unit": "ms"},
        "axes": [f"#{k}" for k in range(2, 8)],
    }
    assert_read(own(tmp_path, rows(";"), **changes))
    assert_read(own(tmp_path, ["t;a;b;c;d;e;f", *rows(";")], **changes))
    with pytest.raises(LogError, match=r"raw/robot.csv:1: column #9 missing"):
        read_recording(
            own(tmp_path, rows(";"), **(changes | {"axes": [f"#{k}" for k in (2, 3, 4, 5, 6, 9)]}))
        )


def test_columns_apart_by_blanks(tmp_path: Path) -> None:
    lines = ["  t   A1 A2  A3 A4 A5 A6", *("   " + line for line in rows("  "))]
    assert_read(own(tmp_path, lines, separators=[" "]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axes": ["A1", "A2"]}, "axes: one column for each axis, 5 to 8, or one `re:`"),
        ({"motors": [f"m{k}" for k in range(6)]}, "names one of motors, axes and joints"),
        ({"axes": ["re:(a+)+$"]}, "repeated groups and more than 3"),
        ({"axes": ["re:.*.*.*.*x"]}, "repeated groups and more than 3"),
        ({"axes": ["re:["]}, "is no regular expression"),
        ({"time": {"column": "#0", "unit": "s"}}, "'#0' is no column number"),
        ({"time": {"column": "t"}}, "give either unit, or forms to tell apart"),
        ({"time": {"column": "t", "unit": "fortnight"}}, "time.unit"),
        ({"separators": []}, "separators: name at least one"),
        ({"source": "ballbar"}, "are a robot's"),
        ({"speeds": ["v1"]}, "unknown key speeds"),
    ],
)
def test_a_dialect_that_cannot_be_followed_is_refused(
    tmp_path: Path, changes: dict, message: str
) -> None:
    with pytest.raises(DescriptionError, match=r"logger.yaml") as caught:
        read_recording(own(tmp_path, ["t;A1", "0;1"], **changes))
    assert message in str(caught.value)


def test_a_dialect_file_lies_in_the_recording_folder(tmp_path: Path) -> None:
    folder = tmp_path / "recording"
    folder.mkdir()
    (tmp_path / "logger.yaml").write_text(yaml.safe_dump(OWN))
    for name in ("../logger.yaml", str(tmp_path / "logger.yaml")):
        with pytest.raises(DescriptionError, match="lies outside the recording folder"):
            read_recording(write(folder, change=put("sources", "robot", "dialect", value=name)))


def test_joint_2_comes_before_joint_10() -> None:
    names = ["joint10", "joint9", "time"]
    first, second = spread(["re:joint"], 2)
    assert (find(first, names), find(second, names)) == ([1], [0])


@pytest.mark.parametrize(
    "damaged", ["irb.joint+3].pos", "irb.joint[7].pos", "irq.joint[3].pos", "irb.joint[2].pos"]
)
def test_a_damaged_name_in_the_header_does_not_change_the_order_of_joints(damaged: str) -> None:
    names = [f"irb.joint[{k}].pos" for k in range(1, 7)]
    selectors = spread([r"re:^ir.*joint.*pos"], 6)
    assert [find(selector, names) for selector in selectors] == [[k] for k in range(6)]
    names[2] = damaged
    assert [find(selector, names) for selector in selectors] == [[]] * 6
    assert "not equal but for one number that counts on" in why_not(selectors[0], names)


@pytest.mark.parametrize("separator", [" ", ","])
def test_a_record_of_ur_rtde(tmp_path: Path, separator: str) -> None:
    names = ["timestamp", *(f"{kind}_q_{k}" for kind in ("target", "actual") for k in range(6))]
    axes = np.deg2rad(AXES_DEG)
    table = np.column_stack((1000.0 + ROBOT_T, axes + 1e-3, axes))
    rows = [separator.join(f"{value:.12f}" for value in row) for row in table.tolist()]
    use = put("sources", "robot", "dialect", value="ur-rtde")
    assert_read(write(tmp_path, robot=[separator.join(names), *rows], change=use))
