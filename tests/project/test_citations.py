"""Every citation leads somewhere: notes and pages to docs/, literature to docs/references.md."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CITING = (
    *("acquisition", "ballbar", "benchmarks", "cell", "generators", "ident", "planning"),
    *("scenarios", "sim", "tests"),
)
OF_TESTS = {"test_citations.py", "test_words.py"}  # hold wrong citations on purpose

_SECTION = r"(?:[A-Z](?:\.\d+)?|\d+(?:\.\d+)?)(?!\w)"
_WORD = r"[a-z]\w*(?: \d+)?"
_KEY = rf'"[^"\n]+"|{_WORD}(?:\s+and\s+{_WORD})?'
NOTE = re.compile(
    r"notes/(?P<name>[a-z]\w*(?:/\w+)?)\b(?!\.md#)(?:\.md)?"
    rf"(?:,?\s+secs?\.\s+(?P<sections>{_SECTION}(?:(?:,|\s+and)\s+{_SECTION})*))?"
    rf"(?:,\s+(?P<keys>{_KEY})(?=\s*[.:;)\n]|$))?"
)
_NAME = r"[A-ZÀ-Ž][A-Za-zÀ-ž'-]+"
AUTHORS = re.compile(
    rf"(?P<names>{_NAME}(?:(?:,\s+|\s+&\s+|\s+and\s+){_NAME})*)(?:\s+et\s+al\.)?,?\s+\(?"
    r"(?P<year>(?:18|19|20)\d\d)\b(?!-\d)"
)
NO_AUTHORS = {
    *("January", "February", "March", "April", "May", "June", "July", "August", "September"),
    *("October", "November", "December", "Mai", "For", "Between", "Until"),
}
IDENTIFIED = re.compile(r"\bISO \d{3,5}(?:-\d+)?|arXiv:\d+\.\d+|\bdoi \d[\w./-]+\w")
PAGE = re.compile(r"\bdocs/[\w/]+\.(?:md|csv|svg|png)\b")


def citing_files() -> list[Path]:
    """Python and YAML files of the product and around it, and the pages."""
    files = [
        file
        for folder in CITING
        for kind in ("*.py", "*.yaml")
        for file in (ROOT / folder).rglob(kind)
        if file.name not in OF_TESTS and "__pycache__" not in file.parts
    ]
    return [*sorted(files), *sorted(DOCS.rglob("*.md")), ROOT / "README.md"]


def on_one_line(text: str) -> str:
    """The text with ends of lines and the comment signs behind them as blanks, length unchanged."""
    return re.sub(r"\n[ \t]*#?", lambda end: " " * len(end[0]), text)


def sections_of(text: str) -> dict[str, str]:
    """Text of each section, by its number or letter and by its title; with what lies below it."""
    headings = list(re.finditer(r"^(#+) (.+)$", text, re.MULTILINE))
    sections = {}
    for k, heading in enumerate(headings):
        behind = (h.start() for h in headings[k + 1 :] if len(h[1]) <= len(heading[1]))
        body = text[heading.end() : next(behind, len(text))]
        numbered = re.match(rf"({_SECTION})\.? (.+)", heading[2])
        sections[heading[2] if numbered is None else numbered[2]] = body
        if numbered:
            sections[numbered[1]] = body
    return sections


def note_faults(text: str) -> Iterator[tuple[int, str]]:
    """Place in the text and fault of every citation of a note that leads nowhere."""
    for cited in NOTE.finditer(on_one_line(text)):
        page = DOCS / "notes" / f"{cited['name']}.md"
        if not page.is_file():
            yield cited.start(), f"there is no docs/notes/{cited['name']}.md"
            continue
        sections = sections_of(page.read_text())
        numbers = re.findall(_SECTION, cited["sections"] or "")
        yield from (
            (cited.start(), f"notes/{cited['name']} has no section {number}")
            for number in numbers
            if number not in sections
        )
        keys = [
            quoted or word
            for quoted, word in re.findall(rf'"([^"]+)"|({_WORD})', cited["keys"] or "")
            if word != "and"
        ]
        where = [sections.get(number, "").lower() for number in numbers]
        for key in keys:
            stands = any(key.lower() in body for body in where) if where else key in sections
            if not stands:
                yield cited.start(), f"notes/{cited['name']} does not have {key!r} there"


def literature_faults(text: str, references: str) -> Iterator[tuple[int, str]]:
    """Place and fault of every author and year, standard or identifier without a reference."""
    entries = re.findall(r"^- \*\*(.+?)\.?\*\*", references, re.MULTILINE)
    for cited in AUTHORS.finditer(on_one_line(text)):
        names = [n for n in re.findall(_NAME, cited["names"]) if n not in NO_AUTHORS]
        if names and not any(
            cited["year"] in entry and all(name in entry for name in names) for entry in entries
        ):
            yield cited.start(), f"{' & '.join(names)} {cited['year']} is not in docs/references.md"
    for cited in IDENTIFIED.finditer(on_one_line(text)):
        if cited[0] not in references:
            yield cited.start(), f"{cited[0]} is not in docs/references.md"


def line_of(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def test_every_note_that_is_cited_has_the_section_that_is_named() -> None:
    faults, cited = [], 0
    for file in citing_files():
        text = file.read_text()
        cited += len(NOTE.findall(text))
        faults += [
            f"{file.relative_to(ROOT)}:{line_of(text, at)}: {fault}"
            for at, fault in note_faults(text)
        ]
    assert cited > 40
    assert not faults, "\n".join(faults)


@pytest.mark.slow
def test_literature_that_is_cited_stands_in_the_references() -> None:
    references = (DOCS / "references.md").read_text()
    files = [file for file in citing_files() if file != DOCS / "references.md"]
    faults = [
        f"{file.relative_to(ROOT)}:{line_of(text, at)}: {fault}"
        for file in files
        for text in [file.read_text()]
        for at, fault in literature_faults(text, references)
    ]
    assert not faults, "\n".join(faults)


def test_every_page_or_table_that_is_named_is_there() -> None:
    faults = [
        f"{file.relative_to(ROOT)}: {name}"
        for file in citing_files()
        for name in PAGE.findall(file.read_text())
        if name.islower() and not (ROOT / name).exists()  # NAME stands for any
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("(notes/thermal sec. 1)", "no docs/notes/thermal.md"),
        ("(notes/notes/plant sec. 1)", "no docs/notes/notes/plant.md"),
        ("# notes/plant secs. 1, 2 and 99.", "no section 99"),
        ("(notes/log_formats\n    # sec. H.9: missing samples)", "no section H.9"),
        ("(notes/identification sec. 6, trap 12)", "does not have 'trap 12'"),
        ("notes/plant, encoder_error_model and thermometer", "does not have 'thermometer'"),
        ('(notes/identification, "Signs and wonders")', "does not have 'Signs and wonders'"),
    ],
)
def test_a_citation_of_a_note_that_is_not_there_is_found(text: str, fault: str) -> None:
    (message,) = {message for _, message in note_faults(text)} or {""}
    assert fault in message


@pytest.mark.parametrize(
    "text",
    [
        "(notes/identification sec. 6, trap 8)",
        "notes/plant secs. 1, 2, 4, 8, 11.",
        "(notes/plant sec. 7.1)",
        "(notes/log_formats sec. H.5: missing samples)",
        "notes/plant, encoder_error_model and motor_position_sensor; shapes",
        "(notes/plant, 12 urad)",
        "Structure: notes/identification.",
    ],
)
def test_a_citation_that_leads_somewhere_passes(text: str) -> None:
    assert not list(note_faults(text))


def test_literature_that_nobody_listed_is_found() -> None:
    references = "- **Kabsch 1976.** ...\n- **Sun & Hollerbach 2008.** ...\n- **ISO 9283**, ..."
    text = (
        'Kabsch 1976; Sun and Hollerbach 2008, ISO 9283; Doe & Roe (1999), ISO 10791-6, "May 2022"'
    )
    assert [fault for _, fault in literature_faults(text, references)] == [
        "Doe & Roe 1999 is not in docs/references.md",
        "ISO 10791-6 is not in docs/references.md",
    ]
