"""Output files appear whole or not at all, and in folders that can hold them."""

from __future__ import annotations

from pathlib import Path

import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.files import (
    aside_of,
    require_writable,
    write_new,
    write_new_together,
    written_whole,
)


def test_a_folder_below_a_file_cannot_be_made(tmp_path: Path) -> None:
    """The nearest place that exists decides, however deep the folder is."""
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match=rf"{tmp_path}/taken: is no folder, so .*taken/a/b cannot"):
        require_writable(tmp_path / "taken" / "a" / "b")
    require_writable(tmp_path / "new" / "a" / "b")
    assert not (tmp_path / "new").exists()


def test_a_file_that_fails_while_written_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "result.yaml"
    path.write_text("earlier")

    def fail() -> None:
        with written_whole(path) as aside:
            aside.write_text("half")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert path.read_text() == "earlier"
    assert not aside_of(path).exists()


def test_files_that_belong_together_are_written_all_or_none(tmp_path: Path) -> None:
    first, second = tmp_path / "sub" / "a", tmp_path / "b"
    write_new(second, b"earlier")
    with pytest.raises(InputError, match="exists already; nothing was written"):
        write_new_together({first: b"1", second: b"2"})
    assert not first.exists()
    assert second.read_bytes() == b"earlier"
    second.unlink()
    write_new_together({first: b"1", second: b"2"})
    assert (first.read_bytes(), second.read_bytes()) == (b"1", b"2")
