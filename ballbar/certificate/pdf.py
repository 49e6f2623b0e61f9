"""A certificate as a PDF file (ISO 32000-1), written object by object.

Text stays text, in the standard fonts Helvetica and Helvetica-Bold with their letters of
Windows-1252, so that it can be searched and copied, and the file depends on nothing but its
content: a check writes it again and compares bytes. The content itself is an attached file. Widths
are Adobe's font metrics, which Matplotlib ships.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path

import matplotlib as mpl
from matplotlib.ft2font import FT2Font

from ballbar.cell.errors import InputError
from ballbar.certificate.page import Page, Panel, Row

MM = 72.0 / 25.4  # points
WIDTH, HEIGHT = 210.0 * MM, 297.0 * MM
LEFT, TOP, BOTTOM, GAP = 16.0 * MM, 15.0 * MM, 18.0 * MM, 8.0 * MM
INNER = WIDTH - 2.0 * LEFT
LEADING = 1.32
REGULAR, BOLD = "Helvetica", "Helvetica-Bold"
INK, QUIET, ACCENT, LINE = "0.11 0.16 0.21", "0.36 0.41 0.45", "0.12 0.31 0.47", "0.82 0.85 0.88"
COLOURS = {"missing": "0.63 0.25 0", "good": "0.07 0.38 0.25", "bad": "0.56 0.11 0.09"}
COLOURS |= {"open": "0.48 0.33 0", "": INK}
OPENING, CLOSING = b"stream\n{", b"\nendstream"  # of the attached content, the first stream
_FIRST = 8  # number of the first page's object
_MINUS = str.maketrans("\u2212", "\u2013")  # an en dash looks like it, and the fonts have it
_SPACES = {"nonbreakingspace": "space", "sfthyphen": "hyphen"}
Part = tuple[float, str]  # height, and operators below a base of 0: what no page end tears


def pdf(page: Page, content: bytes) -> bytes:
    """The file; content : canonical JSON, which is attached as it is.

    Raises InputError for letters that the standard fonts lack.
    """
    sheets, panels = _Sheets(), list(page.panels)
    sheets.put(_head(page))
    while panels:
        panel = panels.pop(0)
        columns = [panel, panels.pop(0)] if panel.half else [panel]
        width = (INNER - GAP * (len(columns) - 1)) / len(columns)
        places = [LEFT + k * (width + GAP) for k in range(len(columns))]
        sheets.put(*(_panel(page, p, x, width) for p, x in zip(columns, places, strict=True)))
    return _file(page, sheets.pages, content)


class _Sheets:
    """Operators of pages that are filled from the top."""

    def __init__(self) -> None:
        self.pages, self.y = [""], HEIGHT - TOP

    def put(self, *columns: Sequence[Part]) -> None:
        """Place columns of parts beside each other, on one page where they fit on one."""
        height = max(sum(part[0] for part in column) for column in columns)
        self._room(height if height < HEIGHT - TOP - BOTTOM else 60.0)
        end = self.y
        for column in columns:
            start = self.y
            for high, operators in column:
                if len(columns) == 1:
                    self._room(high)
                self.pages[-1] += f"q 1 0 0 1 0 {self.y:.2f} cm\n{operators}Q\n"
                self.y -= high
            self.y, end = start if len(columns) > 1 else self.y, min(end, self.y)
        self.y = end

    def _room(self, height: float) -> None:
        if self.y - height < BOTTOM and self.pages[-1]:
            self.pages.append("")
            self.y = HEIGHT - TOP


def _text(x: float, down: float, text: str, size: float, font: str, colour: str) -> str:
    """Operators of a line of text."""
    code = text.translate(_MINUS).encode("cp1252")
    plain = "".join(chr(c) if 31 < c < 127 and c not in b"()\\" else f"\\{c:03o}" for c in code)
    name = "F2" if font == BOLD else "F1"
    return f"BT /{name} {size:g} Tf {colour} rg {x:.2f} {-down:.2f} Td ({plain}) Tj ET\n"


def _rule(x: float, down: float, width: float, colour: str = LINE, thick: float = 0.6) -> str:
    end = f"{x + width:.2f} {-down:.2f}"
    return f"{colour} RG {thick} w {x:.2f} {-down:.2f} m {end} l S\n"


def _head(page: Page) -> list[Part]:
    half = (INNER - GAP) / 2.0
    left = _text(LEFT, 17.0, page.title, 20.0, BOLD, ACCENT)
    left += _text(LEFT, 33.0, page.subtitle, 10.0, REGULAR, QUIET)
    rows, height = "", 0.0
    for high, operators in _rows(page.head, LEFT + half + GAP, half, 8.5):
        rows += f"q 1 0 0 1 0 {-height:.2f} cm\n{operators}Q\n"
        height += high
    height = max(height + 4.0, 42.0)
    parts = [(height + 4.0, left + rows + _rule(LEFT, height, INNER, ACCENT, 2.0))]
    return [*parts, *_lines(page.warning, LEFT, INNER, 10.0, BOLD, COLOURS["bad"])]


def _panel(page: Page, panel: Panel, x: float, width: float) -> list[Part]:
    title = _text(x, 17.0, panel.heading, 10.0, BOLD, ACCENT)
    parts: list[Part] = [(23.0, title + _rule(x, 20.5, width))]
    size = 6.3 if panel.small else 8.5
    parts += _rows(panel.pairs, x, width, min(8.5, size + 1.7))
    parts += [(4.0, ""), *_rows(panel.table, x, width, size)]
    for text in panel.texts:
        parts += [(3.0, ""), *_lines(text, x, width, 7.5, REGULAR, QUIET)]
    if panel.signed:
        words = _text(x, 52.0, page.words("signature"), 7.5, REGULAR, QUIET)
        parts.append((54.0, _rule(x, 43.0, 80.0 * MM, INK) + words))
    return parts


def _rows(rows: Iterable[Row], x: float, width: float, size: float) -> Iterator[Part]:
    """Rows of cells: pairs without a line, tables with a line below each row."""
    for row in rows:
        left, drawn, count = x, "", 1
        for k, (cell, share) in enumerate(zip(row.cells, row.widths, strict=True)):
            own, colour = REGULAR, COLOURS[row.mark] if k == len(row.cells) - 1 else INK
            if row.head or (row.mark and row.ruled and colour != INK):
                own, colour = BOLD, QUIET if row.head else colour
            elif not row.ruled and k == 0:
                colour = QUIET
            lines = wrapped(cell, share * width - 5.0, size, own)
            for number, line in enumerate(lines):
                shift = share * width - text_width(line, size, own) if row.ruled and k else 0.0
                down = (number + 0.9) * size * LEADING + 2.0 * row.ruled
                drawn += _text(left + shift, down, line, size, own, colour)
            left, count = left + share * width, max(count, len(lines))
        height = count * size * LEADING + (1.0 if not row.ruled else 0.6 * size)
        line = _rule(x, height - 0.5, width, QUIET if row.head else LINE) if row.ruled else ""
        yield height, drawn + line


def _lines(text: str, x: float, width: float, size: float, font: str, ink: str) -> Iterator[Part]:
    for line in wrapped(text, width, size, font) if text else ():
        yield size * LEADING, _text(x, 0.9 * size * LEADING, line, size, font, ink)


def wrapped(text: str, width: float, size: float, font: str) -> list[str]:
    """Lines of a text within a width [points]; a word that is longer is torn."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if text_width(longer, size, font) <= width:
            lines[-1] = longer
            continue
        lines += [""] if lines[-1] else []
        for letter in word:
            lines += [""] if text_width(lines[-1] + letter, size, font) > width else []
            lines[-1] += letter
    return lines


def text_width(text: str, size: float, font: str) -> float:
    """[points] of a line of text. Raises InputError for a letter that Windows-1252 lacks."""
    return size * sum(_width(letter, font) for letter in text.translate(_MINUS))


@cache
def _width(letter: str, font: str) -> float:
    """Width of a letter, as a share of the font's size."""
    names, widths = _metrics(font)
    try:
        letter.encode("cp1252")
    except UnicodeEncodeError:
        raise InputError(
            f"the letter {letter!r} (U+{ord(letter):04X}) is not in the standard fonts of PDF. "
            "Write it in Latin letters, or make the certificate as HTML alone (--out NAME.html)."
        ) from None
    name = names.get_glyph_name(names.get_char_index(ord(letter)))  # both fonts name them so
    return widths[_SPACES.get(name, name)]


@cache
def _metrics(font: str) -> tuple[FT2Font, dict[str, float]]:
    """A font that knows the names of glyphs, and the widths of a standard font by these names."""
    fonts = Path(mpl.get_data_path(), "fonts")
    metrics = (fonts / "pdfcorefonts" / f"{font}.afm").read_text("latin-1")
    entries = re.findall(r"^C -?\d+ ; WX (\d+) ; N (\w+) ;", metrics, re.MULTILINE)
    names = FT2Font(str(fonts / "ttf" / "DejaVuSans.ttf"))
    return names, {name: int(width) / 1000.0 for width, name in entries}


def _foot(page: Page, number: int, count: int) -> str:
    """Number, digest and page at the foot of a page."""
    last = page.words("page", page=str(number), pages=str(count))
    middle = f"{page.words('content_digest')}: {page.digest[:16]}"
    right, centred = (INNER - text_width(text, 7.0, REGULAR) for text in (last, middle))
    places = ((0.0, page.title_and_number), (centred / 2.0, middle), (right, last))
    texts = "".join(_text(LEFT + x, 11.0, text, 7.0, REGULAR, QUIET) for x, text in places)
    return f"q 1 0 0 1 0 {BOTTOM - 8.0:.2f} cm\n{_rule(LEFT, 0.0, INNER)}{texts}Q\n"


def _file(page: Page, pages: Sequence[str], content: bytes) -> bytes:
    """Catalog, pages, fonts, attached content, and the table of places."""
    kids = " ".join(f"{_FIRST + 2 * k} 0 R" for k in range(len(pages)))
    title = "FEFF" + page.title_and_number.encode("utf-16-be").hex().upper()
    font = "/Type /Font /Subtype /Type1 /Encoding /WinAnsiEncoding /BaseFont"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /Names << /EmbeddedFiles << /Names [(certificate.json) "
        b"6 0 R] >> >> /Lang (%b) >>" % page.words.locale.encode(),
        f"<< /Type /Pages /Count {len(pages)} /Kids [{kids}] /MediaBox [0 0 {WIDTH:.2f} "
        f"{HEIGHT:.2f}] /Resources << /Font << /F1 3 0 R /F2 4 0 R >> >> >>".encode(),
        *(f"<< {font} /{name} >>".encode() for name in (REGULAR, BOLD)),
        f"<< /Title <{title}> /Producer (ballbar-bench) >>".encode(),
        b"<< /Type /Filespec /F (certificate.json) /EF << /F 7 0 R >> >>",
        _stream(content, b"/Type /EmbeddedFile /Subtype /application#2Fjson "),
    ]
    for k, operators in enumerate(pages):
        objects.append(b"<< /Type /Page /Parent 2 0 R /Contents %d 0 R >>" % (_FIRST + 2 * k + 1))
        objects.append(_stream((operators + _foot(page, k + 1, len(pages))).encode()))
    out, places = b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n", b""
    for number, body in enumerate(objects, start=1):
        places += b"%010d 00000 n \n" % len(out)
        out += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    size, end = len(objects) + 1, b"startxref\n%d\n%%%%EOF\n" % len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n%b" % (size, places)
    return out + b"trailer\n<< /Size %d /Root 1 0 R /Info 5 0 R >>\n%b" % (size, end)


def _stream(content: bytes, entries: bytes = b"") -> bytes:
    return b"<< %b/Length %d >>\nstream\n%b\nendstream" % (entries, len(content), content)
