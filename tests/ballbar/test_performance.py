"""`ballbar performance`: terminal, JSON and page, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline

from ballbar.cell.descriptions import Cell
from ballbar.cell.instruments.base import TrueStand
from ballbar.cell.load import load_instrument, load_plate, load_telescoping_bar
from ballbar.cell.logs import LengthLog, RobotLog
from ballbar.ident.recording_fit import Logs
from ballbar.report.numbers import MISSING
from ballbar.report.performance import shown
from ballbar.result.calibration import load
from ballbar.result.performance import performance, robots_of
from tests.helpers.circular_path import FEED, circle_angles
from tests.helpers.command_line import output, refusal
from tests.helpers.pose_results import write_pose_result, write_pose_table
from tests.helpers.still_poses import table_of, true_robot


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of still poses of a UR5."""
    return write_pose_result(tmp_path_factory.mktemp("ur5") / "calibration.yaml", "ur5", seed=3)


@pytest.fixture(scope="module")
def repetitions(result: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Poses of its test cube, ten times, of another UR5 with the target `ball`."""
    poses = performance(result).poses
    assert poses is not None
    nominal = robots_of(load(result)).nominal
    solved = nominal.inverse(poses[:1]).q[:, 0]
    q = nominal.nearest(poses, solved[np.isfinite(solved).all(axis=1)][0]).q
    table = table_of(true_robot("ur5", seed=3), "point", q=np.tile(q, (10, 1)), noise=1e-5)
    return write_pose_table(
        tmp_path_factory.mktemp("cube") / "poses", table, "ur5", table.groups[0].q, "ball"
    )


def test_a_result_alone_is_predicted(result: Path) -> None:
    text = output("performance", result)
    assert "test cube of 630 mm (ISO 9283:1998, 6.8)" in text
    (line,) = (line for line in text.splitlines() if line.startswith("AP_p   P1 "))
    assert line.count(" mm p") == 3  # nominal, identified and corrected
    assert "m measured, p predicted" in text
    assert "how the servo stops is not known: measure repetitions" in text
    assert " mm m" not in text


def test_repeated_poses_are_measured(result: Path, repetitions: Path) -> None:
    data = json.loads(output("performance", result, repetitions, "--json"))
    rows = {(row["symbol"], row["place"]): row for row in data["characteristics"]}
    spread = next(row for row in rows.values() if row["symbol"] == "RP_l")
    assert spread["cycles"] == 10
    assert spread["clause"] == "ISO 9283:1998, 7.2.2"
    assert spread["nominal"]["origin"] == "measured"
    assert 1e-5 < spread["nominal"]["value"] < 1e-4
    assert data["cube_side_m"] == 0.63
    assert len(data["cube_poses"]) == 5
    assert rows["AP_p", "workspace, mean"]["nominal"]["origin"] == "predicted"


def test_the_page_marks_every_value(result: Path, repetitions: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert f"Wrote {page}" in output("performance", result, repetitions, "--out", page)
    text = page.read_text()
    assert '<span class="origin measured">measured</span>' in text
    assert '<span class="origin predicted">predicted</span>' in text
    assert "not stated" in text
    assert "pose repeatability" in text
    assert "ISO 9283:1998, 7.2.3" in text
    assert "http" not in text
    assert "exists already" in refusal("performance", result, "--out", page)


def test_a_circle_is_drawn(result: Path, tmp_path: Path) -> None:
    """Points 80 mm about a place that the cube holds, by a robot like the nominal one."""
    stated, nominal = performance(result), robots_of(load(result)).nominal
    assert stated.poses is not None
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    poses = np.tile(stated.poses[0], (turn.size, 1, 1))
    poses[:, 0, 3] += 0.08 * np.cos(turn)
    poses[:, 1, 3] += 0.08 * np.sin(turn)
    solved = nominal.inverse(poses[:1])
    q = nominal.nearest(poses, solved.q[int(solved.within[:, 0].argmax()), 0]).q
    true = true_robot("ur5", seed=3)
    table = table_of(true, "point", q=np.concatenate((q, q[::-1])), noise=2e-6)
    folder = write_pose_table(tmp_path / "circle", table, "ur5", table.groups[0].q, "big ball")
    page = tmp_path / "page.html"
    text = output("performance", result, folder, "--out", page)
    assert "G(b)   circle" in text
    (line,) = (line for line in text.splitlines() if line.startswith("RONt"))
    assert " mm m" in line
    shown = page.read_text()
    assert "Polar plot of the circle" in shown
    assert "magnified" in shown
    assert "counter-clockwise" in shown


def test_what_cannot_be_done_is_refused(result: Path, tmp_path: Path) -> None:
    assert "does not take the poses of a cube of 3 m" in refusal(
        "performance", result, "--cube", 3000
    )
    assert "--radius 0: expected a length above 0 mm" in refusal(
        "performance", result, "--radius", 0
    )
    table = table_of(true_robot("ur10", seed=3), "point", count=20)
    other = write_pose_table(tmp_path / "other", table, "ur10", table.groups[0].q, "ball")
    assert "A result is tried on measurements of the same robot" in refusal(
        "performance", result, other
    )


def test_without_a_cube_the_workspace_is_stated_and_why(result: Path, tmp_path: Path) -> None:
    """The ranges of the result narrowed to 2 deg about postures within them."""
    content = yaml.safe_load(result.read_text())
    middles = np.deg2rad([0.0, -60.0, 80.0, -90.0, -80.0, 10.0])
    content["ranges"] = [{"lower_rad": m - 0.02, "upper_rad": m + 0.02} for m in middles.tolist()]
    narrow = tmp_path / "calibration.yaml"
    narrow.write_text(yaml.safe_dump(content, sort_keys=False))
    text = output("performance", narrow)
    assert "No test cube of 250 to 1000 mm lies within the fitted ranges" in text
    lines = [line for line in text.splitlines() if line.startswith("AP_p")]
    assert [line[7:25] for line in lines] == ["workspace, mean   ", "workspace, largest"]
    assert [line.count(" mm p") for line in lines] == [3, 1]
    assert "the result states one mean uncertainty for all poses" in text
    asked = output("performance", narrow, "--cube", 250)
    assert "outside the range of axes that was fitted, where nothing is known" in asked


def test_measurements_without_repetition_are_said_to_show_nothing(
    result: Path, tmp_path: Path
) -> None:
    table = table_of(true_robot("ur5", seed=3), "point", count=20)
    folder = write_pose_table(tmp_path / "once", table, "ur5", table.groups[0].q, "ball")
    assert "The measurements hold no pose three times" in output("performance", result, folder)


def test_a_recording_of_a_ball_bar_is_a_circular_test(result: Path) -> None:
    """The bar logs its length at 100 Hz on a clock that began 0.2 s earlier; the report of the bar
    itself is a fit of radius and two eccentricities to the lengths by the angle of the feed.
    """
    true, instrument = true_robot("ur5", seed=3), load_instrument("qc20w_300")
    way = CubicSpline(FEED, circle_angles()[: FEED.size])

    def feed_at(t: np.ndarray) -> np.ndarray:
        """(N,) [rad] up for 18 s, and down again; t (N,) [s]."""
        return np.asarray(2.0 * np.pi * (1.0 - np.abs(t / 18.0 - 1.0)))

    t, fine = np.arange(0.0, 36.0, 0.01), np.arange(0.0, 35.7, 0.01)
    feed = feed_at(fine + 0.2)
    q = way(feed)
    places = true.positions(q)
    rod = (places - places.mean(axis=0) + np.array([2e-4, -1e-4, 0.0])).T
    noise = np.random.default_rng(4).standard_normal((6, fine.size))
    distance = np.linalg.norm(rod, axis=0)
    stand = TrueStand(rod, distance, np.repeat(np.eye(3)[:, :, None], fine.size, axis=2))
    length = instrument.kind.measure(stand, noise, instrument)[:, 0]
    logs = Logs(RobotLog(t, way(feed_at(t))), None, None, "circle", LengthLog(fine, length))
    cell = Cell(true.robot, load_telescoping_bar("qc20w_300"), load_plate("plate_250"))
    stated = performance(result, logs, radius=0.12, cell=cell)
    rows = {row.symbol: row.statements[0] for row in stated.rows if row.place == "circle"}
    design = np.column_stack((np.ones(feed.size), np.cos(feed), np.sin(feed)))
    solution = np.linalg.lstsq(design, distance, rcond=None)[0]
    left = distance - design @ solution
    # noise of 0.5 um is averaged over ten rows an arc, of 1 deg
    assert rows["G(b)"].value == pytest.approx(np.ptp(left), abs=6e-6)
    assert rows["F_max"].value == pytest.approx(left.max() + solution[0] - 0.12, abs=6e-6)
    assert rows["F_min"].value == pytest.approx(left.min() + solution[0] - 0.12, abs=6e-6)
    assert np.ptp(left) > 5e-5
    assert not any("--radius" in note for note in stated.notes)
    assert any("--radius" in n for n in performance(result, logs, cell=cell).notes)


def test_values_are_in_millimetres_with_their_interval_and_a_number_for_each_remark() -> None:
    def statement(**given: Any) -> Any:
        whole = {"origin": "p", "value": 1.2345e-3, "low": 1e-3, "high": 2e-3, "reason": ""}
        return SimpleNamespace(**whole | given)

    rows: Any = [
        SimpleNamespace(unit="m", statements=[statement(), statement(reason="first")]),
        SimpleNamespace(
            unit="rad", statements=[statement(value=None, reason="second"), statement(low=None)]
        ),
        SimpleNamespace(unit="m", statements=[statement(reason="first")]),
    ]
    table, remarks = shown(rows)
    assert remarks == ["first", "second"]
    assert [unit for _, unit, _ in table] == ["mm", "mrad", "mm"]
    cells = [cell for _, _, cells in table for cell in cells]
    assert cells == [
        ("p", "1.23", "1.00 to 2.00", 0),
        ("p", "1.23", "1.00 to 2.00", 1),
        ("p", MISSING, "1.00 to 2.00", 2),
        ("p", "1.23", "", 0),
        ("p", "1.23", "1.00 to 2.00", 1),
    ]
