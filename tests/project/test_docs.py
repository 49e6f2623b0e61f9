"""The documentation is true: commands run, links lead somewhere, generated pages are fresh."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from ballbar.cell.instruments import kinds
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.run import run_scenario
from ballbar.scenario import load_scenario
from generators import command_line, thesis_figures, validation
from generators.readme_picture import ERRORS, IMAGES, SCENARIO, errors_of
from tests.helpers.command_line import application, ballbar
from tests.helpers.command_line import commands as every_command

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GALLERY = sorted((DOCS / "gallery").glob("*.ipynb"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
TUTORIAL = DOCS / "tutorial.md"
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)#\s]+)(#[^)]*)?\)")
_START = re.compile(r"^(?:\$ )?(?:\.venv/bin/)?(ballbar|python -m|make)(?= |$)")


def _without_comment(command: str) -> str:
    return re.split(r"\s+#\s", command)[0].strip()


def commands(page: Path) -> Iterator[str]:
    """Commands of the project on a page.

    They stand in blocks without language or of sh, in indented lines and in backticks.
    """
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
        "run_a_sweep.md",
        "use_of_results.md",
        "recorder.md",
        "command_line.md",
    }


@pytest.mark.parametrize("page", sorted({page for page, _ in EVERY}))
def test_a_command_on_a_page_exists_with_its_options(page: str) -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for program, *words in (shlex.split(command) for name, command in EVERY if name == page):
        if program == "make":
            assert set(words) <= targets
        elif program == "python":
            name = words[1]
            assert find_spec(name) is not None
            source = "".join(path.read_text() for path in _sources(name))
            options = [word.partition("=")[0] for word in words[2:] if word.startswith("--")]
            assert all(f'"{option}"' in source for option in options), words
        else:
            _parse_ballbar(words)


def _sources(module: str) -> list[Path]:
    path = ROOT / Path(*module.split("."))
    return sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


def _parse_ballbar(words: list[str]) -> None:
    """Fails for a command or an option that does not exist; files need not be there."""
    if not words:
        return
    if words[0].startswith("-"):
        options = application().params
        assert words[0] in {name for option in options for name in option.opts} | {"--help"}
        return
    name = next((name for name in (" ".join(words[:2]), words[0]) if name in every_command()), None)
    assert name, f"no command {words[0]}"
    command, rest = every_command()[name], words[len(name.split()) :]
    known = {option for param in command.params for option in param.opts} | {"--help"}
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

    listed = list(files(site["nav"]))
    assert len(listed) == len(set(listed))
    pages = [*(page for page in PAGES if DOCS in page.parents), *GALLERY]
    assert set(listed) == {str(page.relative_to(DOCS)) for page in pages}


@pytest.mark.parametrize("notebook", GALLERY, ids=lambda file: file.stem)
def test_a_notebook_is_stored_without_results(notebook: Path) -> None:
    """The build of the documentation runs it, and fails where a cell does."""
    cells = [c for c in json.loads(notebook.read_text())["cells"] if c["cell_type"] == "code"]
    assert len(cells) > 1
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)


def test_the_site_asks_nothing_of_other_servers() -> None:
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
    assert site["theme"]["font"] is False
    assert not {"extra_javascript", "extra_css", "google_analytics"} & set(site)


def threshold_faults(page: str) -> list[str]:
    """Thresholds of the table of faults that are not those of their modules."""
    faults = []
    table = page.split("## Faults and thresholds")[1]
    for module, cell in re.findall(r"^\| [^|]+ \| `([a-z._]+)` \| ([^|]+) \|", table, re.MULTILINE):
        for name, number in re.findall(r"`([A-Z_]+)` ([\d.e-]+)", cell):
            value = getattr(import_module(module), name, None)
            if value != float(number):
                faults.append(f"{module}.{name} is {value}, not {number}")
    return faults


def test_thresholds_on_the_page_of_recordings_are_those_of_the_modules() -> None:
    page = (DOCS / "recordings.md").read_text()
    assert page.count("`ballbar.acquisition.faults.") > 5
    assert not threshold_faults(page)
    wrong = page.replace("`PAUSE` 0.5 s", "`PAUSE` 0.7 s")
    assert threshold_faults(wrong) == ["ballbar.acquisition.faults.segments.PAUSE is 0.5, not 0.7"]


@pytest.mark.parametrize(
    ("page", "text"),
    [
        ("command_line.md", command_line.page_text),
        ("thesis_figures.md", thesis_figures.page_text),
        ("validation.md", validation.page_text),
    ],
    ids=lambda part: part if isinstance(part, str) else "",
)
def test_a_generated_page_is_what_its_generator_writes(page: str, text: Callable[[], str]) -> None:
    head = (DOCS / page).read_text()
    generator = re.search(r"python -m generators\.\w+", head)
    assert generator is not None
    assert head == text(), f"run: {generator[0]}"


def test_every_figure_and_table_of_the_thesis_with_results_is_beside_ours() -> None:
    figures = [f"3.{i}" for i in range(1, 7)] + [f"5.{i}" for i in (5, 7, 8, 9, *range(12, 18))]
    tables = [*(f"3.{i}" for i in range(1, 6)), "A.1", "A.2", "B.1"]
    expected = {f"Fig. {i}" for i in (*figures, "B.1")} | {f"Table {i}" for i in tables}
    page = (DOCS / "thesis_figures.md").read_text()
    assert expected <= set(re.findall(r"^\|((?:Fig\.|Table) [\w.]+)\|", page, re.MULTILINE))


def test_no_number_of_a_picture_is_shown_as_the_source_of_a_formula() -> None:
    """Logarithmic ticks are formulas by default, which our style shows as they are written."""
    pictures = list(DOCS.rglob("*.svg"))
    assert len(pictures) > 50
    assert not [file.name for file in pictures if "mathdefault" in file.read_text()]


def test_every_table_of_measured_figures_has_command_commit_and_date() -> None:
    page = (DOCS / "validation.md").read_text()
    line = r"`(?:python -m benchmarks\.|ballbar )[^\n`]+` \([0-9a-f]{7}, 20\d\d-\d\d-\d\d\)"
    for section in re.split(r"^#{2,3} ", page, flags=re.MULTILINE)[1:]:
        title, _, text = section.partition("\n")
        assert re.search(line, text), title
        assert "\n|---|" in text, title
        assert not re.search(r"\bnan\b", text), title


def test_a_cell_of_a_table_is_made_of_rows() -> None:
    rows = pd.DataFrame({"error": [1.0, 2.0, 4.0], "kind": ["a", "b", "b"]})
    made = {
        "median error .1f / largest error .2f": "2.0 / 4.00",
        "rms error .3f": "2.646",
        "count kind=='b' of count": "2 of 3",
        "counts kind": "2 b, 1 a",
        "share error>1.5": "66.7 %",
        "least error*(kind!='a') .0f to value kind": "0 to a",
    }
    assert {text: validation.cell(rows, text) for text in made} == made


@pytest.mark.slow
def test_picture_and_figures_of_the_front_page_are_those_of_the_run_they_name(
    tmp_path: Path,
) -> None:
    """The picture once said 0.0015 mm where the run gave 0.0026 mm."""
    scenario = load_scenario(SCENARIO)
    data = run_scenario(
        scenario, SCENARIO, out=tmp_path / "run", command="", progress=lambda _: None
    )
    errors, (names, values) = errors_of(data), ERRORS.read_text().split()
    committed = dict(zip(names.split(","), values.split(","), strict=True))
    assert committed.keys() == errors.keys()
    for name in ("tcp_mean_mm", "tcp_max_mm", "nominal_mean_mm", "nominal_max_mm"):
        # another processor or library: a different sum in the last bits, and another iteration
        assert float(errors[name]) == pytest.approx(float(committed[name]), rel=0.1), name
    drawn = re.findall(r"mean ([\d.]+) mm", (IMAGES / "readme.svg").read_text())
    assert drawn == [committed["tcp_mean_mm"], committed["nominal_mean_mm"]]
    nominal = [committed[name] for name in ("nominal_mean_mm", "nominal_max_mm")]
    here = [committed[name] for name in ("tcp_mean_mm", "tcp_max_mm")]
    words = f"(nominal robot: {' / '.join(nominal)} mm) | {' / '.join(here)} mm |"
    assert words in (ROOT / "README.md").read_text()


def test_the_date_to_cite_is_that_of_the_changelog() -> None:
    """It once was the date of the version before."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    released = re.findall(
        rf"^## {re.escape(cited['version'])} - (\S+)$",
        (ROOT / "CHANGELOG.md").read_text(),
        re.MULTILINE,
    )
    assert [cited[key] for key in ("date-released",) if key in cited] == released


ON_THE_FRONT_PAGE = {
    "ballbar": ("sensed double ball-bar",),
    "length": ("telescoping ball-bar", "draw-wire"),
    "point": ("laser tracker",),
    "pose": ("motion capture",),
    "socket": ("ball in sockets",),
    "bearing": ("theodolites",),
    "plane": ("dial gauge",),
}


def test_the_front_page_names_every_kind_of_instrument() -> None:
    assert set(ON_THE_FRONT_PAGE) == {*kinds(), "ballbar"}, "name the new kind on both pages"
    for page in (ROOT / "README.md", DOCS / "index.md"):
        text = " ".join(page.read_text().split())
        for name in (name for names in ON_THE_FRONT_PAGE.values() for name in names):
            assert name in text, f"{page.name}: {name}"


def test_a_generator_can_be_imported() -> None:
    """One had lost a helper that stood among the tests."""
    for file in (ROOT / "generators").glob("*.py"):
        import_module(f"generators.{file.stem}")


def test_everything_on_the_api_page_is_there_and_has_a_docstring() -> None:
    names = re.findall(r"^::: (\S+)$", (DOCS / "api.md").read_text(), re.MULTILINE)
    assert len(names) > 20
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert getattr(import_module(module), attribute).__doc__, name


@pytest.mark.slow
def test_the_example_of_axis_angles_gives_the_joint_angles_that_the_page_says() -> None:
    page = (ROOT / "docs/how_to/own_robot.md").read_text()
    (example,) = re.findall(r"```yaml\n(controller_to_joint:.*?)```", page, re.DOTALL)
    matrix = np.array(yaml.safe_load(example)["controller_to_joint"])
    axes = np.array([10.0, 10.0, 10.0])
    assert (axes @ matrix).tolist() == [-10.0, 10.0, 0.0]
    assert "joints are at -10, 10 and 0 deg" in page
    robot = load_robot("irb2400")  # whose map the same convention reads
    turned = controller_to_joints(robot, np.array([0.0, 0.3, 0.0, 0.0, 0.2, 0.0]))
    assert turned.tolist() == [0.0, 0.3, -0.3, 0.0, -0.2, 0.0]


WELD = """MODULE weld
  CONST jointtarget home:=[[0,10,10,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveAbsJ home,v100,fine,tool0;
  ENDPROC
ENDMODULE
"""


@pytest.mark.long
def test_the_tutorial_goes_as_it_is_written_and_other_pages_go_on_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder with nothing but the scenarios; without the viewer and what takes minutes."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(tmp_path)
    said: dict[str, str] = {}
    for language, block in _FENCE.findall(TUTORIAL.read_text()):
        head = re.match(r"# (\S+\.(?:yaml|py))\n", block)
        if head:
            (tmp_path / head[1]).parent.mkdir(parents=True, exist_ok=True)
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
    assert said["ballbar run runs/tutorial/my_cell.yaml"].startswith("Good fit")
    assert "met    TCP error, mean" in said["ballbar run runs/tutorial/my_cell.yaml"]
    assert said["ballbar run runs/tutorial/my_cell_worse.yaml"].startswith("Misfit")
    assert "missed TCP error, mean" in said["ballbar run runs/tutorial/my_cell_worse.yaml"]
    subprocess.run(
        [sys.executable, "runs/tutorial/plot.py"],
        check=True,
        env={"MPLBACKEND": "Agg", "PATH": "", "HOME": str(tmp_path)},
    )
    assert (tmp_path / "runs/tutorial/eccentricity.png").read_bytes().startswith(b"\x89PNG")

    (tmp_path / "targets.csv").write_text("q1,q2,q3,q4,q5,q6\n0.1,0.1,0.1,0.1,0.5,0.1\n")
    (tmp_path / "weld.mod").write_text(WELD)
    cheap = {
        command
        for _, command in EVERY
        if re.match(r"ballbar (export|correct|check|compare) .*runs/irb2400", command)
    }
    assert {command.split()[1] for command in cheap} == {"check", "compare", "correct", "export"}
    for command in sorted(cheap):
        code, _, told = ballbar(*shlex.split(command)[1:])
        assert code == 0, f"{command}: {told}"


@pytest.mark.long
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
    for page in (tmp_path / "site").rglob("*.html"):
        loaded = re.findall(
            r'<(?:script|img|iframe)[^>]* src="([^"]+)"|'
            r'<link[^>]* rel="(?:stylesheet|icon|preconnect)"[^>]* href="([^"]+)"',
            page.read_text(),
        )
        assert not [
            address for pair in loaded for address in pair if address.startswith(("http", "//"))
        ], page.name
    assert ">errors.rod_backlash<" in (tmp_path / "site/scenario_reference.html").read_text(), (
        "every source has a heading"
    )
    for notebook in GALLERY:
        page = (tmp_path / "site/gallery" / notebook.with_suffix(".html").name).read_text()
        assert "Good fit" in page or notebook.stem in ("mix_of_instruments", "an_error_source")
        assert page.count("data:image/png") > 1 or notebook.stem == "own_logs"
    assert 'id="ballbar.result.identify.identify"' in (tmp_path / "site/api.html").read_text()
    for page, script in (
        ("tutorial.html", "assets/search_from_disk.js"),
        ("how_to/own_robot.html", "../assets/search_from_disk.js"),
    ):
        text = (tmp_path / "site" / page).read_text()
        assert f'<script src="{script}">' in text, "search works on pages from the disk"
        assert "md-footer__link--next" in text
    assert (tmp_path / "site/assets/search_from_disk.js").is_file()
    assert (tmp_path / "site/search/search_index.js").is_file()


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_a_page_holds_no_marks_of_a_merge(page: Path) -> None:
    marks = [line for line in page.read_text().splitlines() if re.match(r"(<{7}|>{7}|={7}$)", line)]
    assert not marks
