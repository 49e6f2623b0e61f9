"""A table of still poses reads the same however it was saved."""

import gzip
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from ballbar.acquisition.pose_tables import import_poses, read_poses
from ballbar.cell.errors import DescriptionError
from ballbar.cell.poses import PoseTable
from tests.helpers.pose_files import NAMES, POINTS, Q, columns, lines, write

COUNTED = {
    "joints": {"columns": [1, 2, 3, 4, 5, 6], "unit": "deg"},
    "values": {"columns": [7, 8, 9], "unit": "mm"},
}


def assert_read(table: PoseTable) -> None:
    """The poses of the helpers, to the nine digits that the file has."""
    (group,) = table.groups
    np.testing.assert_allclose(group.q, Q, atol=1e-9)
    np.testing.assert_allclose(group.values, POINTS, atol=1e-9)
    assert group.measured == "point"


@pytest.mark.parametrize(
    ("separator", "comma"), [(",", False), (";", False), (";", True), ("\t", True), (" ", False)]
)
@pytest.mark.parametrize("header", [True, False])
def test_separators_and_decimal_commas(
    tmp_path: Path, separator: str, comma: bool, header: bool
) -> None:
    table = lines(columns(), NAMES if header else [], separator, comma)
    assert_read(read_poses(write(tmp_path, table, **({} if header else COUNTED))))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    text = "\n".join(["Messung des Präzisionsroboters", *lines(columns())]) + "\n"
    assert_read(read_poses(write(tmp_path, text.encode(encoding))))


def test_packed_files_and_the_path_of_the_yaml_itself(tmp_path: Path) -> None:
    folder = write(tmp_path, files=["poses.csv.gz"])
    (folder / "poses.csv.gz").write_bytes(gzip.compress((folder / "poses.csv").read_bytes()))
    table = read_poses(folder / "poses.yaml")
    assert_read(table)
    assert table.name == tmp_path.name


def test_a_comment_is_skipped_and_may_hold_the_header(tmp_path: Path) -> None:
    rows = lines(columns(), [])
    table = ["# tracker 7", f"# {','.join(NAMES)}", *rows[:5], "# pause", *rows[5:]]
    read = import_poses(write(tmp_path, table))
    assert_read(read.table)
    (entry,) = read.report.findings
    assert (entry.kind, entry.count, entry.lines) == ("comment line", 2, (1, 8))
    assert read.table.groups[0].rows[5] == 9


def test_a_tracker_report_has_a_preamble_and_its_units_in_the_header(tmp_path: Path) -> None:
    names = [*(f"A{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]", "Name"]
    rows = [f"{row};P{k}" for k, row in enumerate(lines(columns(), [], ";"))]
    table = ["Report;Tracker 5", "Operator;N. N.", "", ";".join(names), *rows]
    folder = write(
        tmp_path,
        table,
        joints={"columns": [f"A{k}" for k in range(1, 7)]},
        values={"columns": ["X", "Y", "Z"]},
    )
    assert_read(read_poses(folder))


@pytest.mark.parametrize(
    ("angle", "length"),
    [
        *((" [°]", " [mm]"), ("(°)", "(mm)"), (" [º]", "[mm]"), (" [Grad]", " [mm]")),
        *((" / °", " / mm"), (" in °", " in mm"), ("/deg", "/mm")),
    ],
)
def test_headers_state_their_units_in_several_ways(tmp_path: Path, angle: str, length: str) -> None:
    names = [*(f"Achse {k}{angle}" for k in range(1, 7)), *(f"{c}{length}" for c in "XYZ")]
    folder = write(
        tmp_path,
        lines(columns(), names, ";"),
        joints={"columns": [f"Achse {k}" for k in range(1, 7)]},
        values={"columns": ["X", "Y", "Z"]},
    )
    assert_read(read_poses(folder))


def test_grad_may_be_another_unit_and_has_to_be_declared(tmp_path: Path) -> None:
    names = [*(f"A{k} [grad]" for k in range(1, 7)), "x", "y", "z"]
    joints = {"columns": [f"A{k}" for k in range(1, 7)]}
    table = lines(columns(), names)
    with pytest.raises(DescriptionError, match="does not state the unit of A1, A2"):
        read_poses(write(tmp_path, table, joints=joints))
    assert_read(read_poses(write(tmp_path, table, joints={**joints, "unit": "deg"})))


def test_quoted_fields_and_names_in_columns(tmp_path: Path) -> None:
    rows = [f'{row},"seat {k % 2}",ball' for k, row in enumerate(lines(columns(), []))]
    folder = write(
        tmp_path,
        [",".join([*NAMES, "seat", "reflector"]), *rows],
        seat={"column": "seat"},
        target={"column": "reflector"},
    )
    table = read_poses(folder)
    assert table.seats == ("seat 0", "seat 1")
    assert table.targets == ("ball",)
    first, second = table.groups
    np.testing.assert_allclose(first.q, Q[::2], atol=1e-9)
    assert list(second.rows[:2]) == [3, 5]


def test_a_name_among_the_numbers_of_a_file_without_header(tmp_path: Path) -> None:
    rows = [f"P{k};{row}" for k, row in enumerate(lines(columns(), [], ";", comma=True))]
    folder = write(
        tmp_path,
        rows,
        joints={"columns": [2, 3, 4, 5, 6, 7], "unit": "deg"},
        values={"columns": [8, 9, 10], "unit": "mm"},
    )
    assert_read(read_poses(folder))


def test_a_row_with_an_empty_field_is_left_out_and_counted(tmp_path: Path) -> None:
    table = lines(columns(), separator=";")
    for row in (3, 7):
        cells = table[row].split(";")
        cells[7] = "" if row == 3 else "NaN"
        table[row] = ";".join(cells)
    read = import_poses(write(tmp_path, table))
    assert read.table.size == len(Q) - 2
    (entry,) = read.report.findings
    assert (entry.kind, entry.severity, entry.count, entry.lines) == (
        *("empty field", "repaired", 2),
        (4, 8),
    )
    assert "no number in y; row left out" in entry.sentence
    assert list(read.table.groups[0].rows[:4]) == [2, 3, 5, 6]
    assert read.report.files[0].rows_kept == len(Q) - 2


def test_an_empty_field_in_the_first_row_of_a_file_without_header(tmp_path: Path) -> None:
    table = lines(columns(), [])
    table[0] = ",".join([*table[0].split(",")[:-1], ""])
    read = import_poses(write(tmp_path, table, **COUNTED))
    assert read.table.size == len(Q) - 1
    assert read.report.findings[0].lines == (1,)


def test_a_cut_last_line_is_never_a_smaller_number(tmp_path: Path) -> None:
    whole = "\n".join(lines(columns()))
    read = import_poses(write(tmp_path, whole[:-4]))
    assert read.table.size == len(Q) - 1
    assert read.report.findings[0].kind == "unterminated last line"


def test_a_workbook(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.title = "notes"
    sheet = book.create_sheet("poses")
    sheet.append(["UR5, tracker"])
    sheet.append([])
    sheet.append(NAMES)
    for row in columns().tolist():
        sheet.append(row)
    sheet["B7"] = None
    folder = write(tmp_path, files=["poses.xlsx"], sheet="poses")
    book.save(folder / "poses.xlsx")
    read = import_poses(folder)
    assert read.table.size == len(Q) - 1
    np.testing.assert_array_equal(read.table.groups[0].rows[:4], [4, 5, 6, 8])
    np.testing.assert_allclose(read.table.groups[0].q[0], Q[0], atol=1e-12)
    assert read.report.files[0].dialect == "workbook"


def test_joints_of_rapid_code_are_paired_by_order(tmp_path: Path) -> None:
    targets = [
        f"  CONST jointtarget p{k}:=[[{','.join(f'{a:.6f}' for a in row)}],\n"
        "    [9E9,9E9,9E9,9E9,9E9,9E9]]; ! taught"
        for k, row in enumerate(np.rad2deg(Q).tolist())
    ]
    folder = write(
        tmp_path, lines(columns()[:, 6:], ["x", "y", "z"]), joints={"files": ["poses.mod"]}
    )
    code = "MODULE Poses\n" + "\n".join(targets) + "\nENDMODULE\n"
    (folder / "poses.mod").write_text(code)
    (group,) = read_poses(folder).groups
    np.testing.assert_allclose(group.q, Q, atol=1e-7)
    np.testing.assert_allclose(group.values, POINTS, atol=1e-9)


def test_joints_of_kuka_rsi_messages(tmp_path: Path) -> None:
    messages = [
        '<Rob Type="KUKA"><RIst X="1.0" Y="2.0"/><AIPos '
        + " ".join(f'A{i + 1}="{a:.6f}"' for i, a in enumerate(row))
        + f"/><IPOC>{4 * k}</IPOC></Rob>"
        for k, row in enumerate(np.rad2deg(Q).tolist())
    ]
    folder = write(
        tmp_path,
        lines(columns()[:, 6:], ["x", "y", "z"]),
        joints={"files": ["joints.xml"], "unit": "deg"},
    )
    (folder / "joints.xml").write_text("\n".join(messages) + "\n")
    np.testing.assert_allclose(read_poses(folder).q, Q, atol=1e-7)


@pytest.mark.parametrize(("separator", "header"), [(" ", True), (",", True), (",", False)])
def test_a_record_of_ur_rtde(tmp_path: Path, separator: str, header: bool) -> None:
    names = [
        "timestamp",
        *(f"actual_q_{k}" for k in range(6)),
        *(f"target_q_{k}" for k in range(6)),
    ]
    time = 17.0 + np.arange(len(Q))[:, None]
    numbers = np.hstack((time, Q, Q + 1e-4, POINTS))
    joints = [r"re:^actual_q_\d$"] if header else list(range(2, 8))
    folder = write(
        tmp_path,
        lines(numbers, [*names, "x", "y", "z"] if header else [], separator),
        joints={"columns": joints, "unit": "rad"},
        values={"columns": ["x", "y", "z"] if header else [14, 15, 16], "unit": "m"},
        time={"column": "timestamp" if header else 1, "form": "s"},
    )
    (group,) = read_poses(folder).groups
    np.testing.assert_allclose(group.q, Q, atol=1e-9)
    np.testing.assert_allclose(group.time, np.arange(len(Q)), atol=1e-9)


def test_several_files_of_one_table_and_tables_of_several_seats(tmp_path: Path) -> None:
    folder = write(tmp_path, lines(columns()[:20]), files=["poses.csv", "more.csv"], seat="left")
    (folder / "more.csv").write_text("\n".join(lines(columns()[20:])) + "\n")
    table = read_poses(folder)
    assert [(group.file, group.size, group.seat) for group in table.groups] == [
        ("poses.csv", 20, "left"),
        ("more.csv", 20, "left"),
    ]
    np.testing.assert_allclose(table.q, Q, atol=1e-9)
