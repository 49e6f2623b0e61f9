"""One word for each thing: what docs/glossary.md replaces stays out of code and pages."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.helpers.source_imports import nodes

ROOT = Path(__file__).parents[2]
GLOSSARY = ROOT / "docs" / "glossary.md"
PACKAGES = ("acquisition", "ballbar", "cell", "generators", "ident", "planning", "sim")


@dataclass(frozen=True)
class Word:
    """A word that is not used, and the one of the glossary that is."""

    pattern: str  # in any text, underscores read as blanks
    instead: str
    apart_from: str = r"(?!)"  # what may stand all the same, on the line


BANNED = (
    Word(r"courses?", "trajectory", r"\bof course\b"),
    Word(r"mend(ed|s|ing)?", "repaired"),
    Word(r"told", "reported"),
    Word(
        r"senses?",
        "encoder direction",
        r"\b(in|makes?|no) (the|a|this|that|every)? ?sense\b|\"encoders\.senses\"",
    ),
    Word(r"mismatch(es)?", "loop-closure error", r"string_pattern_mismatch"),
    Word(r"cardans?", "universal joint", r"\bCardan joint\b"),
    Word(r"by hand", "manual"),
    Word(r"in words\.", "sentence"),
    Word(
        r"lost motions?",
        "backlash",
        r"lost_motion_rad|\.lost_motion\b|\blost_motion\b.*cata|cata.*lost.motion",
    ),
    Word(r"standstills?|stillness", "dwell"),
    Word(r"g(ive|ives|iven|iving|ave) way", "compliance"),
    Word(r"slack", "backlash"),
    Word(r"free robot", "unloaded robot"),
    Word(r"alike in time", "autocorrelated"),
    Word(r"surprise", "normalised innovation"),
    Word(r"ledgers?", "import report"),
    Word(r"likewise", "the same"),
    Word(r"alike", "equal", r"\balike\("),
    Word(r"anew", "again", r"anew (there|at \{)|anew, (give|or bent)|bolted on anew"),  # of results
    Word(r"foretold|foretells?", "predicted"),
    Word(r"reckon(s|ed|ing)?", "accounted for"),
    Word(r"whoever", "anyone"),
)
FIRST_WORDS = ("Of", "Those", "As", "What", "Likewise")  # of a docstring that is no sentence


def whole(pattern: str) -> str:
    """A pattern that begins and ends with its word."""
    return rf"(?<![A-Za-z])(?:{pattern})(?![A-Za-z])"


BEGUN = re.compile(rf"[\"']\s*(?:{'|'.join(FIRST_WORDS)})\b")  # wherever a text begins so
NAMES = {  # of variables, parameters and attributes of our own: a pronoun hides the noun
    "one": "the noun",
    "found": "the noun",
    "kept": "the noun",
    "near": "the noun",
    "asked": "requested, target",
    "told": "reported",
}
USED = re.compile(rf"\b(?:{'|'.join(NAMES)})\b")
QUOTED = re.compile(r"^\s+says: .*(?:\n\s{6,}.*)*", re.MULTILINE)  # the thesis, in scenarios/claims
CITED = re.compile(r'"[^"\n]+" \((?=(?:sec|ch|App|Table|Fig)\b)')  # the thesis, on a page


def without_quotations(text: str) -> str:
    """The text without sentences of the thesis; as many lines."""
    for quotation in (QUOTED, CITED):
        text = quotation.sub(lambda cited: "\n" * cited[0].count("\n"), text)
    return text


def words_in(text: str) -> Iterator[tuple[int, str]]:
    """Line and fault of every banned word."""
    text = without_quotations(text)
    lower = text.lower().replace("_", " ")
    for word in BANNED:
        if not re.search(word.pattern, lower):  # of any letters before it: quick, and mostly so
            continue
        banned = re.compile(whole(word.pattern))
        for number, (line, plain) in enumerate(
            zip(text.splitlines(), lower.splitlines(), strict=True), start=1
        ):
            if banned.search(plain) and not re.search(word.apart_from, line, re.IGNORECASE):
                yield number, f"{word.pattern}: say {word.instead}"


def nodes_of(source: str, file: Path | None) -> Iterable[ast.AST]:
    """All nodes of the syntax tree of a source, or of the file that it is from."""
    return nodes(file) if file else ast.walk(ast.parse(source))


def docstrings_in(source: str, file: Path | None = None) -> Iterator[tuple[int, str]]:
    """Line and fault of every docstring that begins as no sentence does.

    Docstrings of attributes and descriptions of fields are among them: pages are made of both.
    """
    for node in nodes_of(source, file) if BEGUN.search(source) else ():
        if not isinstance(node, ast.Expr | ast.keyword):
            continue
        text, described = node.value, getattr(node, "arg", "description") == "description"
        if described and isinstance(text, ast.Constant) and isinstance(text.value, str):
            first = re.match(r"\s*([A-Z]\w*)(?![\w-])", text.value)
            if first and first[1] in FIRST_WORDS:
                yield text.lineno, f"docstring begins with {first[1]}: write a sentence"


def names_in(source: str, file: Path | None = None) -> Iterator[tuple[int, str]]:
    """Line and fault of every name in a Python file that is none."""
    for node in nodes_of(source, file) if USED.search(source) else ():
        for field, name in ast.iter_fields(node):
            if field != "value" and isinstance(name, str) and name in NAMES:
                yield node.lineno, f"name `{name}`: say {NAMES[name]}"  # type: ignore[attr-defined]


def files() -> list[Path]:
    """Product, scenarios and pages; the glossary names what it replaces."""
    code = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    data = [
        file
        for folder in ("acquisition", "cell", "scenarios")
        for file in (ROOT / folder).rglob("*.yaml")
    ]
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    return sorted({*code, *data, *pages} - {GLOSSARY})


def faults() -> list[str]:
    """`file:line: fault`, all of them."""
    lines = []
    for file in files():
        text, name = file.read_text(), file.relative_to(ROOT)
        every = [*words_in(text)]
        if file.suffix == ".py":
            every += [*names_in(text, file), *docstrings_in(text, file)]
        lines += [f"{name}:{number}: {fault}" for number, fault in sorted(every)]
    return lines


@pytest.mark.slow
def test_one_word_for_each_thing() -> None:
    every = faults()
    assert not every, f"{len(every)} places\n" + "\n".join(every)


def test_what_is_said_instead_stands_in_the_glossary() -> None:
    glossary = GLOSSARY.read_text()
    terms = {
        term.strip()
        for row in re.findall(r"^\| ([^|]+) \|", glossary, re.MULTILINE)
        for term in row.split(",")
    }
    for word in BANNED:
        assert word.instead in terms, word.instead


@pytest.mark.parametrize(
    "text",
    [
        "the course of a joint",
        "best_course = 1",
        "the declared sense of rotation",
        "class Mismatch:",
        "rms_mismatch_m",
        "the rod gives way",
        "gear_lost_motion: 1.0e-4",
    ],
)
def test_a_banned_word_is_found_in_text_and_names(text: str) -> None:
    assert [number for number, _ in words_in(f"\n{text}\n")] == [2]


@pytest.mark.parametrize(
    "text",
    [
        "of course",
        "coarse offset",
        "in the sense above",
        "lost_motion_rad: [1.2e-4]",
        '| "not mended by hand." (sec. 5.4) | 3 |',
        "    says: >-\n      told by hand\n      with slack\n    source: sec. 5\n",
    ],
)
def test_other_words_and_quotations_of_the_thesis_stay(text: str) -> None:
    assert not list(words_in(text))


@pytest.mark.slow
def test_a_docstring_of_a_test_begins_as_a_sentence_too() -> None:
    """Also in what tests, benchmarks and examples share."""
    for folder in ("benchmarks", "examples", "tests"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            assert not list(docstrings_in(file.read_text())), file


@pytest.mark.parametrize("first", FIRST_WORDS)
def test_a_docstring_without_a_subject_is_found(first: str) -> None:
    source = f'def f() -> None:\n    """{first} the rows."""\n'
    assert [number for number, _ in docstrings_in(source)] == [2]
    assert not list(docstrings_in(source.replace(f"{first} the", f"{first}-if the")))
    for field in (
        f"unit: str\n    '{first} them.'",
        f"unit: str = Field(description='{first} it.')",
    ):
        assert [number for number, _ in docstrings_in(f"class A:\n    {field}")]


def test_a_pronoun_is_found_where_it_is_a_name_and_nowhere_else() -> None:
    source = '"""One was found."""\nfor one in (1, 2):\n    kept = one  # near\n'
    assert [number for number, _ in names_in(source)] == [2, 3, 3]
