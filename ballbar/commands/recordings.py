"""Commands that make and check recordings: `ballbar new`, `check` and `align`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.markup import escape

from acquisition.times import TIME_FORMS
from ballbar.commands.options import AsJson, RecordingOrPoses, say_json
from ballbar.terminal import err, out, progress_bar
from cell.errors import InputError
from cell.foreign_text import printable
from cell.logs import SourceName

commands = typer.Typer()
_POSES = "Options of still poses"


@commands.command(
    epilog="Example: `ballbar new runs/monday robot.csv ballbar.csv`, and answer the questions; of "
    "still poses: `ballbar new runs/tracker --poses poses.csv --robot ur10`"
)
def new(
    folder: Annotated[Path, typer.Argument(help="Recording folder to make.", metavar="DIR")],
    robot_log: Annotated[
        Path | None,
        typer.Argument(help="The robot's log.", metavar="ROBOTLOG", exists=True, dir_okay=False),
    ] = None,
    ballbar_log: Annotated[
        Path | None,
        typer.Argument(
            help="The log of the ball-bar, or of an instrument of a length.",
            metavar="BALLBARLOG",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    poses: Annotated[
        list[Path] | None,
        typer.Option(
            help="A table of still poses, or a folder of tables, instead of two logs; may be "
            "repeated for files of the same columns.",
            metavar="TABLE",
            exists=True,
        ),
    ] = None,
    robot: Annotated[str | None, typer.Option(help="Robot, by name or .yaml file.")] = None,
    ballbar: Annotated[str | None, typer.Option(help="Ball-bar, by name or .yaml file.")] = None,
    robot_dialect: Annotated[
        str | None, typer.Option(help="Dialect of the robot's log, or a .yaml file of your own.")
    ] = None,
    ballbar_dialect: Annotated[
        str | None, typer.Option(help="Dialect of the second log, or a .yaml file.")
    ] = None,
    robot_time: Annotated[
        str | None,
        typer.Option(
            help="Form of the robot log's time stamps, if they do not show it: "
            f"{', '.join(TIME_FORMS)}."
        ),
    ] = None,
    ballbar_time: Annotated[
        str | None, typer.Option(help="Form of the second log's time stamps, likewise.")
    ] = None,
    encoder: Annotated[
        list[str] | None,
        typer.Option(
            help="Counter column of an encoder, with :-1 if it counts in the other direction; may "
            "be repeated.",
            metavar="b1=COLUMN[:-1]",
        ),
    ] = None,
    lines: Annotated[
        int | None, typer.Option(help="Lines of the encoders per turn.", min=1)
    ] = None,
    bits: Annotated[
        int | None, typer.Option(help="Bits of the encoders' interpolation.", min=8, max=13)
    ] = None,
    instrument: Annotated[
        str | None,
        typer.Option(
            help="Instrument of cell/instruments, or a .yaml file: of poses, or of a log of "
            "lengths in place of a ball-bar's."
        ),
    ] = None,
    column: Annotated[
        str | None, typer.Option(help="Column of a log of lengths that holds the length.")
    ] = None,
    unit: Annotated[
        Literal["m", "mm", "um"] | None, typer.Option(help="Unit of that column.")
    ] = None,
    zero: Annotated[
        float | None, typer.Option(help="Length where that column shows zero, in m.")
    ] = None,
    damaged_rows: Annotated[
        int | None,
        typer.Option(
            help="Leave out up to so many rows of each log in which a cell is no number, and "
            "report them; without it such a log is refused.",
            min=1,
        ),
    ] = None,
    joints: Annotated[
        str | None,
        typer.Option(
            help="Columns of the joint angles, in the order of the axes, by name or number.",
            metavar="COLUMN,...",
            rich_help_panel=_POSES,
        ),
    ] = None,
    joint_unit: Annotated[
        str | None, typer.Option(help="rad or deg.", rich_help_panel=_POSES)
    ] = None,
    values: Annotated[
        str | None,
        typer.Option(
            help="Columns of what was measured: a length, x y z, or x y z and a rotation; "
            "'x_t - x_dif' is a difference.",
            metavar="COLUMN,...",
            rich_help_panel=_POSES,
        ),
    ] = None,
    value_unit: Annotated[
        str | None, typer.Option(help="m, cm, mm, um or inch.", rich_help_panel=_POSES)
    ] = None,
    rotation: Annotated[
        str | None,
        typer.Option(
            help="Convention of rotations: XYZ and the like about moving axes, xyz about fixed "
            "ones, rotvec, quat_wxyz, quat_xyzw.",
            rich_help_panel=_POSES,
        ),
    ] = None,
    angle_unit: Annotated[
        str | None, typer.Option(help="Of rotations: rad or deg.", rich_help_panel=_POSES)
    ] = None,
    seat: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of the instrument's placement: once for all files of poses, or once for "
            "each in their order; without it the files show it, or it is asked for.",
            metavar="NAME",
            rich_help_panel=_POSES,
        ),
    ] = None,
    target: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of the ball or reflector on the flange, likewise.",
            metavar="NAME",
            rich_help_panel=_POSES,
        ),
    ] = None,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="Take every proposal without asking; fail where there is none."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make a recording folder from two log files, or poses.yaml from tables of still poses.

    What the files show is proposed; what they cannot show is asked for. Of several tables that is
    also the seat and the target of each. The folder appears only once it has been read without
    error.
    """
    ask = partial(_ask, take_proposals=yes, as_json=as_json)
    if poses:
        if robot_log is not None:
            raise InputError("give either --poses or two logs, not both.")
        _new_poses(
            folder,
            poses,
            {
                "robot": robot,
                "instrument": instrument,
                "joints": joints,
                "joint_unit": joint_unit,
                "values": values,
                "value_unit": value_unit,
                "rotation": rotation,
                "angle_unit": angle_unit,
                "seat": seat or (),
                "target": target or (),
            },
            ask,
            as_json=as_json,
        )
        return
    if robot_log is None or ballbar_log is None:
        raise InputError(
            "name the robot's log and that of the ball-bar or instrument, or a table of still "
            "poses with --poses."
        )
    from ballbar.recordings.check import check_data, check_lines
    from ballbar.recordings.new_recording import Answers, new_recording

    answers = Answers(
        robot=robot,
        ballbar=ballbar,
        robot_dialect=robot_dialect,
        ballbar_dialect=ballbar_dialect,
        robot_time=robot_time,
        ballbar_time=ballbar_time,
        encoders=tuple(encoder or ()),
        lines=lines,
        bits=bits,
        instrument=instrument,
        column=column,
        unit=unit,
        zero=zero,
        damaged_rows=damaged_rows,
    )
    recording = new_recording(folder, robot_log, ballbar_log, answers, ask)
    if as_json:
        say_json({"recording": str(folder), **check_data(recording, None)})
    _say_page(check_lines(recording, None))
    name = escape(str(folder))
    out.print(f"Made {name}. Look at recording.yaml in it, then: ballbar check {name}")


def _new_poses(
    folder: Path,
    tables: list[Path],
    given: dict[str, Any],
    ask: Callable[[str, str | None], str],
    *,
    as_json: bool,
) -> None:
    """Makes a folder with poses.yaml and prints what was written; given : options by name."""
    from ballbar.recordings.check_poses import pose_data, pose_lines
    from ballbar.recordings.new_poses import PoseAnswers, new_poses

    content, text = new_poses(folder, tables, PoseAnswers(**given), ask)
    if as_json:
        say_json({"poses_file": str(folder / "poses.yaml"), **pose_data(content)})
    _say_page(pose_lines(content))
    name = escape(str(folder))
    out.print(f"Wrote {name}/poses.yaml:")
    for line in text.splitlines():
        out.print(f"  {escape(line)}")
    out.print(f"Look at it, then: ballbar check {name}")


def _ask(question: str, proposal: str | None, *, take_proposals: bool, as_json: bool) -> str:
    """The user's answer to a question, or the proposal.

    as_json : standard output is for JSON, so the question goes to standard error.
    """
    if take_proposals and proposal is not None:
        (err if as_json else out).print(f"{escape(question)} [bold]{escape(proposal)}[/]")
        return proposal
    if take_proposals or not sys.stdin.isatty():
        hint = f" Proposed: {proposal}; --yes takes it." if proposal else ""
        raise InputError(
            f"no answer to: {question}{hint} Nothing was written. Answer at a terminal, or by the "
            "options of `ballbar new --help`."
        )
    hint = "" if proposal is None else f" [{printable(proposal)}]"
    text = f"{printable(question)}{hint}"
    return str(typer.prompt(text, default=proposal, show_default=False, err=as_json))


@commands.command(
    epilog="Example: `ballbar check runs/irb2400/recording`, or for programs with `--json`"
)
def check(
    recording: RecordingOrPoses,
    explain_reading: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Print first how each file will be read and why: dialect, columns, time, units, "
            "encoders.",
        ),
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with 1 if anything was repaired or left out.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Read a recording or a table of still poses, and report its content and what was repaired.

    Nothing is identified.
    """
    from ballbar.recordings.check_poses import holds_poses

    read = _check_poses if holds_poses(recording) else _check_recording
    repaired = read(recording, explain_reading=explain_reading and not as_json, as_json=as_json)
    if strict and repaired:
        err.print(
            f"[red]not as logged:[/] {repaired} kinds of repairs were needed, and --strict "
            "allows none"
        )
        raise typer.Exit(1)


def _check_recording(folder: Path, *, explain_reading: bool, as_json: bool) -> int:
    """Prints the page of a recording; gives how many kinds of repairs were needed."""
    from acquisition.explain import explain_lines
    from ballbar.recordings.check import aligned, check_data, check_lines, repairs
    from ballbar.recordings.read_with_causes import read_with_causes

    if explain_reading:
        _say_reasons(explain_lines(folder))
    with progress_bar() as progress:
        progress("reading the recording")
        content = read_with_causes(folder)
        progress("aligning the logs")
        alignment = aligned(content, folder)
    if as_json:
        say_json(check_data(content, alignment))
    _say_page(check_lines(content, alignment))
    return len(repairs(content.report))


def _check_poses(path: Path, *, explain_reading: bool, as_json: bool) -> int:
    """Prints the page of still poses; gives how many kinds of repairs were needed."""
    from acquisition.pose_tables import import_poses
    from ballbar.recordings.check import repairs
    from ballbar.recordings.check_poses import explain_pose_lines, pose_data, pose_lines
    from cell.pose_file import load_poses_file, pose_file_path

    if explain_reading:
        _say_reasons(explain_pose_lines(load_poses_file(pose_file_path(path))))
    with progress_bar() as progress:
        progress("reading the poses")
        content = import_poses(path)
    if as_json:
        say_json(pose_data(content))
    _say_page(pose_lines(content))
    return len(repairs(content.report))


def _say_reasons(lines: list[str]) -> None:
    for line in lines:
        out.print(escape(line))
    out.print()


_LOG = "A table with time stamps, or a recording folder."
_SOURCE = "Which log of recording folder {}; default the robot's."
_TIME = "Form of the time stamps of table {}, if neither they nor their column's name show it: "


@commands.command(
    epilog="Example: `ballbar align recorder.csv camera.csv --channel z=height --time-b ms`"
)
def align(
    log_a: Annotated[Path, typer.Argument(help=_LOG, metavar="A", exists=True)],
    log_b: Annotated[Path, typer.Argument(help=_LOG, metavar="B", exists=True)],
    channel: Annotated[
        list[str] | None,
        typer.Option(
            help="Channel of A and the channel of B that holds the same motion; may be repeated. "
            "Default: channels of the same name, or without any those that move alike.",
            metavar="a=b",
        ),
    ] = None,
    source_a: Annotated[SourceName | None, typer.Option(help=_SOURCE.format("A"))] = None,
    source_b: Annotated[SourceName | None, typer.Option(help=_SOURCE.format("B"))] = None,
    time_a: Annotated[
        str | None, typer.Option(help=_TIME.format("A") + ", ".join(TIME_FORMS) + ".")
    ] = None,
    time_b: Annotated[str | None, typer.Option(help=_TIME.format("B") + "likewise.")] = None,
    as_json: AsJson = False,
) -> None:
    """Clock offset and skew between two logs of one motion, whoever recorded them.

    Channels of both logs are compared with gain and zero of each pair free, so units and directions
    do not matter. Exits with 1 if no clock offset makes them agree, or several do.
    """
    from ballbar.recordings.align import align_data, align_lines, aligned_logs, parsed_pairs

    with progress_bar() as progress:
        progress("reading and aligning the logs")
        result = aligned_logs(
            (log_a, log_b),
            sources=(source_a, source_b),
            times=(time_a, time_b),
            pairs=parsed_pairs(channel or ()),
        )
    if as_json:
        say_json(align_data(*result))
    _say_page(align_lines(*result))


def _say_page(lines: list[str]) -> None:
    """Prints the page of a recording, headings in bold."""
    for line in lines:
        out.print(f"[bold]{escape(line)}[/]" if line[0] != " " else escape(line))
