"""A length instrument as a ball-bar whose rod is sensed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import DescriptionError
from ballbar.cell.geometry import bar_frames, nominal_geometry
from ballbar.cell.load import load_measured_cell, load_plate, load_robot, load_telescoping_bar


def test_a_draw_wire_stands_in_the_cell_as_a_massless_bar() -> None:
    cell = load_measured_cell("irb2400", "drawwire_2m", "plate_250")
    bar = cell.ballbar
    assert bar.length == 1.2
    assert bar.stroke == (0.1, 2.0)
    assert bar.length_tolerance == 5e-3  # its zero is not calibrated
    assert sum(link.mass for link in bar.links) == 0.0
    assert load_telescoping_bar("qc20w_300").length_tolerance == 0.0


def test_a_ball_bar_is_still_a_ball_bar() -> None:
    assert load_measured_cell("irb2400", "lund_600", "plate_250").ballbar.stroke is None


def test_a_file_shows_by_its_schema_what_it_describes(tmp_path: Path) -> None:
    shipped = Path(__file__).parents[2] / "cell/instruments"
    for name in ("qc20w_300", "lund_900"):
        (tmp_path / f"{name}.yaml").write_text((shipped / f"{name}.yaml").read_text())
        cell = load_measured_cell("irb2400", f"{name}.yaml", "plate_250", relative_to=tmp_path)
        assert cell.ballbar.name == name


def test_a_tracker_measures_no_length_over_time() -> None:
    with pytest.raises(DescriptionError, match="tracker_point measures a point, not a length"):
        load_telescoping_bar("tracker_point")


def test_an_extension_moves_the_tool_along_the_rod() -> None:
    bar = load_telescoping_bar("drawwire_2m")
    cell = Cell(load_robot("irb2400"), bar, load_plate("plate_250"))
    geometry = nominal_geometry(cell, np.array([0.5, -0.2, 0.1]))
    b = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 5))
    extension = np.linspace(-1.0, 0.7, 20)
    rigid = bar_frames(geometry, b)
    longer = bar_frames(geometry, np.column_stack((b, extension)))
    np.testing.assert_allclose(longer.tip - rigid.tip, rigid.z[2] * extension, atol=1e-15, rtol=0.0)
    distance = np.linalg.norm(longer.tip.T - geometry.origin, axis=1)
    np.testing.assert_allclose(distance, 1.2 + extension, rtol=1e-14)
