"""Parts that several studies share: their command line, their recordings and their tables."""

from __future__ import annotations

import argparse
import csv
import io
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from ballbar.acquisition.recording import Recording, read_recording
from ballbar.cell.files import write_whole
from ballbar.sim.recording_files import write_recording
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.simulate import Simulation, simulate

ROOT = Path(__file__).parents[1]
SCENARIOS, STUDIES = ROOT / "scenarios", ROOT / "docs" / "studies"
COUNTS_PER_RAD = 3600 * 2**12 / math.tau  # encoders of 3600 lines and 12 bits


def study_parser(text: str | None) -> argparse.ArgumentParser:
    """A command line whose help is the text of a module."""
    form = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(description=text, formatter_class=form)


def table(rows: Sequence[Any], number: str = "", columns: Sequence[str] = ()) -> bytes:
    """Rows (mappings or dataclasses) as CSV, numbers with this format; columns : default all."""
    text, data = io.StringIO(), [asdict(r) if is_dataclass(r) else r for r in rows]  # type: ignore[arg-type]
    writer = csv.DictWriter(
        text, columns or list(data[0]), lineterminator="\n", extrasaction="ignore"
    )
    writer.writeheader()
    for row in data:
        values = {k: format(v, number) if isinstance(v, float) else v for k, v in row.items()}
        writer.writerow(values)
    return text.getvalue().encode()


def write_table(
    path: Path, rows: Sequence[Any], number: str = "", columns: Sequence[str] = ()
) -> None:
    """Writes rows as `table` has them."""
    write_whole(path, table(rows, number, columns))


def in_words(row: Mapping[str, object]) -> str:
    """A row as a line: names and values, numbers to four digits."""
    return ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items())


def kinematic_settings(
    path: Mapping[str, object], **sections: Mapping[str, object] | int
) -> SimulationSettings:
    """A run of the kinematic plant with an IRB 2400 where scenarios/irb2400.yaml has its ball-bar.

    path : of a Lissajous path, but its kind. sections : further ones of the settings, `cell` in
    addition to this one.
    """
    position: Mapping[str, object] = {"ballbar_position_m": [0.70, 0.0, 0.54]}
    cell, more = sections.pop("cell", {}), sections
    assert isinstance(cell, Mapping)
    return SimulationSettings.model_validate(
        {
            "cell": {"robot": "irb2400", "ballbar": "lund_600", **position, **cell},
            "path": {"kind": "lissajous", **path},
            "plant": {"kind": "kinematic"},
            **more,
        }
    )


def recorded(settings: SimulationSettings, relative_to: Path) -> tuple[Simulation, Recording]:
    """A simulation, and its recording through device files and reader."""
    simulation = simulate(settings, relative_to=relative_to)
    with tempfile.TemporaryDirectory() as work:
        write_recording(simulation, settings, Path(work) / "recording")
        return simulation, read_recording(Path(work) / "recording")


def describe(
    folder: Path, below: str = "raw/", joints: Sequence[int] = (1, 2, 3, 4, 5), **of_bar: str
) -> None:
    """recording.yaml of logs of an IRB 2400's motors and of encoders in a folder.

    below : folder of the files robot.csv and ballbar.csv. of_bar : further keys of the second.
    """
    sources = {
        "robot": {"files": [f"{below}robot.csv"], "dialect": "abb-motor"},
        "ballbar": {"files": [f"{below}ballbar.csv"], "dialect": "twincat-plc", **of_bar},
    }
    description = {
        "schema": "ballbar-recording/1",
        "kind": "real",
        "robot": "irb2400",
        "ballbar": "lund_600",
        "sources": sources,
        "encoders": {f"b{j}": {"column": f"b{j}", "lines": 3600, "bits": 12} for j in joints},
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(description))
