"""Output folders: one writer at a time, what a power cut left, a full disk, results that move."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.files import (
    beside,
    claimed_folder,
    copied_description,
    new_folder,
    require_writable,
    write_whole,
)
from ballbar.cell.geometry import Geometry
from ballbar.export.result import load_result
from tests.helpers.calibrations import write_calibration_of

ROBOT = Path(__file__).parents[2] / "cell" / "robots" / "irb2400.yaml"
SECOND = (
    "import sys; from pathlib import Path; from cell.files import claimed_folder\n"
    "with claimed_folder(Path(sys.argv[1]), {'a'}, 'the result'): pass\n"
)


def second_writer(folder: Path) -> str:
    """The message of another process that claims the folder."""
    command = [sys.executable, "-c", SECOND, str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


@pytest.mark.slow
def test_two_processes_never_write_to_one_folder(tmp_path: Path) -> None:
    """One of two `identify` died of the other's unfinished file."""
    folder = tmp_path / "out"
    with claimed_folder(folder, {"a"}, "the result"):
        write_whole(folder / "a", b"first")
        (folder / ".a.part").touch()
        assert "another process writes to this folder" in second_writer(folder)
        assert (folder / ".a.part").exists(), "what the first is writing stays"
    assert second_writer(folder) == ""


def test_what_a_power_cut_left_is_cleaned_up_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / ".a.part").write_bytes(b"half")
    with claimed_folder(tmp_path, {"a", "b"}, "the result"):
        assert not list(tmp_path.iterdir())
    for foreign in (".mine.part", "mine"):
        (tmp_path / foreign).touch()
        (tmp_path / ".a.part").touch()
        with (
            pytest.raises(InputError, match="holds something else"),
            claimed_folder(tmp_path, {"a"}, "the result"),
        ):
            pass
        assert (tmp_path / ".a.part").exists()
        (tmp_path / foreign).unlink()


def test_what_stands_beside_a_folder_has_its_name_where_it_is_called_dot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "monday" / "raw").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "monday" / "raw")
    assert beside(Path(), "-identified") == tmp_path / "monday" / "raw-identified"
    assert beside(Path(".."), "-identified") == tmp_path / "monday-identified"
    assert beside(Path("a/b"), ".truth.yaml") == Path("a/b.truth.yaml")


def test_a_refused_command_leaves_no_folder_behind(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="wrong"),
        claimed_folder(tmp_path / "new", {"a"}, "the result"),
    ):
        raise InputError("wrong")
    assert not (tmp_path / "new").exists()


def test_a_full_disk_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_whole(tmp_path / "report.html", b"page")
    assert caught.value.filename == str(tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_new_folder_appears_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new, left = tmp_path / "a" / "new", tmp_path / "a" / ".new.part"
    left.mkdir(parents=True)  # by a power cut
    (left / "old").write_text("old")

    def fail() -> None:
        with new_folder(new) as aside:
            (aside / "file").write_text("half")
            raise InputError("wrong")

    with pytest.raises(InputError, match="wrong"):
        fail()
    assert not list((tmp_path / "a").iterdir())
    with new_folder(new) as aside:
        (aside / "file").write_text("whole")
        assert not new.exists()
    assert [path.name for path in new.iterdir()] == ["file"]
    with pytest.raises(InputError, match="holds something"), new_folder(new):
        pass
    (new / "file").unlink()
    monkeypatch.chdir(new)
    with pytest.raises(InputError, match="you are in this folder"), new_folder(Path()):
        pass


def test_a_folder_below_a_file_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is no folder"):
        require_writable(tmp_path / "file" / "below")
    require_writable(tmp_path / "new" / "below")


def test_a_result_carries_the_descriptions_it_names(tmp_path: Path, nominal: Geometry) -> None:
    """A calibration that named its robot from the recording could be exported from there alone."""
    own = tmp_path / "recording" / "mine.yaml"
    write_whole(own, ROBOT.read_bytes())
    folder, moved = tmp_path / "result", tmp_path / "elsewhere" / "moved"
    folder.mkdir()
    name = copied_description(folder, "robot", own)
    write_calibration_of(folder / "calibration.yaml", nominal, nominal, robot=name)
    moved.parent.mkdir()
    folder.rename(moved)
    own.unlink()
    assert load_result(moved).robot.name == "mine"
