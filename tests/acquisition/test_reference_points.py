"""Tables with reference points: read into the steady frame of the seat, or refused in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.acquisition.pose_tables import PoseImport, import_poses
from ballbar.acquisition.report import finding_line, report_lines
from ballbar.cell.arrays import Array
from ballbar.cell.errors import DescriptionError, InputError
from tests.helpers.command_line import ballbar
from tests.helpers.pose_files import (
    LENGTHS,
    NAMES,
    POINTS,
    POSES,
    ROTATIONS,
    Q,
    lines,
    refused,
    write,
)

SIGMA = 1e-5  # [m]
FIXED = POINTS.mean(axis=0) + np.array(  # (4, 3) [m] in the tracker's frame
    [[1.0, 0.2, -0.8], [-0.9, 1.0, -0.7], [-0.6, -1.1, -0.9], [0.5, -0.9, 0.9]]
)
COLUMNS = [f"r{k}{axis}" for k in range(1, 5) for axis in "xyz"]
TURN = Rotation.from_rotvec(np.linspace(0.0, 1.0, POSES)[:, None] * [1e-4, -5e-5, 2e-4])
SHIFT = np.linspace(0.0, 1.0, POSES)[:, None] * [2e-4, 1e-4, -1e-4]  # (N, 3) [m]
REFERENCE = {"columns": COLUMNS, "sigma_m": SIGMA}


def references(seed: int = 1, noise: float = SIGMA) -> Array:
    """(N, 4, 3) [m] fixed points as the drifting seat sees them."""
    white = np.random.default_rng(seed).normal(0.0, noise, (POSES, 4, 3))
    return np.stack([TURN.apply(point) + SHIFT for point in FIXED], axis=1) + white


def seen() -> Array:
    """(N, 3) [m] targets as the drifting seat sees them."""
    return TURN.apply(POINTS) + SHIFT


def table(reference: Array | None = None, values: Array | None = None) -> Array:
    """(N, C) [deg, mm] angles, targets and reference points."""
    read = references() if reference is None else reference
    measured = seen() * 1e3 if values is None else values
    return np.hstack((np.rad2deg(Q), measured, read.reshape(len(read), -1) * 1e3))


def text(numbers: Array, **how: Any) -> list[str]:
    """Lines of a table in which NaN is an empty field."""
    return [line.replace("nan", "") for line in lines(numbers, [*NAMES, *COLUMNS], **how)]


def imported(folder: Path, numbers: Array | None = None, **keys: Any) -> PoseImport:
    rows = text(table() if numbers is None else numbers)
    return import_poses(write(folder, rows, **{"reference": REFERENCE} | keys))


def away(values: Array) -> float:
    """[m] rms distance of values (N, 3) from the steady targets, but for a common motion."""
    steady, true = values - values.mean(axis=0), POINTS - POINTS.mean(axis=0)
    turn, _ = Rotation.align_vectors(true, steady)
    return float(np.sqrt(((turn.apply(steady) - true) ** 2).sum(axis=1).mean()))


def said(content: PoseImport, kind: str) -> list[str]:
    return [finding_line(f) for f in content.report.findings if f.kind == kind]


def test_targets_are_read_in_the_mean_frame_of_the_seat(tmp_path: Path) -> None:
    content = imported(tmp_path)
    (group,) = content.table.groups
    assert away(seen()) > 8e-5
    assert away(group.values) < 1e-5  # one reading of a point: 1.7e-5
    plain = import_poses(write(tmp_path / "plain", text(table()))).table.groups[0]
    np.testing.assert_allclose(plain.values, seen(), atol=1e-11)  # digits of the table
    added = np.sqrt(group.sigma**2 - plain.sigma**2)
    assert added.min() > 5e-7
    assert added.max() < 1e-5
    assert any("moving seat" in line for line in report_lines(content.report))


def test_the_report_says_how_far_the_seat_moved_and_it_is_no_repair(tmp_path: Path) -> None:
    content = imported(tmp_path)
    (line,) = said(content, "moving seat")
    assert line.startswith("poses.csv: moving seat: seat seat moved by up to 0.")
    assert "mm (targets) and 0.2" in line  # mrad
    assert "against 4 reference points, read in 40 measurements, which scatter by 0.0" in line
    assert "declared 0.01 mm; corrected, to 0.0" in line
    assert line.endswith("Nothing: the values are those of a seat at rest.")
    code, out, _ = ballbar("check", tmp_path, "--explain", "--strict")
    assert code == 0
    assert "reference points: r1x, r1y, r1z" in out


def test_rotations_of_a_pose_are_corrected_too(tmp_path: Path) -> None:
    rotations = TURN * ROTATIONS
    names = [*NAMES, "rx", "ry", "rz", *COLUMNS]
    values = np.hstack((seen() * 1e3, rotations.as_rotvec()))
    rows = lines(table(values=values), names)
    measured = {
        "columns": ["x", "y", "z", "rx", "ry", "rz"],
        "unit": "mm",
        "rotation": "rotvec",
        "angle_unit": "rad",
    }
    keys = {"instrument": "tracker_pose", "values": measured}
    (group,) = import_poses(write(tmp_path, rows, reference=REFERENCE, **keys)).table.groups
    (plain,) = import_poses(write(tmp_path / "plain", rows, **keys)).table.groups

    def off(vectors: Array) -> float:
        turn = Rotation.from_rotvec(np.array(vectors)) * ROTATIONS.inv()
        return float(np.sqrt(((turn * turn.mean().inv()).magnitude() ** 2).mean()))

    assert off(plain.values[:, 3:]) > 5e-5
    assert off(group.values[:, 3:]) < 1e-5
    assert (group.sigma[:, 3:] > plain.sigma[:, 3:]).all()


@pytest.mark.parametrize("unit", ["header", "yaml"])
def test_units_and_decimal_commas_are_those_of_the_values(unit: str, tmp_path: Path) -> None:
    names = [*NAMES, *COLUMNS]
    if unit == "header":
        names = [*NAMES[:6], *(f"{name} [mm]" for name in names[6:])]
    rows = lines(table(), names, separator=";", comma=True)
    values = {"columns": ["x", "y", "z"], "unit": "mm" if unit == "yaml" else None}
    content = import_poses(write(tmp_path, rows, values=values, reference=REFERENCE))
    assert away(content.table.groups[0].values) < 1e-5


def test_a_unit_of_the_header_that_contradicts_that_of_the_values(tmp_path: Path) -> None:
    rows = lines(table(), [*NAMES, *(f"{name} [m]" for name in COLUMNS)])
    sentence = refused(write(tmp_path, rows, reference=REFERENCE), DescriptionError)
    assert "tables[0].values.unit: mm, but the header says m. Correct one of them." in sentence


def test_azimuth_elevation_and_distance_as_in_the_values(tmp_path: Path) -> None:
    def polar(points: Array) -> Array:
        flat, length = np.hypot(points[..., 0], points[..., 1]), np.linalg.norm(points, axis=-1)
        azimuth = np.arctan2(points[..., 1], points[..., 0])
        return np.stack((azimuth, np.arctan2(points[..., 2], flat), length * 1e3), axis=-1)

    numbers = table(polar(references()) / 1e3, polar(seen()))
    values = {"columns": ["x", "y", "z"], "unit": "mm", "angle_unit": "rad"}
    content = imported(tmp_path, numbers, values={**values, "spherical": "elevation"})
    assert away(content.table.groups[0].values) < 1e-5


def test_sigma_is_that_of_the_instrument_where_none_is_declared(tmp_path: Path) -> None:
    content = imported(tmp_path, reference={"columns": COLUMNS})
    (line,) = said(content, "moving seat")
    assert "declared 0.00748 mm" in line  # tracker_point at 2 m
    assert away(content.table.groups[0].values) < 1e-5


def test_rows_without_reference_points_have_their_frame_from_the_others(tmp_path: Path) -> None:
    read = references()
    read[5::7, 1] = np.nan
    read[3::4] = np.nan
    read[10, 2, 1] = np.nan  # two coordinates make no reading
    content = imported(tmp_path, table(read))
    (group,) = content.table.groups
    assert group.size == POSES
    assert away(group.values) < 1.2e-5
    assert "read in 30 measurements" in said(content, "moving seat")[0]


def test_readings_that_stand_in_several_rows_count_once(tmp_path: Path) -> None:
    once = imported(tmp_path / "once").table.groups[0]
    twice = imported(tmp_path / "twice", np.repeat(table(), 2, axis=0)).table.groups[0]
    np.testing.assert_allclose(twice.values[::2], once.values, atol=1e-12)
    np.testing.assert_allclose(twice.sigma[::2], once.sigma, atol=1e-12)


def two_tables(folder: Path, second: Array, **keys: Any) -> Path:
    """A folder with half of the table in each of two files; keys : of the second."""
    rows = text(table())
    (folder / "b").parent.mkdir(parents=True, exist_ok=True)
    (folder / "b.csv").write_text("\n".join([rows[0], *text(second)[21:]]) + "\n")

    def change(description: dict[str, Any]) -> None:
        (first,) = description["tables"]
        description["tables"].append({**first, "files": ["b.csv"], **keys})

    return write(folder, rows[:21], change, reference=REFERENCE)


def test_files_of_a_seat_define_it_together_and_seats_by_themselves(tmp_path: Path) -> None:
    together = import_poses(two_tables(tmp_path / "a", table()))
    values = np.concatenate([group.values for group in together.table.groups])
    assert away(values) < 1e-5
    assert len(said(together, "moving seat")) == 1
    apart = import_poses(two_tables(tmp_path / "b", table(), seat="other"))
    assert len(said(apart, "moving seat")) == 2
    # half of the drift is no longer taken off: it lies between the two seats
    assert away(np.concatenate([group.values for group in apart.table.groups])) > 4e-5


def test_a_disturbed_reading_is_reported_with_its_line(tmp_path: Path) -> None:
    read = references()
    read[17, 2] += [0.0, 1e-3, 0.0]
    content = imported(tmp_path, table(read))
    (line,) = said(content, "disturbed reference point")
    assert line.startswith("poses.csv:19: disturbed reference point: a point of seat seat lies off")
    assert away(content.table.groups[0].values) < 1e-5


def test_a_knocked_point_is_reported_with_the_line_and_its_size(tmp_path: Path) -> None:
    read = references()
    read[20:, 1] += [1.5e-4, -1.0e-4, 0.8e-4]
    content = imported(tmp_path, table(read))
    (line,) = said(content, "reference point moved")
    assert line.startswith("poses.csv:22: reference point moved: point 2 of seat seat moved by 0.")
    assert "mm against the others; from here on it is another point. Fasten it." in line
    assert away(content.table.groups[0].values) < 1.5e-5


def test_points_that_scatter_beyond_what_was_declared_are_reported(tmp_path: Path) -> None:
    content = imported(tmp_path, table(references(noise=5e-5)))
    (line,) = said(content, "loose reference points")
    assert "scatter about a rigid motion by 0.0" in line
    assert line.endswith("Fasten them, or correct sigma_m of reference in poses.yaml.")


@pytest.mark.parametrize(
    ("reference", "sentence"),
    [
        (
            {"columns": COLUMNS[:6]},
            "FOLDER/poses.yaml:24: tables[0].reference.columns: 2 points; expected 3 or more, "
            "which show how the seat turns",
        ),
        ({"columns": COLUMNS[:10]}, "10 columns; expected x y z of each point"),
        (
            {"columns": [*COLUMNS[:8], "x"]},
            "tables[0].reference.columns: x stands there, or among the joints or values, too.",
        ),
        ({"columns": [*COLUMNS[:8], "r1x"]}, "r1x stands there, or among the joints or values"),
        ({"columns": COLUMNS, "sigma_m": 0}, "sigma_m = 0: expected more than 0"),
        (
            {"columns": COLUMNS, "sigma": 1e-5},
            "unknown key tables[0].reference.sigma. Did you mean sigma_m?",
        ),
    ],
)
def test_keys_that_cannot_be(tmp_path: Path, reference: dict[str, Any], sentence: str) -> None:
    assert sentence in refused(write(tmp_path, text(table()), reference=reference), InputError)


def test_lengths_and_sockets_cannot_be_corrected(tmp_path: Path) -> None:
    rows = lines(np.hstack((np.rad2deg(Q), LENGTHS * 1e3)), NAMES[:7])
    keys: dict[str, Any] = {"values": {"columns": ["x"], "unit": "mm"}, "reference": REFERENCE}
    folder = write(tmp_path, rows, instrument="drawwire_2m", **keys)
    sentence = refused(folder, DescriptionError)
    assert "tables[0].reference: drawwire_2m measures a length; only a measured pos" in sentence
    code, _, err = ballbar("identify", folder, "--out", tmp_path / "result")
    assert code == 2
    assert "Leave reference out." in err
    folder = write(
        tmp_path / "s", rows, instrument="socket_pair_50", values=None, reference=REFERENCE
    )
    assert "socket_pair_50 measures a socket" in refused(folder, DescriptionError)


def test_an_instrument_that_was_set_up_anew_needs_another_seat(tmp_path: Path) -> None:
    read = references()
    read[25:] = (
        Rotation.from_rotvec([0.0, 0.0, 0.1]).apply(read[25:].reshape(-1, 3)).reshape(-1, 4, 3)
    )
    folder = write(tmp_path, text(table(read)), reference=REFERENCE)
    sentence = refused(folder)
    assert sentence.startswith("poses.csv:27: the reference points lie ")
    assert "give each set-up of seat a seat of its own" in sentence


def test_points_in_another_order_in_the_second_file(tmp_path: Path) -> None:
    names = [*COLUMNS[3:], *COLUMNS[:3]]
    folder = two_tables(tmp_path, table(), reference={**REFERENCE, "columns": names})
    assert "Name them in one order" in refused(folder)
    folder = two_tables(tmp_path, table(), reference={**REFERENCE, "columns": COLUMNS[:9]})
    sentence = refused(folder)
    assert sentence.startswith("b.csv: seat seat has 3 reference points, in poses.csv 4.")


def test_points_on_a_line(tmp_path: Path) -> None:
    read = references()
    read[:, 2] = 0.5 * (read[:, 0] + read[:, 1])
    folder = write(tmp_path, text(table(read)), reference={**REFERENCE, "columns": COLUMNS[:9]})
    sentence = refused(folder)
    assert "poses.csv: the reference points of seat seat lie on a line: " in sentence
    assert "They do not show a turn about it:" in sentence


def test_columns_that_are_no_fixed_points(tmp_path: Path) -> None:
    read = references() + np.random.default_rng(3).normal(0.0, 1e-3, (POSES, 4, 3))
    sentence = refused(write(tmp_path, text(table(read)), reference=REFERENCE))
    assert "points of seat seat scatter by 0.9" in sentence
    assert "declared 0.01 mm." in sentence


def test_points_that_are_hardly_ever_read(tmp_path: Path) -> None:
    read = references()
    read[2:, :2] = np.nan
    sentence = refused(write(tmp_path, text(table(read)), reference=REFERENCE))
    assert "of 4 reference points of seat seat 2 are read 3 times. 3 points are needed" in sentence
