"""A certificate as a PDF file (ISO 32000-1), written object by object.

Text stays text, in the standard fonts Helvetica and Helvetica-Bold, so that it can be searched and
copied, and the file depends on nothing but its content: a check writes it again and compares bytes.
The content itself is an attached file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from ballbar.certificate.fonts import BOLD, REGULAR, Letters, stream, text_width
from ballbar.certificate.page import Block, Page, Pair

MM = 72.0 / 25.4  # points
WIDTH, HEIGHT = 210.0 * MM, 297.0 * MM
LEFT, TOP, BOTTOM, GAP = 16.0 * MM, 15.0 * MM, 18.0 * MM, 8.0 * MM
INNER = WIDTH - 2.0 * LEFT
LEADING = 1.32
_FIRST = 8  # number of the first page's object
OPENING, CLOSING = b"stream\n{", b"\nendstream"  # of the attached content, the first stream
INK, QUIET, ACCENT = "0.11 0.16 0.21", "0.36 0.41 0.45", "0.12 0.31 0.47"
LINE, MISSING = "0.82 0.85 0.88", "0.63 0.25 0.00"
VERDICTS = {"good": "0.07 0.38 0.25", "bad": "0.56 0.11 0.09", "open": "0.48 0.33 0.00"}


@dataclass(frozen=True)
class Text:
    """A line of text whose base line is `down` below the top of its part [points]."""

    x: float
    down: float
    text: str
    size: float
    font: str = REGULAR
    colour: str = INK


@dataclass(frozen=True)
class Stroke:
    """A horizontal line."""

    x: float
    down: float
    width: float
    colour: str = LINE
    thick: float = 0.6


@dataclass(frozen=True)
class Part:
    """What is not torn by the end of a page: its height, and what it draws."""

    height: float
    drawn: tuple[Text | Stroke, ...] = ()


@dataclass
class _Sheets:
    """Pages that are filled from the top."""

    letters: Letters = field(default_factory=Letters)
    pages: list[list[str]] = field(default_factory=lambda: [[]])
    y: float = HEIGHT - TOP

    def room(self, height: float) -> None:
        """Begin another page where there is no room for so much."""
        if self.y - height < BOTTOM and self.pages[-1]:
            self.pages.append([])
            self.y = HEIGHT - TOP

    def put(self, parts: Sequence[Part]) -> None:
        """Place parts below each other, on one page where they fit on one."""
        whole = sum(part.height for part in parts)
        self.room(whole if whole < HEIGHT - TOP - BOTTOM else parts[0].height + 40.0)
        for part in parts:
            self.room(part.height)
            self.draw(part, self.y)
            self.y -= part.height

    def beside(self, left: Sequence[Part], right: Sequence[Part]) -> None:
        """Place two columns beside each other."""
        heights = [sum(part.height for part in column) for column in (left, right)]
        self.room(max(heights))
        for column in (left, right):
            y = self.y
            for part in column:
                self.draw(part, y)
                y -= part.height
        self.y -= max(heights)

    def draw(self, part: Part, y: float) -> None:
        """Operators of a part with its top at y."""
        for item in part.drawn:
            x, base = f"{item.x:.2f}", f"{y - item.down:.2f}"
            if isinstance(item, Stroke):
                end = f"{item.x + item.width:.2f}"
                op = f"{item.colour} RG {item.thick} w {x} {base} m {end} {base} l S"
            else:
                shown = self.letters.operators(item.text, item.size, item.font)
                op = f"BT {item.colour} rg {x} {base} Td {shown} ET"
            self.pages[-1].append(op)


def pdf(page: Page, content: bytes) -> bytes:
    """The file; content : canonical JSON, which is attached as it is.

    Raises InputError for letters that the standard fonts lack.
    """
    sheets = _Sheets()
    sheets.put(_head(page))
    blocks = list(page.blocks)
    while blocks:
        block = blocks.pop(0)
        if block.half and blocks and blocks[0].half:
            half = (INNER - GAP) / 2.0
            right = _block(page, blocks.pop(0), LEFT + half + GAP, half)
            sheets.beside(_block(page, block, LEFT, half), right)
        else:
            sheets.put(_block(page, block, LEFT, INNER))
    _feet(page, sheets)
    return _file(page, sheets, content)


def _head(page: Page) -> list[Part]:
    left = [Text(LEFT, 17.0, page.title, 20.0, BOLD, ACCENT)]
    left.append(Text(LEFT, 33.0, page.subtitle, 10.0, REGULAR, QUIET))
    half = (INNER - GAP) / 2.0
    drawn: list[Text | Stroke] = [*left]
    down = 0.0
    for part in _pairs(page, page.head, LEFT + half + GAP, half, 8.5):
        drawn += [_lowered(item, down) for item in part.drawn]
        down += part.height
    height = max(42.0, down + 4.0)
    drawn.append(Stroke(LEFT, height, INNER, ACCENT, 2.0))
    parts = [Part(height + 4.0, tuple(drawn))]
    if page.warning:
        parts += _lines(page.warning, LEFT, INNER, 10.0, BOLD, VERDICTS["bad"])
    return parts


def _lowered(item: Text | Stroke, down: float) -> Text | Stroke:
    if isinstance(item, Stroke):
        return Stroke(item.x, item.down + down, item.width, item.colour, item.thick)
    return Text(item.x, item.down + down, item.text, item.size, item.font, item.colour)


def _block(page: Page, block: Block, x: float, width: float) -> list[Part]:
    heading = Text(x, 17.0, block.heading, 10.0, BOLD, ACCENT)
    parts = [Part(23.0, (heading, Stroke(x, 20.5, width)))]
    parts += _pairs(page, block.pairs, x, width, 8.0 if block.small else 8.5)
    if block.rows:
        parts += [Part(4.0 if block.pairs else 0.0)]
        parts += _table(block, x, width)
    for text in block.texts:
        parts += [Part(3.0), *_lines(text, x, width, 7.5, REGULAR, QUIET)]
    if block.signed:
        words = Text(x, 52.0, page.words("signature"), 7.5, REGULAR, QUIET)
        parts.append(Part(54.0, (Stroke(x, 43.0, 80.0 * MM, INK), words)))
    return parts


def _pairs(page: Page, pairs: Sequence[Pair], x: float, width: float, size: float) -> list[Part]:
    """Labels in one column, values in the other."""
    share = 0.4 if width < INNER else 0.3
    parts = []
    for label, value in pairs:
        colour = INK if value is not None else MISSING
        shown = page.words("missing") if value is None else value
        columns = ((label, x, share * width - 6.0, QUIET), (shown, x + share * width, 0.0, colour))
        drawn, rows = [], 1
        for text, left, room, ink in columns:
            lines = wrapped(text, room or (1.0 - share) * width, size, REGULAR)
            rows = max(rows, len(lines))
            drawn += [
                Text(left, (k + 0.9) * size * LEADING, line, size, REGULAR, ink)
                for k, line in enumerate(lines)
            ]
        parts.append(Part(rows * size * LEADING + 1.0, tuple(drawn)))
    return parts


def _table(block: Block, x: float, width: float) -> Iterator[Part]:
    """Head and rows; the first column from its left, all others to their right."""
    size = 6.3 if block.small else 8.5
    yield _row(block, block.head, x, width, 6.3 if block.small else 7.5, QUIET, BOLD)
    for k, row in enumerate(block.rows):
        colour = VERDICTS[block.verdicts[k]] if block.verdicts else INK
        yield _row(block, row, x, width, size, colour, REGULAR)


def _row(
    block: Block, cells: Sequence[str], x: float, width: float, size: float, colour: str, font: str
) -> Part:
    drawn: list[Text | Stroke] = []
    left, rows = x, 1
    for k, (cell, share) in enumerate(zip(cells, block.widths, strict=True)):
        marked = k == len(cells) - 1 or font == BOLD
        style = BOLD if marked and colour != INK else font
        lines = wrapped(cell, share * width - 4.0, size, style)
        rows = max(rows, len(lines))
        for number, line in enumerate(lines):
            shift = share * width - text_width(line, size, style) if k else 0.0
            base = (number + 1.0) * size * LEADING
            drawn.append(Text(left + shift, base, line, size, style, colour if marked else INK))
        left += share * width
    height = rows * size * LEADING + (2.5 if block.small else 5.0)
    drawn.append(Stroke(x, height - 0.5, width, QUIET if font == BOLD else LINE))
    return Part(height, tuple(drawn))


def _lines(text: str, x: float, width: float, size: float, font: str, colour: str) -> list[Part]:
    return [
        Part(size * LEADING, (Text(x, 0.9 * size * LEADING, line, size, font, colour),))
        for line in wrapped(text, width, size, font)
    ]


def wrapped(text: str, width: float, size: float, font: str) -> list[str]:
    """Lines of a text within a width [points]; a word that is longer is torn."""
    lines, line = [], ""
    for word in text.split(" "):
        if line and text_width(f"{line} {word}", size, font) > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
        while text_width(line, size, font) > width and len(line) > 1:
            fits = 1
            while text_width(line[: fits + 1], size, font) <= width:
                fits += 1
            lines.append(line[:fits])
            line = line[fits:]
    return [*lines, line]


def _feet(page: Page, sheets: _Sheets) -> None:
    """Number, digest and page at the foot of each page."""
    count = str(len(sheets.pages))
    title = " ".join(filter(None, (page.title, page.number)))
    middle = f"{page.words('content_digest')}: {page.digest[:16]}"
    for k, operators in enumerate(sheets.pages):
        number = page.words("page", page=str(k + 1), pages=count)
        right, centred = (INNER - text_width(t, 7.0, REGULAR) for t in (number, middle))
        texts = ((0.0, title), (centred / 2.0, middle), (right, number))
        lines = (Text(LEFT + x, 11.0, text, 7.0, REGULAR, QUIET) for x, text in texts)
        foot = _Sheets(sheets.letters, [operators])
        foot.draw(Part(0.0, (Stroke(LEFT, 0.0, INNER), *lines)), BOTTOM - 8.0)


def _file(page: Page, sheets: _Sheets, content: bytes) -> bytes:
    """Catalog, pages, fonts, attached content, and the table of places."""
    count = len(sheets.pages)
    kids = " ".join(f"{_FIRST + 2 * k} 0 R" for k in range(count))
    own = sheets.letters.font(_FIRST + 2 * count) if sheets.letters.codes else {}
    extra = f" /F3 {min(own)} 0 R" if own else ""
    title = "FEFF" + page.title.encode("utf-16-be").hex().upper()
    encoding = "/Encoding /WinAnsiEncoding"
    objects = (
        "<< /Type /Catalog /Pages 2 0 R /Names << /EmbeddedFiles << /Names "
        f"[(certificate.json) 6 0 R] >> >> /Lang ({page.words.locale}) "
        "/ViewerPreferences << /DisplayDocTitle true >> >>",
        f"<< /Type /Pages /Count {count} /Kids [{kids}] /MediaBox [0 0 {WIDTH:.2f} {HEIGHT:.2f}] "
        f"/Resources << /Font << /F1 3 0 R /F2 4 0 R{extra} >> >> >>",
        f"<< /Type /Font /Subtype /Type1 /BaseFont /{REGULAR} {encoding} >>",
        f"<< /Type /Font /Subtype /Type1 /BaseFont /{BOLD} {encoding} >>",
        f"<< /Title <{title}> /Producer (ballbar-bench) >>",
        "<< /Type /Filespec /F (certificate.json) /UF (certificate.json) /EF << /F 7 0 R >> >>",
    )
    numbered = {k: text.encode() for k, text in enumerate(objects, start=1)}
    numbered[7] = stream(content, b"/Type /EmbeddedFile /Subtype /application#2Fjson ")
    for k, operators in enumerate(sheets.pages):
        at = _FIRST + 2 * k
        numbered[at] = f"<< /Type /Page /Parent 2 0 R /Contents {at + 1} 0 R >>".encode()
        numbered[at + 1] = stream("\n".join(operators).encode())
    return _assembled(numbered | own)


def _assembled(objects: dict[int, bytes]) -> bytes:
    """The file of numbered objects, the first the catalog and the fifth the information."""
    out, places = b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n", []
    for number, body in objects.items():
        places.append(len(out))
        out += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    start, count = len(out), len(objects) + 1
    out += b"xref\n0 %d\n0000000000 65535 f \n" % count
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    return out + (
        b"trailer\n<< /Size %d /Root 1 0 R /Info 5 0 R >>\nstartxref\n%d\n%%%%EOF\n"
        % (count, start)
    )
