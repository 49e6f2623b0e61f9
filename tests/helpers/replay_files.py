"""Replay files as rerun reads them: entities, values over the timeline, and what rerun verifies."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import Chunk, RrdReader

from ballbar.cell.arrays import Array


def chunks(path: Path, entity: str = "") -> list[Chunk]:
    """Chunks of an entity, by default of all."""
    every = RrdReader(str(path)).stream().to_chunks()
    return [chunk for chunk in every if entity in ("", chunk.entity_path)]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in chunks(path)}


def values(path: Path, entity: str, component: str) -> list[Any]:
    """All rows of a component, also of one that never changes."""
    batches = [chunk.to_record_batch() for chunk in chunks(path, entity)]
    known = [batch for batch in batches if component in batch.schema.names]
    return [row for batch in known for row in batch.column(component).to_pylist()]


def over_time(path: Path, entity: str, component: str) -> tuple[Array, Array]:
    """Times [ns] and values of one component over the timeline."""
    batches = [chunk.to_record_batch() for chunk in chunks(path, entity) if not chunk.is_static]
    known = [b for b in batches if {"robot_time", component} <= set(b.schema.names)]
    times = [batch.column("robot_time").cast("int64").to_numpy() for batch in known]
    rows = [np.array(b.column(component).to_pylist()).reshape(b.num_rows, -1) for b in known]
    return np.concatenate(times), np.concatenate(rows)


def rerun_says(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Output and exit code of a command of rerun itself about files."""
    command = [sys.executable, "-m", "rerun_cli", "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def verified(path: Path) -> bool:
    """Whether rerun itself finds no fault in a file."""
    return rerun_says("verify", path).returncode == 0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
