"""`ballbar record`: sources from the options, recorders until Ctrl-C, and what was recorded."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from ballbar.acquisition.live.egm_source import LOOPBACK, EgmSource
from ballbar.acquisition.live.file_source import FileSource
from ballbar.acquisition.live.folder import CellNames, RecordingFolder
from ballbar.acquisition.live.plc_source import Memory, PlcSource
from ballbar.acquisition.live.recorder import LiveRecording
from ballbar.acquisition.live.source import Source
from ballbar.acquisition.sources import log_source
from ballbar.cell.errors import InputError, imports_for
from ballbar.cell.load import describes_instrument, load_cell, load_robot
from ballbar.cell.plc_ring import RING
from ballbar.cell.processes import on_stop_signals
from ballbar.cell.recording import load_recording_file
from ballbar.record.terminal import quiet_libraries, say_recording, show_until_stopped
from ballbar.watch.beside import WatchBeside
from ballbar.watch.show import Data, panel

if TYPE_CHECKING:  # pyads is an extra
    from ballbar.acquisition.live.ads import AdsMemory

PLC_PORT = 851  # of the first PLC project of TwinCAT 3

_NET_ID = re.compile(r"(\d{1,3}(?:\.\d{1,3}){5})(?::(\d{1,5}))?(?:@(.+))?")
_LISTEN = re.compile(r"(?:(\d{1,3}(?:\.\d{1,3}){3}):)?(\d{1,5})")


@dataclass(frozen=True)
class RecordOptions:
    """The options of `ballbar record`, unchecked."""

    plc: str | None
    egm: str | None
    egm_torque: bool  # whether the test signals of EGM are declared to be the axes' torques
    robot: str | None
    ballbar: str | None
    plate: str = "plate_250"
    files: Path | None = None  # folder of a recording.yaml whose logs other programs write
    duration: float | None = None  # [s]
    live: bool = False
    identify: bool = False
    accuracy: float | None = None  # [m]


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording that has ended."""

    recording: LiveRecording
    identified: Data | None  # the last state of the process that has identified it meanwhile
    failure: str = ""  # why that process has ended too early


Meanwhile = Callable[[LiveRecording, WatchBeside | None], None]


def record(
    folder: Path, options: RecordOptions, out: Console, *, meanwhile: Meanwhile | None = None
) -> Recorded:
    """Records until Ctrl-C or until the duration is over, and shows the progress on `out`.

    meanwhile : instead of what is shown; the recording ends when it returns.

    Raises InputError for bad options or a folder in use, RecorderError when it cannot write.
    """
    if options.plc is None and options.egm is None and options.files is None:
        raise InputError(
            "nothing to record: name a PLC with --plc, a port for the robot's EGM messages with "
            "--egm, or a folder of logs that other programs write with --files."
        )
    if options.egm_torque and options.egm is None:
        raise InputError("--egm-torque: belongs to --egm, which is not named. Name its port.")
    names, files = _cell_names(options)
    with ExitStack() as stack:
        sources = _growing(options, names)
        if options.plc is not None:
            sources.append(PlcSource(_ads_memory(options.plc), lines=names.lines))
        if options.egm is not None:
            address, port = _listen(options.egm)
            egm = EgmSource(port, address=address, torque=options.egm_torque)
            stack.callback(egm.close)
            sources.append(egm)
        on_batch = None
        if options.live:
            from ballbar.record import view  # noqa: PLC0415  rerun is heavy
            from ballbar.replay.window import live_window  # noqa: PLC0415

            layout = view.layout(sources)
            stream = stack.enter_context(live_window(view.APPLICATION, layout))
            on_batch = view.LiveView(stream).on_batch
        recording = LiveRecording(RecordingFolder(folder, names, files), sources, on_batch=on_batch)
        beside = identified = None
        if options.identify:
            duration, accuracy = options.duration, options.accuracy
            beside = WatchBeside(folder, accuracy=accuracy, duration=duration)
        display = meanwhile or partial(show_until_stopped, out, duration=options.duration)
        try:
            with on_stop_signals(recording.stop), quiet_libraries():
                recording.start()
                try:
                    display(recording, beside)
                finally:
                    recording.finish()
            if beside is not None and meanwhile is None:
                out.print("Last fit of the whole recording; Ctrl-C leaves it out.")
        finally:
            if beside is not None:
                with suppress(*(() if meanwhile else (KeyboardInterrupt,))):
                    identified = beside.finish()
    return Recorded(recording, identified, "" if beside is None else beside.failure)


def silent(recording: LiveRecording) -> list[str]:
    """Names of the sources that delivered nothing."""
    return [source.name for source in recording.progress if not source.records]


def record_data(folder: Path, recorded: Recorded) -> dict[str, object]:
    """JSON of `record`: counts and events of each source, what the recording lacks and shows."""
    recording = recorded.recording
    sources = {
        source.name: {
            "records": source.records,
            "lost": source.lost,
            "gaps": source.gaps,
            "refused": source.refused,
            "segments": source.segments,
            "rate_Hz": source.rate,
            "events": list(source.events),
            "warnings": list(source.warnings),
        }
        for source in recording.progress
    }
    data = {"recording": str(folder), "sources": sources, "missing": list(recording.missing)}
    if recorded.failure:
        data["identification_ended"] = recorded.failure
    return {**data, **({"identified": recorded.identified} if recorded.identified else {})}


def say(out: Console, folder: Path, recorded: Recorded) -> None:
    """Prints what was recorded, what the recording lacks and what was identified."""
    recording = recorded.recording
    say_recording(out, recording.progress)
    empty, name = silent(recording), escape(str(folder))
    for source in empty:
        out.print(f"[red]{source}: delivered nothing[/]")
    if len(empty) == len(recording.progress):
        return
    for item in recording.missing:
        out.print(f"Still missing: {escape(item)}.")
    if recorded.identified is not None:
        out.print(panel(recorded.identified))
    if recorded.failure:
        out.print(f"[red]identification ended: {escape(recorded.failure)}[/]")
    hint = "" if recording.missing else f", look at it with: ballbar check {name}"
    out.print(f"Recording {name}{hint}")


def _cell_names(options: RecordOptions) -> tuple[CellNames, list[Path]]:
    """Robot, ball-bar and plate as recording.yaml names them, and the user's own files.

    These are copied into the recording, which can then be moved as a whole.
    """
    robot, ballbar, plate, described = options.robot, options.ballbar, options.plate, None
    if options.files is not None:
        if options.robot or options.ballbar:
            what = "recording.yaml in that folder names robot and instrument."
            raise InputError.at(
                f"--files {options.files}", what, "Leave out --robot and --ballbar."
            )
        described = load_recording_file(options.files)
        robot, ballbar, plate = described.robot, described.measured_by, described.plate
    if robot is None or ballbar is None:
        raise InputError(
            "name the robot with --robot and the ball-bar with --ballbar, or with --files a folder "
            "whose recording.yaml names them."
        )
    if described is None and describes_instrument(ballbar):
        raise InputError(
            f"--ballbar {ballbar}: is an instrument without encoders, whose log another program "
            "writes. Describe it with `ballbar new`, and name that folder with --files."
        )
    base, bar = options.files or Path(), None
    if described is None or described.ballbar is not None:
        bar = load_cell(robot, ballbar, plate, relative_to=base).ballbar
    elif options.plc is not None:
        what = f"{ballbar} has no encoders that a PLC reads."
        raise InputError.at(f"--plc {options.plc}", what, "Leave it out.")
    stated = [robot, ballbar, plate]
    if described is not None:
        stated += dict.fromkeys(source.dialect for source in described.sources.named.values())
    files = [base / name for name in stated if name.endswith(".yaml")]
    if len({*(file.name.casefold() for file in files), "recording.yaml"}) <= len(files):
        what = "two files of one folder, or one and recording.yaml, cannot have the same name."
        raise InputError.at(", ".join(map(str, files)), what, "Rename one of them.")
    robot, ballbar, plate = (Path(n).name if n.endswith(".yaml") else n for n in stated[:3])
    return CellNames(robot, ballbar, plate, bar.encoder_lines if bar else 0, described), files


def _growing(options: RecordOptions, names: CellNames) -> list[Source]:
    """The logs that other programs write, but for those that a PLC or EGM delivers."""
    described, folder = names.described, options.files
    if described is None or folder is None:
        return []
    axes = load_robot(described.robot, relative_to=folder).joints
    delivered = {"robot": options.egm, "ballbar": options.plc}
    return [
        FileSource(
            log_source(
                folder,
                name,
                declared,
                axes=axes if name == "robot" else None,
                encoders=described.encoders if name == "ballbar" else None,
            )
        )
        for name, declared in described.sources.named.items()
        if delivered.get(name) is None
    ]


def _ads_memory(plc: str) -> Memory:
    match = _NET_ID.fullmatch(plc)
    if match is None or any(int(number) > 255 for number in match[1].split(".")):
        raise InputError(
            f"--plc {plc}: an AMS address is NETID[:PORT][@HOST], such as 5.12.82.20.1.1 or "
            "5.12.82.20.1.1:851@192.168.1.20."
        )
    reader = ads_reader(f"--plc {plc}")
    return reader(match[1], int(match[2] or PLC_PORT), symbol=RING, host=match[3])


def ads_reader(wanted: str) -> type[AdsMemory]:
    """The reader of a PLC's memory; raises InputError where its library cannot be loaded.

    wanted : what needs it, for the message.
    """
    try:
        with imports_for(wanted, "ballbar-bench[ads]"):
            from ballbar.acquisition.live.ads import AdsMemory  # noqa: PLC0415
    except OSError as error:  # pyads loads the ADS library when it is imported
        what = f"the ADS library of pyads cannot be loaded ({error})."
        raise InputError.at(wanted, what, "On Windows it comes with TwinCAT.") from None
    return AdsMemory


def _listen(egm: str) -> tuple[str, int]:
    match = _LISTEN.fullmatch(egm)
    if match is None or not 0 < int(match[2]) < 65536:
        raise InputError(
            f"--egm {egm}: give a port such as 6510, or ADDRESS:PORT to listen on a network card, "
            "such as 192.168.125.10:6510."
        )
    return match[1] or LOOPBACK, int(match[2])
