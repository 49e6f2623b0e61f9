"""`ballbar check` and `ballbar new --poses`: still poses on the page, as JSON, and made again."""

import json
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import yaml

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.errors import InputError
from ballbar.cell.instruments import kinds
from ballbar.cell.instruments.base import Kind
from ballbar.cell.load import instrument_names, load_instrument
from ballbar.cell.rigid_fit import nominal_frames
from ballbar.recordings.new import _sources
from tests.helpers.command_line import ballbar, output, refusal
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
    write,
)
from tests.helpers.terminal import at_the_terminal, in_turn

SAID = ["--robot", "ur5", "--instrument", "tracker_point"]


def table(folder: Path, rows: list[str]) -> Path:
    path = folder / "table.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_page_of_still_poses(tmp_path: Path) -> None:
    rows = lines(columns())
    code, out, _ = ballbar("check", write(tmp_path, [*rows[:4], rows[4] + "x", *rows[5:]]))
    assert code == 2
    rows[4] = rows[4].rpartition(",")[0] + ","
    folder = write(tmp_path, rows)
    out = output("check", folder)
    assert "  poses.csv: 39 of 40 rows used" in out
    assert "poses.csv:5: empty field: no number in z; row left out." in out
    assert "  39 poses of Universal Robots UR5 in 1 group: 1 seat, 1 target" in out
    assert "seat seat, target target: 39 poses, point; x " in out
    assert "  axis 6: " in out
    assert ballbar("check", folder / "poses.yaml")[1] == out
    code, _, err = ballbar("check", folder, "--strict")
    assert code == 1
    assert "1 kinds of repairs" in err
    _, reasons, _ = ballbar("check", folder, "--explain")
    assert "joints: q1, q2, q3, q4, q5, q6; controller's axis angles, in deg" in reasons


def test_the_poses_as_json(tmp_path: Path) -> None:
    def distance(description: dict) -> None:
        first = description["tables"][0]
        description["tables"].append({**first, "seat": "b"})
        description["distances"] = [{"pairs": [["a", "b"]], "length_m": 0.2, "sigma_m": 1e-5}]

    _, out, _ = ballbar("check", "--json", write(tmp_path, change=distance, seat="a"))
    data = json.loads(out)
    poses = data["poses"]
    assert (poses["robot"], poses["poses"], poses["seats"]) == ("ur5", 80, ["a", "b"])
    assert poses["distances"] == [{"seats": ["a", "b"], "length_m": 0.2, "sigma_m": 1e-5}]
    np.testing.assert_allclose(poses["groups"][1]["upper"], POINTS.max(axis=0), atol=1e-9)
    np.testing.assert_allclose(poses["axis_lower_rad"], Q.min(axis=0), atol=1e-9)
    assert data["files"][0]["source"] == "poses"


def test_a_folder_with_poses_and_a_recording_is_not_guessed(tmp_path: Path) -> None:
    (write(tmp_path) / "recording.yaml").write_text("schema: ballbar-recording/1\n")
    err = refusal("check", tmp_path)
    assert "holds poses.yaml and recording.yaml" in err


def test_names_and_numbers_of_a_table_answer_every_question(tmp_path: Path) -> None:
    names = [f"joint_{k}" for k in range(1, 7)]
    rows = lines(columns(), [*names, "x", "y", "z"], ";", comma=True)
    made = tmp_path / "made"
    code, out, _ = ballbar("new", made, "--poses", table(tmp_path, rows), *SAID)
    assert code == 0, "no question was left"
    described = yaml.safe_load((made / "poses.yaml").read_text())
    assert described["tables"] == [
        {
            "files": ["raw/table.csv"],
            "joints": {"columns": names, "unit": "deg"},
            "values": {"columns": ["x", "y", "z"], "unit": "mm"},
        }
    ]
    assert f"Wrote {made}/poses.yaml:" in out
    assert "columns: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]" in out
    np.testing.assert_allclose(read_poses(made).q, Q, atol=1e-9)
    err = refusal("new", made, "--poses", table(tmp_path, rows), *SAID)
    assert "exists and holds something; nothing was written" in err


@pytest.mark.parametrize("unit", ["°", "Grad"])
def test_a_workbook_in_degrees_needs_no_answer(tmp_path: Path, unit: str) -> None:
    """Small angles, whose range does not tell the unit."""
    near = nominal_frames(ROBOT, 0.05 * Q)
    book = openpyxl.Workbook()
    book.active.append(
        [*(f"Achse {k} [{unit}]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    )
    for row in np.hstack((np.rad2deg(0.05 * Q), 1e3 * near.tip.T)).tolist():
        book.active.append(row)
    book.save(tmp_path / "table.xlsx")
    made = tmp_path / "made"
    output("new", made, "--poses", tmp_path / "table.xlsx", *SAID, "--yes")
    np.testing.assert_allclose(read_poses(made).q, 0.05 * Q, atol=1e-12)


def test_a_workbook_whose_columns_are_not_seen_asks_for_them(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.append([*(f"Motor {k}" for k in range(1, 7)), "x", "y", "z"])
    for row in columns().tolist():
        book.active.append(row)
    book.save(tmp_path / "table.xlsx")
    code, _, err = ballbar(
        "new", tmp_path / "made", "--poses", tmp_path / "table.xlsx", *SAID, "--yes"
    )
    assert code == 2
    assert "which 6 columns hold the joint angles" in err


def test_the_convention_of_rotations_and_the_deviations_are_seen(tmp_path: Path) -> None:
    raw = ROTATIONS.as_euler("ZYX", degrees=True)
    deviation = np.full((len(Q), 6), 0.01)
    values = ["m_x", "m_y", "m_z", "m_rx", "m_ry", "m_rz"]
    names = [*(f"actual_q_{k}" for k in range(6)), *values, *(f"{v}_std" for v in values)]
    numbers = np.hstack((Q, POINTS, raw, deviation))
    path = table(tmp_path, lines(numbers, names))
    words = ["--robot", "ur5", "--instrument", "tracker_pose", "--yes", "--json"]
    code, out, err = ballbar("new", tmp_path / "made", "--poses", path, *words)
    assert code == 0, err
    assert "unit of the joint angles? (rad or deg) rad" in err
    (made,) = yaml.safe_load((tmp_path / "made/poses.yaml").read_text())["tables"]
    assert made["values"] == {
        **{"columns": values, "unit": "m"},
        **{"angle_unit": "deg", "rotation": "ZYX"},
    }
    assert made["sigma"] == {"columns": [f"{v}_std" for v in values]}
    assert json.loads(out)["poses_file"] == str(tmp_path / "made/poses.yaml")


def test_without_header_the_columns_are_counted(tmp_path: Path) -> None:
    path = table(tmp_path, lines(np.hstack((columns()[:, :6], LENGTHS)), []))
    words = ["--robot", "ur5", "--instrument", "drawwire_2m", "--value-unit", "m"]
    output("new", tmp_path / "made", "--poses", path, *words, "--seat", "floor")
    (made,) = yaml.safe_load((tmp_path / "made/poses.yaml").read_text())["tables"]
    assert made["joints"]["columns"] == [1, 2, 3, 4, 5, 6]
    assert (made["values"]["columns"], made["seat"]) == ([7], "floor")


@pytest.mark.parametrize(
    ("instrument", "measured", "values"),
    [
        ("dial_gauge", ["height_mm"], {"unit": "mm"}),
        ("theodolite_pair", ["azimuth_deg", "elevation_deg"], {"angle_unit": "deg"}),
    ],
)
def test_values_of_other_kinds_are_known_by_their_names(
    tmp_path: Path, instrument: str, measured: list[str], values: dict[str, str]
) -> None:
    numbers = np.hstack((columns()[:, :6], POINTS[:, : len(measured)]))
    path = table(tmp_path, lines(numbers, [*JOINTS, *measured]))
    words = ["--robot", "ur5", "--instrument", instrument, "--seat", "a", "--yes"]
    output("new", tmp_path / "made", "--poses", path, *words)
    (made,) = yaml.safe_load((tmp_path / "made/poses.yaml").read_text())["tables"]
    assert made["values"] == {"columns": measured, **values}
    assert read_poses(tmp_path / "made").groups[0].values.shape == (len(Q), len(measured))


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.name)
def test_what_every_kind_measures_is_asked_for_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Kind
) -> None:
    """Where the columns of a table do not tell; a socket has none."""
    instrument = next(n for n in instrument_names() if load_instrument(n).kind == kind)
    asked: list[str] = []

    def reply(question: str, _proposal: str | None) -> str:
        asked.append(question)
        raise KeyboardInterrupt

    at_the_terminal(monkeypatch, reply)
    path = table(tmp_path, lines(columns()[:, :7], [*JOINTS, "q_"]))
    words = ["--robot", "ur5", "--instrument", instrument, "--joint-unit", "deg"]
    ballbar("new", tmp_path / "made", "--poses", path, *words)
    if not kind.columns:
        assert not any("which columns hold" in question for question in asked)
        return
    assert all(name in asked[0] for name in kind.names if not name.startswith("r"))


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        (["--yes"], "which robot?"),
        ([*SAID, "--values", "x,y"], "'x,y': 2 columns, expected 3"),
        ([*SAID, "--values", "x,y,q"], "column q missing"),
        ([*SAID, "--joint-unit", "grad"], "'grad': expected rad or deg."),
        (["--robot", "ur4", *SAID[2:]], "unknown robot 'ur4'"),
        ([*SAID, "--value-unit", "m"], "Write `unit: mm` under values"),
    ],
)
def test_a_wrong_or_missing_answer_leaves_nothing(
    tmp_path: Path, words: list[str], missing: str
) -> None:
    path = table(tmp_path, lines(columns()))
    err = refusal("new", tmp_path / "made", "--poses", path, *words)
    assert missing in err
    assert [entry.name for entry in tmp_path.iterdir()] == ["table.csv"]


def test_a_wrong_answer_at_the_prompt_is_said_and_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [*JOINTS, "a", "b", "c"]  # no name says that these are x, y, z
    asked = at_the_terminal(monkeypatch, in_turn("a,b", "a,b,d", "a,b,c"))
    path = table(tmp_path, lines(columns(), names))
    output("new", tmp_path / "made", "--poses", path, *SAID)
    assert "which columns hold x, y and z?" in asked[0][0]
    assert asked[1][0].startswith("'a,b': 2 columns, expected 3")
    assert "column d missing" in asked[2][0]
    np.testing.assert_allclose(read_poses(tmp_path / "made").q, Q, atol=1e-9)


def test_poses_and_logs_are_not_mixed(tmp_path: Path) -> None:
    path = table(tmp_path, lines(columns(), NAMES))
    code, _, err = ballbar("new", tmp_path / "made", path, path, "--poses", path)
    assert (code, "either --poses or two logs" in err) == (2, True)
    code, _, err = ballbar("new", tmp_path / "made", path)
    assert (code, "a table of still poses with --poses" in err) == (2, True)


def test_copies_are_named_by_as_much_of_their_paths_as_differs(tmp_path: Path) -> None:
    files = [tmp_path / part for part in ("a/day/x.csv", "b/day/x.csv", "b/day/y.csv")]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    assert list(_sources([files[0], files[2]])) == ["raw/x.csv", "raw/y.csv"]
    three = ["raw/a/day/x.csv", "raw/b/day/x.csv", "raw/b/day/y.csv"]
    assert list(_sources(files)) == three
    assert list(_sources([files[0], tmp_path / "b"]).values()) == files
    with pytest.raises(InputError, match="is named twice"):
        _sources([files[0], tmp_path / "a"])
