"""Commands at a recording that is being written: `ballbar record` and `watch`."""

from __future__ import annotations

import json
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live

from ballbar.commands.options import AsJson, RecordingFolder, command, say_json
from ballbar.terminal import err, out, silence
from ballbar.units import MM

commands = typer.Typer()
Accuracy = Annotated[
    float | None,
    typer.Option(
        help="TCP error [mm] (rms over the workspace) that is enough: said at half of it as stated "
        "uncertainty (1 sigma), so that the true one is within it in 95 % of cases.",
        metavar="MM",
        min=1e-6,
    ),
]


@command(commands)
def record(
    folder: Path,
    *,
    robot: str | None = None,
    ballbar: str | None = None,
    plate: str = "plate_250",
    files: Path | None = None,
    plc: str | None = None,
    egm: str | None = None,
    egm_torque: bool = False,
    duration: Annotated[float | None, typer.Option(min=0.1)] = None,
    live: bool = False,
    identify: bool = False,
    accuracy: Accuracy = None,
    as_json: AsJson = False,
) -> None:
    """Record live: a TwinCAT PLC over ADS, ABB EGM, and logs that other programs write.

    The PLC runs docs/plc/ball_bar.st and reads the encoders of a ball-bar. Of a tracker
    that follows the robot, a sensed length, a force sensor or another robot, the rows are taken as
    they come into a file. The recording can be read at any moment. The command waits for the
    devices, starts a new file when one was disconnected, and ends with Ctrl-C. Exits with 1 when
    the disk is full, or a device delivered nothing.

    Example: `ballbar record runs/monday --robot irb2400 --ballbar lund_600 --plc 5.12.82.20.1.1
    --egm 192.168.125.10:6510`

    Example: `ballbar record runs/monday --files logs --egm 192.168.125.10:6510`, a tracker beside
    an ABB robot

    DIR : New folder for the recording.
    --robot NAME : Robot of cell/robots, or a .yaml file.
    --ballbar NAME : Ball-bar of cell/instruments, or a .yaml file.
    --plate NAME : Offset plate of cell/plates, or a .yaml file.
    --files FOLDER : Folder of a recording.yaml, as `ballbar new` makes it, whose logs other
        programs write meanwhile. It names robot and instrument, too.
    --plc NETID[:PORT][@HOST] : AMS address of the PLC that reads the encoders.
    --egm [ADDRESS:]PORT : Address and port that receive the robot's EGM feedback; a port alone
        hears this machine only.
    --egm-torque : The first six EGM test signals are the axes' torques (signal 4002).
    --duration : Seconds from the first record. Default: until Ctrl-C.
    --live : Show the angles in a rerun window while recording.
    --identify : Identify the robot meanwhile, in a process of its own, and raise alarms.
    """
    from ballbar.record.show import RecordOptions, record_data, say, silent
    from ballbar.record.show import record as record_live

    options = RecordOptions(
        plc=plc,
        egm=egm,
        egm_torque=egm_torque,
        robot=robot,
        ballbar=ballbar,
        plate=plate,
        files=files,
        duration=duration,
        live=live,
        identify=identify,
        accuracy=None if accuracy is None else accuracy / MM,
    )
    recorded = record_live(folder, options, err if as_json else out)
    if as_json:
        say_json(record_data(folder, recorded))
    say(out, folder, recorded)
    raise typer.Exit(1 if silent(recorded.recording) else 0)


@command(commands)
def watch(
    folder: RecordingFolder,
    accuracy: Accuracy = None,
    duration: Annotated[float | None, typer.Option(min=1.0)] = None,
    live: bool = False,
    as_json: bool = False,
) -> None:
    """Identify a recording while it is being written, by any logger.

    Every second the files are read, the latest rows are compared with what the earlier ones
    predict, and the robot is identified again. Nothing is written. The folder must exist; its files
    may come later. Ends with Ctrl-C, or when the duration is over and no more rows come. Exits with
    1 if an alarm stands at the end, or the accuracy is not reached.

    Example: `ballbar watch runs/monday --accuracy 0.05`, in a second terminal while the recording
    is written

    --duration : Seconds that the recording takes, for the uncertainty at its end. Default: until
        Ctrl-C.
    --live : Show uncertainty, coverage and alarms in a rerun window.
    --json : Print a line of JSON in SI units for each update.
    """
    from ballbar.cell.processes import on_stop_signals
    from ballbar.cell.threads import one_thread_each

    with one_thread_each():  # read when the libraries load
        from ballbar.watch.run import watch as watch_folder
    from ballbar.watch.show import Data, line, panel

    requested = None if accuracy is None else accuracy / MM
    if as_json:
        silence()
    with ExitStack() as stack:
        in_window = None
        if live:
            from ballbar.replay.window import live_window
            from ballbar.watch.view import APPLICATION, WatchView, layout

            stream = stack.enter_context(live_window(APPLICATION, layout()))
            in_window = WatchView(stream).show
        stop = threading.Event()
        stack.enter_context(on_stop_signals(stop.set))
        panels = None
        if out.is_terminal and not as_json:
            panels = stack.enter_context(Live(console=out, auto_refresh=False, transient=True))

        def show(data: Data) -> None:
            if in_window is not None:
                in_window(data)
            if as_json:
                typer.echo(json.dumps(data))
            elif panels is not None:
                panels.update(panel(data), refresh=True)
            else:
                out.print(line(data), markup=False)

        state = watch_folder(folder, show, accuracy=requested, duration=duration, stop=stop)
    if panels is not None:
        out.print(panel(state.to_dict()))
    raise typer.Exit(1 if state.alarms or (accuracy is not None and not state.enough) else 0)
