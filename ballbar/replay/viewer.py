"""The viewers for replays and live data: native, or on the web and served on this machine alone.

Both come with the rerun package.
"""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
import time
import urllib.parse
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

from ballbar.cell.errors import FailureError, InputError
from ballbar.cell.processes import process_apart

LOOPBACK = "127.0.0.1"  # the viewer's own default is every interface
_MAGIC = b"RRF"  # first bytes of a rerun recording, before the version of its format
_START_TIMEOUT = 20.0  # [s]
_BINARIES = ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun")  # Linux, Windows, macOS


class ViewerError(FailureError):
    """The viewer did not start, or ended with an error."""


def _require_replay(path: Path, name: str) -> None:
    """Raises InputError for what is no replay; name : of the file in the folder of a run."""
    if not path.is_file():
        remedy = "Make one with `ballbar run`, or `ballbar identify RECORDING --rerun`."
        raise InputError.at(path, "no replay file.", remedy)
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise InputError.at(path, "is not a replay.", f"Name a folder with {name}.")


def chosen_replay(run: Path, against: Path | None) -> AbstractContextManager[Path]:
    """The file to show: that of a run, or two runs over each other in one that goes with the block.

    run, against : folders with run.rrd, or the files themselves.

    Raises InputError when there is no such file.
    """
    from ballbar.result.names import REPLAY  # noqa: PLC0415  imports what reads YAML

    paths = (run,) if against is None else (run, against)
    files = [path / REPLAY if path.is_dir() else path for path in paths]
    for file in files:
        _require_replay(file, REPLAY)
    if against is None:
        return nullcontext(files[0])
    # rerun is slow to import, and reading replays is rarely needed
    from ballbar.replay.comparison import comparison  # noqa: PLC0415

    return comparison(*files)


def open_viewer(path: Path) -> None:
    """Show a replay in the native viewer and return when its window is closed.

    Raises ViewerError if the viewer fails.
    """
    _check_screen("Use --web, and a browser on this machine.")
    command = [_rerun(), "--bind", LOOPBACK, "--port", "auto", str(path)]
    try:
        code = subprocess.run(command, check=False, env=_quiet()).returncode
    except KeyboardInterrupt:
        return
    if code != 0:
        raise ViewerError(
            f"{path}: the viewer ended with code {code}. Without a screen or graphics driver use "
            "--web."
        )


def _check_screen(remedy: str) -> None:
    screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and not screen:
        raise ViewerError(
            f"there is no screen (neither DISPLAY nor WAYLAND_DISPLAY is set). {remedy}"
        )


def serve_web(path: Path, *, port: int | None = None, show: Callable[[str], None] = print) -> None:
    """Serve the web viewer with a replay on this machine alone, until interrupted.

    port : of the page; None for a free one. show : called with a sentence that holds the address.

    Raises InputError if the port is taken, ViewerError if the server fails.
    """
    with web_server(path, port=port) as (url, server):
        show(f"{path.name}: open {url} (only from this machine; Ctrl-C ends)")
        try:
            code = server.wait()
        except KeyboardInterrupt:
            return
    raise ViewerError(
        f"{path}: the web viewer ended with code {code}. "
        "Run the command again, or view without --web."
    )


def _require_free(port: int) -> None:
    """Raises InputError for a port that another program holds."""
    with socket.socket() as probe:
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise InputError(
                f"port {port} on {LOOPBACK} cannot be used ({error.strerror}); choose another."
            ) from None


@contextmanager
def web_server(
    path: Path, *, port: int | None = None
) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A running web viewer: its address and its process, which ends with the block.

    port : as `serve_web`. Raises as `serve_web`.
    """
    if port is not None:
        _require_free(port)
    port, data_port = port or _free_port(), _free_port()
    ports = ["--port", str(data_port), "--web-viewer-port", str(port)]
    command = [_rerun(), "--serve-web", "--bind", LOOPBACK, *ports, str(path)]
    server = subprocess.Popen(command, env=_quiet())
    data = urllib.parse.quote(f"rerun+http://{LOOPBACK}:{data_port}/proxy", safe="")
    try:
        _wait_for(server, port, f"{path}: the web viewer")
        yield f"http://{LOOPBACK}:{port}/?url={data}", server
    finally:
        server.terminate()
        server.wait()


def live_viewer() -> str:
    """Start a native viewer that waits for data on this machine alone, and return its address.

    The window outlives the program.

    Raises ViewerError if it does not start.
    """
    _check_screen("Leave out --live.")  # without one the viewer answers first, and ends then
    port = _free_port()
    address = ["--bind", LOOPBACK, "--port", str(port)]
    command = [_rerun(), *address, "--hide-welcome-screen", "--expect-data-soon"]
    viewer = process_apart(command, env=_quiet())
    try:
        _wait_for(viewer, port, "the viewer")
    except ViewerError as error:
        viewer.terminate()
        raise ViewerError(
            f"{error} Leave out --live where there is no screen or graphics driver."
        ) from None
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def _quiet() -> dict[str, str]:
    """The environment in which the viewer writes errors alone, and collects no usage data.

    CI is what rerun itself looks for to collect none; the user's own setting of rerun stays.
    """
    return {**os.environ, "RUST_LOG": "error", "CI": "1"}


def _rerun() -> str:
    """Path of the viewer's own program.

    Not `python -m rerun_cli`: ending that would leave the program behind it running.
    """
    if (spec := importlib.util.find_spec("rerun_cli")) is None:
        raise ModuleNotFoundError("No module named 'rerun'", name="rerun")
    folders = map(Path, spec.submodule_search_locations or ())
    for program in (folder / name for folder in folders for name in _BINARIES):
        if program.is_file():
            return str(program)
    raise ViewerError(
        "the rerun viewer is not installed beside rerun-sdk; reinstall it with "
        "`pip install --force-reinstall rerun-sdk`."
    )


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def _wait_for(server: subprocess.Popen[bytes], port: int, what: str) -> None:
    deadline = time.monotonic() + _START_TIMEOUT
    while time.monotonic() < deadline:
        if server.poll() is not None:
            raise ViewerError(
                f"{what} ended with code {server.returncode} before it answered. "
                "Run the command again; where it ends again, reinstall rerun-sdk."
            )
        with socket.socket() as probe:
            probe.settimeout(0.2)
            if probe.connect_ex((LOOPBACK, port)) == 0:
                return
        time.sleep(0.05)
    raise ViewerError(
        f"{what} did not answer on port {port} within {_START_TIMEOUT:.0f} s. "
        "Run the command again; where it stays silent, reinstall rerun-sdk."
    )
