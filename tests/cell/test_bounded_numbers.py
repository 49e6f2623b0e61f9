"""No schema takes a number that no quantity has: its square is infinite, or its inverse."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.recording import read_recording
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import DescriptionError
from ballbar.cell.geometry import Geometry
from ballbar.cell.schema import LARGEST, Strict
from ballbar.export.formats import exported
from ballbar.export.result import load_result
from ballbar.scenario import load_scenario
from tests.helpers.calibrations import GEARS, corrections_of, write_calibration_of
from tests.helpers.device_logs import put, write
from tests.helpers.source_imports import FILES

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def test_every_schema_is_strict() -> None:
    plain = [name for name, file in FILES.items() if "(BaseModel)" in file.read_text("utf-8")]
    assert plain == ["ballbar.cell.schema"]


@pytest.mark.parametrize("unit", sorted(LARGEST))
def test_the_unit_of_a_key_bounds_its_number(unit: str) -> None:
    fields = {"__annotations__": {f"size_{unit}": float}}
    made: type[Strict] = type("Made", (Strict,), fields)
    assert made.model_validate({f"size_{unit}": LARGEST[unit]})
    for value in (1.01 * LARGEST[unit], -1.01 * LARGEST[unit], 1e-120):
        with pytest.raises(ValueError, match=r"expected (at most|0, or)"):
            made.model_validate({f"size_{unit}": value})


@pytest.mark.parametrize("value", [".nan", "-.inf", "1e300", "1e-300"])
def test_no_number_of_a_calibration_is_beyond_every_quantity(
    tmp_path: Path, cell: Cell, nominal: Geometry, value: str
) -> None:
    """One of them made `export` write a robot with NaN, and `compare` end in a traceback."""
    corrections = corrections_of(cell, GEARS, np.random.default_rng(1))
    path = write_calibration_of(
        tmp_path / "calibration.yaml", nominal, nominal, corrections=corrections
    )
    assert exported(load_result(path), "dh")
    lines, keys = path.read_text().split("\n"), set()
    for i, line in enumerate(lines):
        key = re.fullmatch(r"( *(?:- |\w+: ))-?\d[\d.e+-]*", line)
        if key is None or key[1] in keys:
            continue
        keys.add(key[1])
        path.write_text("\n".join([*lines[:i], f"{key[1]}{value}", *lines[i + 1 :]]))
        with pytest.raises(DescriptionError, match=rf"calibration\.yaml:{i + 1}: "):
            load_result(path)
    assert len(keys) > 15


def test_a_negative_sigma_is_refused(tmp_path: Path, nominal: Geometry) -> None:
    path = write_calibration_of(tmp_path / "calibration.yaml", nominal, nominal)
    text = path.read_text()
    path.write_text(text.replace("sigma: 2.0e-06", "sigma: -2.0e-06", 1))
    with pytest.raises(DescriptionError, match=r"\.sigma = -2e-06: expected 0 or more"):
        load_result(path)


def test_lines_of_an_encoder_and_steps_of_time_are_bounded(tmp_path: Path) -> None:
    write(tmp_path, change=put("encoders", "b1", "lines", value=10**30))
    with pytest.raises(DescriptionError, match=r"encoders\.b1\.lines.*10000000 or less"):
        read_recording(tmp_path)
    scenario = tmp_path / "a.yaml"
    text = (SCENARIOS / "irb2400.yaml").read_text()
    scenario.write_text(text.replace("timestep_s: 1.0e-3", "timestep_s: 1.0e-9"))
    with pytest.raises(DescriptionError, match=r"plant\.timestep_s = 1e-09: expected 0\.0001"):
        load_scenario(scenario)
