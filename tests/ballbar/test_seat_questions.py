"""Which seats and targets `ballbar new` proposes for several files, what it says and asks.

The tables are made by a robot of its own formulas (tests.helpers.own_poses), with errors of half a
millimetre and sag, and written as a German spreadsheet writes them.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ballbar.recordings.seat_questions import labels
from tests.helpers import own_poses, real_robots
from tests.helpers.command_line import ballbar
from tests.helpers.own_poses import Array
from tests.helpers.terminal import at_the_terminal, in_turn

ARM = own_poses.irb120(np.random.default_rng(11))
Q = ARM.drawn(np.random.default_rng(12), 60)
OTHERS = ARM.drawn(np.random.default_rng(13), 50)
REFLECTORS = np.array([[0.03, 0.0, 0.06], [-0.05, 0.08, 0.05], [-0.04, -0.09, 0.07]])  # [m]
SEAT = (Rotation.from_rotvec([0.1, -0.2, 0.9]), np.array([1.9, -0.4, 0.3]))
MOVED = (Rotation.from_rotvec([0.0, 0.1, -1.4]), np.array([0.8, 1.7, 0.2]))
POINTS = ["--robot", "irb120", "--instrument", "tracker_point"]
LENGTHS = ["--robot", "irb120", "--instrument", "drawwire_2m", "--value-unit", "mm"]
Seat = tuple[Rotation, Array]


def points(q: Array, reflector: Array, seat: Seat = SEAT, noise: float = 2e-5) -> Array:
    """(N, 3) [m] what a tracker measures."""
    rng = np.random.default_rng(len(q))
    measured = seat[0].inv().apply(ARM.target(q, reflector) - seat[1])
    return np.asarray(measured + noise * rng.standard_normal(measured.shape))


def lengths(q: Array, place: Sequence[float]) -> Array:
    """(N, 1) [m] what a draw-wire measures from a place."""
    rng = np.random.default_rng(len(q))
    length = np.linalg.norm(ARM.target(q, REFLECTORS[0]) - place, axis=1, keepdims=True)
    return np.asarray(length + 3e-4 * rng.standard_normal(length.shape))


def table(path: Path, q: Array, values: Array, digits: int = 6, scale: float = 1e3) -> Path:
    """A file with semicolons, decimal commas and cp1252; angles with so many digits of a degree."""
    names = ["x", "y", "z", "rx", "ry", "rz"] if values.shape[1] > 1 else ["Länge"]
    lines = [";".join([*(f"J{k}" for k in range(1, 7)), *names[: values.shape[1]], "Größe"])]
    for angles, row in zip(np.rad2deg(q).tolist(), values.tolist(), strict=True):
        cells = [f"{a:.{digits}f}" for a in angles] + [f"{scale * v:.4f}" for v in row]
        lines.append(";".join([*cells, "0"]).replace(".", ","))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("cp1252"))
    return path


def new(folder: Path, tables: Sequence[Path], *words: object) -> tuple[int, str, str]:
    poses = [word for path in tables for word in ("--poses", path)]
    return ballbar("new", folder, *poses, *words)


def described(folder: Path) -> dict[str, tuple[str, str]]:
    """Seat and target of every file of a poses.yaml."""
    content: dict[str, Any] = yaml.safe_load((folder / "poses.yaml").read_text("utf-8"))
    return {
        file.removeprefix("raw/"): (entry.get("seat"), entry.get("target"))
        for entry in content["tables"]
        for file in entry["files"]
    }


def made(folder: Path, tables: Sequence[Path], *words: object) -> tuple[str, dict[str, Any]]:
    """The output of a command that succeeds, and the seat and target of every file."""
    code, out, err = new(folder, tables, *words)
    assert code == 0, err
    return out, described(folder)


def refused(folder: Path, tables: Sequence[Path], *words: object) -> str:
    """The error of a command that fails."""
    code, _, err = new(folder, tables, *words)
    assert code == 2
    return err


def test_three_reflectors_in_three_files_are_one_seat_and_three_targets(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    second, third = points(Q, REFLECTORS[1]), points(Q, REFLECTORS[2])
    second[::12] += 1e-3 * rng.standard_normal((5, 3))  # badly seated
    order = rng.permutation(len(Q))[:45]  # another order, rows missing
    files = [
        table(tmp_path / "smr_left.csv", Q, points(Q, REFLECTORS[0])),
        table(tmp_path / "smr_right.csv", Q, second, digits=1),
        table(tmp_path / "smr_top.csv", Q[order], third[order]),
    ]
    out, places = made(tmp_path / "made", files, *POINTS, "--yes")
    assert places == {
        "smr_left.csv": ("seat", "left"),
        "smr_right.csv": ("seat", "right"),
        "smr_top.csv": ("seat", "top"),
    }
    assert "Seats and targets of 3 files:\n  smr_left.csv: seat seat, target left\n" in out
    said = re.findall(r"angles its points are ([\d.]+) mm beside those of smr_left.csv", out)
    apart = np.linalg.norm(REFLECTORS[1:] - REFLECTORS[0], axis=1)
    np.testing.assert_allclose([float(n) for n in said], 1e3 * apart, atol=0.5)
    assert "1 seat, 3 targets" in out


@pytest.mark.parametrize("q", [Q, OTHERS], ids=["equal poses", "other poses"])
def test_a_moved_tracker_is_another_seat(tmp_path: Path, q: Array) -> None:
    files = [
        table(tmp_path / "monday" / "poses.csv", Q, points(Q, REFLECTORS[0])),
        table(tmp_path / "friday" / "poses.csv", q, points(q, REFLECTORS[0], MOVED)),
    ]
    out, places = made(tmp_path / "made", files, *POINTS, "--yes")
    assert places == {
        "monday/poses.csv": ("monday", "target"),
        "friday/poses.csv": ("friday", "target"),
    }
    said = re.search(r"([\d.]+) m and ([\d.]+) deg .*: another seat$", out, re.MULTILINE)
    assert said is not None
    turned = np.rad2deg((SEAT[0].inv() * MOVED[0]).magnitude())
    expected = [np.linalg.norm(SEAT[1] - MOVED[1]), turned]  # [m, deg]
    np.testing.assert_allclose([float(n) for n in said.groups()], expected, rtol=5e-3)


@pytest.mark.parametrize("q", [Q, OTHERS], ids=["equal poses", "other poses"])
def test_one_seat_and_one_target_in_two_files_are_said_to_be_so(tmp_path: Path, q: Array) -> None:
    files = [
        table(tmp_path / "grid.csv", Q, points(Q, REFLECTORS[0])),
        table(tmp_path / "random.csv", q, points(q, REFLECTORS[0]) + 1e-5),
    ]
    out, places = made(tmp_path / "made", files, *POINTS, "--yes")
    assert set(places.values()) == {("seat", "target")}
    assert "one seat and one target" in out
    assert "random.csv: seat seat, target target" in out
    content = yaml.safe_load((tmp_path / "made" / "poses.yaml").read_text("utf-8"))
    assert [entry["files"] for entry in content["tables"]] == [["raw/grid.csv", "raw/random.csv"]]


def test_two_seats_of_two_targets_are_told_from_each_other(tmp_path: Path) -> None:
    files = [
        table(tmp_path / f"{seat}{target}.csv", q, points(q, REFLECTORS[target], place))
        for seat, place in (("a", SEAT), ("b", MOVED))
        for target, q in ((0, Q), (1, OTHERS))
    ]
    out, places = made(tmp_path / "made", files, *POINTS, "--yes")
    last = re.search(r"b1.csv: seat b0, target a1\n    (.*)\n", out)
    assert last is not None
    assert last[1].count(";") == 1, "the files that it shares a seat or a target with, no others"
    assert places == {
        "a0.csv": ("a0", "a0"),
        "a1.csv": ("a0", "a1"),
        "b0.csv": ("b0", "a0"),
        "b1.csv": ("b0", "a1"),
    }


def test_a_six_d_target_that_was_turned_alone_is_another_one(tmp_path: Path) -> None:
    def poses(turn: Sequence[float]) -> Array:
        flange = ARM.rigid(Q)[:, :3, :3]
        turned = SEAT[0].inv() * Rotation.from_matrix(flange) * Rotation.from_rotvec(turn)
        return np.hstack((1e3 * points(Q, REFLECTORS[0]), turned.as_euler("XYZ", degrees=True)))

    files = [
        table(tmp_path / "before.csv", Q, poses([0.1, 0.0, 0.0]), scale=1.0),
        table(tmp_path / "after.csv", Q, poses([0.1, 0.0, 1.5]), scale=1.0),
    ]
    words = ["--robot", "irb120", "--instrument", "tracker_pose", "--yes"]
    _, places = made(tmp_path / "made", files, *words)
    assert places == {"before.csv": ("seat", "before"), "after.csv": ("seat", "after")}


def test_lengths_are_one_seat_a_file_where_they_are_not_of_one(tmp_path: Path) -> None:
    files = [
        table(tmp_path / "floor.csv", Q, lengths(Q, [0.9, 0.4, -0.2])),
        table(tmp_path / "wall.csv", Q, lengths(Q, [-0.3, 0.9, 0.3])),
        table(tmp_path / "floor_again.csv", OTHERS, lengths(OTHERS, [0.9, 0.4, -0.2])),
    ]
    words = [*LENGTHS, "--values", "Länge", "--yes"]
    _, places = made(tmp_path / "made", files, *words)
    assert places == {
        "floor.csv": ("floor", "target"),
        "wall.csv": ("wall", "target"),
        "floor_again.csv": ("floor", "target"),
    }


def test_every_file_of_a_folder_of_sockets_is_a_seat(tmp_path: Path) -> None:
    for k, site in enumerate(("left", "right")):
        for hole in ("hole_0", "hole_1"):
            path = tmp_path / "sites" / site / f"{hole}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savetxt(path, Q[10 * k : 10 * k + 10], delimiter=",")
    (tmp_path / "sites" / ".notes").write_text("no table")
    words = ["--robot", "irb120", "--instrument", "socket_pair_50", "--yes"]
    out, places = made(tmp_path / "made", [tmp_path / "sites"], *words)
    assert places == {
        f"{site}/{hole}.csv": (f"{site}/{hole}", "target")
        for site in ("left", "right")
        for hole in ("hole_0", "hole_1")
    }
    assert "a file of sockets is one socket, and the ball on the flange one target" in out


def test_names_are_given_by_options_once_for_all_files_or_once_for_each(tmp_path: Path) -> None:
    files = [
        table(tmp_path / "a.csv", Q, points(Q, REFLECTORS[0])),
        table(tmp_path / "b.csv", Q, points(Q, REFLECTORS[1])),
        table(tmp_path / "c.csv", OTHERS, points(OTHERS, REFLECTORS[1])),
    ]
    balls = ["--target", "ball", "--target", "cone", "--target", "cone"]
    out, places = made(tmp_path / "both", files, *POINTS, "--seat", "hall 3", *balls)
    assert "Seats and targets" not in out
    expected = {"a.csv": "ball", "b.csv": "cone", "c.csv": "cone"}
    assert places == {f: ("hall 3", ball) for f, ball in expected.items()}
    out, places = made(tmp_path / "seat", files, *POINTS, "--seat", "hall 3", "--yes")
    assert places == {"a.csv": ("hall 3", "a"), "b.csv": ("hall 3", "b"), "c.csv": ("hall 3", "b")}
    err = refused(tmp_path / "made", files, *POINTS, "--seat", "a", "--seat", "b")
    assert "2 times --seat for 3 files: give it once for all, or once for each" in err
    assert "in this order: a.csv, b.csv, c.csv." in err
    code, _, err = new(tmp_path / "made", files, *POINTS, "--seat", "")
    assert (code, "'': no name of a seat or target." in err) == (2, True)


def test_a_column_of_seats_leaves_the_targets_to_be_seen(tmp_path: Path) -> None:
    files = []
    for k, name in enumerate(("a", "b")):
        path = table(tmp_path / f"{name}.csv", Q, points(Q, REFLECTORS[k]))
        moved = table(tmp_path / "moved.csv", OTHERS, points(OTHERS, REFLECTORS[k], MOVED))
        rows = path.read_text("cp1252").splitlines()
        more = moved.read_text("cp1252").splitlines()[1:]
        head = rows[0].replace("Größe", "Station")
        named = [f"{row[:-1]}floor" for row in rows[1:]] + [f"{row[:-1]}hall" for row in more]
        path.write_text("\n".join([head, *named]) + "\n")
        files.append(path)
    out, places = made(tmp_path / "made", files, *POINTS, "--value-unit", "mm", "--yes")
    assert "b.csv: seat of column Station, target b" in out
    station = {"column": "Station"}
    assert places == {"a.csv": (station, "a"), "b.csv": (station, "b")}


# Axes 2, 3 and 5 are parallel, and their angles have one sum: the flange keeps its orientation.
_TURNS = np.random.default_rng(5).uniform([-0.6, -0.8], [0.9, 0.6], (40, 2))
STANDING = np.tile([0.4, 0.0, 0.0, 0.0, 0.5, 0.3], (40, 1))
STANDING[:, 1:3] += _TURNS
STANDING[:, 4] -= _TURNS.sum(axis=1)


@pytest.mark.parametrize(
    ("q", "reason"),
    [
        (Q[:8], "it or a.csv has fewer than 10 poses"),
        (STANDING, "another seat than that of a.csv explains it, and so does another target"),
    ],
)
def test_files_that_show_nothing_are_refused_by_yes_and_named_by_options(
    tmp_path: Path, q: Array, reason: str
) -> None:
    files = [
        table(tmp_path / "a.csv", q, points(q, REFLECTORS[0])),
        table(tmp_path / "b.csv", q, points(q, REFLECTORS[1])),
    ]
    code, out, err = new(tmp_path / "made", files, *POINTS, "--yes", "--joint-unit", "deg")
    assert code == 2
    assert f"  b.csv: seat ?, target ?\n    {reason}\n" in out
    assert f"b.csv does not show its seat: {reason}. Which is it? (or --seat NAME, once" in err
    assert not (tmp_path / "made").exists()
    words = ["--seat", "one", "--target", "a", "--target", "b", "--joint-unit", "deg"]
    made(tmp_path / "made", files, *POINTS, *words)


def test_a_file_that_fits_no_robot_or_not_what_is_given_shows_nothing(tmp_path: Path) -> None:
    shuffled = points(OTHERS, REFLECTORS[0])[::-1]
    files = [
        table(tmp_path / "a.csv", Q, points(Q, REFLECTORS[0])),
        table(tmp_path / "b.csv", OTHERS, shuffled),
    ]
    err = refused(tmp_path / "made", files, *POINTS, "--yes")
    assert "b.csv does not show its seat: beside a.csv it fits the catalogue robot to " in err
    table(tmp_path / "b.csv", OTHERS, points(OTHERS, REFLECTORS[0], MOVED))
    err = refused(tmp_path / "made", files, *POINTS, "--seat", "hall", "--yes")
    assert "its target: it and a.csv do not fit the one seat that is given. Which is it?" in err


def test_at_a_terminal_the_proposal_is_accepted_or_replaced_by_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [
        table(tmp_path / "a.csv", Q, points(Q, REFLECTORS[0])),
        table(tmp_path / "b.csv", Q, points(Q, REFLECTORS[1])),
    ]
    code, _, err = new(tmp_path / "made", files, *POINTS)
    assert code == 2, "without a terminal nothing is taken in silence"
    assert "Proposed: yes; --yes takes it." in err
    replies = in_turn("perhaps", "No", "floor", "ball", " ", "floor", "cone")
    asked = at_the_terminal(monkeypatch, replies)
    _, places = made(tmp_path / "made", files, *POINTS)
    assert "  b.csv: seat seat, target b\n    at equal joint angles its points are" in asked[0][0]
    assert asked[1][0].startswith("'perhaps': expected yes or no.\n")
    assert [default for _, default in asked] == ["yes", "yes", "seat", "a", "seat", "seat", "b"]
    assert "' ': no name of a seat or target." in asked[5][0]
    assert places == {"a.csv": ("floor", "ball"), "b.csv": ("floor", "cone")}


def test_a_file_is_named_once_and_a_folder_holds_files(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", Q, points(Q, REFLECTORS[0]))
    code, _, err = new(tmp_path / "made", [path, tmp_path / "a.csv"], *POINTS)
    assert (code, "is named twice; name it once" in err) == (2, True)
    (tmp_path / "empty").mkdir()
    code, _, err = new(tmp_path / "made", [tmp_path / "empty"], *POINTS)
    assert (code, "this folder holds no files" in err) == (2, True)


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["grid_cleaned.csv", "random_cleaned.csv"], ["grid", "random"]),
        (["left/hole_0.csv", "left/hole_1.csv"], ["left/hole_0", "left/hole_1"]),
        (["monday/poses.csv", "friday/poses.csv"], ["monday", "friday"]),
        (["poses_1.csv", "poses_2.csv"], ["poses_1", "poses_2"]),
        (["poses.csv", "poses_2.csv"], ["poses", "poses_2"]),
        (["2026-11-20.csv.gz", "2026-11-21.csv.gz"], ["2026-11-20", "2026-11-21"]),
        (["a.csv", "a.txt"], ["a.csv", "a.txt"]),
        (["_.csv", "__.csv"], ["_.csv", "__.csv"]),
    ],
)
def test_files_are_called_by_what_their_names_differ_in(files: list[str], names: list[str]) -> None:
    assert labels(files) == names


needs_data = pytest.mark.skipif(
    not real_robots.DATA.is_dir(), reason=f"{real_robots.DATA}: no data of real robots"
)


@needs_data
def test_two_files_of_a_measured_ur5_are_one_seat_and_one_target(tmp_path: Path) -> None:
    values = ",".join(f"{c}_t - {c}_dif" for c in "xyz")
    files = sorted((real_robots.DATA / "ur5_tracker").glob("*.csv"))
    words = ["--robot", "ur5", "--instrument", "tracker_point", "--values", values, "--yes"]
    out, places = made(tmp_path / "made", files, *words)
    assert set(places.values()) == {("seat", "target")}
    assert "one seat and one target fit it and" in out


@needs_data
@pytest.mark.long
def test_two_series_of_a_measured_ur10_are_two_seats_and_one_target(tmp_path: Path) -> None:
    files = sorted((real_robots.DATA / "ur10_tmac").glob("*/measurements_*.csv"))
    words = ["--robot", "ur10", "--instrument", "tracker_pose", "--yes"]
    out, places = made(tmp_path / "made", files, *words)
    assert list(places.values()) == [("grid", "target"), ("joint_configurations", "target")]
    assert "two seats, 5.21 m and 50.3 deg apart, and one target fit it and" in out


@needs_data
def test_every_file_of_a_measured_panda_is_a_socket(tmp_path: Path) -> None:
    words = ["--robot", "panda", "--instrument", "socket_pair_50", "--yes"]
    folder = real_robots.DATA / "panda_sockets" / "panda_6"
    _, places = made(tmp_path / "made", [folder], *words)
    assert places == {
        f"{site}/hole_{k}.csv": (f"{site}/hole_{k}", "target")
        for site in real_robots.PANDA_SITES["panda_6"]
        for k in (0, 1)
    }
