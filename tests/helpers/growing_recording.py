"""A simulated recording whose files grow as they would while the robot moves, with faults in it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array

PER_COUNT = 2.0 * np.pi / (3600 * 2**12)  # [rad] of the simulated encoders
WORD = 2**32
OFFSET, SKEW = 0.137, 5e-5  # [s], [1] of the simulated clocks


@dataclass(eq=False)
class TextLog:
    """A device log as cells of text."""

    head: str
    separator: str
    cells: NDArray[np.object_]  # (N, C), the first column the stamps
    t: Array  # (N,) [s] of each row on the robot's clock

    @classmethod
    def read(cls, path: Path) -> TextLog:
        lines = path.read_text().splitlines()
        separator = ";" if ";" in lines[0] else ","
        cells = np.array([line.split(separator) for line in lines[1:]], dtype=object)
        seconds = cells[:, 0].astype(float) * (1.0 if "." in cells[0, 0] else 1e-9)
        t = seconds - seconds[0]
        if path.stem == "ballbar":
            t = OFFSET + (1.0 + SKEW) * t
        return cls(lines[0], separator, cells, t)

    def column(self, name: str) -> int:
        return self.head.split(self.separator).index(name)

    def numbers(self, name: str) -> Array:
        return np.asarray(self.cells[:, self.column(name)].astype(float))

    def put(self, rows: NDArray[np.intp], name: str, values: Array) -> None:
        """Replaces numbers, as the logger would write them."""
        if name.startswith("b"):
            text = [str(int(v) % WORD) for v in np.rint(values)]
        else:
            text = [f"{v:.9f}" for v in values]
        self.cells[rows, self.column(name)] = text


Logs = dict[str, TextLog]
Fault = Callable[[Logs, float, np.random.Generator], None]


class GrowingRecording:
    """A folder that holds the rows of another recording up to an instant, and half a row more."""

    def __init__(self, source: Path, folder: Path) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "raw").mkdir(parents=True)
        shutil.copy(source / "recording.yaml", folder)
        self.folder = folder
        self.logs: Logs = {
            path.stem: TextLog.read(path) for path in sorted((source / "raw").glob("*.csv"))
        }
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
                file.write_text(log.head + "\n")
            lines = [log.separator.join(row) + "\n" for row in log.cells[first : last + 1]]
            torn = lines.pop()[:7] if last < len(log.cells) and lines else ""
            whole = "".join(lines)
            with file.open("a", newline="") as stream:
                stream.write(whole[len(self._torn[name]) :] + torn if whole else "")
            if whole:
                self._torn[name], self._written[name] = torn, last
