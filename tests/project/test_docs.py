"""The documentation does what it says: its commands parse or run, its links lead somewhere, its generated pages are fresh."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer
import yaml

from ballbar.commands import cli
from generators import scenario_reference
from tests.helpers.command_line import ballbar

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
TUTORIAL = DOCS / "tutorial.md"
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)#\s]+)(#[^)]*)?\)")
_START = re.compile(r"^(?:\$ )?(?:\.venv/bin/)?(ballbar|python -m|make)(?= |$)")


def _without_comment(command: str) -> str:
    return re.split(r"\s+#\s", command)[0].strip()


def commands(page: Path) -> Iterator[str]:
    """Commands of the project on a page: lines of blocks without language or of sh, indented lines, words in backticks."""
    text = page.read_text()
    lines = [
        line
        for language, block in _FENCE.findall(text)
        if language in ("", "sh")
        for line in block.replace("\\\n", " ").splitlines()
    ]
    rest = _FENCE.sub("", text)
    lines += [line.strip() for line in rest.splitlines() if line.startswith("    ")]
    lines += [" ".join(words.split()) for words in re.findall(r"`([^`]+)`", rest)]
    for line in lines:
        if _START.match(line):
            yield _START.sub(lambda found: found[1], _without_comment(line))


EVERY = sorted({(page.name, command) for page in PAGES for command in commands(page)})


def test_the_pages_show_commands_of_every_kind() -> None:
    words = {command.split()[0] for _, command in EVERY}
    assert words == {"ballbar", "make", "python"}
    assert len(EVERY) > 40
    assert {name for name, _ in EVERY} >= {
        "README.md",
        "tutorial.md",
        "sweeps.md",
        "use_of_results.md",
        "recorder.md",
        "command_line.md",
    }


@pytest.mark.parametrize(("page", "command"), EVERY)
def test_a_command_on_a_page_exists_with_its_options(page: str, command: str) -> None:
    program, *words = shlex.split(command)
    if program == "make":
        targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert set(words) <= set(targets)
    elif program == "python":
        name = words[1]
        assert find_spec(name) is not None
        source = "".join(path.read_text() for path in _sources(name))
        assert all(
            f'"{word.partition("=")[0]}"' in source for word in words[2:] if word.startswith("--")
        ), command
    else:
        _parse_ballbar(words)


def _sources(module: str) -> list[Path]:
    path = ROOT / Path(*module.split("."))
    return sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


def _parse_ballbar(words: list[str]) -> None:
    """Fails for a command or an option that there is not; what the arguments name need not be there."""
    group = typer.main.get_command(cli.app)
    if not words:
        return
    if words[0].startswith("-"):
        assert words[0] in {name for option in group.params for name in option.opts} | {"--help"}
        return
    name, *rest = words
    assert name in group.commands, f"no command {name}"  # type: ignore[attr-defined]
    known = {option for param in group.commands[name].params for option in param.opts} | {"--help"}  # type: ignore[attr-defined]
    given = {word.partition("=")[0] for word in rest if word.startswith("-")}
    assert given <= known, f"{name} has no {', '.join(sorted(given - known))}"


def test_an_option_that_is_not_there_would_be_found() -> None:
    with pytest.raises(AssertionError, match="compare has no --fast"):
        _parse_ballbar(["compare", "a", "b", "--fast"])
    with pytest.raises(AssertionError, match="no command guess"):
        _parse_ballbar(["guess"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_of_a_page_are_there(page: Path) -> None:
    text = _FENCE.sub("", page.read_text())
    for target, _ in _LINK.findall(text):
        if not target.startswith(("http://", "https://")):
            assert (page.parent / target).exists(), target


def test_every_page_is_in_the_navigation_and_nothing_else() -> None:
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text())

    def files(entries: list[dict[str, object]]) -> Iterator[str]:
        for entry in entries:
            for value in entry.values():
                yield from files(value) if isinstance(value, list) else [str(value)]

    found = list(files(site["nav"]))
    assert len(found) == len(set(found))
    assert set(found) == {page.name for page in PAGES if page.parent == DOCS}


def test_the_site_asks_nothing_of_other_servers() -> None:
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
    assert site["theme"]["font"] is False
    assert not {"extra_javascript", "extra_css", "google_analytics"} & set(site)


def test_the_scenario_reference_is_that_of_the_schema() -> None:
    text = scenario_reference.reference()
    assert scenario_reference.PAGE.read_text() == text, (
        "run: python -m generators.scenario_reference"
    )
    for words in (
        "| `duration_s` | number > 0, ≤ 3600 | needed |",
        "### errors.rod_strain",
        "| `cost` | `ml`, `length`,",
        "| `fitted` | list of (whole number ≥ 1, ≤ 5) |",
    ):
        assert words in text, words
    assert not re.search(r"Annotated|NoneType|typing\.|<class", text)


def test_everything_on_the_api_page_is_there_and_has_a_docstring() -> None:
    names = re.findall(r"^::: (\S+)$", (DOCS / "api.md").read_text(), re.MULTILINE)
    assert len(names) > 20
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert getattr(import_module(module), attribute).__doc__, name
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "api.md").read_text(), re.DOTALL)
    exec(compile(code, "api.md", "exec"), {})


@pytest.mark.slow
def test_the_tutorial_goes_as_it_is_written_and_other_pages_go_on_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder with nothing but the scenarios; left out is what opens a viewer, and of other pages what takes minutes."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(tmp_path)
    said: dict[str, str] = {}
    for language, block in _FENCE.findall(TUTORIAL.read_text()):
        head = re.match(r"# (\S+\.(?:yaml|py))\n", block)
        if head:
            (tmp_path / head[1]).write_text(block)
            continue
        assert language == "sh", block
        for line in block.splitlines():
            command = _without_comment(line)
            if command.startswith("ballbar ") and not command.startswith("ballbar replay"):
                words = shlex.split(command)[1:]
                code, said[command], told = ballbar(*words)
                assert code == (1 if "# exit code 1" in line else 0), (
                    f"{command}: {said[command]}{told}"
                )
    assert (tmp_path / "runs/irb2400/report.html").is_file()
    assert (tmp_path / "runs/irb2400/run.rrd").is_file()
    assert said["ballbar run my_cell.yaml"].startswith("Good fit")
    assert "met    TCP error, mean" in said["ballbar run my_cell.yaml"]
    assert said["ballbar run my_cell_worse.yaml"].startswith("Misfit")
    assert "missed TCP error, mean" in said["ballbar run my_cell_worse.yaml"]
    subprocess.run(
        [sys.executable, "plot.py"],
        check=True,
        env={"MPLBACKEND": "Agg", "PATH": "", "HOME": str(tmp_path)},
    )
    assert (tmp_path / "eccentricity.png").read_bytes().startswith(b"\x89PNG")

    (tmp_path / "targets.csv").write_text("q1,q2,q3,q4,q5,q6\n0.1,0.1,0.1,0.1,0.5,0.1\n")
    cheap = {
        command
        for _, command in EVERY
        if re.match(r"ballbar (export|correct|check|compare) .*runs/irb2400", command)
    }
    assert {command.split()[1] for command in cheap} == {"export", "correct", "compare"}
    for command in sorted(cheap):
        code, _, told = ballbar(*shlex.split(command)[1:])
        assert code == 0, f"{command}: {told}"


@pytest.mark.slow
def test_the_site_is_built_with_every_anchor_and_without_foreign_requests(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--site-dir",
        str(tmp_path / "site"),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    faults = [
        line
        for line in done.stderr.splitlines()
        if "no such anchor" in line or line.startswith("WARNING")
    ]
    assert not faults
    for page in (tmp_path / "site").glob("*.html"):
        loaded = re.findall(
            r'<(?:script|img|iframe)[^>]* src="([^"]+)"|<link[^>]* rel="(?:stylesheet|icon|preconnect)"[^>]* href="([^"]+)"',
            page.read_text(),
        )
        assert not [
            address for pair in loaded for address in pair if address.startswith(("http", "//"))
        ], page.name
    assert ">errors.rod_backlash<" in (tmp_path / "site/effects.html").read_text(), (
        "Markdown in its table is read"
    )
    assert 'id="ident.identify.identify"' in (tmp_path / "site/api.html").read_text()
