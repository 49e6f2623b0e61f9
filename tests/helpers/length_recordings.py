"""A robot and an instrument that measures one length, each logged on a clock of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import BallBar, Cell
from ballbar.cell.geometry import Geometry, bar_frames, nominal_geometry, robot_frames
from ballbar.cell.inverse import refine
from ballbar.cell.load import load_plate, load_robot, load_telescoping_bar
from ballbar.cell.logs import LengthLog, RobotLog
from ballbar.ident.recording_fit import Logs
from ballbar.sim.path import Lissajous, reference_path

PLATE = load_plate("plate_250")
ROBOT = load_robot("irb2400")
QUANTUM = 2.0 * np.pi / 2**20  # [rad] step of the logged joint angles
SEAT_OF_BAR, SEAT_OF_WIRE = np.array([0.3, 0.0, 0.2]), np.array([0.55, -0.75, 0.1])
SHAPE = Lissajous(  # of a bar of 1 m: within the IRB 2400's reach
    centre=np.radians([-23.2, -40.0, 20.8, -129.6, 138.0]),
    amplitude=np.radians([75.9, -19.6, 31.0, -18.2, 87.4]),
    cycles=np.array([3.0, 1.0, 4.0, 2.0, 5.0]),
    phase=np.radians([18.0, 49.7, 251.0, 277.2, 357.4]),
)


@dataclass(frozen=True, eq=False)
class LengthRun:
    """The true values, and the logs."""

    cell: Cell
    true: Geometry
    clock: Clock
    zero: float  # [m] true length minus the length as read
    logs: Logs


def telescoping_bar() -> BallBar:
    """A bar of 1 m with a stroke of 5 mm either way, calibrated."""
    bar = load_telescoping_bar("qc20w_300")
    return replace(bar, name="bar_1000", d=[0.0, 0.0, 1.0, 0.0, 0.0], stroke=(0.995, 1.005))


def bar_run(clock: Clock, *, seed: int, noise: float = 5e-7, duration: float = 120.0) -> LengthRun:
    """A telescoping bar whose length varies by 5 mm while the tool moves on its sphere."""
    rng, cell = np.random.default_rng(seed), Cell(ROBOT, telescoping_bar(), PLATE)
    nominal = nominal_geometry(cell, SEAT_OF_BAR)
    true = drawn(nominal, rng)
    path = reference_path(ROBOT, nominal, SHAPE, duration=duration, dwell=2.0, stops=0, step=0.02)
    angle = 2.0 * np.pi * np.clip(path.t - 2.0, 0.0, duration - 4.0) / (duration - 4.0)
    stroke = 2.5e-3 * (np.sin(7.0 * angle) + np.sin(4.0 * angle + 1.0))
    b = np.column_stack((path.b, stroke))
    q = refine(true.robot, path.q, bar_frames(true, b).poses())
    return _logged(cell, true, clock, path.t, q, 1.0 + stroke, 0.0, noise, rng)


def planned_run(
    cell: Cell, nominal: Geometry, t: Array, q: Array, *, seed: int, noise: float
) -> LengthRun:
    """A drawn robot that follows nominal targets, and a bar that takes up what its errors do.

    t : (N,) [s], q : (N, J) [rad] of a path that keeps the nominal length.
    """
    rng = np.random.default_rng(seed)
    true = drawn(nominal, rng)
    tip = robot_frames(true, q).tip.T
    out = tip[0] - true.origin  # the seat is set so that the bar begins at its nominal length
    seat = tip[0] - nominal["bd3"] * out / np.linalg.norm(out)
    true = true.replaced({name: float(v) for name, v in zip(("ox", "oy", "oz"), seat, strict=True)})
    length = np.linalg.norm(tip - seat, axis=1)
    return _logged(cell, true, Clock(0.3, 2e-5), t, q, length, 0.0, noise, rng)


def wire_run(
    clock: Clock, *, seed: int, zero: float = 3e-3, noise: float = 5e-5, motion: int = 1
) -> LengthRun:
    """Two minutes of a draw-wire beside a robot that moves all its joints.

    motion : seed of the path; runs of one `seed` are of one robot.
    """
    duration = 120.0
    rng = np.random.default_rng(seed)
    cell = Cell(ROBOT, load_telescoping_bar("drawwire_2m"), PLATE)
    true = drawn(nominal_geometry(cell, SEAT_OF_WIRE), rng)
    true = true.replaced({"bd3": true["bd3"] + zero})
    t = np.arange(0.0, duration, 0.02)
    moving = np.clip(t - 2.0, 0.0, duration - 4.0)
    eased = moving - np.sin(2.0 * np.pi * moving / (duration - 4.0)) * (duration - 4.0) / (
        2.0 * np.pi
    )
    middle = np.radians([-35.0, 25.0, -15.0, 0.0, 50.0, 0.0])
    size = np.radians([35.0, 25.0, 25.0, 90.0, 45.0, 120.0])
    cycles = 2.0 * np.pi * np.array([0.07, 0.11, 0.13, 0.09, 0.17, 0.08])
    phase = np.random.default_rng(motion).uniform(0.0, 2.0 * np.pi, 6)
    q = middle + size * np.sin(cycles * eased[:, None] + phase)
    length = np.linalg.norm(robot_frames(true, q).tip.T - SEAT_OF_WIRE, axis=1)
    return _logged(cell, true, clock, t, q, length, zero, noise, rng)


def drawn(nominal: Geometry, rng: np.random.Generator, size: float = 1e-3) -> Geometry:
    """The nominal robot with errors of mm and mrad in every parameter but those of gauge and plate.

    No Hayati angles: the `dh` model has none.
    """
    table = nominal.table
    names = [n for n in table.robot if n not in (*table.gauge, table.plate)]
    return nominal.replaced({n: nominal[n] + size * rng.standard_normal() for n in names})


def _logged(
    cell: Cell,
    true: Geometry,
    clock: Clock,
    t: Array,
    q: Array,
    length: Array,
    zero: float,
    noise: float,
    rng: np.random.Generator,
) -> LengthRun:
    """The logs of a motion: the robot's in rows of 4 ms, the length's in rows of 10 ms."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415

    joints, lengths = make_interp_spline(t, q, k=5), make_interp_spline(t, length, k=5)
    t_robot = np.arange(0.0, t[-1], 0.004)
    seen = joints(t_robot) + 5e-6 * rng.standard_normal((t_robot.size, q.shape[1]))
    robot = RobotLog(t_robot, np.round(seen / QUANTUM) * QUANTUM)
    t_length = np.arange(0.0, t[-1], 0.01)
    at = np.asarray(clock.robot_time(t_length))
    inside = (at >= 0.0) & (at <= t[-1])
    t_length = t_length[inside] - t_length[inside][0]
    first = float(at[inside][0])
    read = lengths(at[inside]) - zero + noise * rng.standard_normal(t_length.size)
    logs = Logs(robot, None, length=LengthLog(t_length, read))
    return LengthRun(cell, true, Clock(first, clock.skew), zero, logs)


def first_seconds(run: LengthRun, seconds: float) -> LengthRun:
    """The run with the beginning of both logs alone."""
    robot, length = run.logs.robot, run.logs.length
    assert length is not None
    rows, reads = robot.t < seconds, length.t < seconds
    logs = Logs(
        RobotLog(robot.t[rows], robot.q[rows]),
        None,
        length=LengthLog(length.t[reads], length.length[reads]),
    )
    return replace(run, logs=logs)


def write_folder(run: LengthRun, folder: Path, instrument: str) -> None:
    """A recording folder with the run's logs, lengths in mm.

    instrument : a shipped one, or the text of a description of its own.
    """
    (folder / "raw").mkdir(parents=True)
    robot, length = run.logs.robot, run.logs.length
    assert length is not None
    header = "time," + ",".join(f"q{k + 1}" for k in range(robot.q.shape[1]))
    _write(folder / "raw" / "robot.csv", header, np.column_stack((robot.t, robot.q)))
    rows = np.column_stack((length.t, length.length * 1e3))
    _write(folder / "raw" / "length.csv", "time,length", rows)
    if "\n" in instrument:
        (folder / "instrument.yaml").write_text(instrument)
        instrument = "instrument.yaml"
    (folder / "recording.yaml").write_text(f"""schema: ballbar-recording/1
kind: simulated
robot: irb2400
instrument: {instrument}
sources:
  robot: {{files: [raw/robot.csv], dialect: joint-rad}}
  length: {{files: [raw/length.csv], dialect: length-table, column: length, unit: mm, time: s}}
""")


def _write(file: Path, header: str, rows: Array) -> None:
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.9f")
