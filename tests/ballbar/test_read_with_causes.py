"""A robot's log that its reader refuses is compared with the whole cell, and its mistake named."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.recording import read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.recordings.read_with_causes import read_with_causes
from tests.helpers.simulated_recordings import Recorded


def changed(recorded: Recorded, folder: Path, change: Callable[[Array], Array]) -> Path:
    """A copy of the recording with other motor angles."""
    shutil.copytree(recorded.folder, folder)
    file = folder / "raw" / "robot.csv"
    header, *rows = file.read_text().splitlines()
    stamps = [row.split(",", maxsplit=1)[0] for row in rows]
    motors = change(np.array([row.split(",")[1:] for row in rows], dtype=float))
    lines = (
        ",".join([stamp, *(f"{angle:.9f}" for angle in row)])
        for stamp, row in zip(stamps, motors, strict=True)
    )
    file.write_text("\n".join([header, *lines, ""]))
    return folder


def declared(recorded: Recorded, folder: Path, robot: str) -> Path:
    """A copy of the recording that names another robot."""
    shutil.copytree(recorded.folder, folder)
    file = folder / "recording.yaml"
    file.write_text(file.read_text().replace("robot: irb2400", f"robot: {robot}"))
    return folder


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        pytest.param(
            np.rad2deg,
            "the robot's log is in degrees and was read as rad: once corrected, ",
            marks=pytest.mark.slow,
        ),
        (
            lambda motors: motors[:, [0, 1, 2, 3, 5, 4]],
            "the columns of motors 5 and 6 of the robot's log are exchanged: once corrected, ",
        ),
    ],
    ids=["degrees", "motors 5 and 6"],
)
def test_a_unit_or_two_columns_are_named_in_place_of_the_question(
    recorded: Recorded, tmp_path: Path, change: Callable[[Array], Array], cause: str
) -> None:
    folder = changed(recorded, tmp_path / "copy", change)
    with pytest.raises(LogError) as refused:
        read_with_causes(folder)
    words = str(refused.value)
    assert words.startswith(cause)
    assert words.endswith("deg.)")  # what the reader says of the first row
    assert "?" not in words


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["irb4600", pytest.param("kr210", marks=pytest.mark.long)])
def test_another_robot_is_named_and_not_another_unit(
    recorded: Recorded, tmp_path: Path, robot: str
) -> None:
    with pytest.raises(LogError) as refused:
        read_with_causes(declared(recorded, tmp_path / "copy", robot))
    words = str(refused.value)
    assert words.startswith(f"this is not the log of robot {robot} with plate plate_250: ")
    assert "egrees where" not in words


def test_what_nothing_explains_keeps_the_question_of_the_reader(
    recorded: Recorded, tmp_path: Path
) -> None:
    """A file without encoders that can be read has nothing to compare the robot with."""
    folder = changed(recorded, tmp_path / "copy", np.rad2deg)
    (folder / "raw" / "ballbar.csv").write_text("")
    with pytest.raises(LogError, match="Degrees where radians are declared") as plain:
        read_recording(folder)
    with pytest.raises(LogError) as refused:
        read_with_causes(folder)
    assert str(refused.value) == str(plain.value)


def test_a_refusal_goes_from_one_process_to_another_as_it_is(
    recorded: Recorded, tmp_path: Path
) -> None:
    folder = changed(recorded, tmp_path / "copy", np.rad2deg)
    with pytest.raises(LogError) as refused:
        read_recording(folder)
    assert str(pickle.loads(pickle.dumps(refused.value))) == str(refused.value)


def test_a_sound_recording_is_read_as_it_is(recorded: Recorded) -> None:
    plain, read = read_recording(recorded.folder), read_with_causes(recorded.folder)
    np.testing.assert_array_equal(read.robot_log.q, plain.robot_log.q)
