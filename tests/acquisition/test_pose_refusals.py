"""Bad tables of still poses are refused with file, place and remedy; odd ones give findings."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ballbar.acquisition.pose_tables import import_poses, read_poses
from ballbar.cell.errors import DescriptionError
from ballbar.cell.rigid_fit import nominal_frames
from tests.helpers.pose_files import (
    JOINTS,
    LENGTHS,
    NAMES,
    POINTS,
    ROBOT,
    ROTATIONS,
    Q,
    columns,
    lines,
    refused,
    write,
)

VALUES = {"columns": ["x", "y", "z"], "unit": "mm"}


def with_cell(row: int, column: int, cell: str) -> list[str]:
    table = lines(columns())
    cells = table[row].split(",")
    cells[column] = cell
    return [*table[:row], ",".join(cells), *table[row + 1 :]]


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (
            {"joints": {"columns": JOINTS}},
            "FOLDER/poses.yaml: tables[0].joints.unit: missing: the header does not state the unit "
            "of q1, q2, q3, q4, q5, q6. Add it: rad or deg.",
        ),
        (
            {"values": {"columns": ["x", "y", "z"]}},
            "tables[0].values.unit: missing: the header does not state the unit of x, y, z. Add "
            "it: m, cm, mm, um, inch.",
        ),
        (
            {"joints": {"columns": JOINTS[:5], "unit": "deg"}},
            "tables[0].joints.columns: 5 columns, but ur5 has 6 axes.",
        ),
        (
            {"joints": {"columns": [*JOINTS[:5], "q5"], "unit": "deg"}},
            "tables[0].joints.columns: q5 stands there twice.",
        ),
        (
            {"values": {"columns": ["x", "y"], "unit": "mm"}},
            "tables[0].values.columns: 2 columns; tracker_point measures a point: expected 3.",
        ),
        (
            {"values": {"columns": ["x", "y", "x"], "unit": "mm"}},
            "tables[0].values.columns: x stands there, or among the joints, too.",
        ),
        ({"values": None}, "tables[0].values: missing; tracker_point measures a point."),
        (
            {"values": {**VALUES, "rotation": "XYZ"}},
            "tables[0].values.rotation: tracker_point measures a point, without rotation",
        ),
        ({"values": {**VALUES, "offset_m": 0.1}}, "an offset belongs to lengths only"),
        ({"sigma": {"columns": ["x"]}}, "tables[0].sigma.columns: 1 columns, expected 3"),
        ({"sigma": {}}, "tables[0].sigma: give either columns or length_m"),
        (
            {"joints": {"columns": JOINTS, "unit": "deg", "files": ["a", "b"]}},
            "2 files of joints for 1 files of the table; give as many",
        ),
        ({"joints": {"columns": JOINTS, "unit": "grad"}}, "expected 'rad' or 'deg'"),
        ({"time": {"column": "x", "form": "utc"}}, "unknown form of time 'utc'. Valid forms: "),
    ],
)
def test_what_poses_yaml_lacks(tmp_path: Path, keys: dict[str, Any], sentence: str) -> None:
    assert sentence in refused(write(tmp_path, **keys), DescriptionError)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda d: d.update(distances=[{"pairs": [["left", "seat"]], "length_m": 1}]),
            "give length_m and sigma_m, or none of them",
        ),
        (
            lambda d: d.update(
                distances=[{"pairs": [["saet", "seat"]], "length_m": 1, "sigma_m": 0.1}]
            ),
            "distances[0]: nothing is measured at seat 'saet'. Did you mean seat? Valid seats: "
            "seat.",
        ),
        (
            lambda d: d.update(distances=[{"pairs": [["seat", "other"]]}]),
            "distances[0]: length_m is missing, and tracker_point states no distance of its own.",
        ),
        (lambda d: d.update(distances=[{"pairs": [["a", "a"]]}]), "expected two different seats"),
        (lambda d: d.update(instrument="trackr_point"), "unknown instrument 'trackr_point'."),
    ],
)
def test_distances_and_instruments_that_do_not_exist(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], sentence: str
) -> None:
    assert sentence in refused(write(tmp_path, change=change), DescriptionError)


def test_a_missing_column_names_the_nearest(tmp_path: Path) -> None:
    table = lines(columns(), ["q1", "q2", "q3", "q4", "Q_5", "q6", "x", "y", "z"])
    sentence = refused(write(tmp_path, table))
    assert (
        "poses.csv:1: column q5 missing; the header has 'q1', 'q2', 'q3', 'q4', 'Q_5'" in sentence
    )
    assert "Is 'Q_5' meant? Correct the name in poses.yaml, or give the number" in sentence


def test_a_column_that_stands_twice(tmp_path: Path) -> None:
    table = lines(np.hstack((columns(), columns()[:, :1])), [*NAMES, "q1"])
    assert "poses.csv:1: column q1 stands 2 times in the header." in refused(write(tmp_path, table))


def test_names_for_a_file_without_header(tmp_path: Path) -> None:
    sentence = refused(write(tmp_path, lines(columns(), [])))
    assert "poses.csv:1: the first line holds numbers, not column names" in sentence
    assert "give columns by number in poses.yaml: `columns: [1, 2, 3]`" in sentence


def test_units_of_the_header_that_contradict_the_yaml(tmp_path: Path) -> None:
    table = lines(columns(), [*JOINTS, "x [um]", "y [um]", "z [um]"])
    sentence = refused(write(tmp_path, table), DescriptionError)
    assert "tables[0].values.unit: mm, but the header says um. Correct one of them." in sentence


@pytest.mark.parametrize(
    ("cell", "sentence"),
    [
        ("12.5x", "poses.csv:6: column y: '12.5x' is not a number. Correct the cell"),
        ("1.234.5", "'1.234.5' is not a number. Thousands separators? Export without them."),
        ('"1,5"', "column y: '1,5' is not a number. A decimal comma, or thousands? Export with"),
        ("inf", "poses.csv:6: column y: 'inf' is not a finite number."),
        ("1e999", "'1e999' is not a finite number."),
        ("1_0", "'1_0' is not a finite number."),
    ],
)
def test_cells_that_are_no_numbers(tmp_path: Path, cell: str, sentence: str) -> None:
    assert sentence in refused(write(tmp_path, with_cell(5, 7, cell)))


@pytest.mark.parametrize("cell", ["1.234,567", "-12.345.678,9"])
def test_separators_between_the_thousands(tmp_path: Path, cell: str) -> None:
    table = lines(columns(), separator=";", comma=True)
    fields = table[5].split(";")
    table[5] = ";".join([*fields[:7], cell, *fields[8:]])
    sentence = refused(write(tmp_path, table))
    assert f"poses.csv:6: column y: '{cell}' has a separator of thousands." in sentence
    assert "Export without" in sentence


def test_rows_with_another_number_of_fields(tmp_path: Path) -> None:
    table = lines(columns())
    torn = [f"{line},1" if k in (4, 9, 12) else line for k, line in enumerate(table)]
    sentence = refused(write(tmp_path, torn))
    assert "poses.csv:5: 3 of 40 rows do not have the header's number of fields" in sentence
    assert "is this the file that poses.yaml describes?" in sentence


def test_a_table_without_a_complete_row(tmp_path: Path) -> None:
    table = [
        line.rpartition(",")[0] + "," if k else line for k, line in enumerate(lines(columns()))
    ]
    assert "poses.csv: no row has all numbers" in refused(write(tmp_path, table))


def test_degrees_declared_as_radians(tmp_path: Path) -> None:
    sentence = refused(write(tmp_path, joints={"columns": JOINTS, "unit": "rad"}))
    assert "read as rad puts axis" in sentence
    assert "far beyond its limits -360 to 360 deg" in sentence
    assert "With `unit: deg` all angles stay within the limits: write so under joints" in sentence


@pytest.mark.parametrize("instrument", ["tracker_point", "drawwire_2m", "socket_pair_50"])
def test_radians_declared_as_degrees(tmp_path: Path, instrument: str) -> None:
    table = lines(np.hstack((columns(angle=1.0), LENGTHS)), [*NAMES, "l"])
    values = {
        "tracker_point": VALUES,
        "drawwire_2m": {"columns": ["l"], "unit": "m"},
        "socket_pair_50": None,
    }[instrument]
    folder = write(tmp_path, table, measured_by=instrument, values=values)
    sentence = refused(folder)
    assert "no joint angle exceeds" in sentence
    assert "Radians? Write `unit: rad` under joints in poses.yaml." in sentence


def test_small_angles_in_degrees_are_believed_where_the_points_say_so(tmp_path: Path) -> None:
    q = np.deg2rad(Q)  # within two degrees
    points = nominal_frames(ROBOT, q).tip.T * 1e3
    folder = write(tmp_path, lines(np.hstack((np.rad2deg(q), points))))
    np.testing.assert_allclose(read_poses(folder).q, q, atol=1e-9)


def test_columns_that_are_no_angles(tmp_path: Path) -> None:
    joints = {"columns": [*JOINTS[:3], "x", "y", "z"], "unit": "deg"}
    sockets = write(tmp_path, measured_by="socket_pair_50", joints=joints, values=None)
    sentence = refused(sockets)
    assert "Name the columns of the robot's angles, in the order of its axes" in sentence


@pytest.mark.parametrize(("right", "wrong"), [("mm", "m"), ("m", "mm"), ("um", "mm")])
def test_points_in_another_unit(tmp_path: Path, right: str, wrong: str) -> None:
    scale = {"m": 1.0, "mm": 1e3, "um": 1e6}[right]
    table = lines(columns(length=scale))
    sentence = refused(write(tmp_path, table, values={**VALUES, "unit": wrong}))
    assert "poses.csv: the measured points spread over" in sentence
    assert f"In {right}? Write `unit: {right}` under values in poses.yaml." in sentence


def test_lengths_in_another_unit(tmp_path: Path) -> None:
    table = lines(np.hstack((columns()[:, :6], LENGTHS * 1e3)), [*JOINTS, "l"])
    folder = write(
        tmp_path, table, measured_by="drawwire_2m", values={"columns": ["l"], "unit": "m"}
    )
    assert "In mm? Write `unit: mm` under values in poses.yaml." in refused(folder)


@pytest.mark.parametrize("change", ["sign", "swap"])
def test_a_left_handed_frame(tmp_path: Path, change: str) -> None:
    points = POINTS * [1.0, -1.0, 1.0] if change == "sign" else POINTS[:, [1, 0, 2]]
    sentence = refused(write(tmp_path, lines(np.hstack((columns()[:, :6], points * 1e3)))))
    assert "fit ur5 only as their mirror image" in sentence
    assert "Is an axis missing its sign, or are two columns swapped?" in sentence


def test_another_convention_of_the_rotations_is_named(tmp_path: Path) -> None:
    raw = ROTATIONS.as_euler("XYZ", degrees=True)
    values = {"columns": ["x", "y", "z", "a", "b", "c"], "unit": "mm", "angle_unit": "deg"}
    folder = write(
        tmp_path,
        lines(np.hstack((columns(), raw)), [*NAMES, "a", "b", "c"]),
        measured_by="tracker_pose",
        values={**values, "rotation": "xyz"},
    )
    sentence = refused(folder)
    assert "the rotations read as xyz do not turn as the flange of ur5 does" in sentence
    assert "with `rotation: XYZ, angle_unit: deg` they do" in sentence


def test_quaternions_that_are_none(tmp_path: Path) -> None:
    quat = ROTATIONS.as_quat() * 1.2
    folder = write(
        tmp_path,
        lines(np.hstack((columns(), quat)), [*NAMES, "i", "j", "k", "r"]),
        measured_by="tracker_pose",
        values={
            "columns": ["x", "y", "z", "i", "j", "k", "r"],
            **{"unit": "mm", "rotation": "quat_xyzw"},
        },
    )
    assert "poses.csv:2: the quaternion has length 1.2, expected 1." in refused(folder)


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    folder = write(tmp_path, b"\xd0\xcf\x11\xe0" + b"0" * 600)
    assert "a workbook of the old kind (.xls). Save it as .xlsx or .csv." in refused(folder)
    assert "is no workbook (.xlsx), or damaged" in refused(
        write(tmp_path, b"PK\x03\x04" + b"0" * 99)
    )
    assert "a log (json-lines), not a table of still poses" in refused(
        write(tmp_path, '{"a": 1}\n')
    )
    folder = write(tmp_path, files=["pose.csv"])
    assert "pose.csv: no such file (looked for FOLDER/pose.csv)." in refused(folder)
    assert "has no sheet 'a'" in refused(write(tmp_path, sheet="a"))


def test_rapid_code_and_values_of_another_count(tmp_path: Path) -> None:
    target = "CONST jointtarget p:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    points = lines(columns()[:, 6:], ["x", "y", "z"])
    folder = write(tmp_path, points, joints={"files": ["poses.mod"]})
    (folder / "poses.mod").write_text(target * 3)
    assert "poses.csv has 40 rows, poses.mod has 3: they are paired by their order" in refused(
        folder
    )
    (folder / "poses.mod").write_text(target * 2 + target.replace(",30,0]", ",30]"))
    assert "poses.mod:3: expected a jointtarget of six angles" in refused(folder)
    (folder / "poses.mod").write_text(target + target.replace("[[0,", "[[9E9,"))
    assert "poses.mod:2: 9E9 for a robot axis" in refused(folder)
    (folder / "poses.mod").write_text(target * 39 + target[:30] + "\n")
    assert "poses.mod:40: expected a jointtarget" in refused(folder)


def kinds(folder: Path) -> dict[str, Any]:
    return {entry.kind: entry for entry in import_poses(folder).report.findings}


def test_rounded_angles_and_standing_axes_are_reported(tmp_path: Path) -> None:
    numbers = columns()
    numbers[:, :4] = np.round(numbers[:, :4], 1)
    numbers[:, 4] = 10.0 * np.rint(numbers[:, 4] / 10.0)
    numbers[:, 5] = 7.0
    found = kinds(write(tmp_path, lines(numbers)))
    assert "axis 6 never moves" in found["axis stands still"].sentence
    entries = [
        f.sentence for f in import_poses(tmp_path).report.findings if f.kind == "angles on a grid"
    ]
    assert entries == [
        "all angles of axes 1, 2, 3, 4 are whole multiples of 0.1 deg.",
        "all angles of axis 5 are whole multiples of 10 deg.",
    ]
    numbers[:, :6] = numbers[0, :6]
    assert (
        "no axis moves over the whole table"
        in kinds(write(tmp_path, lines(numbers)))["joints stand still"].sentence
    )


def test_repeated_poses_are_counted(tmp_path: Path) -> None:
    numbers = np.vstack((columns(), columns()[3:9] + 1e-3))
    entry = kinds(write(tmp_path, lines(numbers)))["repeated pose"]
    assert (entry.count, entry.lines) == (6, (42, 43, 44, 45, 46))


def test_a_pose_beyond_the_limits_and_one_far_off(tmp_path: Path) -> None:
    numbers = columns()
    numbers[5, 0] = 370.0
    entry = kinds(write(tmp_path, lines(numbers)))["beyond axis limits"]
    assert entry.lines == (7,)
    assert "axis 1 of ur5 lies up to 10 deg beyond its limits" in entry.sentence


def test_points_of_another_robot_are_reported(tmp_path: Path) -> None:
    folder = write(tmp_path, robot="ur10")
    assert "off the catalogue robot" in kinds(folder)["far from the nominal robot"].sentence


def test_a_point_out_of_reach_is_reported_and_does_not_hide_the_others(tmp_path: Path) -> None:
    entry = kinds(write(tmp_path, with_cell(5, 8, "99999999.0")))["point out of reach"]
    assert (entry.severity, entry.lines, entry.count) == ("warning", (6,), 1)
    assert list(kinds(tmp_path)) == ["point out of reach"]


@pytest.mark.parametrize("shift", [0.5, 8.0])
@pytest.mark.parametrize(
    ("behind", "said"),
    [
        (np.arange(len(Q)) >= 15, "lines 2 to 16; and lines 17 to 41"),
        (np.arange(len(Q)) % 2 == 1, "lines 2, 4, 6, 8, ... (20 of those judged); and lines 3, 5,"),
    ],
)
def test_two_seats_under_one_name(
    tmp_path: Path, shift: float, behind: np.ndarray, said: str
) -> None:
    """8 m apart they were called a wrong unit, and with names as well."""
    points = POINTS + shift * np.where(behind, 1.0, 0.0)[:, None] * [0.6, -0.8, 0.1]
    table = lines(np.hstack((np.rad2deg(Q), 1e3 * points)))
    sentence = refused(write(tmp_path / "one", table))
    assert f"two seats of the instrument under one name: {said}" in sentence
    assert "Give each seat its name" in sentence
    names = ["seat", *np.where(behind, "B", "A")]
    named = [f"{line},{name}" for line, name in zip(table, names, strict=True)]
    read = read_poses(write(tmp_path / "two", named, seat={"column": "seat"}))
    assert set(read.seats) == {"A", "B"}


def test_another_robot_is_not_called_two_seats(tmp_path: Path) -> None:
    swapped = np.hstack((np.rad2deg(Q)[:, [0, 2, 1, 3, 4, 5]], 1e3 * POINTS))
    read = import_poses(write(tmp_path, lines(swapped)))
    assert any(entry.kind == "far from the nominal robot" for entry in read.report.findings)
