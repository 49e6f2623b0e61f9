"""`ballbar camera detect`: the files of corners that a folder of poses is made of."""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ballbar.acquisition.formats.table_file import pose_text
from ballbar.acquisition.table.quantities import read_rows
from ballbar.camera.contact_sheet import contact_sheet
from ballbar.camera.detect import Picture, detect
from ballbar.cell.board import load_board
from ballbar.cell.board_pattern import Pattern
from ballbar.cell.errors import InputError
from ballbar.cell.files import new_folder

CORNERS, BOARD, SHEET, JOINTS = "corners.csv", "board.yaml", "contact_sheet.png", "joints"
IMAGE = "image"  # column of the pictures' names in both tables


def write_corners(
    folder: Path, images: Sequence[Path], board: Path, joints: Path
) -> tuple[Picture, ...]:
    """Writes the folder, and reports what became of each picture.

    images : files, and folders of files. joints : table of the joint angles, whose column `image`
    names the picture of each row. Raises InputError where nothing could be used.
    """
    pattern = Pattern(load_board(board).file)
    known = _named(joints)
    pictures = [_with_joints(p, known) for p in detect(_files(images), pattern)]
    if not any(picture.used for picture in pictures):
        reasons = ", ".join(dict.fromkeys(str(picture.unused) for picture in pictures))
        raise InputError(f"none of {len(pictures)} pictures can be used: {reasons}.")
    with new_folder(folder) as aside:
        (aside / CORNERS).write_bytes(_table(pictures))
        (aside / SHEET).write_bytes(contact_sheet(pictures))
        shutil.copyfile(board, aside / BOARD)
        shutil.copyfile(joints, aside / f"{JOINTS}{''.join(joints.suffixes[-2:])}")
    return tuple(pictures)


def _files(images: Sequence[Path]) -> list[Path]:
    """The files of pictures and folders; of a folder those that are no hidden ones."""
    out = list[Path]()
    for image in images:
        if not image.is_dir():
            out.append(image)
            continue
        content = sorted(file for file in image.glob("[!.]*") if file.is_file())
        if not content:
            raise InputError.at(image, "this folder holds no files.", "Name that of the pictures.")
        out += content
    return out


def _named(joints: Path) -> set[str]:
    """Names of the pictures that have joint angles. Raises LogError without a column of names."""
    text, kind = pose_text(joints, joints.name)
    return set(read_rows(text, kind, [IMAGE], [IMAGE]).text(IMAGE))


def _with_joints(picture: Picture, known: set[str]) -> Picture:
    if picture.used and picture.name not in known:
        return replace(picture, unused="no row of joint angles names it")
    return picture


def _table(pictures: Sequence[Picture]) -> bytes:
    """The corners of the pictures that are used, a row each."""
    buffer = io.StringIO(newline="")
    rows = csv.writer(buffer)
    rows.writerow((IMAGE, "corner", "u", "v"))
    for picture in pictures:
        if picture.used:
            for number, (u, v) in zip(picture.numbers, picture.pixels, strict=True):
                rows.writerow((picture.name, int(number), f"{u:.4f}", f"{v:.4f}"))
    return buffer.getvalue().encode()
