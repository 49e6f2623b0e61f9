"""Simulated recordings of a length: settings, the forces of rod and wire, the log, the stroke."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from ballbar.acquisition.recording import read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import robot_frames
from ballbar.scenario import Scenario
from ballbar.sim.plant.statics import gravity_torque
from ballbar.sim.recording_files import write_recording
from ballbar.sim.simulate import Simulation, simulate

SCENARIOS = Path(__file__).parents[2] / "scenarios"
CELLS = {
    "telescoping": ("qc20w_300", [0.976, -0.208, 0.754]),
    "drawwire": ("drawwire_2m", [-0.006, -0.575, 0.062]),
}


def content(instrument: str, **changes: Any) -> dict[str, Any]:
    """A scenario of 16 s with a telescoping bar or a draw-wire and the kinematic plant."""
    name, position = CELLS[instrument]
    path = {"kind": "lissajous", "file": f"paths/irb2400_{instrument}.yaml", "duration_s": 60}
    cell = {"robot": "irb2400", "instrument": name, "ballbar_position_m": position}
    return {
        "name": "length",
        "cell": cell,
        "path": path | {"stops": 0},
        "plant": {"kind": "kinematic"},
        "seed": 3,
    } | changes


def simulated(instrument: str, **changes: Any) -> Simulation:
    scenario = Scenario.model_validate(content(instrument, **changes))
    return simulate(scenario, relative_to=SCENARIOS)


@pytest.mark.parametrize("instrument", list(CELLS))
def test_the_log_is_the_distance_from_seat_to_tool_with_noise_and_zero(
    instrument: str, tmp_path: Path
) -> None:
    """The distance by DH alone, at the shown angles of the true robot without gears' errors."""
    scenario = Scenario.model_validate(
        content(
            instrument,
            errors={"static": {"sigma_m": 5e-5, "sigma_rad": 5e-5}},
            length={"rate_hz": 50, "noise_scale": 2.0},
            clocks={"offset_s": 0.2, "skew": 1e-4, "restart": {"at_s": 30.0}},
        )
    )
    simulation = simulate(scenario, relative_to=SCENARIOS)
    write_recording(simulation, scenario, tmp_path / "recording")
    log = read_recording(tmp_path / "recording").length_log
    assert log is not None
    assert np.median(np.diff(log.t)) == pytest.approx(0.02)
    true, motion = simulation.truth.geometry, simulation.motion
    rows = np.concatenate(simulation.rows.ballbar)
    q = motion.shown_at(simulation.times.bar_true[rows])
    distance = np.linalg.norm(robot_frames(true, q).tip.T - true.origin, axis=1)
    assert simulation.instrument is not None
    zero = true["bd3"] - simulation.instrument.nominal
    assert (zero != 0.0) == (instrument == "drawwire")  # the bar is calibrated
    off = log.length - (distance - zero)
    assert off.std() == pytest.approx(2.0 * simulation.instrument.sigma_length, rel=0.05)
    assert abs(off.mean()) < 4.0 * off.std() / np.sqrt(off.size)


@pytest.mark.parametrize("instrument", list(CELLS))
def test_elastic_gears_yield_to_weight_rod_and_wire(instrument: str) -> None:
    """At rest, against statics without MuJoCo: weight and pull as torques of the joints."""
    run = simulated(
        instrument,
        plant={"kind": "mujoco", "servo": "stiff", "rod_friction_N": 0.0},
        errors={"joint_compliance": {}},
    )
    motion, geometry, cell = run.motion, run.truth.geometry, run.cell
    q = motion.q[1000]

    def change(value: Any) -> Array:
        """(6,) derivative of a function of the joint angles."""
        step = 1e-6 * np.eye(6)
        return np.array([(value(q + d) - value(q - d)) / 2e-6 for d in step])

    def tip(angles: Array) -> Array:
        return robot_frames(geometry, angles[None]).tip[:, 0]

    length = float(np.linalg.norm(tip(q) - geometry.origin))
    pull = 6.0 if instrument == "drawwire" else 500.0 * (length - 0.3)
    torque = gravity_torque(cell, geometry, q[None])[0]
    torque += pull * change(lambda a: np.linalg.norm(tip(a) - geometry.origin))
    if instrument == "telescoping":  # half the rod's weight
        torque += 0.5 * 0.25 * 9.81 * change(lambda a: tip(a)[2])
    stiffness = run.truth.plant.gear_stiffness_N_m_per_rad
    assert stiffness is not None
    yielded = (q - motion.shown[1000]) @ cell.robot.joint_to_gear
    expected = -(cell.robot.gear_to_joint @ torque) / np.array(stiffness)
    np.testing.assert_allclose(yielded, expected, atol=2e-8)  # 0.02 N m at the main axes


def test_a_bar_that_leaves_its_stroke_is_refused_with_time_and_length() -> None:
    errors = {"static": {"sigma_m": 1e-3, "sigma_rad": 1e-3}}
    with pytest.raises(InputError, match=r"qc20w_300 leaves its range at t = .* outside 299..301"):
        simulated("telescoping", errors=errors)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"encoders": {"bits": 11}}, "needs a ball-bar with encoders"),
        ({"errors": {"rod_strain": {}}}, "needs a ball-bar"),
        ({"clocks": {"overrun_probability": 0.1}}, "needs a ball-bar"),
        ({"path": {"kind": "push_pull", "file": "x", "duration_s": 60}}, "push_pull needs"),
        ({"identify": {"cost": "length"}}, "needs a ball-bar"),
        (
            {"cell": {"robot": "irb2400", "ballbar_position_m": [1, 0, 1]}},
            "either ballbar or instrument",
        ),
        (
            {
                "cell": {
                    "robot": "irb2400",
                    "ballbar": "lund_600",
                    "ballbar_position_m": [1, 0, 1],
                },
                "length": {"rate_hz": 10},
            },
            "needs cell.instrument",
        ),
    ],
)
def test_keys_of_the_other_kind_of_instrument_are_refused(
    changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(ValidationError, match=f"(?s){words}"):
        Scenario.model_validate(content("telescoping", **changes))


@pytest.mark.parametrize("instrument", list(CELLS))
def test_a_scenario_with_all_its_defaults_written_out_is_the_same(instrument: str) -> None:
    scenario = Scenario.model_validate(content(instrument))
    written = scenario.model_dump(mode="json", exclude_none=True, by_alias=True)
    assert Scenario.model_validate(written) == scenario


def test_a_rigid_rod_has_no_path_of_varying_length() -> None:
    cell = {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": [0.7, 0.0, 0.54]}
    with pytest.raises(InputError, match="the rod of lund_600 does not telescope"):
        simulated("telescoping", cell=cell)
