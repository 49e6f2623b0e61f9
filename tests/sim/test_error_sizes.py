"""Every error source has the size that a scenario states, measured in what it makes, without a
run of a plant.

Each is stated at another size than its default. Of drawn values the tolerance is five deviations of
what a sample of that many tells: `5 / sqrt(2 n)` for a standard deviation, `5 sqrt((1 - p) / n p)`
for a share p. Without a draw it is rounding. Sources whose size shows in a log of the kinematic
plant are measured there (test_log_errors), those of paired samples in tests/ballbar/test_trial.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.dialect import ABB_PERIOD
from ballbar.cell.geometry import bar_frames, nominal_geometry, robot_frames
from ballbar.cell.load import load_cell
from ballbar.cell.robot_angles import motors_to_joints
from ballbar.sim.errors.plant_errors import PlantErrors
from ballbar.sim.errors.sample_errors import SampleErrors
from ballbar.sim.errors.sensor_effects import resolver_effects
from ballbar.sim.errors.sensor_errors import SensorErrors, SignalNoise
from ballbar.sim.errors.static_errors import true_geometry
from ballbar.sim.kinematic_samples import kinematic_samples, sample_path
from ballbar.sim.logging.clocks import log_times, logged_rows
from ballbar.sim.logging.encoders import (
    BarEncoder,
    frozen_bits,
    joint_lags,
    motor_angles,
    read_counts,
    with_lags,
)
from ballbar.sim.logging.load_logs import (
    SENSOR_EPOCH,
    ForceSensor,
    LoadLogs,
    TorqueLog,
    drawn_loads,
    motor_torques,
    sensor_rows,
)
from ballbar.sim.motion import Motion
from ballbar.sim.path_files import scenario_path
from ballbar.sim.plant.effects import Plant, PlantEffects, plant_effects, stated_masses
from ballbar.sim.plant.mjcf import BAR_JOINTS, ROTORS, plant_model
from ballbar.sim.recording_files import write_recording
from ballbar.sim.settings import OF_POSES, ClockSettings, ErrorSettings
from ballbar.sim.simulate import simulate
from tests.helpers.simulated_recordings import SCENARIOS, lissajous, settings, wire_settings

CELL = load_cell("irb2400", "lund_600", "plate_250")
NOMINAL = nominal_geometry(CELL, np.array([0.70, 0.0, 0.54]))
GEARS = CELL.robot.required("gears")
ROUNDING = 1e-9
SEEDS = range(400)
SPEED = 0.2  # [rad/s] at which gears and bearings rub
ROWS = 100_000


@dataclass(frozen=True, eq=False)
class Size:
    """A size as measured and as stated, and how far apart they may be."""

    measured: Array | float
    stated: Array | float
    within: float = ROUNDING  # relative


def spread(values: Array, sigma: float) -> Size:
    """Standard deviation of values whose mean is 0."""
    return Size(np.sqrt(np.mean(values**2)), sigma, 5.0 / np.sqrt(2.0 * values.size))


def white(values: Array, sigma: float) -> Size:
    """Standard deviation of three channels over a minute, which have no memory nor each other's."""
    assert abs(np.sum(values[1:] * values[:-1]) / np.sum(values**2)) < 0.02
    assert np.abs(np.corrcoef(values.T) - np.eye(3)).max() < 0.04
    return spread(values, sigma)


def share(hit: Array, probability: float) -> Size:
    """How many of the values are true."""
    within = 5.0 * np.sqrt((1.0 - probability) / (probability * hit.size))
    return Size(float(np.mean(hit)), probability, float(within))


# --- gears, rod, plate, base, masses


def machine(seed: int = 1, **errors: Any) -> PlantEffects:
    return plant_effects(PlantErrors.model_validate(errors), CELL, seed)


def machines(read: Callable[[PlantEffects], Array], **errors: Any) -> Array:
    """(S, ...) of one machine a seed."""
    return np.stack([read(machine(seed, **errors)) for seed in SEEDS])


def stiffness(effects: PlantEffects) -> Array:
    assert effects.gear_stiffness is not None
    return effects.gear_stiffness


def backlash(**changes: Any) -> dict[str, Any]:
    return {"joint_compliance": {}, "gear_backlash": changes}


def ripples(gear: int, orders: tuple[float, ...], **errors: Any) -> Array:
    """(K,) [rad] amplitudes of the harmonics of a gear's error, and nothing else is in it."""
    angle = np.linspace(0.0, 40.0 * np.pi, 20_000)
    error = machine(**errors).transmission_error(np.repeat(angle[:, None], 6, axis=1))[:, gear]
    waves = np.stack([wave(order * angle) for order in orders for wave in (np.sin, np.cos)], axis=1)
    fit = np.linalg.lstsq(waves, error, rcond=None)[0]
    assert np.abs(error - waves @ fit).max() < 1e-12
    return np.hypot(fit[::2], fit[1::2])


def rms(gear: int, **errors: Any) -> float:
    """[rad] of a gear's error over a turn of its output."""
    angle = np.repeat(2.0 * np.pi * np.arange(4096)[:, None] / 4096, 6, axis=1)
    return float(machine(**errors).transmission_error(angle)[:, gear].std())


def listed_ripples() -> Size:
    measured, stated = [], []
    for gear, harmonics in enumerate(GEARS.harmonics):
        orders, sizes = zip(*harmonics, strict=True)
        measured.append(ripples(gear, orders, transmission_error={"scale": 2.0}))
        stated.append(2.0 * np.array(sizes))
    return Size(np.concatenate(measured), np.concatenate(stated))


def cusped_ripple() -> Size:
    """RMS of pi/2 |sin| without its mean, whose peak is 1; four harmonics have all but 0.1 %."""
    stated = 1e-4 * 0.5 * np.pi * np.sqrt(0.5 - 4.0 / np.pi**2)
    return Size(rms(1, cycloid_ripple={"amplitude_rad": 1e-4}), stated, 0.002)


def motor_ripple() -> Size:
    order = 1.0 / abs(float(CELL.robot.transmission[2, 2]))
    stated = {"amplitude_rad": 3e-4, "side": "input"}
    return Size(ripples(2, (order,), sinusoidal_gear_error=stated), 3e-4)


def unlisted_ripples() -> Size:
    measured = [rms(gear, unlisted_ripple={"amplitude_rad": 7e-6}) for gear in range(6)]
    return Size(np.array(measured), 7e-6 / np.sqrt(2.0))


def body_masses(effects: PlantEffects) -> Array:
    """(B, 4) logarithm of mass and centre [m]."""
    assert effects.masses is not None
    return np.column_stack((np.log(effects.masses.mass), effects.masses.centre))


def masses(spread_of_masses: float, centre: float) -> Array:
    """(S, B, 4) deviations from the files."""
    errors = {"spread": spread_of_masses, "centre_sigma_m": centre}
    exact = body_masses(machine(masses={"spread": 0.0, "centre_sigma_m": 0.0}))
    return machines(body_masses, masses=errors) - exact


def payloads(**errors: float) -> Array:
    """(S, 4) mass [kg] of the payload on the plate, and its place [m] from the plate's centre."""
    exact, plate = stated_masses(CELL), CELL.robot.joints
    out = []
    for seed in SEEDS:
        masses = machine(seed, payload=errors).masses
        assert masses is not None
        more = masses.mass[plate] - exact.mass[plate]
        place = (masses.centre[plate] - exact.centre[plate]) * masses.mass[plate] / more
        out.append([more, *place])
        others = np.arange(len(masses.names)) != plate
        assert (masses.mass[others] == exact.mass[others]).all()
    return np.array(out)


def friction(**errors: Any) -> tuple[Array, Array]:
    """(6,) [N m] of the gears and (5,) of the ball-bar's joints, all of which turn at SPEED.

    For 200 ms in MuJoCo, at the same pose: the friction model's bristles are then at rest. Springs
    and dampers are those of a machine without friction, and subtracted.
    """
    forces = []
    for named in (errors, {}):
        effects = machine(**named, joint_compliance={})
        plant = Plant(CELL, NOMINAL, effects, CELL.robot.servo["soft"])
        model = plant_model(plant, timestep=1e-3).model
        data = mujoco.MjData(model)
        turning = [model.joint(name).dofadr[0] for name in (*ROTORS[:6], *BAR_JOINTS)]
        start = data.qpos.copy()
        for _ in range(200):
            data.qpos[:], data.qvel[:] = start, 0.0
            data.qvel[turning] = SPEED
            mujoco.mj_step(model, data)
        rubbing = data.qfrc_damper + data.qfrc_actuator
        forces.append(-rubbing[turning])
    gears, bearings = np.split(forces[0] - forces[1], [6])
    return gears, bearings


PLANT: dict[str, Callable[[], Size]] = {
    "joint_compliance.scale": lambda: Size(
        stiffness(machine(joint_compliance={"scale": 0.6})), 0.6 * GEARS.stiffness
    ),
    "joint_compliance.spread": lambda: spread(
        np.log(machines(stiffness, joint_compliance={"spread": 0.1}) / GEARS.stiffness), 0.1
    ),
    "gear_backlash.scale, dead band": lambda: Size(
        2.0 * machine(**backlash(scale=1.5)).gear_backlash, 1.5 * GEARS.lost_motion
    ),
    "gear_backlash.scale, hysteresis": lambda: Size(
        2.0 * machine(**backlash(scale=1.5, kind="hysteresis")).gear_hysteresis,
        1.5 * GEARS.lost_motion,
    ),
    "gear_backlash.spread": lambda: spread(
        np.log(2.0 * machines(lambda m: m.gear_backlash, **backlash(spread=0.2)))
        - np.log(GEARS.lost_motion),
        0.2,
    ),
    "transmission_error.scale": listed_ripples,
    "cycloid_ripple.amplitude_rad, harmonic": lambda: Size(
        ripples(1, (40.0,), cycloid_ripple={"amplitude_rad": 1e-4, "waveform": "harmonic"}), 1e-4
    ),
    "cycloid_ripple.amplitude_rad, cusped": cusped_ripple,
    "sinusoidal_gear_error.amplitude_rad, output": lambda: Size(
        ripples(4, (1.0,), sinusoidal_gear_error={"amplitude_rad": 3e-4}), 3e-4
    ),
    "sinusoidal_gear_error.amplitude_rad, input": motor_ripple,
    "unlisted_ripple.amplitude_rad": unlisted_ripples,
    "gear_friction.scale": lambda: Size(
        friction(gear_friction={"scale": 1.2})[0], 1.2 * (GEARS.coulomb + GEARS.viscous * SPEED)
    ),
    "rod_strain.scale": lambda: Size(
        machine(rod_strain={"scale": 0.7}).rod_stiffness, 0.7 * CELL.ballbar.axial_stiffness
    ),
    "rod_backlash.gimbal_m, universal_joint_m": lambda: Size(
        2.0 * machine(rod_backlash={"gimbal_m": 3e-6, "universal_joint_m": 1e-6}).rod_backlash, 4e-6
    ),
    "rod_backlash of the file": lambda: Size(
        2.0 * machine(rod_backlash={}).rod_backlash, CELL.ballbar.backlash
    ),
    "bar_friction.torque_N_m": lambda: Size(friction(bar_friction={"torque_N_m": 0.08})[1], 0.08),
    "plate_bending.tip_stiffness_N_per_m": lambda: Size(
        machine(plate_bending={"tip_stiffness_N_per_m": 2e6}).plate_stiffness or 0.0, 2e6
    ),
    "base_compliance.stiffness_N_per_m": lambda: Size(
        machine(base_compliance={"stiffness_N_per_m": 3e7}).base_stiffness or 0.0, 3e7
    ),
    "masses.spread": lambda: spread(masses(0.05, 0.0)[..., 0], 0.05),
    "payload.sigma_kg": lambda: spread(payloads(sigma_kg=0.8)[:, 0], 0.8),
    "payload.centre_sigma_m": lambda: spread(payloads(centre_sigma_m=0.02)[:, 1:], 0.02),
    "masses.centre_sigma_m": lambda: spread(masses(0.0, 4e-3)[..., 1:], 4e-3),
}


# --- geometry


def drawn_geometry(kind: bool, **errors: Any) -> Array:
    """Deviations [m] of lengths (kind True) or [rad] of angles, of 400 machines."""
    chosen = ErrorSettings.model_validate(errors)
    cell = replace(CELL, plate=replace(CELL.plate, length_sigma=7e-6))
    true = np.stack([true_geometry(NOMINAL, chosen, cell, seed=seed).values for seed in SEEDS])
    of_kind = np.array([p.is_length for p in NOMINAL.table.parameters]) == kind
    drawn = (true - NOMINAL.values)[:, of_kind]
    return np.asarray(drawn[:, drawn.any(axis=0)])


def axes(kind: bool, size: float, parameters: str) -> Size:
    errors = {"sigma_m": 2e-5, "sigma_rad": 3e-4, "parameters": parameters}
    return spread(drawn_geometry(kind, ballbar_axes=errors), size)


def motor_offsets() -> Size:
    """At motors 2 to 6, back through the gears from the angles of the joints."""
    joints = drawn_geometry(False, motor_offsets={"sigma_rad": 0.1})
    return spread(joints @ np.linalg.inv(CELL.robot.transmission[1:, 1:]), 0.1)


def grown(errors: dict[str, float]) -> Array:
    """(7, 2) [m] by which a2 and d4 are longer every 10 s, so that the loop closes."""
    chosen = settings(
        path=lissajous("paths/irb2400_a.yaml", 60.0, dwell_s=4.0),
        plant={"kind": "kinematic"},
        errors={"thermal_growth": errors},
    )
    motion = simulate(chosen, relative_to=SCENARIOS).motion
    rows = np.searchsorted(motion.t, np.arange(0.0, 61.0, 10.0) - 1e-6)
    q, true = motion.q[rows], motion.geometry
    end = bar_frames(true, motion.b[rows]).poses()
    short = end[:, :3, 3] - robot_frames(true, q).tip.T
    longer = (true.replaced({name: true[name] + 1e-3}) for name in ("ra2", "rd4"))
    columns = [(robot_frames(each, q).tip - robot_frames(true, q).tip).T for each in longer]
    fits = [
        np.linalg.lstsq(np.stack(c, axis=1), s, rcond=None)
        for *c, s in zip(*columns, short, strict=True)
    ]
    assert max(fit[1].max(initial=0.0) for fit in fits) < 1e-20
    return 1e-3 * np.stack([fit[0] for fit in fits])


def linear_growth() -> Size:
    stated = np.outer(np.arange(7) / 6.0, (5e-5, 2e-5))
    return Size(grown({"a2_m": 5e-5, "d4_m": 2e-5}), stated)


def exponential_growth() -> Size:
    """Growth of the same size at the end."""
    stated = -np.expm1(-np.arange(7) / 3.0) / -np.expm1(-2.0)
    growth = grown({"a2_m": 5e-5, "d4_m": 2e-5, "time_constant_s": 30.0})
    return Size(growth, np.outer(stated, (5e-5, 2e-5)))


GEOMETRY: dict[str, Callable[[], Size]] = {
    "thermal_growth, linear": linear_growth,
    "thermal_growth, exponential": exponential_growth,
    "motor_offsets.sigma_rad": motor_offsets,
    "static.sigma_m": lambda: spread(
        drawn_geometry(True, static={"sigma_m": 2e-3, "sigma_rad": 1e-3}), 2e-3
    ),
    "static.sigma_rad": lambda: spread(
        drawn_geometry(False, static={"sigma_m": 2e-3, "sigma_rad": 1e-3}), 1e-3
    ),
    "ballbar_axes.sigma_m": lambda: axes(True, 2e-5, "between"),
    "ballbar_axes.sigma_rad": lambda: axes(False, 3e-4, "between"),
    "ballbar_axes.sigma_m, all": lambda: axes(True, 2e-5, "all"),
    "ballbar_axes.sigma_rad, all": lambda: axes(False, 3e-4, "all"),
    "base_tilt.sigma_rad": lambda: spread(
        drawn_geometry(False, base_tilt={"sigma_rad": 2e-3}), 2e-3
    ),
    "plate_length.sigma_m": lambda: spread(
        drawn_geometry(True, plate_length={"sigma_m": 1e-4}), 1e-4
    ),
    "plate_length of the file": lambda: spread(drawn_geometry(True, plate_length={}), 7e-6),
}


# --- robot's angles, lengths


def logged_joints(**errors: Any) -> Array:
    """(N, 6) [rad] errors of the angles that a robot at rest logs."""
    chosen = ErrorSettings.model_validate(errors)
    motors = motor_angles(CELL.robot, np.zeros((ROWS, 6)), chosen, None, seed=1)
    return motors_to_joints(CELL.robot, motors)


def outliers(side: str) -> Array:
    """(N,) [rad] of rows; 0 where a row has none."""
    stated = {"robot_probability": 0.1, "ballbar_probability": 0.2, "size_rad": [1e-3, 1e-2]}
    chosen = ErrorSettings.model_validate({"outliers": stated})
    assert chosen.outliers is not None
    drawn = logged_joints(outliers=stated)
    if side == "ballbar":
        drawn = chosen.outliers.on_ballbar(ROWS, 5, 1)
    assert (np.count_nonzero(np.abs(drawn) > 1e-9, axis=1) <= 1).all()
    return np.asarray(np.abs(drawn).max(axis=1))


def outlier_sizes(side: str) -> Size:
    """Log-uniform from 1e-3 to 1e-2: the logarithm over that of 10 has mean 1/2, sigma 0.29."""
    sizes = outliers(side)
    decades = np.log10(sizes[sizes > 1e-9] / 1e-3)
    assert decades.min() > -1e-6
    assert decades.max() < 1.0 + 1e-6
    return Size(decades.mean(), 0.5, 5.0 * 0.29 / 0.5 / np.sqrt(decades.size))


def zeros() -> Size:
    """Zeros of a sensed length, one a seed."""
    drawn = [
        true_geometry(NOMINAL, ErrorSettings(), CELL, seed=s, zero_sigma=2e-3)["bd3"]
        for s in range(1000)
    ]
    return spread(np.array(drawn) - NOMINAL["bd3"], 2e-3)


def zero_scale() -> Size:
    nominal, *zero = (
        simulate(chosen, relative_to=SCENARIOS).truth.geometry["bd3"]
        for chosen in (wire_settings(length={"zero_scale": s}) for s in (0.0, 1.0, 3.0))
    )
    assert abs(zero[0] - nominal) > 0.0
    return Size((zero[1] - nominal) / (zero[0] - nominal), 3.0)


def lags(**errors: float) -> Array:
    """(S, 6) [s] by which the angles of an even motion are late: the filter's time."""
    t = np.linspace(0.0, 1.0, 1001)
    still, bar = 0.0 * t, np.zeros((t.size, 5))
    gears = 0.7 + np.repeat(t[:, None], 6, axis=1)  # away from zero, where it starts at rest
    joints = gears @ CELL.robot.gear_to_joint
    motion = Motion(t, joints, joints, bar, still, still, NOMINAL)
    chosen = ErrorSettings.model_validate({"joint_lag": errors}).joint_lag
    late = []
    for seed in SEEDS:
        logged = with_lags(motion, CELL.robot, joint_lags(chosen, joints=6, seed=seed)).shown
        behind = gears - logged @ CELL.robot.joint_to_gear
        assert np.abs(behind[0]).max() < 1e-12
        assert behind.min() > -1e-12
        late.append(behind[-1])
    return np.stack(late)


def signal_noise() -> Size:
    """Readings of an encoder at rest, in rad at its shaft; a count is a hundredth of it."""
    noise = ErrorSettings.model_validate({"signal_noise": {"share": 0.01}}).signal_noise
    counts = at_rest(np.zeros(ROWS), noise, bits=13)
    return spread(counts * 2.0 * np.pi / (3600 << 13), 0.01 / 3600.0)


def at_rest(angle: Array, noise: SignalNoise | None, *, bits: int) -> Array:
    """(N,) counts of an encoder at angles (N,) [rad]."""
    encoder = BarEncoder(1, 3600, bits, direction=1, declared=1, offset=0.0, noise_sigma=0.0)
    counts = read_counts(encoder, angle, np.arange(float(angle.size)), noise, seed=1)
    return counts.astype(np.int32).astype(float)


ANGLES: dict[str, Callable[[], Size]] = {
    "joint_lag.time_constant_s": lambda: Size(
        lags(time_constant_s=0.02, spread=0.0), np.full((len(SEEDS), 6), 0.02), 1e-6
    ),
    "joint_lag.spread": lambda: spread(np.log(lags(time_constant_s=0.02, spread=0.2) / 0.02), 0.2),
    "signal_noise.share": signal_noise,
    "joint_noise.sigma_rad": lambda: spread(logged_joints(joint_noise={"sigma_rad": 3e-5}), 3e-5),
    "outliers.robot_probability": lambda: share(outliers("robot") > 1e-9, 0.1),
    "outliers.ballbar_probability": lambda: share(outliers("ballbar") > 1e-9, 0.2),
    "outliers.size_rad, robot": lambda: outlier_sizes("robot"),
    "outliers.size_rad, ballbar": lambda: outlier_sizes("ballbar"),
    "zero of a length": zeros,
    "length.zero_scale": zero_scale,
}


# --- loggers


def rows_written(side: str, **clocks: Any) -> Array:
    """(N,) how often each row of ten minutes stands in the file."""
    chosen = ClockSettings.model_validate(clocks)
    times = log_times(600.0, chosen, seed=1)
    rows = logged_rows(times, chosen, seed=1)
    written, taken = (
        (rows.robot, times.robot_true.size)
        if side == "robot"
        else (np.concatenate(rows.ballbar), times.bar_true.size)
    )
    return np.bincount(written, minlength=taken)


def dropped(side: str) -> Size:
    key = {f"{side}_probability": 0.05}
    return share(rows_written(side, dropped_rows=key) == 0, 0.05)


def duplicated(side: str) -> Size:
    key = {f"{side}_probability": 0.04}
    return share(rows_written(side, duplicated_rows=key) == 2, 0.04)


def overruns() -> Size:
    chosen = ClockSettings(overrun_probability=0.1)
    late = np.diff(log_times(600.0, chosen, seed=1).bar_stamp) == 15_000_000  # [ns] three tasks
    return share(late, 0.1)


def jitter() -> Size:
    chosen = ClockSettings.model_validate({"jitter": {"sigma_s": 3e-4}})
    stamps = log_times(600.0, chosen, seed=1).robot_stamp
    late = stamps - stamps[0] - ABB_PERIOD * np.arange(stamps.size)
    assert late[0] == 0.0  # the first row, from which time counts
    assert late[1:] @ late[:-1] / (late @ late) == pytest.approx(0.0, abs=0.02)
    return spread(late[1:], 3e-4)


def robot_wander() -> Size:
    chosen = ClockSettings.model_validate({"robot_wander": {"rate_rms_ppm": 0.7}})
    times = log_times(600.0, chosen, seed=1)
    assert (times.bar_true == log_times(600.0, ClockSettings(), seed=1).bar_true).all()
    rate = np.diff(times.robot_true) / ABB_PERIOD - 1.0
    return Size(rate.std(), 0.7e-6, 0.01)  # a knot a second


LOGGERS: dict[str, Callable[[], Size]] = {
    "robot_wander.rate_rms_ppm": robot_wander,
    "overrun_probability": overruns,
    "jitter.sigma_s": jitter,
    "dropped_rows.robot_probability": lambda: dropped("robot"),
    "dropped_rows.ballbar_probability": lambda: dropped("ballbar"),
    "duplicated_rows.robot_probability": lambda: duplicated("robot"),
    "duplicated_rows.ballbar_probability": lambda: duplicated("ballbar"),
}


# --- load logs

EXACT_SENSOR = dict.fromkeys(("noise_N", "noise_N_m", "bias_N", "bias_N_m", "gain_sigma"), 0.0)
EXACT_TORQUE = dict.fromkeys(("noise_N_m", "wrist_noise_N_m", "gain_sigma"), 0.0)


def loaded(size: float, seconds: float) -> Motion:
    """A robot at rest with the same load in every channel; none, or `size` [N, N m]."""
    t = np.array([0.0, seconds])
    still, load = np.zeros((2, 6)), np.full((2, 6), size)
    bar = still[:, :5]
    return Motion(t, still, still, bar, t * 0.0, t * 0.0, NOMINAL, torque=load, wrench=load)


def felt(size: float, seconds: float, seed: int = 1, **changes: float) -> tuple[Array, Array]:
    """Stamps and readings of a force sensor."""
    sensor = ForceSensor.model_validate(EXACT_SENSOR | changes)
    drawn = drawn_loads(LoadLogs(force_sensor=sensor), 6, seed)
    motion = loaded(size, seconds)
    return sensor_rows(motion, 0.0, seconds, sensor=sensor, drawn=drawn, seed=seed)


def shown(size: float, seconds: float, seed: int = 1, **changes: float) -> Array:
    """(N, 6) [N m] logged torques at the gears' outputs."""
    log = TorqueLog.model_validate(EXACT_TORQUE | changes)
    drawn, times = drawn_loads(LoadLogs(torque=log), 6, seed), np.arange(0.0, seconds, ABB_PERIOD)
    motion = loaded(size, seconds)
    motors = motor_torques(CELL.robot, motion, times, log=log, drawn=drawn, seed=seed)
    return np.asarray(motors / np.diag(CELL.robot.transmission))


def sensors(**changes: float) -> Array:
    """(S, 6) first readings of many sensors without load, less those under 1 kN."""
    return np.stack([felt(1e3, 0.1, s, **changes)[1][0] for s in SEEDS]) - 1e3


def sensor_period() -> Size:
    return Size(np.diff(felt(0.0, 10.0, rate_hz=250.0)[0]), 1.0 / 250.0)


def ramp_felt(**clock: float) -> tuple[Array, Array]:
    """Stamps and readings of a load that grows by 1 N/s in every channel, over 10 s."""
    ramp = replace(loaded(0.0, 10.0), wrench=np.array([[0.0] * 6, [10.0] * 6]))
    sensor = ForceSensor.model_validate(EXACT_SENSOR | {"offset_s": 0.3} | clock)
    drawn = drawn_loads(LoadLogs(force_sensor=sensor), 6, 1)
    return sensor_rows(ramp, 0.0, 10.0, sensor=sensor, drawn=drawn, seed=1)


def sensor_start() -> Size:
    """By the first row."""
    stamps, read = ramp_felt()
    assert stamps[0] == SENSOR_EPOCH
    return Size(read[0], 0.3)


def sensor_clock() -> Size:
    """By the last row: the robot's clock has gained 5 ms in 10 s."""
    stamps, read = ramp_felt(skew=5e-4)
    return Size((read[-1] - read[0]) / (stamps[-1] - stamps[0]) - 1.0, 5e-4, 1e-6)


LOADS: dict[str, Callable[[], Size]] = {
    "force_sensor.skew": sensor_clock,
    "torque.noise_N_m": lambda: white(shown(0.0, 60.0, noise_N_m=3.0)[:, :3], 3.0),
    "torque.wrist_noise_N_m": lambda: white(shown(0.0, 60.0, wrist_noise_N_m=0.4)[:, 3:], 0.4),
    "torque.gain_sigma": lambda: spread(
        np.stack([shown(1.0, 0.01, s, gain_sigma=0.03)[0] for s in SEEDS]) - 1.0, 0.03
    ),
    "force_sensor.noise_N": lambda: white(felt(0.0, 60.0, noise_N=1.5)[1][:, :3], 1.5),
    "force_sensor.noise_N_m": lambda: white(felt(0.0, 60.0, noise_N_m=0.15)[1][:, 3:], 0.15),
    "force_sensor.bias_N": lambda: spread(sensors(bias_N=3.0)[:, :3], 3.0),
    "force_sensor.bias_N_m": lambda: spread(sensors(bias_N_m=0.3)[:, 3:], 0.3),
    "force_sensor.gain_sigma": lambda: spread(sensors(gain_sigma=0.02) / 1e3, 0.02),
    "force_sensor.rate_hz": sensor_period,
    "force_sensor.offset_s": sensor_start,
}

EVERY = {**PLANT, **GEOMETRY, **ANGLES, **LOGGERS, **LOADS}
IN_LOGS = {*SensorErrors.model_fields, "offset_s", "skew", "wander", "step", "quantum", "restart"}


@pytest.mark.parametrize("source", EVERY)
def test_a_source_has_the_size_that_the_scenario_states(source: str) -> None:
    size = EVERY[source]()
    assert size.within < 0.25  # half the size is always seen
    assert size.measured == pytest.approx(size.stated, rel=size.within)


def test_no_source_is_without_a_test_of_its_size() -> None:
    measured = {name.replace(",", " ").split()[0].split(".")[0] for name in EVERY}
    still = {key.removeprefix("errors.") for key in OF_POSES}  # tests/sim/test_still_poses.py
    elsewhere = IN_LOGS | set(SampleErrors.model_fields) | still
    for group in (ErrorSettings, ClockSettings, LoadLogs):
        assert set(group.model_fields) <= measured | elsewhere


def test_lengths_are_rounded_to_the_stated_step(tmp_path: Path) -> None:
    chosen = wire_settings(length={"resolution_m": 3e-5})
    write_recording(simulate(chosen, relative_to=SCENARIOS), chosen, tmp_path / "recording")
    (file,) = tmp_path.glob("recording/raw/length*.csv")
    steps = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1] / 3e-2  # mm
    assert np.abs(steps - np.rint(steps)).max() < 1e-4  # the file has seven decimals
    assert np.gcd.reduce(np.diff(np.rint(steps).astype(int))) == 1


def test_the_lag_of_the_first_motor_is_part_of_the_clock_offset() -> None:
    """No log can tell one from the other."""
    chosen = settings(plant={"kind": "kinematic"}, errors={"joint_lag": {}})
    truth = simulate(chosen, relative_to=SCENARIOS).truth
    assert len(truth.logs.joint_lag_s) == 6
    assert truth.clock.offset_s == 0.137 + truth.logs.joint_lag_s[0] > 0.14


def test_the_lowest_of_thirteen_bits_fluctuates_at_rest_and_that_of_twelve_hardly() -> None:
    """Why the experiments of the thesis took 12 (sec. 4.6)."""
    angle = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, ROWS)
    changed = {
        bits: np.mean(at_rest(angle, SignalNoise(), bits=bits) != at_rest(angle, None, bits=bits))
        for bits in (10, 12, 13)
    }
    assert changed[13] > 0.3
    assert changed[12] < 0.2
    assert changed[10] < 0.05


def test_another_seed_has_other_resolvers_in_recordings_and_samples() -> None:
    """Equal phases on every machine would be a systematic error."""
    chosen = ErrorSettings.model_validate({"resolver_error": {}}).resolver_error
    assert resolver_effects(chosen, joints=6, seed=1) != resolver_effects(chosen, joints=6, seed=2)
    runs = [
        settings(
            plant={"kind": "kinematic"},
            errors={"resolver_error": {}},
            encoders={},
            clocks={},
            seed=seed,
        )
        for seed in (1, 2)
    ]
    first, second = (simulate(run, relative_to=SCENARIOS).resolvers for run in runs)
    assert first is not None
    assert second is not None
    phases = [[h.phase_rad for m in r.motors for h in m] for r in (first, second)]
    assert np.abs(np.subtract(*phases)).min() > 1e-3
    path = scenario_path(runs[0].path, CELL, NOMINAL, relative_to=SCENARIOS)
    one, other = (kinematic_samples(run, sample_path(CELL, NOMINAL, path, 50)).q for run in runs)
    assert np.abs(one - other).max() > 1e-6


@pytest.mark.parametrize(
    "source", ["transmission_error", "cycloid_ripple", "sinusoidal_gear_error", "unlisted_ripple"]
)
def test_the_phases_of_a_ripple_are_drawn_over_the_whole_turn(source: str) -> None:
    """Else a fit could profit from a phase that is likelier than others.

    The mean of exp(i phase) of n even draws scatters by 1 / sqrt(n). An even share of the turn that
    is missing or doubled, as small as 0.05, moves it by that share.
    """
    stated = {"waveform": "harmonic"} if source == "cycloid_ripple" else {}
    errors = PlantErrors.model_validate({source: stated})
    phases = [r.phase for seed in SEEDS for r in plant_effects(errors, CELL, seed).ripples]
    assert abs(np.exp(1j * np.array(phases)).mean()) < 4.0 / np.sqrt(len(phases))


def test_a_converter_rounds_to_the_nearest_of_its_steps() -> None:
    errors = SensorErrors.model_validate(
        {"resolver_error": {"amplitude_rad": [0.0, 0.0], "quantum_rad": 1e-3}}
    )
    effects = resolver_effects(errors.resolver_error, joints=1, seed=1)
    assert effects is not None
    angle = np.linspace(-0.02, 0.02, 4001)[:, None]
    error = effects.read_angles(angle) - angle
    assert np.abs(error).max() == pytest.approx(0.5e-3)
    assert abs(error.mean()) < 1e-5  # always down would be half a step


@pytest.mark.parametrize("bits", [8, 12, 13])
def test_six_bits_of_a_signal_period_are_left_at_any_speed(bits: int) -> None:
    """Bits that freeze by the terminal's documents (notes/log_formats sec. A.3)."""
    frozen = frozen_bits(np.array([0.0, 100.0, 200.0, 1e9]), 100.0, bits)
    assert frozen.tolist() == [0, 1, min(2, bits - 6), bits - 6]
