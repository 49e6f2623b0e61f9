"""What `ballbar replay` shows: the replay of a run, its iterations, or two runs over each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Literal

from ballbar.result.names import REPLAY
from cell.errors import InputError

Layout = Literal["run", "identify"]


def chosen_replay(run: Path, layout: Layout, against: Path | None) -> AbstractContextManager[Path]:
    """The file to show; one that is made for it goes when the block ends.

    run, against : folders with run.rrd, or the files themselves.

    Raises InputError when there is no such file, it lacks what the layout shows, or the options
    contradict each other.
    """
    if against is not None and layout != "run":
        raise InputError("--against has a layout of its own; leave --layout out.")
    file = _replay_file(run)
    if layout == "run" and against is None:
        return _unchanged(file)
    # rerun is slow to import, and reading replays is rarely needed
    from ballbar.replay.arrangements import comparison, identify_replay  # noqa: PLC0415

    return identify_replay(file) if against is None else comparison(file, _replay_file(against))


def _replay_file(run: Path) -> Path:
    file = run / REPLAY if run.is_dir() else run
    if not file.is_file():
        raise InputError(
            f"{file}: no replay file. Make one with `ballbar run`, or "
            "`ballbar identify RECORDING --rerun`."
        )
    return file


@contextmanager
def _unchanged(file: Path) -> Iterator[Path]:
    yield file
