"""Recordings of a machine as the loggers write them, and the truth to judge a result by.

The folder holds raw/robot.csv (motor angles and torques), raw/ballbar.csv (counters) and
recording.yaml, in the formats of docs/recordings.md. The truth stays in memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from tests.independent.machine import CELL, Effects, Files, Machine, drawn, files
from tests.independent.path import FIRST, SECOND, Choice, path
from tests.independent.path import Path as RobotPath
from tests.independent.screws import Array, Pose, exponential
from tests.independent.statics import Motion, held, resting_flanks, unloaded

ENCODERS = (1, 2, 4, 5)
LINES, BITS = 3600, 12
ROBOT_PERIOD, TASK = 0.004032, 0.005  # [s] rows of the robot; PLC task, two to a row
OVERRUN = 0.005  # probability of a row one task late
FIRST_STAMPS = 1234.5, 830_000_000_000_000_000  # [s, ns] up-time; distributed clock
LEAD = 1.0  # [s] into the path at which the later log begins
NOISE = 2e-6  # [rad] of encoders, and of the robot's joints
QUANTUM = 2.0 * np.pi / 65536  # [rad] of a resolver's converter
TORQUE_NOISE = np.array([2.0, 2.0, 2.0, 0.3, 0.3, 0.3])  # [N m] at the outputs
GRADUATION = (6e-5, 2.5e-5, 8e-6, 2e-6)  # [rad] 1 to 4 cycles a turn
SIGNAL = (0.03, 0.02, 0.02)  # offset, gain and phase of sine against cosine
OFFSET, SKEW, DRIFT = 0.8, 5e-5, 1e-7  # [s, 1, 1] clock; drift of the rate over 120 s
FINE = 1e-3  # [s] steps of the lag's filter
AGE = 150.0  # [s] from one recording to the next, of a robot that warms up exponentially


@dataclass(frozen=True)
class Faults:
    """Faults between a sound machine and its files; none by default."""

    robot: str = ""  # another robot's file
    forearm_error: float = 0.0  # [m] of the d4 that the robot's file states
    rod_error: float = 0.0  # [m] of the length that the ball-bar's file states
    lines: int = LINES  # declared for b1
    swapped: tuple[int, int] | None = None  # two encoders whose columns change places
    swapped_motors: tuple[int, int] | None = None
    sign: int = 0  # encoder whose declared sign is wrong
    motor_sign: int = 0  # motor that is logged with the wrong sign
    keep: tuple[float, float] = (0.0, np.inf)  # [s] of rows that are kept
    late: int = 0  # encoder that is one row late
    scaled: tuple[int, float] = (0, 1.0)  # motor and factor of its angles
    slip: tuple[int, float] = (0, 0.0)  # encoder and step [rad] halfway
    still: tuple[int, ...] = ()  # motors whose logged angle does not change
    no_torque: bool = False
    clock_step: float = 0.0  # [s] of the ball-bar's stamps, halfway


@dataclass(frozen=True, eq=False)
class Truth:
    """Machine, motion and faults that one recording was made from."""

    machine: Machine
    # [s] t_robot = offset + (1 + skew) t_ballbar, both from their first rows; the lag of motor 1,
    # which no log tells from the clock, is part of it
    offset: float
    skew: float
    motion: Motion
    scaled: tuple[int, float] = (0, 1.0)  # motor, and factor by which its log is wrong

    def tool(self, joints: Array) -> Array:
        """(N, 3) [m] tool of the unloaded robot under its own weight at logged angles (N, 6) [rad].

        The logged angles are free of lag and noise, their resolvers' errors included.
        """
        return unloaded(self.machine, self._rigid(joints))

    def flanks(self, joints: Array) -> Array:
        """(N, 6) flank, -1 to 1, on which each gear's backlash then lies."""
        return resting_flanks(self.machine, self._rigid(joints))

    def _rigid(self, joints: Array) -> Array:
        """(N, 6) [rad] where rigid gears would be."""
        m = self.machine
        readings = joints @ np.linalg.inv(m.to_joint) / m.ratio
        motor, factor = self.scaled
        if motor:
            readings[:, motor - 1] /= factor
        return m.gears(m.from_readings(readings))


@dataclass(frozen=True)
class Plan:
    """Which machine is recorded, and how."""

    seed: int = 1
    effects: Effects = field(default_factory=Effects)
    paths: tuple[Choice, ...] = (FIRST, SECOND)
    duration: float = 120.0  # [s]
    rod_known: float = 0.0  # [m] sigma of a measured rod whose length the ball-bar's file states


def record(plan: Plan, folder: Path, faults: Faults = Faults()) -> list[Truth]:
    """Write a recording a path, `folder/1`, `folder/2`, ...; their truths."""
    return [record_path(plan, k, folder / str(k + 1), faults) for k in range(len(plan.paths))]


def record_path(plan: Plan, k: int, folder: Path, faults: Faults = Faults()) -> Truth:
    """Write the recording of path k, from 0; its truth."""
    cell = files()
    machine, motion = _moved(plan, k)
    rng = np.random.default_rng([plan.seed, k, 120])
    clock = float(rng.uniform(-OFFSET, OFFSET)), float(SKEW * rng.standard_normal())
    (folder / "raw").mkdir(parents=True, exist_ok=True)
    first = _write_robot(machine, motion, clock[0], rng, folder, faults)
    offset, skew = _write_ballbar(plan, motion, clock, rng, folder, faults)
    _write_description(plan, cell, machine, folder, faults)
    return Truth(machine, offset - first + plan.effects.lag[0], skew, motion, faults.scaled)


@lru_cache(maxsize=2)
def _moved(plan: Plan, k: int) -> tuple[Machine, Motion]:
    """The machine of a plan, and its motion on path k: the same whatever spoils the files."""
    machine, way = drawn(files(), plan.seed, plan.effects), _path(plan.paths[k], plan.duration)
    grown = _growth(plan.effects, way.command.t, k)
    return machine, held(machine, way.command, grown, way.bar, _remounted(plan, k))


@lru_cache(maxsize=8)
def _path(choice: Choice, duration: float) -> RobotPath:
    return path(files(), choice, duration)


def _growth(effects: Effects, t: Array, k: int) -> Array:
    """(2, N) [m] of a2 and d4."""
    ends = np.array(effects.growth)[:, None]
    if effects.growth_time == 0.0:
        return np.asarray(ends * t / 120.0)
    return np.asarray(ends * (1.0 - np.exp(-(t + k * AGE) / effects.growth_time)))


def _remounted(plan: Plan, k: int) -> Pose:
    """Displacement of the plate in recording k against the first, tool frame."""
    size, angle = plan.effects.remount
    drawn_twist = np.random.default_rng([plan.seed, k, 6]).standard_normal(6)
    out = Pose(np.eye(3), np.zeros(3))
    for i in range(6 if k else 0):
        twist = np.zeros(6)
        twist[i] = 1.0
        out = out @ exponential(twist, np.asarray(drawn_twist[i] * (angle if i < 3 else size)))
    return out


def _write_robot(
    machine: Machine, motion: Motion, offset: float, rng: np.random.Generator, folder: Path,
    faults: Faults,
) -> float:  # fmt: skip
    """Write motor angles and torques; the time [s] of the first row that is kept."""
    start = LEAD - max(0.0, offset)
    rows = int((motion.t[-1] - LEAD - start) / ROBOT_PERIOD) + 1
    t: Array = start + ROBOT_PERIOD * np.arange(rows, dtype=np.float64)
    noise = NOISE * rng.standard_normal((rows, 6))
    noise = noise @ np.linalg.inv(machine.to_joint) / machine.ratio
    motors = machine.read(_lagged(machine, motion, t) + noise)
    motors = QUANTUM * np.rint(motors / QUANTUM)
    torque = np.stack([np.interp(t, motion.t, column) for column in motion.torque.T], axis=1)
    torque = torque * machine.gain + TORQUE_NOISE * rng.standard_normal((rows, 6))
    torque = torque * machine.ratio  # at the motor, by virtual work
    motors = _mistaken(motors, faults)
    columns = [FIRST_STAMPS[0] + t - t[0], *motors.T]
    names = ["time", *(f"m{i}" for i in range(1, 7))]
    if not faults.no_torque:
        columns, names = [*columns, *torque.T], [*names, *(f"tau{i}" for i in range(1, 7))]
    inside = (t - t[0] >= faults.keep[0]) & (t - t[0] <= faults.keep[1])
    table = np.stack(columns, axis=1)[inside]
    form = ",".join(["%.6f", *["%.9f"] * (len(names) - 1)]) + "\n"
    lines = [",".join(names) + "\n", *(form % tuple(row) for row in table.tolist())]
    (folder / "raw" / "robot.csv").write_text("".join(lines))
    return float((t - t[0])[inside][0])


def _mistaken(motors: Array, faults: Faults) -> Array:
    out = motors.copy()
    if faults.swapped_motors:
        i, j = (k - 1 for k in faults.swapped_motors)
        out[:, [i, j]] = out[:, [j, i]]
    if faults.motor_sign:
        out[:, faults.motor_sign - 1] *= -1.0
    if faults.scaled[0]:
        out[:, faults.scaled[0] - 1] *= faults.scaled[1]
    for i in faults.still:
        out[:, i - 1] = out[0, i - 1]
    return out


def _lagged(machine: Machine, motion: Motion, t: Array) -> Array:
    """(N, 6) [rad] motor angles behind the first-order filters of the controller."""
    fine = np.arange(0.0, motion.t[-1], FINE)
    lags = np.array(machine.effects.lag)
    spline = CubicSpline(motion.t, motion.rigid)
    if not lags.any():
        return machine.motors(spline(t))
    motors = machine.motors(spline(fine))
    out = np.empty((t.size, 6))
    for i, (lag, m) in enumerate(zip(lags, motors.T, strict=True)):
        if lag == 0.0:
            out[:, i] = CubicSpline(fine, m)(t)
            continue
        # exact for an input that is straight between fine steps
        k = np.exp(-FINE / lag)
        ahead = 1.0 - lag / FINE * (1.0 - k)
        filtered = lfilter([ahead, 1.0 - k - ahead], [1.0, -k], m - m[0]) + m[0]
        out[:, i] = CubicSpline(fine, filtered)(t)
    return out


def _write_ballbar(
    plan: Plan, motion: Motion, clock: tuple[float, float], rng: np.random.Generator,
    folder: Path, faults: Faults,
) -> tuple[float, float]:  # fmt: skip
    """Write the counters; offset [s] at the first row that is kept, and skew.

    Both are those of the straight line through the clock's drift.
    """
    offset, skew = clock
    start = LEAD + min(0.0, offset)
    end = motion.t[-1] - LEAD
    late = rng.random(int((end - start) / (2.0 * TASK))) < OVERRUN
    tasks = np.cumsum(2 + late) - (2 + late[0])
    stamp = TASK * tasks
    drift = 0.5 * DRIFT / 120.0 * rng.standard_normal() * stamp**2
    true = start + (1.0 + skew) * stamp + drift
    inside = true <= end
    tasks, stamp, true, drift = (x[inside] for x in (tasks, stamp, true, drift))
    rate, ahead = np.polyfit(stamp, drift, 1)
    bar = CubicSpline(motion.t, motion.bar)(true)
    columns = {}
    kinds = np.random.default_rng([plan.seed, 5])
    for j in range(1, 6):
        angle = bar[:, j - 1] + (np.where(stamp > 0.5 * stamp[-1], faults.slip[1], 0.0)
                                 if faults.slip[0] == j else 0.0)  # fmt: skip
        counts = _counts(angle, direction(plan.seed, j), rng, kinds)
        columns[j] = np.roll(counts, 1) if faults.late == j else counts
    if faults.swapped:
        i, j = faults.swapped
        columns[i], columns[j] = columns[j], columns[i]
    time = FIRST_STAMPS[1] + np.rint(1e9 * stamp).astype(np.int64)
    time += np.where(stamp > 0.5 * stamp[-1], round(1e9 * faults.clock_step), 0)
    table = [time, *(columns[j] for j in ENCODERS), *[(tasks & 1) << 15] * len(ENCODERS)]
    names = ["time", *(f"b{j}" for j in ENCODERS), *(f"s{j}" for j in ENCODERS)]
    inside = (stamp >= faults.keep[0]) & (stamp <= faults.keep[1])
    inside[0] &= not faults.late
    rows = np.stack(table, axis=1)[inside].tolist()
    lines = [";".join(names), *(";".join(map(str, row)) for row in rows)]
    (folder / "raw" / "ballbar.csv").write_text("\r\n".join(lines) + "\r\n", newline="")
    skew += float(rate)
    return offset + float(ahead) + (1.0 + skew) * float(stamp[inside][0]), skew


def direction(seed: int, encoder: int) -> int:
    """-1 or 1: how an encoder (from 1) counts."""
    return int(np.random.default_rng([seed, encoder, 9]).choice([-1, 1]))


def _counts(angle: Array, sign: int, rng: np.random.Generator, kinds: np.random.Generator) -> NDInt:
    """(N,) counter values at joint angles (N,) [rad]: graduation, then sine and cosine signals."""
    first, *others = GRADUATION
    mounted = angle - kinds.uniform(0.0, 2.0 * np.pi)
    scale = angle + np.arctan2(first * np.sin(mounted), 1.0 + first * np.cos(mounted))
    for order, size in enumerate(others, start=2):
        scale = scale + size * np.sin(order * angle + kinds.uniform(0.0, 2.0 * np.pi))
    turns = LINES * scale
    offset, gain, phase = SIGNAL * kinds.standard_normal(3)
    sine = (1.0 + gain) * np.sin(turns + phase) + offset
    within = np.angle((np.cos(turns) + 1j * sine) * np.exp(-1j * turns))
    read = (turns + within) / LINES + NOISE * rng.standard_normal(angle.size)
    zero = kinds.uniform(-np.pi, np.pi)
    counted = np.rint(sign * (read - zero) * (LINES << BITS) / (2.0 * np.pi)).astype(np.int64)
    return np.asarray(counted % 2**32)


NDInt = np.ndarray[tuple[int], np.dtype[np.int64]]


def _write_description(
    plan: Plan, cell: Files, machine: Machine, folder: Path, faults: Faults
) -> None:
    robot, bar = faults.robot or "irb2400", "lund_600"
    if faults.forearm_error:
        text = (CELL / "robots" / f"{robot}.yaml").read_text()
        stated = cell.robot["dh"][3]["d_m"]
        robot = "robot.yaml"
        text = text.replace(f"d_m: {stated},", f"d_m: {stated + faults.forearm_error:.6f},")
        (folder / robot).write_text(text)
    if plan.rod_known or faults.rod_error:
        stated = cell.bar["dh"][2]["d_m"]
        if plan.rod_known:
            error = np.random.default_rng([plan.seed, 3]).standard_normal()
            stated = machine.rod + plan.rod_known * float(error)
        text = (CELL / "instruments" / f"{bar}.yaml").read_text()
        text = text.replace("d_m: 0.600,", f"d_m: {stated + faults.rod_error:.9f},")
        bar = "bar.yaml"
        (folder / bar).write_text(text)
    encoders = {
        f"b{j}": {
            "column": f"b{j}",
            "lines": faults.lines if j == 1 else LINES,
            "bits": BITS,
            "sign": direction(plan.seed, j) * (-1 if faults.sign == j else 1),
        }
        for j in ENCODERS
    }
    description = {
        "schema": "ballbar-recording/1",
        "kind": "simulated",
        "robot": robot,
        "ballbar": bar,
        "plate": "plate_250",
        "sources": {
            "robot": {"files": ["raw/robot.csv"], "dialect": "abb-motor"},
            "ballbar": {"files": ["raw/ballbar.csv"], "dialect": "twincat-plc"},
        },
        "encoders": encoders,
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(description, sort_keys=False))


def accuracy_box(cell: Files, count: int = 800, seed: int = 8) -> Array:
    """(N, 6) [rad] random joint angles of the robot's accuracy box."""
    low, high = (np.array(cell.robot[f"accuracy_{side}_deg"]) for side in ("lower", "upper"))
    shares = np.random.default_rng(seed).uniform(size=(count, 6))
    return np.asarray(np.deg2rad(low + shares * (high - low)) @ cell.axis_to_joint)


def aligned_distance(points: Array, target: Array) -> Array:
    """(N,) [m] between points and target (N, 3) [m] after the best rigid motion."""
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    return np.asarray(np.linalg.norm(a @ (u @ turn @ vt) - b, axis=1))
