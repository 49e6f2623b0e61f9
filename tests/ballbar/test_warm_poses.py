"""Still poses measured at 35 degC: rods, fixtures and boards have grown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import ballbar
from ballbar.acquisition.pose_tables import import_poses
from ballbar.cell.geometry import parameter_named
from ballbar.cell.load import load_instrument, load_robot
from ballbar.report.budget import temperature_sentence
from ballbar.result.calibration import Calibration
from ballbar.sim.truth import PoseTruth, load_truth
from tests.helpers.still_poses import table_of, true_robot

STEEL, SIGMA = 11.5e-6, 1e-6  # [1/K]
WARM = 35.0  # [deg C]
GROWTH = 15.0 * STEEL
SEATS = [{"name": name, "position_m": place} for name, place in (
    ("left", [0.8, 0.5, 0.0]), ("right", [0.8, -0.5, 0.0]), ("behind", [-0.6, 0.6, 0.0]),
)]  # fmt: skip


def steel(folder: Path, instrument: str) -> str:
    """File of a shipped instrument whose lengths are of steel."""
    shipped = Path(ballbar.__file__).parent / "cell" / "instruments" / f"{instrument}.yaml"
    stated = yaml.safe_load(shipped.read_text()) | {
        "expansion": {"per_K": STEEL, "sigma_per_K": SIGMA}
    }
    (folder / "steel.yaml").write_text(yaml.safe_dump(stated, sort_keys=False))
    return "steel.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An IRB 2400 of steel on a wire of steel, noise of a hundredth of the file's, both at WARM."""
    folder = tmp_path_factory.mktemp("warm")
    scenario = {
        "name": "warm",
        "cell": {
            "robot": "irb2400", "instrument": steel(folder, "drawwire_2m"),
            "temperature_C": WARM, "temperature_sigma_K": 0.5,
        },
        "plant": {"kind": "kinematic"},
        "poses": {
            "count": 150, "lowest_m": 0.05,
            "seats": [s | {"position_m": [1.6 * x for x in s["position_m"]]} for s in SEATS],
            "targets": [{"name": "hook", "position_m": [0.05, 0.0, 0.08]}],
        },
        "errors": {"geometry": {}, "instrument_noise": {"scale": 0.01}},
        "seed": 3,
    }  # fmt: skip
    (folder / "warm.yaml").write_text(yaml.safe_dump(scenario))
    ballbar.simulate(folder / "warm.yaml", folder / "recording")
    return folder


def identified(folder: Path, *, temperature: bool) -> Calibration:
    """The robot of the poses, whose temperature somebody wrote down or nobody did."""
    path = folder / "recording" / "poses.yaml"
    stated = yaml.safe_load(path.read_text())
    if not temperature:
        stated = {k: v for k, v in stated.items() if not k.startswith("temperature")}
    other = path.with_name(f"{'warm' if temperature else 'cold'}.yaml")
    other.write_text(yaml.safe_dump(stated, sort_keys=False))
    return ballbar.identify(other)


@pytest.mark.slow
def test_lengths_of_a_warm_wire_are_those_of_the_truth(folder: Path) -> None:
    """0.17 mm on the metre would be missing where nobody states the temperature."""
    warm, cold = (identified(folder, temperature=known) for known in (True, False))
    truth = load_truth(folder / "recording.truth.yaml")
    assert isinstance(truth, PoseTruth)
    stated = warm.file.temperature
    assert stated is not None
    assert stated.instrument_expansion_per_K == STEEL
    assert stated.factor_to_20_C == pytest.approx(1.0 / (1.0 + GROWTH), abs=1e-12)
    # the robot's coefficient and temperature, and those of the wire, which the fit took as exact
    each = np.hypot(STEEL * 0.5, 15.0 * SIGMA)
    assert stated.factor_sigma == pytest.approx(np.sqrt(2.0) * each, rel=1e-9)
    # rd4 is 0.05 mm short in four draws, where 0.13 would be missing
    for name in ("ra2", "rd4"):
        true = getattr(truth.dh, parameter_named(name).kind)[parameter_named(name).row]
        entry = warm.file.parameters[name]
        assert entry.value == pytest.approx(true, abs=6e-5)
        assert entry.value / cold.file.parameters[name].value == pytest.approx(
            1.0 + GROWTH, abs=2e-5
        )
        at_20 = true / (1.0 + GROWTH)
        assert entry.value * stated.factor_to_20_C == pytest.approx(at_20, abs=6e-5)
    assert "Lengths of the instrument were taken as they are there, with 11.5" in (
        temperature_sentence(stated)
    )
    assert cold.file.temperature is None


def poses_file(folder: Path, instrument: str, **stated: object) -> Path:
    """Two seats of an instrument with a table of a UR5, and what else its poses.yaml states."""
    q = table_of(true_robot("ur5", seed=1), "point", count=8).groups[0].q
    axes = [f"J{k}" for k in range(1, 7)]
    lines = [",".join([*axes, "seat", "T"])]
    for k, row in enumerate(np.rad2deg(q)):
        lines.append(",".join([*(f"{v:.6f}" for v in row), f"s{k % 2}", f"{WARM + k - 3.5}"]))
    (folder / "table.csv").write_text("\n".join(lines) + "\n")
    content = {
        "schema": "ballbar-poses/1", "kind": "real", "robot": "ur5", "instrument": instrument,
        "tables": [{
            "files": ["table.csv"], "joints": {"columns": axes, "unit": "deg"},
            "seat": {"column": "seat"}, "target": "ball", "temperature": {"column": "T"},
        }],
        "distances": [{"pairs": [["s0", "s1"]]}],
        **stated,
    }  # fmt: skip
    (folder / "poses.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return folder


def test_a_fixture_is_as_long_as_the_mean_of_a_column_of_temperatures_makes_it(
    tmp_path: Path,
) -> None:
    read = import_poses(poses_file(tmp_path, steel(tmp_path, "socket_pair_50")))
    (known,) = read.table.distances
    assert read.description.temperature_C == pytest.approx(WARM)
    assert known.length == pytest.approx(0.05 * (1.0 + GROWTH), rel=1e-12)
    thermal = 0.05 * np.hypot(STEEL * 1.0, 15.0 * SIGMA)  # 1 K where none is stated
    assert known.sigma == pytest.approx(np.hypot(2e-4, thermal), rel=1e-12)
    assert read.expansion is not None


def test_without_a_coefficient_nothing_grows(tmp_path: Path) -> None:
    read = import_poses(poses_file(tmp_path, "socket_pair_50", temperature_C=WARM))
    (known,) = read.table.distances
    assert (known.length, known.sigma) == load_instrument("socket_pair_50").distance
    assert read.expansion is None
    assert load_robot("ur5").expansion is None
