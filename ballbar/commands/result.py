"""Commands for a result: `ballbar replay`, `export` and `correct`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.cell.files import write_new, write_whole
from ballbar.commands.options import AsJson, ResultFile, command, say_json
from ballbar.terminal import out, progress_bar

commands = typer.Typer()


def _formats() -> list[str]:
    """Values of --to, for completion."""
    from ballbar.export.formats import FORMATS

    return list(FORMATS)


@command(commands)
def replay(
    run_dir: Path,
    web: bool = False,
    port: Annotated[int | None, typer.Option(min=1, max=65535)] = None,
    save: Path | None = None,
    against: Path | None = None,
) -> None:
    """Open the replay of a run, or of two runs, in the rerun viewer.

    Example: `ballbar replay runs/irb2400 --web`, or `ballbar replay runs/irb2400 --against
    runs/nj220`

    RUN : Folder with run.rrd, or the file itself.
    --web : Serve the replay to a browser on this machine (loopback only).
    --port : Port of --web on this machine. Default: a free one.
    --save FILE : Write the replay file instead of opening it.
    --against RUN : Another run, shown beside this one.
    """
    from ballbar.replay.viewer import chosen_replay, open_viewer, serve_web

    if save is not None and save.exists():
        raise InputError(f"{save}: exists already; nothing was written. Name another file.")
    if port is not None and not web:
        raise InputError("--port is that of the web viewer; add --web.")
    with chosen_replay(run_dir, against) as file:
        if save is not None:
            write_whole(save, file.read_bytes())
            out.print(f"Saved {escape(str(save))}")
        elif web:
            serve_web(file, port=port)
        else:
            open_viewer(file)


@command(commands)
def export(
    result: ResultFile,
    to: Annotated[str | None, typer.Option(autocompletion=_formats)] = None,
    into: Path | None = None,
    joints: str = "",
    file: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Write the identified robot for other programs: URDF, MJCF, DH tables, screws, RAPID, JSON.

    Comments in each format state what it leaves out (gear compliance, backlash, ripple), the
    standard deviation of every parameter, and which parameters are nominal.

    Example: `ballbar export runs/irb2400 --to urdf --out irb2400.urdf`, or `ballbar export
    runs/irb2400 --to hayati`, or `ballbar export results/ur10 --into ur10.urdf --out
    ur10-identified.urdf`

    --to FORMAT : Robot model (urdf, mjcf), table (dh; mdh: Craig's DH; hayati; poe: screw axes),
        RAPID data (abb), kinematics of ur_description (ur-kinematics), poses of camera and board
        (hand-eye), everything (json), or the format of a plug-in.
    --into FILE : URDF or xacro of the robot: written again with the identified joint origins, all
        else as it is. Or joint offsets alone, the best that these can do: LeRobot's calibration
        (.json), robot_calibration's offsets (.yaml).
    --joints NAME,NAME : Turning joints of FILE from base to tip, if it has more than the robot.
    --out FILE : New file. Default: print to the terminal.
    """
    from ballbar.export.formats import export_summary, exported
    from ballbar.export.into_urdf import changed_lines, into_file
    from ballbar.export.joint_offsets import OFFSET_FILES, offsets_into
    from ballbar.export.result import load_result

    if (to is None) == (into is None):
        raise InputError("give either --to FORMAT or --into FILE.")
    if joints and into is None:
        raise InputError("--joints names joints of the file of --into; give both or none.")
    robot = load_result(result)
    ranges = robot.range_notes
    if into is not None:
        names = [name.strip() for name in joints.split(",") if name.strip()]
        if into.suffix in OFFSET_FILES:
            content, lines = offsets_into(robot, into, names)
        else:
            changed = into_file(robot, into, names)
            content, lines, ranges = changed.content, changed_lines(changed, robot), changed.ranges
    else:
        assert to is not None  # one of the two is given
        content = exported(robot, to).encode()
        lines = [f"Not in it: {'; '.join(robot.left_out)}", *ranges]
    if file is not None:
        write_new(file, content)
    if as_json:
        say_json(export_summary(robot, to or "into", content, file, ranges))
    elif file is None:
        typer.echo(content.decode(), nl=False)
    else:
        out.print(f"Wrote {escape(str(file))}")
        for line in lines:
            out.print(escape(line))


@command(commands)
def correct(
    path: Path,
    *,
    result: Path,
    file: Path | None = None,
    payload: list[str] | None = None,
    tool: list[str] | None = None,
    frame: list[str] | None = None,
    keep: list[str] | None = None,
    as_json: AsJson = False,
) -> None:
    """Correct targets planned with the nominal robot so that the identified robot reaches them.

    The correction accounts for geometry, and for what was identified of the gears: compliance under
    the robot's own weight and the payload, backlash, ripple. Other columns of a table are copied.
    Of a program everything but the numbers of the targets stays the same, byte for byte, and every
    target is corrected, or the program is refused with the line.

    Example: `ballbar correct targets.csv --with runs/irb2400 --out corrected.csv`, or `ballbar
    correct weld.mod --with runs/irb2400 --out weld-corrected.mod`

    PATH : CSV file with columns q1, q2, ... [rad, DH joints] or axis1_deg, axis2_deg, ...
        [controller], or a program: RAPID (.mod, .modx, .sys, .prg), KRL (.src with its .dat), PDL2
        (.pdl).
    --with RESULT : A calibration.yaml, or the folder that holds it.
    --out FILE : New file. Default: beside PATH, -corrected.
    --payload [TOOL=]KG[,X,Y,Z] : Mass [kg] of a program's tool and its centre in the flange's frame
        [mm]; repeatable.
    --tool [TOOL=]X,Y,Z,A,B,C : Frame of a tool that the program does not declare, in that of the
        flange [mm, deg; turns about z, y', x'']; repeatable.
    --frame [NAME=]X,Y,Z,A,B,C : The same for a work object or base, in the robot's base frame;
        repeatable.
    --keep NAME : Target of another file that stays as it is; repeatable.
    """
    from ballbar.compensation.frames import frame_options
    from ballbar.compensation.programs import correct_and_write_programs, is_program
    from ballbar.compensation.targets_file import correct_and_write_table
    from ballbar.export.result import load_result

    if not path.is_file():
        raise InputError.at(path, "no such file.", "Name a table of targets or a program.")
    stated = frame_options(tool or (), frame or (), payload or (), keep or ())
    robot, program = load_result(result), is_program(path)
    if not program and (tool or frame or payload or keep):
        raise InputError("--tool, --frame, --payload and --keep are for programs, not for tables.")
    new = file or path.with_name(f"{path.stem}-corrected{path.suffix}")
    with progress_bar() as progress:
        progress("correcting the targets")
        if program:
            data, lines = correct_and_write_programs(path, robot, new, stated)
        else:
            data, lines = correct_and_write_table(path, robot, new)
    if as_json:
        say_json(data)
    for line in lines:
        out.print(escape(line))
