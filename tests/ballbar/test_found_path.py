"""A scenario whose path names no file takes the first path that is found."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.run import simulate_scenario
from ballbar.scenario import load_scenario, scenario_path
from ballbar.sim.simulate import Simulation, simulate
from ballbar.sim.truth import Truth, load_truth

TEXT = """\
name: found
cell: {{robot: {robot}, ballbar: lund_600, ballbar_set: without_strain}}
path: {{kind: lissajous, duration_s: 20, dwell_s: 1, stops: 0}}
{rest}
"""


@pytest.mark.slow
def test_a_robot_without_data_is_simulated_on_a_path_that_nobody_named(tmp_path: Path) -> None:
    file = tmp_path / "found.yaml"
    rest = "plant: {typical_spread: 1.0}\nerrors: {joint_compliance: {}, resolver_error: {}}"
    file.write_text(TEXT.format(robot="irb1600", rest=rest))
    scenario = load_scenario(file)
    run = simulate_scenario(scenario, file, tmp_path / "recording", progress=lambda _: None)
    assert isinstance(run, Simulation)
    assert "typical of a robot of its size: links, servo, gears" in run.plant
    truth = load_truth(tmp_path / "recording.truth.yaml")
    assert isinstance(truth, Truth)
    assert truth.plant.typical == ("links", "servo", "gears", "rotor_inertia_kg_m2")
    arm = sum(b.mass_kg for n, b in truth.plant.bodies.items() if n.startswith("link"))
    assert 30.0 < arm < 600.0  # 250 kg with its base
    resolvers = truth.logs.resolvers
    assert resolvers is not None  # at the joint, as no gear ratio is stated
    assert max(h.amplitude_rad for motor in resolvers.motors for h in motor) < 5e-5
    kept = load_scenario(scenario_path(tmp_path / "recording"))  # it can be run again as it is
    assert kept.path is not None
    assert yaml.safe_load((tmp_path / kept.path.file).read_text())["schema"] == "ballbar-path/1"
    assert kept.cell.ballbar_position_m is not None


def test_a_path_without_a_file_is_refused_where_none_is_looked_for(tmp_path: Path) -> None:
    file = tmp_path / "found.yaml"
    file.write_text(TEXT.format(robot="irb1600", rest="plant: {kind: kinematic}"))
    scenario = load_scenario(file)
    placed = scenario.cell.model_copy(update={"ballbar_position_m": (0.6, 0.0, 0.5)})
    with pytest.raises(InputError, match=r"path\.file: .* has no file here"):
        simulate(scenario.model_copy(update={"cell": placed}), relative_to=tmp_path)
    file.write_text(
        TEXT.format(robot="irb1600", rest="accept: {held_out_file: a.yaml, held_out_ratio: 1.3}")
    )
    with pytest.raises(DescriptionError, match="and its file"):
        load_scenario(file)
