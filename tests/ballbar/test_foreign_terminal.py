"""Names in files cannot steer the terminal: its title, its colours, what stands on it."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest
from rich.table import Table
from rich.text import Text

from ballbar.cell.errors import DescriptionError
from ballbar.cell.files import write_yaml
from ballbar.cell.foreign_text import printable
from ballbar.cell.strict_yaml import load_yaml
from ballbar.commands import cli
from ballbar.result.identify import names_of_places
from ballbar.terminal import PlainConsole, wide_console
from tests.helpers.command_line import ballbar
from tests.helpers.device_logs import robot_lines, write

TITLE = "\x1b]0;owned\x07\x1b[2J\x9b2J\u202e"


def test_control_characters_of_any_renderable_are_shown_as_escapes() -> None:
    file = io.StringIO()
    console = PlainConsole(file=file, force_terminal=True, width=200)
    table = Table(title=f"a{TITLE}")
    table.add_column(f"b{TITLE}")
    table.add_row(Text(f"c{TITLE}", style="red"))
    for text in (f"[bold]d{TITLE}[/]", table):
        console.print(text)
        wide_console(console, 80).print(text)
    shown = file.getvalue()
    assert "\\x1b]0;owned" in shown
    assert "\x1b[1m" in shown, "our own colours stay"
    assert not any(sign in shown for sign in ("\x1b]", "\x1b[2J", "\x9b", "\x07", "\u202e"))


@pytest.mark.parametrize("strange", ["column", "folder"])
def test_names_of_a_recording_are_printed_harmless(tmp_path: Path, strange: str) -> None:
    robot, folder = robot_lines(), tmp_path / (f"a{TITLE}" if strange == "folder" else "a")
    folder.mkdir()
    if strange == "column":
        robot[0] = robot[0].replace("m1", TITLE)
        write(folder, robot=robot)
    code, out, err = ballbar("check", folder)
    assert code == 2
    assert "owned" in err
    assert not any(sign in out + err for sign in "\x1b\x07\x9b\u202e")


def test_a_wrong_argument_is_printed_harmless(tmp_path: Path) -> None:
    code, out, err = ballbar("check", tmp_path, f"more{TITLE}")
    assert code == 2
    assert "more" in err
    assert not any(sign in out + err for sign in "\x07\x9b\u202e")


def test_a_description_with_control_characters_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(f"a: 1\nb: {json.dumps(TITLE)}\n")
    with pytest.raises(DescriptionError, match=r"a\.yaml:2: .*control or invisible"):
        load_yaml(file)
    write_yaml(file, {"name": [TITLE]})
    assert load_yaml(file).data["name"][0].startswith("\\x1b]0;owned")


def test_the_name_of_a_recording_can_be_written_wherever_it_stands(tmp_path: Path) -> None:
    """Under a locale that is not UTF-8, ü is two characters that UTF-8 cannot hold."""
    (name,) = names_of_places([tmp_path / f"Gr\udcc3\udcbcn{TITLE}"])
    assert name == f"Gr\\udcc3\\udcbcn{printable(TITLE)}"


def test_a_locale_without_the_characters_prints_their_escapes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(sys, "argv", ["ballbar", "check", str(tmp_path / "Grün")])
    with pytest.raises(SystemExit, match="2"):
        cli.main()
    stream.seek(0)
    assert "Gr\\xfcn: no such folder" in stream.read()
