"""Commands for a camera: `ballbar camera board` and `detect`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import typer
from rich.markup import escape

from ballbar.cell.errors import FailureError, InputError
from ballbar.commands.listing import AT_THE_CELL
from ballbar.commands.options import AsJson, Out, command, say_json
from ballbar.terminal import out

group = typer.Typer(name="camera", no_args_is_help=True)
commands = typer.Typer()
commands.add_typer(group)


@group.callback()
def camera() -> None:
    """Print a board, and find its corners in pictures."""


@command(group, AT_THE_CELL)
def board(
    *,
    out_file: Path = Path("board.pdf"),
    kind: Literal["charuco", "checkerboard"] = "charuco",
    squares: str = "9x7",
    square_mm: float | None = None,
    paper: Literal["A5", "A4", "A3", "A2", "A1"] = "A4",
) -> None:
    """Draw a board to print at its true size, and write its description.

    Measure the print, and write what you measured to the description: all lengths of the result
    have its scale. Of a ChArUco board a part is enough; a checkerboard must be seen whole.

    Example: `ballbar camera board --out board.pdf`

    --out FILE : PDF to write; the description has its name with .yaml. Neither may exist.
    --kind KIND : With markers (charuco) or without (checkerboard).
    --squares NxM : Squares in a row and in a column.
    --square-mm MM : Side of a square; the largest whole number that fits if none.
    --paper PAPER : Size of the paper, across.
    """
    from ballbar.camera.print_board import write_board

    match = re.fullmatch(r"(\d{1,3})\s*[x,]\s*(\d{1,3})", squares)
    if match is None:
        raise InputError(f"--squares {squares}: expected two whole numbers such as 9x7.")
    size = int(match[1]), int(match[2])
    description, _ = write_board(out_file, kind, size, square_mm, paper)
    out.print(
        f"Wrote {escape(str(out_file))} and {escape(str(description))}. Print at 100 %, measure "
        "a whole row of squares, and correct square_m and sigma_m."
    )


@command(group, AT_THE_CELL)
def detect(
    images: list[Path], *, board: Path, joints: Path, out_dir: Out = None, as_json: AsJson = False
) -> None:
    """Find the corners of a board in pictures, and name the pictures that show none.

    Writes corners.csv, copies of board and joint angles, and contact_sheet.png, which shows what
    was found. Exits with 1 where less than half of the pictures can be used.

    Example: `ballbar camera detect pictures --board board.yaml --joints joints.csv --out found`

    IMAGES : Pictures, or folders of pictures.
    --board FILE : Description of the board, as `ballbar camera board` writes it.
    --joints FILE : Table of the joint angles; its column `image` names the picture of each row.
    """
    from ballbar.camera.corner_files import CORNERS, SHEET, write_corners

    folder = out_dir or Path("corners")
    pictures = write_corners(folder, images, board, joints)
    used = [picture for picture in pictures if picture.used]
    if as_json:
        unused = {p.name: p.unused for p in pictures if not p.used}
        corners = {p.name: len(p.numbers) for p in used}
        say_json({"folder": str(folder), "corners": corners, "unused": unused})
    for picture in pictures:
        if not picture.used:
            out.print(escape(f"{picture.name}: {picture.unused}"))
    total = sum(len(picture.numbers) for picture in used)
    out.print(
        f"{total} corners in {len(used)} of {len(pictures)} pictures: "
        f"{escape(str(folder / CORNERS))}. Look at {escape(str(folder / SHEET))}."
    )
    if 2 * len(used) < len(pictures):
        raise FailureError(f"only {len(used)} of {len(pictures)} pictures can be used.")
