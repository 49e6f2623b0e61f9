"""A simulated recording as rows of its device files, and a folder whose files grow by them."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.dialect import load_dialect
from ballbar.cell.errors import InputError
from ballbar.cell.files import DESCRIPTIONS
from ballbar.cell.load import load_robot
from ballbar.cell.recording import RecordingFile, load_recording_file

WORD = 2**32  # of a counter
EXACT = Clock(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class TextLog:
    """A device log as cells of text."""

    head: str
    separator: str
    cells: NDArray[np.object_]  # (N, C), the first column the stamps
    t: Array  # (N,) [s] of each row on the robot's clock
    scales: dict[str, float]  # of each measured column: its units in a rad of the joint, or in a m
    counts: bool  # whether the measured columns are counters of 32 bits

    def has(self, name: str) -> bool:
        return name in self.head.split(self.separator)

    def column(self, name: str) -> int:
        return self.head.split(self.separator).index(name)

    def numbers(self, name: str) -> Array:
        return np.asarray(self.cells[:, self.column(name)].astype(float))

    def table(self, names: Sequence[str]) -> Array:
        """(N, K) numbers of K columns."""
        return np.stack([self.numbers(name) for name in names], axis=1)

    def put(self, rows: NDArray[np.intp], name: str, values: Array) -> None:
        """Replaces numbers, as the logger would write them."""
        if self.counts:
            text = [str(int(v) % WORD) for v in np.rint(values)]
        else:
            text = [f"{v:.9f}" for v in values]
        self.cells[rows, self.column(name)] = text


Logs = dict[str, TextLog]


def device_logs(recording: Path, clock: Clock, tracker: Clock = EXACT) -> Logs:
    """The logs of a simulated recording, by the names of their sources; a force sensor's is not.

    clock : of the ball-bar's log, or of the length's. tracker : of a tracker's. Raises InputError
    for a log that is no text.
    """
    described, logs = load_recording_file(recording), Logs()
    encoders = [encoder for _, encoder in sorted(described.encoders.items())]
    counts = [e.lines * 2**e.bits / (2.0 * np.pi) for e in encoders]
    clocks = {"robot": EXACT, "ballbar": clock, "length": clock, "tracker": tracker}
    for name, source in described.sources.named.items():
        if name not in clocks:
            continue
        (file,) = source.files  # the simulated logger was not started again
        if not file.endswith(".csv"):
            raise InputError(
                f"{file}: a log that is no table of text cannot grow row by row. Choose another "
                "dialect with logs.robot.dialect"
            )
        scales = {"ballbar": counts, "tracker": [*3 * [1e3], *3 * [1.0]]}.get(name, [1e3])  # mm
        if name == "robot":
            scales = _motor_scales(described, recording)
        lines = (recording / file).read_text("utf-8").splitlines()
        separator = ";" if ";" in lines[0] else ","
        cells = np.array([line.split(separator) for line in lines[1:]], dtype=object)
        seconds = cells[:, 0].astype(float) * (1.0 if "." in cells[0, 0] else 1e-9)
        seconds = seconds - seconds[0]
        logs[name] = TextLog(
            head=lines[0],
            separator=separator,
            cells=cells,
            t=np.asarray(clocks[name].robot_time(seconds)),
            scales=dict(zip(lines[0].split(separator)[1:], scales, strict=False)),
            counts=name == "ballbar",
        )
    return logs


def _motor_scales(described: RecordingFile, folder: Path) -> list[float]:
    """Units of each angle of the robot's log in a rad of its joint."""
    robot = load_robot(described.robot, relative_to=folder)
    dialect = load_dialect(described.sources.robot.dialect)
    unit = np.degrees(1.0) if dialect.angle_unit == "deg" else 1.0
    motors = dialect.angle_kind == "motors"
    turns = 1.0 / np.abs(np.diag(robot.transmission)) if motors else np.ones(robot.joints)
    return list((unit * turns).tolist())


class GrowingRecording:
    """A folder that holds the rows of another recording up to an instant, and half a row more."""

    def __init__(self, source: Path, folder: Path, clock: Clock, tracker: Clock = EXACT) -> None:
        """clock, tracker : of the logs beside the robot's, as of `device_logs`."""
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "raw").mkdir(parents=True)
        shutil.copy(source / "recording.yaml", folder)
        if (source / DESCRIPTIONS).is_dir():
            shutil.copytree(source / DESCRIPTIONS, folder / DESCRIPTIONS)
        self.folder = folder
        self.logs = device_logs(source, clock, tracker)
        self._written = dict.fromkeys(self.logs, 0)
        self._torn = dict.fromkeys(self.logs, "")

    @property
    def seconds(self) -> float:
        return float(min(log.t[-1] for log in self.logs.values()))

    def write_until(self, now: float) -> None:
        """Appends the rows that were taken by then [s], and the beginning of the next one."""
        for name, log in self.logs.items():
            file = self.folder / "raw" / f"{name}.csv"
            first, last = self._written[name], int(np.searchsorted(log.t, now))
            if not file.exists():
                file.write_text(log.head + "\n", "utf-8", newline="\n")
            lines = [log.separator.join(row) + "\n" for row in log.cells[first : last + 1]]
            torn = lines.pop()[:7] if last < len(log.cells) and lines else ""
            whole = "".join(lines)
            with file.open("a", encoding="utf-8", newline="") as stream:
                stream.write(whole[len(self._torn[name]) :] + torn if whole else "")
            if whole:
                self._torn[name], self._written[name] = torn, last
