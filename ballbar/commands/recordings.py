"""Recordings: live from the cell, from two files, and what was read in them."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from acquisition.times import TIME_FORMS
from ballbar.commands.options import AT_THE_CELL, AsJson, RecordingFolder, say_json
from ballbar.terminal import err, out
from cell.errors import InputError

commands = typer.Typer()


@commands.command(
    rich_help_panel=AT_THE_CELL,
    epilog="Example: `ballbar record runs/monday --robot irb2400 --ballbar lund_600 --plc 5.12.82.20.1.1 --egm 192.168.125.10:6510`",
)
def record(
    folder: Annotated[Path, typer.Argument(help="A new folder for the recording.", metavar="DIR")],
    robot: Annotated[str, typer.Option(help="A robot of cell/robots, or a file.", metavar="NAME")],
    ballbar: Annotated[
        str, typer.Option(help="A ball-bar of cell/ballbars, or a file.", metavar="NAME")
    ],
    plate: Annotated[
        str, typer.Option(help="An offset plate of cell/plates, or a file.", metavar="NAME")
    ] = "plate_250",
    plc: Annotated[
        str | None,
        typer.Option(
            help="AMS address of the PLC that reads the encoders.", metavar="NETID[:PORT][@HOST]"
        ),
    ] = None,
    egm: Annotated[
        str | None,
        typer.Option(
            help="Where to hear the robot's EGM feedback; a port alone is this machine only.",
            metavar="[ADDRESS:]PORT",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Seconds after the first record; default until Ctrl-C.", min=0.1),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Show the angles in a rerun window as they come.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Record live: encoders from a TwinCAT PLC over ADS, robot axes from ABB EGM, into a recording that can be read at any moment.

    The PLC runs the program of docs/recorder.md. Waits for the devices, starts a new file when one was away, ends with Ctrl-C.
    Exits with 1 when the disk is full, or a device delivered nothing.
    """
    from ballbar.record.show import RecordOptions, record_data, say, silent
    from ballbar.record.show import record as record_live

    options = RecordOptions(
        plc=plc, egm=egm, robot=robot, ballbar=ballbar, plate=plate, duration=duration, live=live
    )
    recording = record_live(folder, options, err if as_json else out)
    if as_json:
        say_json(record_data(folder, recording))
    say(out, folder, recording)
    raise typer.Exit(1 if silent(recording) else 0)


@commands.command(
    rich_help_panel=AT_THE_CELL,
    epilog="Example: `ballbar new runs/monday robot.csv ballbar.csv`, and answer what it asks",
)
def new(
    folder: Annotated[Path, typer.Argument(help="The recording folder to make.", metavar="DIR")],
    robot_log: Annotated[
        Path,
        typer.Argument(help="The robot's log.", metavar="ROBOTLOG", exists=True, dir_okay=False),
    ],
    ballbar_log: Annotated[
        Path,
        typer.Argument(
            help="The ball-bar's log.", metavar="BALLBARLOG", exists=True, dir_okay=False
        ),
    ],
    robot: Annotated[str | None, typer.Option(help="Robot, by name or .yaml file.")] = None,
    ballbar: Annotated[str | None, typer.Option(help="Ball-bar, by name or .yaml file.")] = None,
    robot_dialect: Annotated[
        str | None, typer.Option(help="Dialect of the robot's log, or a .yaml file of your own.")
    ] = None,
    ballbar_dialect: Annotated[
        str | None, typer.Option(help="Dialect of the ball-bar's log, or a .yaml file.")
    ] = None,
    robot_time: Annotated[
        str | None,
        typer.Option(help=f"Its time stamps, if they do not show it: {', '.join(TIME_FORMS)}."),
    ] = None,
    ballbar_time: Annotated[str | None, typer.Option(help="Likewise.")] = None,
    encoder: Annotated[
        list[str] | None,
        typer.Option(help="Counter column of an encoder; repeat.", metavar="b1=COLUMN[:-1]"),
    ] = None,
    lines: Annotated[int | None, typer.Option(help="Lines of the encoders a turn.", min=1)] = None,
    bits: Annotated[
        int | None, typer.Option(help="Bits of their interpolation.", min=8, max=13)
    ] = None,
    yes: Annotated[
        bool,
        typer.Option(
            "--yes", help="Take what is proposed without asking; fail where nothing can be."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make a recording folder from two log files: what they show is proposed, what they cannot show is asked.

    The folder appears only once it has been read without error.
    """
    from ballbar.recordings import check as check_page
    from ballbar.recordings.new_recording import Told, new_recording

    told = Told(
        robot,
        ballbar,
        robot_dialect,
        ballbar_dialect,
        robot_time,
        ballbar_time,
        tuple(encoder or ()),
        lines,
        bits,
    )
    read = new_recording(
        folder, robot_log, ballbar_log, told, partial(_answer, proposals_taken=yes, apart=as_json)
    )
    if as_json:
        say_json({"recording": str(folder), **check_page.check_data(read, None)})
    _say_page(check_page.check_lines(read, None))
    out.print(
        f"Made {escape(str(folder))}. Look at recording.yaml in it, then: ballbar check {escape(str(folder))}"
    )


def _answer(question: str, proposal: str | None, *, proposals_taken: bool, apart: bool) -> str:
    """What the user answers, or the proposal; apart : from the standard output, which is for JSON."""
    if proposals_taken and proposal is not None:
        (err if apart else out).print(f"{escape(question)} [bold]{escape(proposal)}[/]")
        return proposal
    if proposals_taken or not sys.stdin.isatty():
        raise InputError(
            f"not told: {question}{f' Proposed: {proposal}; --yes takes it.' * bool(proposal)} Nothing was written."
        )
    return str(typer.prompt(question, default=proposal, err=apart))


@commands.command(
    rich_help_panel=AT_THE_CELL,
    epilog="Example: `ballbar check runs/irb2400/recording`, or for programs `ballbar check runs/irb2400/recording --json`",
)
def check(
    recording: RecordingFolder,
    explain_reading: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Say first how each file will be read, and why: dialect, columns, time, units, encoders.",
        ),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit with 1 if anything had to be repaired or left out."),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the import report as JSON.")
    ] = False,
) -> None:
    """Read a recording and report what was found and repaired, without identifying anything."""
    from acquisition import explain_lines, read_recording
    from ballbar.recordings import check as check_page

    if explain_reading and not as_json:
        for line in explain_lines(recording):
            out.print(escape(line))
        out.print()
    read = read_recording(recording)
    alignment = check_page.aligned(read)
    if as_json:
        typer.echo(json.dumps(check_page.check_data(read, alignment), indent=2))
    else:
        _say_page(check_page.check_lines(read, alignment))
    if strict and (repaired := check_page.repairs(read)):
        err.print(
            f"[red]not as logged:[/] {len(repaired)} kinds of repairs were needed, and --strict allows none"
        )
        raise typer.Exit(1)


def _say_page(lines: list[str]) -> None:
    """The page of a recording, its headings bold."""
    for line in lines:
        out.print(f"[bold]{escape(line)}[/]" if line[0] != " " else escape(line))
