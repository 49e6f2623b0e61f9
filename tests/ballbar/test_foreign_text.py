"""Titles, names and cells of others do nothing in a program, a page, a table or a terminal.

A title with a line break once ended the comment of a RAPID program, and what followed stood there
as code.
"""

from __future__ import annotations

import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import DescriptionError
from ballbar.cell.foreign_text import comment, is_printable, markdown
from ballbar.cell.geometry import Geometry
from ballbar.cell.load import load_robot, robot_names
from ballbar.cell.strict_yaml import load_yaml
from ballbar.claims.show import page_text
from ballbar.compensation.targets_file import TargetFile, joint_columns, targets_text
from ballbar.export.formats import FORMATS, exported
from ballbar.export.result import Result, load_result
from ballbar.planning.pose_plan import PosePlan
from ballbar.planning.programs import ProgrammedPath, path_program, path_table, pose_program
from ballbar.planning.trajectory import Targets
from ballbar.report.section import template
from ballbar.sweep.table import write_table
from tests.helpers.calibrations import write_calibration_of

ROBOT = Path(__file__).parents[2] / "cell" / "robots" / "ur5e.yaml"
EVIL = "x\nENDMODULE\nMODULE evil\nPROC main()\nSetDO do1,1;\nENDPROC"
# text of every kind, with what acts in one of the formats mixed in
SIGNS = ("\n", "\r", "\0", "\x0b", "\x0c", "\x1b[2J", "\x85", "\x9b", "\u2028", "\u202e", "\ud800")
MARKS = ("--", "-->", "]]>", "<script>", "|", "`", "![a](http://b)", "$\\frac{", "{{", "{%", "&")
CELLS = ("=cmd()", "@", "+", "-", ",", ";", "!", '"', "'")
ACTING = st.sampled_from((*SIGNS, *MARKS, *CELLS, EVIL))
HOSTILE = st.lists(st.text(max_size=8) | ACTING, max_size=8).map("".join)
TARGETS = Targets(np.array([0.0, 2.0]), np.zeros((2, 6)), np.array([1.0, 0.0]), 1e-5)
hostile = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, nominal: Geometry) -> Result:
    path = tmp_path_factory.mktemp("result") / "calibration.yaml"
    return load_result(write_calibration_of(path, nominal, nominal))


def with_title(cell: Cell, title: str) -> Cell:
    """The cell with the title of a file whose check was passed by."""
    return replace(
        cell,
        robot=replace(cell.robot, title=title),
        ballbar=replace(cell.ballbar, title=title),
        plate=replace(cell.plate, title=title),
    )


def pose_plan_of(cell: Cell, text: str) -> PosePlan:
    """A plan as the writers of pose programs see it, with hostile text in it."""
    station = SimpleNamespace(seat=text, target=text)
    limits = SimpleNamespace(axis_margin_deg=1.0, clearance_m=0.01)
    setup = SimpleNamespace(
        request=SimpleNamespace(name="plan", limits=limits, settle_s=1.0),
        robot=cell.robot,
        instrument=SimpleNamespace(title=text, measured="point"),
        stations=[station],
    )
    poses = SimpleNamespace(axes=np.zeros((2, 6)), size=2, station=np.zeros(2, dtype=np.intp))
    route = SimpleNamespace(blocked=(), passing={})
    return cast("PosePlan", SimpleNamespace(setup=setup, poses=poses, route=route))


def code(program: str, mark: str) -> list[str]:
    """Lines of a program that a controller runs, however it ends lines and reads bytes."""
    readings = (program, program.encode().decode("latin-1"))
    lines = [[line.split(mark)[0].strip() for line in text.splitlines()] for text in readings]
    run = [[line for line in text if line] for text in lines]
    assert run[0] == run[1], "the same code in both encodings"
    return run[0]


@hostile
@example(EVIL)
@given(HOSTILE)
def test_no_title_adds_code_to_a_program(cell: Cell, made: Result, text: str) -> None:
    plain, evil = with_title(cell, "A robot"), with_title(cell, text)
    paths = [ProgrammedPath("plan", c.robot, TARGETS, [c.robot.title]) for c in (plain, evil)]
    assert code(path_table(paths[0]), "#") == code(path_table(paths[1]), "#")
    poses = [pose_plan_of(c, c.robot.title) for c in (plain, evil)]
    for language, mark in (("rapid", "!"), ("pdl2", "--"), ("krl", ";")):
        for write, pair in ((path_program, paths), (pose_program, poses)):
            programs = [write(language, plan) for plan in pair]
            assert code(programs[0], mark) == code(programs[1], mark)
    results = [replace(made, cell=c, file=Path(c.robot.title)) for c in (plain, evil)]
    for kind, mark in (("abb", "!"), ("dh", "#"), ("mdh", "#"), ("hayati", "#"), ("poe", "#")):
        texts = [FORMATS[kind](result) for result in results]
        assert code(texts[0], mark) == code(texts[1], mark)


@hostile
@given(HOSTILE)
def test_models_and_json_stay_what_they_are(cell: Cell, made: Result, text: str) -> None:
    result = replace(made, cell=with_title(cell, text), file=Path(text))
    plain = replace(made, cell=with_title(cell, "A robot"), file=Path("a"))
    for kind in ("urdf", "mjcf"):
        shown = exported(result, kind)  # type: ignore[arg-type]
        trees = [ET.fromstring(model) for model in (shown, exported(plain, kind))]  # type: ignore[arg-type]
        names = [[element.tag for element in tree.iter()] for tree in trees]
        assert names[0] == names[1]
        assert is_printable(shown, allowed="\n")
    assert json.loads(exported(result, "json"))["title"] == text


@hostile
@given(HOSTILE)
@example("\r=")
@example("\r\r")
def test_no_cell_is_run_by_a_spreadsheet(cell: Cell, tmp_path: Path, text: str) -> None:
    robot, names = cell.robot, joint_columns(cell.robot)
    targets = TargetFile(
        path=Path("t.csv"),
        header=("name", *names),
        rows=((text, *"000000"),),
        lines=(2,),
        columns=names,
        q=np.zeros((1, 6)),
    )
    cells = list(csv.reader(io.StringIO(targets_text(targets, robot, targets.q), newline="")))
    written = [row[0] for row in cells]
    if "\ud800" not in text:  # Parquet is UTF-8, and so are the files that texts of a sweep are of
        (tmp_path / "chunk").write_text(json.dumps([{"run": 0, "reason": text}]))
        write_table([tmp_path / "chunk"], {}, {"parquet": tmp_path / "p", "csv": tmp_path / "c"})
        cells = list(csv.reader(io.StringIO((tmp_path / "c").read_text("utf-8"), newline="")))
        written += [row[-1] for row in cells if row]
    for cell_text in written:
        number = re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", cell_text)
        assert number or not cell_text.startswith(("=", "+", "-", "@", "\t", "\r", "\n"))


@hostile
@given(HOSTILE)
def test_pages_show_text_as_text(text: str) -> None:
    shown = markdown(text)
    assert not re.search(r"(?<!\\)[`*_\[\]<>|]", shown.replace("\\\\", ""))
    assert "\n" not in shown
    topic = SimpleNamespace(
        name="a", file=SimpleNamespace(title=text, place="p", about="a", sets=("core",))
    )
    judged = cast("Any", SimpleNamespace(topic=topic, verdicts=[], runs=0))
    lines = page_text([judged], {}, {}).splitlines()
    assert lines == page_text([judged], {}, {}).split("\n")[:-1], "no other line ends"
    assert f"## {shown}".rstrip() in [line.rstrip() for line in lines]
    page = template("macros.html").environment.from_string("<p>{{ text }}</p>").render(text=text)
    assert page.count("<") == 2


@given(HOSTILE)
@settings(deadline=None)
def test_a_comment_is_one_line_of_ascii(text: str) -> None:
    assert is_printable(comment("!", text))
    assert comment("!", text).isascii()


@pytest.mark.parametrize("title", [EVIL, "a\tb", "\x1b]0;title\x07", "a\u202eb", "x" * 201])
def test_a_title_of_several_lines_is_refused_with_its_key(tmp_path: Path, title: str) -> None:
    shipped = ROBOT.read_text("utf-8")
    path = tmp_path / "evil.yaml"
    path.write_text(
        re.sub(
            r"^title: .*$", lambda _: f"title: {json.dumps(title)}", shipped, count=1, flags=re.M
        )
    )
    line = load_yaml(ROBOT).place_of(("title",)).line
    with pytest.raises(DescriptionError, match=rf"evil\.yaml:{line}: "):
        load_robot(str(path))


def test_shipped_robots_have_titles_of_one_line() -> None:
    assert all(is_printable(load_robot(name).title) for name in robot_names())
