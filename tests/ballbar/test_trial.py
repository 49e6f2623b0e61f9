"""Trials: paired samples with their error sources, recorded paths, and the row of results."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_geometry, robot_frames
from ballbar.cell.load import load_cell
from ballbar.ident.estimator.closure import close_loop
from ballbar.ident.thesis.paired_samples import fit_samples, noise_of
from ballbar.run import run_scenario, simulate_scenario
from ballbar.scenario import Scenario, load_scenario
from ballbar.sim.kinematic_samples import (
    KinematicSamples,
    SampledPath,
    kinematic_samples,
    sample_path,
)
from ballbar.sim.path_files import scenario_path
from ballbar.sim.simulate import simulate
from ballbar.sim.streams import stream
from ballbar.trial.nominal_path import recorded_log
from ballbar.trial.sample_trial import trial_samples
from ballbar.trial.trial import _row, run_trial
from tests.helpers.simulated_recordings import SCENARIOS, Recorded, record
from tests.helpers.six_axes import NAMES

STATIC = {"static": {"table": "thesis_3_1"}}
NOISE = {"joint_noise": {"sigma_rad": 1e-5}}
SAMPLE_ERRORS = {
    "synchronisation": {"delay_s": 2e-3},
    "rod_deviation": {"amplitude_m": 1e-5},
    "truncation": {"step_rad": 1e-4},
}
FIGURES = {
    "distance_mm_mrad",
    "largest_mm_mrad",
    "largest_parameter",
    "parameters",
    "tcp_mean_mm",
    "tcp_max_mm",
    "tcp_left",
    "iterations",
    "converged",
    "rms_residual",
}
CLOCK = {"clock_offset_error_us", "clock_skew_error_ppm"}
CELL = {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": [0.70, 0.0, 0.54]}
TIMES = {"kind": "lissajous", "duration_s": 60.0, "dwell_s": 2.0, "stops": 1}
PATH = {"file": "paths/irb2400_a.yaml", **TIMES}


def on_samples(cost: str = "transform", **more: Any) -> dict[str, Any]:
    """Settings of an identification from 400 paired samples."""
    return {"cost": cost, "data": "samples", "samples": 400} | more


def scenario(**changes: Any) -> Scenario:
    """Thesis ch. 3 in 60 s: kinematic plant, Table 3.1, 10 urad of noise, 400 samples, C_T."""
    base: dict[str, Any] = {
        "name": "trial",
        "cell": CELL,
        "path": PATH,
        "plant": {"kind": "kinematic"},
        "errors": STATIC | NOISE,
        "encoders": {"noise_sigma_rad": 1e-5},
        "identify": on_samples(),
        "seed": 1,
    }
    return Scenario.model_validate(base | changes)


def samples_of(**changes: Any) -> KinematicSamples:
    return trial_samples(scenario(**changes), SCENARIOS)


def clean(**errors: Any) -> KinematicSamples:
    """Samples without noise."""
    return samples_of(errors=STATIC | errors, encoders={})


def test_paired_samples_close_the_true_loop_exactly() -> None:
    samples = clean()
    assert samples.t.size == 400
    assert np.abs(close_loop(samples.true, samples.q, samples.b).error).max() < 1e-12
    assert 1e-3 < np.abs(close_loop(samples.nominal, samples.q, samples.b).error).max() < 2e-2
    assert samples.true["btheta3"] - samples.nominal["btheta3"] == pytest.approx(
        -1.90e-3, abs=1e-15
    )  # no zero is drawn


def test_samples_are_spread_evenly_over_the_moving_part_of_the_path() -> None:
    t = clean().t
    assert np.ptp(np.diff(t)) < 1e-12
    assert 2.0 <= t[0] < 2.3  # the ramp passes 1 mrad/s some tenths after the dwell
    assert 57.7 < t[-1] <= 58.0


def test_samples_show_the_machine_that_a_recording_with_the_same_seed_shows() -> None:
    """Drawn geometry, gear phases and encoder phases come from the same streams.

    Only the means over the path are missing.
    """
    errors = {
        "static": {"sigma_m": 1e-3, "sigma_rad": 1e-3},
        "sinusoidal_gear_error": {"amplitude_rad": 1e-4},
        "encoder_eccentricity": {},
    }
    drawn = scenario(errors=errors, encoders={}, seed=7)
    samples = trial_samples(drawn, SCENARIOS)
    simulation = simulate(drawn, relative_to=SCENARIOS)
    assert np.array_equal(samples.true.values, simulation.motion.geometry.values)
    motion = simulation.motion
    shown, b = motion.shown_at(samples.t), motion.bar_at(samples.t)
    missing = samples.q - shown
    assert np.abs(missing - missing.mean(axis=0)).max() < 1e-9  # the run is a spline through 10 ms
    read = np.stack(
        [e.effects.read_angle(b[:, e.joint - 1], samples.t) for e in simulation.encoders], axis=1
    )
    missing = samples.b - read
    assert np.abs(missing - missing.mean(axis=0)).max() < 1e-9


def test_what_varies_along_the_path_has_no_mean() -> None:
    """Thesis sec. 3.1: a mean would be a static error."""
    gears = {
        "cycloid_ripple": {"amplitude_rad": 1e-4},
        "sinusoidal_gear_error": {"amplitude_rad": 1e-4},
    }
    exact, noisy = clean(), samples_of(errors=STATIC | NOISE | gears)
    for error in (noisy.q - exact.q, noisy.b - exact.b):
        assert np.abs(error.mean(axis=0)).max() < 1e-15
        assert (error.std(axis=0) > 0.9e-5).all()


def test_noise_is_that_of_its_streams() -> None:
    exact, noisy = clean(), samples_of()
    drawn = stream(1, "joint_noise").normal(0.0, 1e-5, (400, 6))
    assert np.abs(noisy.q - exact.q - (drawn - drawn.mean(axis=0))).max() < 1e-14
    drawn = stream(1, "encoder_noise_b4").normal(0.0, 1e-5, 400)
    assert np.abs(noisy.b[:, 3] - exact.b[:, 3] - (drawn - drawn.mean())).max() < 1e-14


def test_each_sample_error_leaves_all_other_draws_bit_identical() -> None:
    plain = samples_of()
    for name, settings in SAMPLE_ERRORS.items():
        one = samples_of(errors=STATIC | NOISE | {name: settings})
        assert np.array_equal(one.true.values, plain.true.values)
        assert np.array_equal(one.b, plain.b) == (name != "truncation")
        assert np.array_equal(one.q, plain.q) == (name == "truncation")
        noise = one.q - clean(**{name: settings}).q
        assert np.abs(noise - (plain.q - clean().q)).max() < 1e-14


def test_truncation_leaves_multiples_of_the_step_nearest_to_the_angles() -> None:
    plain, stepped = (
        samples_of(),
        samples_of(errors=STATIC | NOISE | {"truncation": {"step_rad": 1e-4}}),
    )
    assert np.array_equal(stepped.b, np.rint(plain.b / 1e-4) * 1e-4)
    smallest = np.diff(np.unique(np.round(stepped.b[:, 0] / 1e-4).astype(int))).min()
    assert smallest == 1


def test_a_rod_that_deviates_is_longer_as_its_end_rises_and_shorter_as_it_sinks() -> None:
    samples = clean(rod_deviation={"amplitude_m": 1e-5})
    tip = robot_frames(samples.true, samples.q).tip
    deviation = np.linalg.norm(tip - samples.true.origin[:, None], axis=0) - samples.true["bd3"]
    assert np.abs(deviation - 1e-5 * (samples.sign - samples.sign.mean())).max() < 1e-13
    assert set(np.unique(samples.sign)) == {-1.0, 1.0}
    speed = np.gradient(tip[2], samples.t)
    fast = np.abs(speed) > 5e-3
    assert np.array_equal(np.sign(speed[fast]), samples.sign[fast])
    assert (
        np.abs(close_loop(samples.true, samples.q, samples.b).error[3:]).max() < 1e-12
    )  # a length, no turn


@pytest.mark.parametrize("pulled", ["counterclockwise", "drawn"])
def test_the_rod_may_be_pulled_in_other_patterns(pulled: str) -> None:
    samples = clean(rod_deviation={"amplitude_m": 1e-5, "pulled": pulled})
    rod = robot_frames(samples.true, samples.q).tip - samples.true.origin[:, None]
    deviation = np.linalg.norm(rod, axis=0) - samples.true["bd3"]
    assert np.abs(deviation - 1e-5 * (samples.sign - samples.sign.mean())).max() < 1e-13
    changes = np.count_nonzero(np.diff(samples.sign))
    if pulled == "drawn":
        assert 14 < changes < 45  # 28 in 56 s, Poisson: 2.6 sigma
        other = samples_of(
            errors=STATIC | {"rod_deviation": {"amplitude_m": 1e-5, "pulled": pulled}}, seed=2
        )
        assert not np.array_equal(samples.sign, other.sign)
        return
    around = rod[0] * np.gradient(rod[1], samples.t) - rod[1] * np.gradient(rod[0], samples.t)
    fast = np.abs(around) > 5e-3
    assert np.array_equal(np.sign(around[fast]), samples.sign[fast])


def test_samples_may_be_of_the_stops_or_of_what_lies_between() -> None:
    q = {
        instants: samples_of(
            path=PATH | {"stops": 3},
            errors=STATIC,
            encoders={},
            identify=on_samples(instants=instants),
        ).q
        for instants in ("standing", "moving", "constant_speed")
    }
    assert len(np.unique(q["standing"].round(9), axis=0)) == 3  # not those at the ends
    assert len(np.unique(q["moving"].round(9), axis=0)) > 390
    assert len(np.unique(q["constant_speed"].round(9), axis=0)) > 390
    with pytest.raises(InputError, match=r"identify\.instants = standing: the path has none"):
        samples_of(path=PATH | {"stops": 0}, identify=on_samples(instants="standing"))


@pytest.mark.slow
def test_all_parameters_and_a_loose_stop_are_those_of_the_row() -> None:
    rows = {
        key: run_trial(scenario(identify=on_samples(**changes)), SCENARIOS)
        for key, changes in {
            "core": {},
            "all": {"parameters": "all"},
            "tight": {"form": "thesis"},
            "loose": {"form": "thesis", "relative_stop": 1e-4},
        }.items()
    }
    assert (rows["core"]["parameters"], rows["all"]["parameters"]) == (29, 39)
    assert "error.balpha1" in rows["all"]
    assert int(rows["loose"]["iterations"]) < 0.5 * int(rows["tight"]["iterations"])
    assert float(rows["loose"]["rms_residual"]) > float(rows["tight"]["rms_residual"])


def test_a_robot_logged_late_is_a_robot_at_a_later_time() -> None:
    """Row by row: the angles paired with t are those that an exact log has at t + delay."""
    late = clean(synchronisation={"delay_s": 2e-3})
    exact = clean()
    between = np.interp(late.t[:-1] + 2e-3, exact.t, exact.q[:, 0])
    assert np.abs(late.q[:-1, 0] - between).max() < 2e-4  # linear between samples 0.14 s apart
    assert np.abs(late.q - exact.q).max() > 5e-4
    assert np.array_equal(late.b, exact.b)


def test_the_clock_parameter_recovers_the_delay_of_paired_samples() -> None:
    late = clean(synchronisation={"delay_s": 2e-3})
    result = fit_samples(late.t, late.q, late.b, (1, 2, 3, 4, 5), late.nominal)
    clock = result.fit.clock()
    # 2e-8 s: accuracy of splines through samples 0.14 s apart
    assert clock.offset == pytest.approx(-2e-3, abs=2e-8)
    assert clock.skew == pytest.approx(0.0, abs=1e-9)
    error = result.fit.geometry().values - late.true.values
    assert np.abs(error[result.parameters]).max() < 1e-6


def test_a_path_sampled_for_another_delay_is_not_taken() -> None:
    path = sampled(scenario())
    with pytest.raises(ValueError, match=r"a delay of 0\.0 s, settings ask for 0\.002 s"):
        kinematic_samples(scenario(errors=STATIC | {"synchronisation": {"delay_s": 2e-3}}), path)


def sampled(asked: Scenario) -> SampledPath:
    cell = load_cell("irb2400", "lund_600", "plate_250")
    nominal = nominal_geometry(cell, np.array(asked.cell.ballbar_position_m))
    return sample_path(
        cell, nominal, scenario_path(asked.path, cell, nominal, relative_to=SCENARIOS), 50
    )


def test_noise_of_samples_is_told_from_their_motion() -> None:
    noisy = samples_of(identify={"cost": "ml", "data": "samples", "samples": 1500})
    for angles in (noisy.q, noisy.b):
        assert noise_of(angles) == pytest.approx(
            np.full(angles.shape[1], 1e-5), rel=0.15
        )  # a median of 1500 scatters by 3 %


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"errors": {"rod_strain": {}}}, r"errors\.rod_strain: needs forces"),
        ({"errors": {"frozen_bits": {}}}, r"errors\.frozen_bits: acts on device logs"),
        ({"clocks": {"wander": {}}}, r"clocks\.wander: acts on device logs"),
        (
            {"path": {"kind": "push_pull", "file": "paths/irb2400_push.yaml", "duration_s": 60.0}},
            "needs forces",
        ),
    ],
)
def test_what_paired_samples_do_not_have_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_trial(scenario(**changes), SCENARIOS)


@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
@pytest.mark.parametrize("name", SAMPLE_ERRORS)
def test_device_logs_refuse_the_errors_of_paired_samples(name: str, plant: str) -> None:
    asked = scenario(
        errors={name: SAMPLE_ERRORS[name]}, plant={"kind": plant}, identify={"cost": "ml"}
    )
    with pytest.raises(InputError, match=rf"errors\.{name}: acts on samples .*, or leave it out"):
        run_trial(asked, SCENARIOS)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plant": {"kind": "mujoco"}}, "samples come from the kinematic plant only"),
        (
            {"encoders": {"fitted": [1, 2, 4, 5]}},
            "needs encoders on b3, which are not in encoders.fitted",
        ),
        ({"identify": {"cost": "ml", "form": "thesis"}}, "the thesis prints no ml"),
        ({"path": {"kind": "recorded", "duration_s": 60.0}}, "kind recorded needs recording"),
        (
            {
                "path": {"kind": "lissajous", "duration_s": 60.0},
                "accept": {"held_out_file": "paths/irb2400_b.yaml", "held_out_ratio": 1.3},
            },
            "another path needs path.kind = lissajous and its file",
        ),
        (
            {"path": {"kind": "recorded", "recording": "r", "stops": 0, "duration_s": 60.0}},
            "kind recorded has no use for it",
        ),
    ],
)
def test_a_scenario_that_contradicts_itself_is_refused_when_it_is_read(
    changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(ValidationError, match=words):
        scenario(**changes)


def test_a_validated_scenario_may_be_written_and_read_again() -> None:
    for path in (
        {"kind": "recorded", "recording": "r", "duration_s": 60.0},
        {"kind": "lissajous", "file": "f", "duration_s": 60.0},
    ):
        one = scenario(path=path)
        assert Scenario.model_validate_json(one.model_dump_json(by_alias=True)) == one


@pytest.mark.parametrize(
    ("cost", "form", "count", "distance"),
    [
        ("length", "vector", 23, 0.3),
        ("position", "vector", 25, 0.1),
        ("position_angles", "vector", 28, 0.05),
        ("transform", "vector", 29, 0.05),
        ("length", "thesis", 23, 0.3),
        ("ml", "vector", 29, 0.05),
    ],
)
def test_a_row_tells_how_far_the_identified_robot_is_from_the_true_one(
    cost: str, form: str, count: int, distance: float
) -> None:
    """Distances in mm|mrad as thesis Fig. 3.2 orders them; C_l is several times worse."""
    row = run_trial(scenario(identify=on_samples(cost, form=form)), SCENARIOS)
    errors = {
        key.removeprefix("error."): value for key, value in row.items() if key.startswith("error.")
    }
    assert set(row) - {f"error.{name}" for name in errors} == FIGURES | (
        CLOCK | {"chi2_per_dof", "verdict"} if cost == "ml" else set()
    )
    assert row["parameters"] == len(errors) == count
    assert set(errors) <= set(NAMES)
    values = np.array(list(errors.values()), dtype=float)
    assert row["distance_mm_mrad"] == pytest.approx(np.linalg.norm(values))
    assert row["largest_mm_mrad"] == pytest.approx(np.abs(values).max())
    assert abs(float(errors[str(row["largest_parameter"])])) == row["largest_mm_mrad"]
    assert 1e-3 < float(row["distance_mm_mrad"]) < distance
    assert 0.0 < float(row["tcp_mean_mm"]) < float(row["tcp_max_mm"]) < 0.2
    assert row["converged"] == 1
    assert int(row["iterations"]) <= 6
    assert all(type(value) in (float, int, str) for value in row.values())


def test_a_trial_repeats_itself_and_follows_its_seed() -> None:
    one = run_trial(scenario(), SCENARIOS)
    assert run_trial(scenario(), SCENARIOS) == one
    assert run_trial(scenario(seed=2), SCENARIOS) != one


def test_without_varying_errors_every_cost_finds_the_truth() -> None:
    """Thesis sec. 3.4 reached 1 um|urad; its criterion was the solver's."""
    for cost in ("length", "position", "position_angles", "transform"):
        asked = scenario(errors=STATIC, encoders={}, identify=on_samples(cost))
        row = run_trial(asked, SCENARIOS)
        assert float(row["largest_mm_mrad"]) < 1e-6


def test_a_synchronisation_error_ruins_the_thesis_costs_with_encoders_and_not_ml() -> None:
    """Thesis Fig. 3.4; C_l has no second clock."""
    late = STATIC | {"synchronisation": {"delay_s": 2e-3}}
    rows = {
        cost: run_trial(scenario(errors=late, encoders={}, identify=on_samples(cost)), SCENARIOS)
        for cost in ("length", "transform", "ml")
    }
    assert float(rows["length"]["distance_mm_mrad"]) < 1e-6
    assert float(rows["transform"]["distance_mm_mrad"]) > 0.3
    assert float(rows["ml"]["distance_mm_mrad"]) < 1e-3
    assert abs(float(rows["ml"]["clock_offset_error_us"])) < 0.02


@pytest.mark.slow
def test_device_logs_give_the_same_row_with_the_clock_found_on_the_way() -> None:
    row = run_trial(
        scenario(clocks={"offset_s": 0.137, "skew": 5e-5}, identify={"cost": "ml", "samples": 400}),
        SCENARIOS,
    )
    assert set(row) >= FIGURES | CLOCK | {"chi2_per_dof", "verdict"}
    assert row["parameters"] == 29
    assert float(row["distance_mm_mrad"]) < 0.02
    assert abs(float(row["clock_offset_error_us"])) < 20
    assert str(row["verdict"]) in ("good", "suspect")


@pytest.mark.slow
@pytest.mark.parametrize(("cost", "distance"), [("transform", 0.05), ("length", 0.3)])
def test_a_thesis_cost_takes_the_angles_of_device_logs_on_the_clock_that_alignment_found(
    cost: str, distance: float
) -> None:
    row = run_trial(
        scenario(clocks={"offset_s": 0.137, "skew": 5e-5}, identify={"cost": cost, "samples": 400}),
        SCENARIOS,
    )
    each = {key for key in row if key.startswith(("error.", "identified."))}
    assert set(row) - each == FIGURES | {"identified_mm_mrad", "identified_largest_mm_mrad"}
    assert 1e-3 < float(row["distance_mm_mrad"]) < distance


@pytest.mark.slow
def test_logs_of_a_thesis_cost_may_be_smoothed() -> None:
    """A moving average bends the motion; least-squares splines do not, and leave less noise."""
    rows = {
        smoothing: run_trial(
            scenario(identify={"cost": "transform", "samples": 400, "smoothing": smoothing}),
            SCENARIOS,
        )
        for smoothing in ("none", "moving_average", "spline")
    }
    none, averaged, spline = (float(row["distance_mm_mrad"]) for row in rows.values())
    assert averaged > 3.0 * none
    assert spline < none
    with pytest.raises(ValueError, match="of the thesis's costs on logs"):
        scenario(identify={"cost": "ml", "smoothing": "spline"})


@pytest.mark.slow
def test_a_thesis_cost_pairs_device_logs_itself() -> None:
    """Clock and encoder offsets from the logs alone; identified errors are those from nominal."""
    asked = {"cost": "position_angles", "samples": 400, "pairing": "logs"}
    row = run_trial(
        scenario(clocks={"offset_s": 0.137}, errors=STATIC, encoders={}, identify=asked), SCENARIOS
    )
    assert row["parameters"] == 27  # the 23 of C_l and four encoder offsets (sec. 5.4)
    assert abs(float(row["clock_offset_error_us"])) < 5e3
    identified = {k: float(v) for k, v in row.items() if k.startswith("identified.")}
    assert len(identified) == 20
    assert {"identified.ox", "identified.btheta1"}.isdisjoint(identified)
    assert row["identified_mm_mrad"] == pytest.approx(np.linalg.norm(list(identified.values())))
    assert 0.01 < float(row["distance_mm_mrad"]) < float(row["identified_mm_mrad"])
    with pytest.raises(ValueError, match="is of a thesis cost on files, and smooths itself"):
        scenario(identify={"cost": "ml", "pairing": "logs"})


@pytest.mark.slow
def test_device_logs_of_a_robot_of_the_user_s_own_can_be_tried(tmp_path: Path) -> None:
    """Regression: recording.yaml repeated the name relative to the scenario.

    The reader then looked for the file beside the recording.
    """
    robot = yaml.safe_load((SCENARIOS.parent / "cell" / "robots" / "irb2400.yaml").read_text())
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(robot | {"title": "Mine"}))
    cell = CELL | {"robot": "mine.yaml"}
    path = TIMES | {"file": str(SCENARIOS / "paths" / "irb2400_a.yaml")}
    row = run_trial(
        scenario(cell=cell, path=path, identify={"cost": "ml", "samples": 300}), tmp_path
    )
    assert float(row["distance_mm_mrad"]) < 0.02


def test_a_run_with_report_refuses_what_only_sweeps_do(tmp_path: Path) -> None:
    file = tmp_path / "scenario.yaml"
    asked = scenario().model_dump(mode="json", exclude_none=True, by_alias=True)
    file.write_text(
        yaml.safe_dump(
            asked | {"path": asked["path"] | {"file": str(SCENARIOS / "paths" / "irb2400_a.yaml")}}
        )
    )
    with pytest.raises(
        InputError, match=r"identify\.cost = transform, data = samples: .* are for sweeps"
    ):
        run_scenario(
            load_scenario(file), file, out=tmp_path / "out", command="test", progress=lambda _: None
        )
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A recording to take the path from, folder `measured`."""
    return record(tmp_path_factory.mktemp("recorded") / "measured", plant={"kind": "kinematic"})


RECORDED = {"kind": "recorded", "recording": "measured", "duration_s": 58.0}


@pytest.mark.slow
def test_a_recorded_path_goes_where_the_recorded_robot_went(measured: Recorded) -> None:
    folder = measured.folder.parent
    asked = scenario(path=RECORDED, errors=STATIC, encoders={})
    samples = trial_samples(asked, folder)
    log = read_recording(measured.folder).robot_log
    logged = np.stack([np.interp(samples.t, log.t, angle) for angle in log.q.T], axis=1)
    assert (
        np.abs(samples.q - logged).max() < 0.05
    )  # a robot that is off by millimetres, led back to a sphere of 0.6 m
    assert np.sqrt(np.mean((samples.q - logged) ** 2)) < 0.01
    assert np.abs(close_loop(samples.true, samples.q, samples.b).error).max() < 1e-12
    row = run_trial(scenario(path=RECORDED), folder)
    assert float(row["distance_mm_mrad"]) < 0.05


@pytest.mark.slow
def test_a_recorded_path_is_smooth_although_its_log_is_noisy(measured: Recorded) -> None:
    folder = measured.folder.parent
    asked = scenario(path=RECORDED, identify={"cost": "ml"})
    path = simulate(asked, relative_to=folder, recorded=recorded_log(asked.path, folder)).path
    acceleration = np.diff(path.speed, axis=0) / 0.01  # [rad/s^2]
    assert np.abs(acceleration[:100]).max() < 0.15  # at rest; a tenth of what the motion needs
    assert 1.0 < np.abs(acceleration).max() < 1.3
    assert (path.b[:, [1, 3]] < 0.0).all()  # the configuration of the path files


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
def test_a_recorded_path_can_be_run_again_with_known_errors(measured: Recorded, plant: str) -> None:
    asked = scenario(path=RECORDED, plant={"kind": plant}, identify={"cost": "ml", "samples": 400})
    row = run_trial(asked, measured.folder.parent)
    assert float(row["distance_mm_mrad"]) < 0.02
    assert row["converged"] == 1


@pytest.mark.slow
def test_a_recording_made_along_a_recorded_path_is_an_ordinary_one(
    measured: Recorded, tmp_path: Path
) -> None:
    asked = scenario(path=RECORDED | {"duration_s": 20.0}, identify={"cost": "ml"})
    simulate_scenario(
        asked, measured.folder.parent / "scenario.yaml", tmp_path / "again", progress=lambda _: None
    )
    assert read_recording(tmp_path / "again").robot_log.t[-1] == pytest.approx(20.0 - 1.0, abs=0.01)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"path": RECORDED | {"duration_s": 60.0}},
            r"path\.duration_s = 60: the recording's robot log lasts 59\.\d s",
        ),
        ({"path": RECORDED | {"recording": "lost"}}, "lost: no such folder"),
        (
            {"path": RECORDED, "cell": CELL | {"ballbar": "lund_900"}},
            r"-30\d mm off the ball-bar's sphere",
        ),
    ],
)
def test_a_recorded_path_that_cannot_be_is_refused(
    measured: Recorded, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        run_trial(scenario(**changes), measured.folder.parent)


def test_mujoco_refuses_a_recording_that_begins_in_motion(
    measured: Recorded, tmp_path: Path
) -> None:
    rows = (measured.folder / "raw" / "robot.csv").read_text().splitlines(keepends=True)
    cut = tmp_path / "measured"
    (cut / "raw").mkdir(parents=True)
    (cut / "recording.yaml").write_text((measured.folder / "recording.yaml").read_text())
    (cut / "raw" / "ballbar.csv").write_bytes(
        (measured.folder / "raw" / "ballbar.csv").read_bytes()
    )
    (cut / "raw" / "robot.csv").write_text("".join((rows[0], *rows[2000:])))
    asked = scenario(
        path=RECORDED | {"duration_s": 20.0}, plant={"kind": "mujoco"}, identify={"cost": "ml"}
    )
    with pytest.raises(InputError, match="the robot moves at its first row"):
        run_trial(asked, tmp_path)


def test_a_simulation_wants_the_log_of_the_recording_handed_in(measured: Recorded) -> None:
    with pytest.raises(InputError, match="was not handed to the simulation"):
        simulate(
            scenario(path=RECORDED, identify={"cost": "ml"}), relative_to=measured.folder.parent
        )


def test_the_row_of_a_fit_is_in_the_units_of_its_names() -> None:
    """Lengths in mm, angles in mrad, clocks in us and ppm; without a clock no such columns."""
    tcp = SimpleNamespace(mean=2e-5, maximum=5e-5)
    given: Any = SimpleNamespace(
        largest=("ra1", -4e-5), distance=5e-5, deviations={"ra1": -4e-5, "rtheta2": 3e-5}, tcp=tcp,
        tcp_nominal=SimpleNamespace(mean=2e-3), offset=7e-6, skew=-3e-8,
    )  # fmt: skip
    row = _row(given, 6, 1.5, converged=True, verdict={"verdict": "good"})
    assert row == pytest.approx(
        {
            "distance_mm_mrad": 0.05, "largest_mm_mrad": 0.04, "largest_parameter": "ra1",
            "parameters": 2, "tcp_mean_mm": 0.02, "tcp_max_mm": 0.05, "tcp_left": 0.01,
            "iterations": 6, "converged": 1, "rms_residual": 1.5, "verdict": "good",
            "clock_offset_error_us": 7.0, "clock_skew_error_ppm": -0.03, "error.ra1": -0.04,
            "error.rtheta2": 0.03,
        }
    )  # fmt: skip
    given.offset = None
    assert not any("clock" in key for key in _row(given, 6, 1.5, converged=False))
