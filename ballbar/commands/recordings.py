"""Commands that make and check recordings: `ballbar new`, `check` and `align`."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.cell.foreign_text import printable
from ballbar.cell.logs import SourceName
from ballbar.commands.options import AsJson, RecordingOrPoses, command, say_json, with_options
from ballbar.recordings.answers import Answers
from ballbar.terminal import err, out, progress_bar

if TYPE_CHECKING:
    from ballbar.recordings.check import CheckedPoses, CheckedRecording

commands = typer.Typer()


@command(commands)
@with_options(Answers)
def new(
    folder: Path,
    *,
    robot_log: Annotated[Path | None, typer.Argument(exists=True, dir_okay=False)] = None,
    ballbar_log: Annotated[Path | None, typer.Argument(exists=True, dir_okay=False)] = None,
    poses: Annotated[list[Path] | None, typer.Option(exists=True)] = None,
    options: Answers,
    yes: bool = False,
    as_json: AsJson = False,
) -> None:
    """Make a recording folder from two log files, or poses.yaml from tables of still poses.

    What the files show is proposed; what they cannot show is asked for. Of several tables that is
    also the seat and the target of each. The folder appears only once it has been read without
    error.

    Example: `ballbar new runs/monday robot.csv ballbar.csv`, and answer the questions; of still
    poses: `ballbar new runs/tracker --poses poses.csv --robot ur10`

    DIR : Recording folder to make.
    ROBOTLOG : The robot's log.
    BALLBARLOG : The log of the ball-bar, or of an instrument of a length or one that follows the
        tool; none where one table holds both and --instrument names it.
    --poses TABLE : A table of still poses, or a folder of tables of the same columns, instead of
        two logs; repeatable.
    --yes : Take every proposal without asking; fail where there is none.
    """
    if poses and robot_log is not None:
        raise InputError("give either --poses or two logs, not both.")
    shared = options.instrument is not None  # whose rows may stand in the robot's table
    if not poses and (robot_log is None or (ballbar_log is None and not shared)):
        raise InputError(
            "name the robot's log and that of the ball-bar or instrument, or a table of still "
            "poses with --poses."
        )
    options.refuse_others(poses=bool(poses))
    from ballbar.recordings.check import CheckedPoses, CheckedRecording
    from ballbar.recordings.new import new_poses, new_recording

    ask = partial(_ask, take_proposals=yes, as_json=as_json)
    name = escape(str(folder))
    checked: CheckedRecording | CheckedPoses
    if robot_log is not None:
        logs = robot_log, ballbar_log or robot_log  # one table may hold both
        checked = CheckedRecording(new_recording(folder, *logs, options, ask))
        made = {"recording": str(folder)}
        closing = [f"Made {name}. Look at recording.yaml in it, then: ballbar check {name}"]
    else:
        read, text = new_poses(folder, poses or (), options, ask)
        checked = CheckedPoses(read)
        made = {"poses_file": str(folder / "poses.yaml")}
        written = [f"  {escape(line)}" for line in text.splitlines()]
        closing = [f"Wrote {name}/poses.yaml:", *written]
        closing.append(f"Look at it, then: ballbar check {name}")
    if as_json:
        say_json({**made, **checked.data()})
    _say_page(checked.lines())
    for line in closing:
        out.print(line)


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


@command(commands)
def check(
    recording: RecordingOrPoses,
    explain_reading: bool = False,
    strict: bool = False,
    as_json: AsJson = False,
) -> None:
    """Read a recording or a table of still poses, and report its content and what was repaired.

    Nothing is identified.

    Example: `ballbar check runs/irb2400/recording`, or for programs with `--json`

    --explain : Print first how each file will be read and why: dialect, columns, time, units,
        encoders.
    --strict : Exit with 1 if anything was repaired or left out.
    """
    from ballbar.recordings.check import holds_poses, repairs

    poses = holds_poses(recording)
    if explain_reading and not as_json:
        for line in _reasons(recording, poses=poses):
            out.print(escape(line))
        out.print()
    checked = _checked(recording, poses=poses)
    if as_json:
        say_json(checked.data())
    _say_page(checked.lines())
    if strict and (repaired := len(repairs(checked.read.report))):
        err.print(
            f"[red]not as logged:[/] {repaired} kinds of repairs were needed, and --strict "
            "allows none"
        )
        raise typer.Exit(1)


def _reasons(path: Path, *, poses: bool) -> list[str]:
    """How each file of a recording, or of still poses, will be read and why."""
    from ballbar.acquisition.explain import explain_lines
    from ballbar.cell.pose_file import load_poses_file, pose_file_path
    from ballbar.recordings.check import explain_poses

    return explain_poses(load_poses_file(pose_file_path(path))) if poses else explain_lines(path)


def _checked(path: Path, *, poses: bool) -> CheckedRecording | CheckedPoses:
    """A recording and the coarse offset of its clocks, or still poses."""
    from ballbar.acquisition.pose_tables import import_poses
    from ballbar.recordings.check import CheckedPoses, CheckedRecording
    from ballbar.recordings.read_with_causes import aligned, read_with_causes

    with progress_bar() as progress:
        if poses:
            progress("reading the poses")
            return CheckedPoses(import_poses(path))
        progress("reading the recording")
        recording = read_with_causes(path)
        progress("aligning the logs")
        return CheckedRecording(recording, aligned(recording, path))


@command(commands)
def align(
    *,
    log_a: Annotated[Path, typer.Argument(exists=True)],
    log_b: Annotated[Path, typer.Argument(exists=True)],
    channel: list[str] | None = None,
    vector: list[str] | None = None,
    rotation: list[str] | None = None,
    source_a: SourceName | None = None,
    source_b: SourceName | None = None,
    time_a: Annotated[
        str | None,
        typer.Option(
            help="Form of table A's time stamps, if neither they nor their column's name show it; "
            "forms as of `ballbar new --robot-time`."
        ),
    ] = None,
    time_b: str | None = None,
    as_json: AsJson = False,
) -> None:
    """Clock offset and skew between two logs of one motion, of any recorders.

    Channels of both logs are compared with gain and zero of each pair free, so units and directions
    do not matter. Vectors, rotations and poses are compared with the rotation, shift and lever arm
    between their frames free, which are found too (hand-eye calibration). Exits with 1 if no clock
    offset makes them agree, or several do.

    Example: `ballbar align recorder.csv camera.csv --channel z=height --time-b ms`; of poses:
    `ballbar align arm.csv camera.csv --vector x,y,z=u,v,w --rotation qx,qy,qz,qw=rx,ry,rz,rw`

    A : A table with time stamps, or a recording folder.
    B : A table with time stamps, or a recording folder.
    --channel a=b : Channels of A and B that hold the same motion; repeatable. Default: vectors and
        rotations that the names show, then channels of the same name, or those that move in the
        same way.
    --vector x,y,z=u,v,w : Three coordinates of A, and those of B in a frame of its own; repeatable.
    --rotation x,y,z,w=x,y,z,w : A quaternion of A and one of B, in that order, or three angular
        rates of the body on one side. With --vector they are poses of one rigid body.
    --source-a : Log of recording folder A; default the robot's.
    --source-b : Log of recording folder B; default the robot's.
    --time-b : The same of table B.
    """
    from ballbar.recordings.align import align_data, align_lines, aligned_logs

    with progress_bar() as progress:
        progress("reading and aligning the logs")
        result = aligned_logs(
            (log_a, log_b),
            sources=(source_a, source_b),
            times=(time_a, time_b),
            channels=channel or (),
            vectors=vector or (),
            rotations=rotation or (),
        )
    if as_json:
        say_json(align_data(*result))
    _say_page(align_lines(*result))


def _say_page(lines: list[str]) -> None:
    """Prints the page of a recording, headings in bold."""
    for line in lines:
        out.print(f"[bold]{escape(line)}[/]" if line[0] != " " else escape(line))
