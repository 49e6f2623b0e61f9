"""Commands for descriptions of robots: `ballbar robot new` and `show`."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.commands.listing import AT_THE_CELL
from ballbar.commands.options import AsJson, command, say_json
from ballbar.terminal import out

if TYPE_CHECKING:
    from ballbar.robot_file.new_robot import NewRobot

group = typer.Typer(name="robot", no_args_is_help=True)
commands = typer.Typer()
commands.add_typer(group)


@group.callback()
def robot() -> None:
    """Describe a robot: from a URDF or a table of DH rows; look at it."""


@command(group, AT_THE_CELL)
def new(
    name: str,
    *,
    urdf: Path | None = None,
    base: str | None = None,
    tip: str | None = None,
    dh: Path | None = None,
    out_file: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Write the description of a robot from its URDF or from a table of DH rows.

    Standard DH rows, limits, and where the source has them speeds and masses. What was written is
    compared with the source at 100 random poses; a difference above 1e-9 m or rad is refused. A
    picture is drawn beside the file. The robot is then used by its file, `--robot NAME.yaml`.

    Example: `ballbar robot new my_robot --urdf my_robot.urdf --tip tool0`

    NAME : Name of the robot.
    --urdf FILE : URDF of the robot, xacro expanded.
    --base LINK : Link of the URDF that is the base; its root if none.
    --tip LINK : Link of the URDF that is the flange; the end of its longest chain of turning joints
        if none.
    --dh FILE : Table of DH rows, CSV or YAML: a_mm, d_mm, alpha_deg, theta_deg or in m and rad;
        standard, or `convention: modified`.
    --out FILE : File to write; NAME.yaml if none. It must not exist.
    """
    from ballbar.robot_file.dh_table import draft_from_table
    from ballbar.robot_file.draft import draft_from_urdf
    from ballbar.robot_file.new_robot import target_file, write_robot

    file = target_file(name, out_file)
    if urdf is not None and dh is None:
        draft = draft_from_urdf(name, urdf, base, tip)
    elif dh is not None and urdf is None and base is None and tip is None:
        draft = draft_from_table(name, dh)
    else:
        raise InputError(
            "name one source: --urdf FILE, with --base and --tip where needed, or --dh FILE."
        )
    written = write_robot(draft, file)
    if as_json:
        say_json(_data(written))
    _say(written)


@command(group, AT_THE_CELL)
def show(name: str, web: bool = False, save: Path | None = None) -> None:
    """Show the DH rows and frames of a robot in the rerun viewer; each axis moves once.

    Example: `ballbar robot show panda`, or `ballbar robot show my_robot.yaml --web`

    NAME : Robot of cell/robots, or a .yaml file.
    --web : Serve it to a browser on this machine (loopback only).
    --save FILE : Write the .rrd file instead of opening it.
    """
    from ballbar.cell.files import write_new
    from ballbar.cell.load import load_robot
    from ballbar.replay.viewer import open_viewer, serve_web
    from ballbar.robot_file.view import write_view

    described = load_robot(name)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{described.name}.rrd"
        write_view(described, file)
        if save is not None:
            write_new(save, file.read_bytes())
            out.print(f"Wrote {escape(str(save))}")
        elif web:
            serve_web(file, show=lambda text: out.print(escape(text)))
        else:
            open_viewer(file)


def _say(written: NewRobot) -> None:
    """Prints the check, the poses outside the rows, what is missing, and the written files."""
    from ballbar.robot_file.new_robot import POSES
    from ballbar.robot_file.text import is_identity, missing, transform_lines

    draft, form = written.draft, written.draft.form
    out.print(escape(f"{draft.title}: {draft.source}"))
    out.print(
        f"Check: largest difference to the source at {POSES} random poses "
        f"{written.position:.2g} m, {written.angle:.2g} rad"
    )
    for text, pose in (
        ("The source's base is not the frame of row 1. T_base_dh:", form.T_base_dh),
        ("The source's tip is not the frame of the last row. T_flange_tip:", form.T_flange_tip),
    ):
        if not is_identity(pose):
            out.print(f"{text} rotation and m; it stands in the file as a comment, and is not used")
            for line in transform_lines(pose):
                out.print(escape(f"  {line}"))
    out.print("Missing, and what it is needed for:")
    for key, use in missing(draft):
        out.print(escape(f"  {key}: {use}"))
    file = escape(str(written.file))
    out.print(
        f"Wrote {file} and {escape(written.picture.name)}. Look at it: ballbar robot show {file}"
    )


def _data(written: NewRobot) -> dict[str, object]:
    from ballbar.robot_file.text import missing

    form = written.draft.form
    return {
        "file": str(written.file),
        "picture": str(written.picture),
        "axes": written.robot.joints,
        "largest_difference_m": written.position,
        "largest_difference_rad": written.angle,
        "T_base_dh": form.T_base_dh.tolist(),
        "T_flange_tip": form.T_flange_tip.tolist(),
        "missing": [key for key, _ in missing(written.draft)],
    }
