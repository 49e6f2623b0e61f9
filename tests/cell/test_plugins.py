"""Tables that plug-ins extend: names without an import, and what is refused in which words."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ballbar.cell.errors import InputError
from ballbar.cell.plugins import PluginTable

OWN = {"dot": len}
Installed = Callable[..., None]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Installed:
    """Makes a distribution of one module with entry points of group `ballbar.marks`."""

    def install(package: str, code: str, *points: str) -> None:
        folder = tmp_path / f"{package}-2.1.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 2.1\n")
        (folder / "entry_points.txt").write_text("\n".join(["[ballbar.marks]", *points]))
        (tmp_path / f"{package}.py").write_text(code)
        monkeypatch.delitem(sys.modules, package, raising=False)
        monkeypatch.syspath_prepend(tmp_path)

    return install


def test_a_plugin_is_named_before_it_is_imported(installed: Installed) -> None:
    installed("pens", "def ink(): pass", "line = pens:ink")
    table = PluginTable("marks", OWN)
    assert list(table) == ["dot", "line"]
    assert "line" in table
    assert "pens" not in sys.modules
    assert table["line"].__name__ == "ink"
    assert table["dot"] is len


def test_without_plugins_a_table_is_its_own() -> None:
    table = PluginTable("nothing_has_this_group", OWN)
    assert dict(table) == OWN
    with pytest.raises(KeyError):
        table["line"]
    with pytest.raises(InputError, match="unknown mark; there are dot"):
        table.known("line", " mark")


@pytest.mark.parametrize(
    ("code", "point", "words"),
    [
        ("import nowhere_at_all", "line = pens:ink", "ModuleNotFoundError: No module named 'nowh"),
        ("", "line = pens:ink", "cannot be loaded (AttributeError"),
        ("ink = 3", "line = pens:ink", "is no entry of that name and group, but 3"),
        ("def ink(): pass\nink.name = 'dash'", "line = pens:ink", "is no entry of that name"),
        ("def ink(): pass", "dot = pens:ink", "has a name that ballbar itself uses"),
    ],
)
def test_a_plugin_at_fault_is_named_with_its_package(
    installed: Installed, code: str, point: str, words: str
) -> None:
    installed("pens", code, point)
    with pytest.raises(InputError) as refused:
        dict(PluginTable("marks", OWN))
    assert words in str(refused.value)
    assert "of package pens (ballbar.marks = pens:ink)" in str(refused.value)
    assert str(refused.value).endswith("or uninstall pens.")


def test_two_plugins_of_one_name_are_refused(installed: Installed) -> None:
    installed("pens", "def ink(): pass", "line = pens:ink")
    installed("inks", "def ink(): pass", "line = inks:ink")
    with pytest.raises(InputError, match=r"has a name that (pens|inks) uses; rename one of them"):
        list(PluginTable("marks", OWN))
