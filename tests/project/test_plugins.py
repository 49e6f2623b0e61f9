"""The example of plug-ins, installed from its wheel beside that of ballbar, and put to work."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.files import write_yaml
from ballbar.cell.strict_yaml import load_yaml
from tests.helpers.source_imports import ROOT
from tests.helpers.wheels import OFFLINE, commands_of, python, run

__all__ = ["python"]  # fixture: ballbar by its wheel, alone in an environment
pytestmark = pytest.mark.slow

EXAMPLE = ROOT / "examples" / "plugin"
BELT = 2.0e-4  # [rad] amplitude of the pitch error
CORRECTIONS = "rod_strain,belt_ripple"
MOVING = f"""name: belt
cell: {{robot: irb2400, ballbar: lund_600, ballbar_position_m: [0.70, 0.0, 0.54]}}
path: {{kind: lissajous, file: {ROOT}/scenarios/paths/irb2400_a.yaml, duration_s: 40, dwell_s: 2}}
plant: {{kind: kinematic}}
errors:
  static: {{table: thesis_3_1}}
  joint_noise: {{sigma_rad: 1.0e-5}}
  belt_ripple: {{amplitude_rad: {BELT}}}
encoders: {{noise_sigma_rad: 1.0e-5}}
identify: {{corrections: [rod_strain, belt_ripple]}}
seed: 3
"""
STILL = """name: cameras
cell: {robot: ur10e, instrument: camera.yaml}
poses:
  count: 60
  seats:
    - {name: side, position_m: [0.6, 1.5, 0.5], rotvec_rad: [1.5707963, 0, 0]}
    - {name: above, position_m: [0.6, 0.0, 2.0], rotvec_rad: [3.1415926, 0, 0]}
  targets: [{name: ball, position_m: [0.05, 0.0, 0.1]}]
  axis_lower_deg: [-180, -180, -150, -180, -180, -180]
  axis_upper_deg: [180, 0, 150, 180, 180, 180]
  lowest_m: 0.1
errors: {geometry: {}, instrument_noise: {}}
accept: {verdict: good, tcp_mean_mm: 0.03}
seed: 1
"""
SPAWNED = """
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from ballbar.cell.load import load_cell
from ballbar.ident.corrections import correction_named

if __name__ == "__main__":
    made = correction_named("belt_ripple", load_cell("irb2400", "lund_600", "plate_250"), ())
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        print(pool.submit(getattr, made, "sentence").result())
"""
Ballbar = Callable[..., str]


@pytest.fixture(scope="module")
def folder(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Work folder, once the example is installed from its wheel; nothing is downloaded."""
    source = tmp_path_factory.mktemp("plugin") / "source"
    shutil.copytree(EXAMPLE, source)
    pip, options = ("-m", "pip"), ("--no-deps", *OFFLINE)
    run(
        *(sys.executable, *pip, "wheel", source, "-w", "dist", "--no-build-isolation", *options),
        cwd=source.parent,
    )
    (built,) = (source.parent / "dist").glob("ballbar_example-*.whl")
    run(sys.executable, *pip, "--python", python, "install", *options, built, cwd=source.parent)
    for name in ("camera.yaml", "npy.yaml"):
        shutil.copy(EXAMPLE / name, source.parent)
    return source.parent


@pytest.fixture(scope="module")
def ballbar(python: Path, folder: Path) -> Iterator[Ballbar]:
    """Standard output of a command of the environment, which succeeds."""
    with commands_of(python, folder) as say:
        yield say


@pytest.fixture(scope="module")
def recording(ballbar: Ballbar, folder: Path) -> Path:
    """A recording of a robot with a toothed belt at axis 1."""
    (folder / "belt.yaml").write_text(MOVING)
    ballbar("simulate", "belt.yaml", "--out", "recording")
    return folder / "recording"


@pytest.fixture(scope="module")
def result(ballbar: Ballbar, folder: Path, recording: Path) -> Path:
    """The identification with the correction of it."""
    words = ("--corrections", CORRECTIONS, "--out", "result")
    assert "belt_ripple" in ballbar("identify", recording, *words)
    return folder / "result"


def test_the_example_is_short() -> None:
    files = [EXAMPLE / "pyproject.toml", *EXAMPLE.rglob("*.py")]
    assert len(files) == 7
    assert sum(len(file.read_text().splitlines()) for file in files) < 150


def test_an_instrument_of_a_plugin_identifies_a_robot_at_still_poses(
    python: Path, folder: Path
) -> None:
    """By the installed command, in a process of its own."""
    (folder / "cameras.yaml").write_text(STILL)
    installed = python.with_name("ballbar")
    assert "Good fit" in run(installed, "run", "cameras.yaml", "--out", "cameras", cwd=folder)
    assert "camera readings" in (folder / "cameras/report.html").read_text()


def test_an_error_source_of_a_plugin_is_found_again_by_its_correction(result: Path) -> None:
    """By its size, which the calibration file and the report state."""
    stated = load_yaml(result / "calibration.yaml").data["corrections"]["belt_ripple"]
    waves = [stated[name] for name in ("belt1_sin", "belt1_cos")]
    sigma = max(wave["sigma"] for wave in waves)
    assert sigma < 0.01 * BELT
    assert abs(np.hypot(*(wave["value"] for wave in waves)) - BELT) < 4.0 * sigma
    report = (result / "report.html").read_text()
    assert "Pitch error of the belt" in report
    assert "ballbar-example 1.0" in " ".join(report.split())


def test_the_truth_of_a_run_states_the_errors_of_a_plugin(ballbar: Ballbar, result: Path) -> None:
    """The identified robot is compared with one that has them: without the correction it is off."""
    ballbar("identify", "recording", "--corrections", "rod_strain", "--out", "without")
    found, without = (
        json.loads(ballbar("compare", f"{r}/calibration.yaml", "recording.truth.yaml", "--json"))
        for r in (result, "without")
    )
    found, without = (comparison["tcp_error"]["mean_m"] for comparison in (found, without))
    assert found < 1e-5
    assert without > 5e-5


def test_help_and_schema_name_what_plugins_add(ballbar: Ballbar, folder: Path) -> None:
    assert "belt_ripple" in "".join(ballbar("identify", "--help").split("│"))
    assert "errors.belt_ripple" in ballbar("run", "--help")
    ballbar("schema", "--out", "schemas")
    schema = (folder / "schemas/scenario.schema.json").read_text()
    assert "The belt of axis 1 has a pitch error." in schema
    assert "Cycles per turn of the axis." in schema


def test_keys_that_no_plugin_has_are_refused(ballbar: Ballbar, folder: Path) -> None:
    wrong = {"belt_ripple:": "belt_riple:", "amplitude_rad": "amplitud_rad"}
    for key, other in wrong.items():
        (folder / "wrong.yaml").write_text(MOVING.replace(key, other))
        with pytest.raises(AssertionError, match=f"Did you mean {key.strip(':')}"):
            ballbar("simulate", "wrong.yaml", "--out", "w")


def test_a_recording_in_a_container_of_a_plugin_is_the_same_recording(
    ballbar: Ballbar, folder: Path, recording: Path, result: Path
) -> None:
    other = shutil.copytree(recording, folder / "other")
    shutil.copy(EXAMPLE / "npy.yaml", other)
    lines = (other / "raw/robot.csv").read_text().splitlines()
    values = np.array([line.split(",") for line in lines[1:]], dtype=np.float64)
    kinds = [("t_ns", np.int64), *((f"m{k}", np.float64) for k in range(1, 7))]
    rows = np.empty(len(values), dtype=kinds)
    rows["t_ns"] = np.rint(values[:, 0] * 1e9)
    for k in range(1, 7):
        rows[f"m{k}"] = values[:, k]
    np.save(other / "raw/robot.npy", rows)
    content = load_yaml(other / "recording.yaml").data
    content["sources"]["robot"] = {"files": ["raw/robot.npy"], "dialect": "npy.yaml"}
    write_yaml(other / "recording.yaml", content)
    ballbar("identify", other, "--corrections", CORRECTIONS, "--out", "other-result")
    read, expected = (
        load_yaml(where / "calibration.yaml").data["parameters"]
        for where in (folder / "other-result", result)
    )
    for name, entry in expected.items():
        assert read[name]["value"] == pytest.approx(entry["value"], abs=1e-9)


def test_a_result_is_written_in_a_format_of_a_plugin(ballbar: Ballbar, result: Path) -> None:
    text = ballbar("export", result, "--to", "matlab")
    assert "robot = SerialLink([" in text
    assert text.count("Link('d'") == 6


def test_a_worker_process_has_the_plugins_too(python: Path, folder: Path) -> None:
    (folder / "spawned.py").write_text(SPAWNED)
    assert "pitch error of the belt" in run(python, "spawned.py", cwd=folder)
