"""One simulated recording: path, plant, encoders, clocks, device files; and the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cell.descriptions import Cell, load_cell
from cell.files import write_yaml
from cell.geometry import Geometry, nominal_geometry
from cell.strict_yaml import load_model
from sim.clocks import LogTimes, log_times
from sim.encoders import BarEncoder, healthy_status, motor_angles
from sim.kinematic import run_kinematic
from sim.motion import Motion
from sim.path import Lissajous, ReferencePath, reference_path
from sim.plant import run_plant
from sim.settings import LissajousFile, SimulationSettings
from sim.static_errors import true_geometry
from sim.streams import stream
from sim.truth import Truth
from sim.writers import write_abb_motor, write_twincat_plc

PATH_STEP = 0.01  # [s] grid of the reference path; the command between is a cubic spline


@dataclass(frozen=True, eq=False)
class Simulation:
    """What was simulated, before it was logged."""

    cell: Cell
    path: ReferencePath
    motion: Motion
    encoders: tuple[BarEncoder, ...]
    declared: tuple[int, ...]  # sense of each encoder as recording.yaml will state it
    times: LogTimes
    truth: Truth


def simulate(settings: SimulationSettings, *, relative_to: Path) -> Simulation:
    """Runs the plant and decides what the loggers will see.

    relative_to : folder of the scenario, for files it names. Raises InputError for a scenario that cannot be run.
    """
    chosen = settings.cell
    cell = load_cell(chosen.robot, chosen.ballbar, chosen.plate, relative_to=relative_to)
    nominal = nominal_geometry(cell, np.array(chosen.ballbar_position_m))
    true = true_geometry(nominal, settings.errors.static, stream(settings.seed, "static"))
    timing = settings.path
    shape = load_lissajous(relative_to / timing.file)
    path = reference_path(cell.robot, nominal, shape, duration=timing.duration_s, dwell=timing.dwell_s, stops=timing.stops, step=PATH_STEP)
    motion = _moved(settings, cell, true, path)
    encoders, declared = _encoders(settings, cell)
    clocks = settings.clocks
    times = log_times(
        float(motion.t[-1]),
        offset=clocks.offset_s,
        skew=clocks.skew,
        overrun_probability=clocks.overrun_probability,
        rng=stream(settings.seed, "overruns"),
    )
    truth = _truth(settings, true, motion, encoders, declared)
    return Simulation(cell, path, motion, encoders, declared, times, truth)


def write_recording(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    """Writes `folder/raw/*`, the truth as `folder.truth.yaml` beside it, and `folder/recording.yaml` last."""
    motion, times = simulation.motion, simulation.times
    noise = settings.errors.joint_noise
    q, _ = motion.at(times.robot_true)
    sigma = noise.sigma_rad if noise else 0.0
    motors = motor_angles(simulation.cell.robot, q, noise_sigma=sigma, rng=stream(settings.seed, "joint_noise"))
    write_abb_motor(folder / "raw" / "robot.csv", times.robot_stamp, motors)
    _, b = motion.at(times.bar_true)
    counts = {f"b{e.joint}": e.counts(b[:, e.joint - 1], stream(settings.seed, f"encoder_noise_b{e.joint}")) for e in simulation.encoders}
    if counts:
        status = {f"s{e.joint}": healthy_status(times.bar_task) for e in simulation.encoders}
        write_twincat_plc(folder / "raw" / "ballbar.csv", times.bar_stamp, counts, status)
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "recording.yaml", _recording_yaml(simulation, settings))


def truth_path(folder: Path) -> Path:
    """Where the truth of a simulated recording lies: beside its folder, never inside."""
    return folder.with_name(folder.name + ".truth.yaml")


def load_lissajous(path: Path) -> Lissajous:
    """The path file as radians. Raises DescriptionError."""
    file = load_model(path, LissajousFile)
    return Lissajous(
        np.radians(file.centre_deg), np.radians(file.amplitude_deg), np.array(file.cycles, dtype=float), np.radians(file.phase_deg)
    )


def _moved(settings: SimulationSettings, cell: Cell, true: Geometry, path: ReferencePath) -> Motion:
    plant = settings.plant
    if plant.kind == "kinematic":
        return run_kinematic(true, path)
    return run_plant(cell, true, path, servo=plant.servo, timestep=plant.timestep_s)


def _encoders(settings: SimulationSettings, cell: Cell) -> tuple[tuple[BarEncoder, ...], tuple[int, ...]]:
    """Encoders as they are, and the senses that recording.yaml declares; a zero and a sense per joint, fitted or not."""
    rng = stream(settings.seed, "encoder_mounting")
    zeros, senses = rng.uniform(-np.pi, np.pi, 5), rng.choice([-1, 1], 5)
    given = settings.encoders
    encoders = tuple(
        BarEncoder(j, cell.ballbar.encoder_lines, given.bits, int(senses[j - 1]), float(zeros[j - 1]), given.noise_sigma_rad)
        for j in given.fitted
    )
    return encoders, tuple(e.sign if given.senses == "declared" else 1 for e in encoders)


def _truth(
    settings: SimulationSettings, true: Geometry, motion: Motion, encoders: tuple[BarEncoder, ...], declared: tuple[int, ...]
) -> Truth:
    zeros = {f"btheta{e.joint}": true[f"btheta{e.joint}"] + e.zero for e in encoders}
    position, angle = motion.closure()
    return Truth(
        geometry=true.replaced(zeros),
        senses={f"b{e.joint}": e.sign * said for e, said in zip(encoders, declared, strict=True)},
        offset=settings.clocks.offset_s,
        skew=settings.clocks.skew,
        seed=settings.seed,
        closure_position=float(position.max()),
        closure_angle=float(angle.max()),
        rod_force_min=float(motion.rod_force.min()),
        rod_force_max=float(motion.rod_force.max()),
    )


def _recording_yaml(simulation: Simulation, settings: SimulationSettings) -> dict[str, object]:
    chosen = settings.cell
    sources: dict[str, object] = {"robot": {"files": ["raw/robot.csv"], "dialect": "abb-motor"}}
    if simulation.encoders:
        sources["ballbar"] = {"files": ["raw/ballbar.csv"], "dialect": "twincat-plc"}
    return {
        "schema": "ballbar-recording/1",
        "kind": "simulated",
        "robot": chosen.robot,
        "ballbar": chosen.ballbar,
        "plate": chosen.plate,
        "sources": sources,
        "encoders": {
            f"b{e.joint}": {"column": f"b{e.joint}", "lines": e.lines, "bits": e.bits, "sign": said}
            for e, said in zip(simulation.encoders, simulation.declared, strict=True)
        },
        "notes": "",
    }
