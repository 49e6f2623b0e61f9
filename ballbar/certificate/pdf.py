"""A certificate as a PDF file: the elements of the HTML file, with the content attached.

It depends on nothing but the content: a check writes it again and compares bytes. Text stays text,
in the standard fonts of PDF, so that it can be searched and copied.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from itertools import zip_longest
from unicodedata import normalize
from xml.etree.ElementTree import Element, fromstring

from fpdf import FPDF, FontFace
from fpdf.errors import FPDFUnicodeEncodingException

from ballbar.cell.errors import InputError
from ballbar.certificate.content import Content, canonical, digest_of
from ballbar.certificate.html import document
from ballbar.certificate.words import Words

LEFT, TOP, BOTTOM = 16.0, 14.0, 20.0  # [mm]
LINE = 1.32 * 25.4 / 72.0  # [mm per point]
QUIET, ACCENT, FAINT = "#5c6873", "#1f4e79", "#d5dce1"
STYLES = {
    "title": FontFace(emphasis="BOLD", color=ACCENT),
    "": FontFace(color="#1d2a35"),
    "label": FontFace(color=QUIET),
    "missing": FontFace(color="#a04000"),
    "head": FontFace(emphasis="BOLD", color=QUIET),
    "good": FontFace(emphasis="BOLD", color="#12603f"),
    "bad": FontFace(emphasis="BOLD", color="#8f1d17"),
    "open": FontFace(emphasis="BOLD", color="#7a5300"),
}
# size [points], style, and room above [mm] of elements, and of classes
TEXTS = {
    "h1": (20.0, "title", 0.0),
    "h2": (10.0, "title", 3.0),
    "p": (7.5, "label", 0.0),
    "subtitle": (10.0, "label", 0.0),
    "warning": (10.0, "bad", 0.0),
    "signature": (7.5, "label", 15.0),
}
OPENING, CLOSING = b"stream\n{", b"\nendstream"  # of the attached content
Row = list[tuple[str, str]]  # text and style of each cell


def pdf(content: Content) -> bytes:
    """The file. Raises InputError for letters that the standard fonts lack."""
    body = fromstring(document(content)).find("body")
    assert body is not None
    pages = _Pages(content)
    pages.embed_file(
        bytes=canonical(content), basename="certificate.json", mime_type="application/json"
    )
    try:
        for part in body:
            with pages.offset_rendering() as trial:
                trial.draw(part)
            if trial.page_break_triggered:
                pages.add_page()
            pages.draw(part)
        return bytes(pages.output())
    except FPDFUnicodeEncodingException as error:
        letter = error.character
        raise InputError(
            f"the letter {letter!r} (U+{ord(letter):04X}) is not in the standard fonts of PDF. "
            "Write it in Latin letters, or make the certificate as HTML alone (--out NAME.html)."
        ) from None


class _Pages(FPDF):
    """Pages that are filled from the top; lengths in mm, sizes of fonts in points."""

    def __init__(self, content: Content) -> None:
        super().__init__()
        self.words, number = Words(content["locale"]), content["details"]["number"]
        self.heading = " ".join(filter(None, (self.words("title"), number)))
        self.digest = f"{self.words('content_digest')}: {digest_of(content)[:16]}"
        self.core_fonts_encoding, self.c_margin = "windows-1252", 0.0
        self.set_creation_date(datetime(1970, 1, 1, tzinfo=UTC))  # the same for everyone
        self.set_compression(False)
        self.set_margins(LEFT, TOP)
        self.set_auto_page_break(True, BOTTOM)
        self.set_title(self.heading)
        self.set_lang(content["locale"])
        self.add_page()

    def draw(self, part: Element) -> None:
        """A part of the document from here on."""
        kind = part.get("class", "")
        if part.tag in TEXTS:
            size, style, above = TEXTS.get(kind) or TEXTS[part.tag]
            self.ln(above)
            if kind == "signature":
                self.rule(QUIET, 80.0)
            self.rows([[(_text(part), style)]], (1.0,), size)
            if part.tag == "h2":
                self.rule(FAINT)
        elif kind == "halves":
            self.halves([_text(heading) for heading in part.iter("h2")], part.iter("table"))
        elif part.tag == "table":
            widths = [float(column.get("style", "").split()[1][:-1]) for column in part.iter("col")]
            small = 6.3 if "small" in kind else 8.5
            self.rows(_rows(part), widths or (0.3, 0.7), small, ruled="ruled" in kind)
            self.ln(1.0)
        else:
            for element in part:
                self.draw(element)
            if part.tag == "header":
                self.ln(1.0)
                self.rule(ACCENT, thick=0.7)
                self.ln(1.0)

    def halves(self, headings: Sequence[str], tables: Iterable[Element]) -> None:
        """Two tables beside each other."""
        if headings:
            self.ln(3.0)
            self.rows([[(text, "title") for text in headings]], (0.52, 0.48), 10.0)
            self.rule(FAINT)
        pairs = zip_longest(*map(_rows, tables), fillvalue=[("", ""), ("", "")])
        rows = [[*left, ("", ""), *right] for left, right in pairs]
        self.rows(rows, (0.19, 0.29, 0.04, 0.19, 0.29), 8.5)

    def rows(
        self, rows: Sequence[Row], widths: Sequence[float], size: float, *, ruled: bool = False
    ) -> None:
        """Rows over the whole width."""
        self.set_font("Helvetica", size=size)
        high = LINE * size
        with self.table(
            borders_layout="HORIZONTAL_LINES" if ruled else "NONE",
            col_widths=widths,
            first_row_as_headings=False,
            line_height=high,
            padding=(0.2 * high, 0.0) if ruled else (0.0, 0.5, 0.3, 0.0),
            text_align=("LEFT", *["RIGHT" if ruled else "LEFT"] * len(widths)),
            v_align="BOTTOM" if ruled else "TOP",
        ) as table:
            for row in rows:
                cells = table.row()
                for text, style in row:
                    cells.cell(text, style=STYLES[style])

    def rule(self, colour: str, width: float | None = None, thick: float = 0.2) -> None:
        """A line from the left margin on."""
        self.set_draw_color(colour)
        self.set_line_width(thick)
        self.line(LEFT, self.y, LEFT + (width or self.epw), self.y)
        self.set_line_width(0.2)
        self.ln(0.8)

    def footer(self) -> None:
        """Number, page and digest at the foot of a page."""
        number = self.words("page", page=self.page_no(), pages="{nb}")
        self.set_auto_page_break(False)
        self.y = self.h - BOTTOM + 3.0
        self.rule(FAINT)
        row = [(text, "label") for text in (self.heading, number, self.digest)]
        self.rows([row], (0.4, 0.2, 0.4), 7.0, ruled=True)
        self.set_auto_page_break(True, BOTTOM)


def _rows(table: Element) -> list[Row]:
    """Text and style of each cell of a table."""
    return [[(_text(cell), cell.get("class", "")) for cell in row] for row in table.iter("tr")]


def _text(element: Element) -> str:
    """Its text; an en dash looks like a minus sign, and the fonts have it."""
    return normalize("NFC", element.text or "").replace("\u2212", "\u2013")
