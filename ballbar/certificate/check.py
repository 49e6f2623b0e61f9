"""A certificate as a file, and whether it still holds.

A file holds its content as JSON. A check asks three things: does the file print that content and
nothing else, are the input files those that it names, and do they give the same content again?
Numbers may differ in their last digits (LAST_BITS), for other computers round otherwise.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from jinja2 import TemplateError

from ballbar.cell.errors import InputError
from ballbar.cell.foreign_files import read_regular
from ballbar.certificate import html, pdf
from ballbar.certificate.content import SCHEMA, Content, certificate_content
from ballbar.code_version import code_version
from ballbar.ident.options import SILENT, Listener
from ballbar.report.provenance import hashed

MAX_BYTES = 20_000_000
LAST_BITS = 1e-5  # relative; measured between kinds of processors: 1e-7
KINDS: dict[str, tuple[Callable[[Content], bytes], bytes, bytes]] = {
    ".html": (html.html, html.OPENING, html.CLOSING),
    ".pdf": (pdf.pdf, pdf.OPENING, pdf.CLOSING),
}

# what a content raises that the program did not write; InputError is a ValueError
WRONG = (ArithmeticError, LookupError, SyntaxError, TemplateError, TypeError, ValueError)


def certificate_file(content: Content, kind: str) -> bytes:
    """The file of a content; kind : its ending, a key of KINDS."""
    return KINDS[kind][0](content)


def content_of(file: Path) -> tuple[Content, bytes]:
    """The content that a certificate holds, and the file as it is.

    Raises InputError where it is no certificate.
    """
    if file.suffix.lower() not in KINDS:
        raise InputError.at(file, "is no certificate.", f"They end in {' or '.join(KINDS)}.")
    _, opening, closing = KINDS[file.suffix.lower()]
    raw = read_regular(file, MAX_BYTES)
    try:
        start = raw.index(opening) + len(opening) - 1
        content = json.loads(raw[start : raw.index(closing, start)])
        known = content["schema"] == SCHEMA
    except (ValueError, TypeError, KeyError, RecursionError):
        known = False
    if not known:
        what = (
            f"holds no content of a certificate ({SCHEMA}) that can be read, so it does not hold."
        )
        raise InputError.at(file, what, "Name a file that ballbar certificate wrote, unchanged.")
    return content, raw


def check_certificate(
    file: Path, inputs: Path | None = None, *, listener: Listener = SILENT
) -> list[str]:
    """Sentences on each thing that does not hold of a certificate; none where it holds.

    inputs : the folder from which its input files are named, by default where it was written from.

    Raises InputError for a file that is no certificate.
    """
    content, raw = content_of(file)
    try:
        base = inputs or file.resolve().parent / content["base"]
        text, files = list(_text(file, content, raw)), list(_files(base, content))
        if files or (text and content["program"] == code_version()):
            return text + files
        return text + list(_recomputed(base, content, listener))
    except WRONG as error:
        return [f"its content cannot be read ({type(error).__name__}: {error}): it was changed"]


def _text(file: Path, content: Content, raw: bytes) -> Iterator[str]:
    """Whether the file prints its content and nothing else."""
    expected, program = certificate_file(content, file.suffix.lower()), content["program"]
    if raw == expected:
        return
    if program != (own := code_version()):
        yield f"its text is not what {own} prints of its content: check it with {program}"
        return
    pairs = zip(raw, expected, strict=False)
    at = next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(raw), len(expected)))
    changed = raw[max(0, at - 20) : at + 20].decode("utf-8", "replace")
    yield f"its text is not that of its content, from byte {at} ({changed!r}): it was changed"


def _files(base: Path, content: Content) -> Iterator[str]:
    """Whether the input files are those that the certificate names."""
    for stated in content["files"]:
        name = stated["name"]
        try:
            own = hashed(base, name)
        except OSError as error:
            yield f"{base / name}: {error.strerror}; name the folder of the inputs with --inputs"
            continue
        if own.sha256 != stated["sha256"] or own.size != stated["size"]:
            yield f"{name}: is not the file that was certified ({own.sha256[:16]} ...)"


def _recomputed(base: Path, content: Content, listener: Listener) -> Iterator[str]:
    """Whether the input files give the content again."""
    paths = base / content["result_file"], base / content["details_file"]
    try:
        again, _ = certificate_content(
            *paths, base=base, locale=content["locale"], listener=listener
        )
    except (InputError, RuntimeError) as error:
        yield f"it cannot be recomputed: {error}"
        return
    stated = {key: value for key, value in content.items() if key not in ("program", "base")}
    del again["program"]
    yield from unlike(stated, again)


def unlike(stated: Any, computed: Any, place: str = "") -> Iterator[str]:
    """Places where stated plain data is not what was computed, beyond the last bits of numbers."""
    if isinstance(stated, dict) and isinstance(computed, dict):
        for key in dict.fromkeys((*stated, *computed)):
            if key not in stated or key not in computed:
                yield f"{place}{key}: {'stated' if key in stated else 'computed'} alone"
            else:
                yield from unlike(stated[key], computed[key], f"{place}{key}: ")
    elif isinstance(stated, list) and isinstance(computed, list) and len(stated) == len(computed):
        for k, pair in enumerate(zip(stated, computed, strict=True)):
            yield from unlike(*pair, f"{place}{k + 1}: ")
    elif isinstance(stated, float) and isinstance(computed, float):
        if not math.isclose(stated, computed, rel_tol=LAST_BITS, abs_tol=1e-12):
            yield f"{place}states {stated:.6g}, computed {computed:.6g}"
    elif type(stated) is not type(computed) or stated != computed:
        yield f"{place}states {stated!r}, computed {computed!r}"
