"""Letters of a PDF file: the standard fonts' own, and outlines for all others.

Every viewer has Windows-1252 in Helvetica; widths are those of Adobe's font metrics. Letters beyond
it, such as those of Polish or Greek names, are drawn by their outlines in DejaVu Sans, as a font of
type 3 in the file itself. Matplotlib ships both fonts.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font
from matplotlib.textpath import TextPath

from ballbar.cell.errors import InputError

REGULAR, BOLD = "Helvetica", "Helvetica-Bold"
_DEJAVU = Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
_ENTRY = re.compile(r"^C -?\d+ ; WX (\d+) ; N (\w+) ;", re.MULTILINE)
_SPACES = {"nonbreakingspace": "space", "sfthyphen": "hyphen"}
_MINUS = str.maketrans("\u2212", "\u2013")  # an en dash, which the standard fonts have, looks so
_EM = 1000  # units of an outline


@cache
def _outlines() -> FT2Font:
    font = FT2Font(str(_DEJAVU))
    font.set_size(_EM, 72)
    return font


@cache
def _widths(font: str) -> dict[str, float]:
    """Width of each glyph of a standard font by its name, as a share of the font's size."""
    file = Path(mpl.get_data_path(), "fonts", "pdfcorefonts", f"{font}.afm")
    return {name: int(w) / 1000.0 for w, name in _ENTRY.findall(file.read_text("latin-1"))}


@cache
def _width(letter: str, font: str) -> float:
    """Share of the font's size. Raises InputError for a letter that no font here has."""
    outlines = _outlines()
    if not (index := outlines.get_char_index(ord(letter))):
        raise InputError(
            f"the letter {letter!r} (U+{ord(letter):04X}) is not in the fonts of PDF certificates. "
            "Write it in other letters, or make the certificate as HTML alone (--out NAME.html)."
        )
    if _standard(letter) is None:
        return float(outlines.load_char(ord(letter)).linearHoriAdvance / 65536.0 / _EM)
    name = outlines.get_glyph_name(index)  # those of both fonts are named alike
    return _widths(font)[_SPACES.get(name, name)]


def _standard(letter: str) -> int | None:
    """Code of a letter in Windows-1252; None where it has none."""
    try:
        return letter.encode("cp1252")[0]
    except UnicodeEncodeError:
        return None


def text_width(text: str, size: float, font: str) -> float:
    """[points] of a line of text."""
    return size * sum(_width(letter, font) for letter in text.translate(_MINUS))


@dataclass
class Letters:
    """The letters beyond Windows-1252 that a file uses, by their code in its own font."""

    codes: dict[str, int] = field(default_factory=dict)

    def operators(self, text: str, size: float, font: str) -> str:
        """Operators that show a text: runs in a standard font F1 or F2, and in the file's own F3.

        Raises InputError for more letters than a font takes.
        """
        own, shown, current = "F2" if font == BOLD else "F1", "", ""
        for letter in text.translate(_MINUS):
            code, name = _standard(letter), own
            if code is None:
                code, name = self.codes.setdefault(letter, len(self.codes) + 1), "F3"
            if code > 255:
                raise InputError("more than 255 letters beyond Windows-1252; write fewer.")
            if name != current:
                shown += f"{') Tj ' if current else ''}/{name} {size:g} Tf ("
                current = name
            plain = " " <= letter <= "~" and letter not in "()\\"
            shown += letter if plain else f"\\{code:03o}"
        return f"{shown}) Tj" if current else ""

    def font(self, first: int) -> dict[int, bytes]:
        """Objects of the file's own font F3, the font itself with the number `first`."""
        count = len(self.codes)
        named = {letter: f"u{ord(letter):04X}" for letter in self.codes}
        widths = [_width(letter, REGULAR) * _EM for letter in self.codes]
        listed = " ".join(f"/{name}" for name in named.values())
        places = " ".join(f"/{name} {first + 2 + k} 0 R" for k, name in enumerate(named.values()))
        pairs = "\n".join(
            f"<{code:02X}> <{letter.encode('utf-16-be').hex().upper()}>"
            for letter, code in self.codes.items()
        )
        unicode = (
            "/CIDInit /ProcSet findresource begin 12 dict begin begincmap /CMapName /F3 def "
            "/CMapType 2 def 1 begincodespacerange <00> <FF> endcodespacerange "
            f"{count} beginbfchar\n{pairs}\nendbfchar endcmap end end"
        )
        fonts = (
            f"<< /Type /Font /Subtype /Type3 /FontBBox [-1100 -500 2500 1300] "
            f"/FontMatrix [{1 / _EM} 0 0 {1 / _EM} 0 0] /FirstChar 1 /LastChar {count} "
            f"/Widths [{' '.join(f'{w:.1f}' for w in widths)}] /Resources << >> "
            f"/Encoding << /Type /Encoding /Differences [1 {listed}] >> "
            f"/CharProcs << {places} >> /ToUnicode {first + 1} 0 R >>"
        )
        objects = {first: fonts.encode(), first + 1: stream(unicode.encode())}
        for k, (letter, width) in enumerate(zip(named, widths, strict=True)):
            outline = f"{width:.1f} 0 -1100 -500 2500 1300 d1\n{_outline(letter)}f"
            objects[first + 2 + k] = stream(outline.encode())
        return objects


def stream(content: bytes, entries: bytes = b"") -> bytes:
    """A stream object of PDF."""
    return b"<< %b/Length %d >>\nstream\n%b\nendstream" % (entries, len(content), content)


def _outline(letter: str) -> str:
    """Path operators of a letter's outline."""
    path, text, last = TextPath((0, 0), letter, _EM, FontProperties(fname=_DEJAVU)), "", np.zeros(2)
    for points, code in path.iter_segments(curves=True, simplify=False):
        ends = points.reshape(-1, 2)
        if code == path.CURVE3:  # PDF has cubic curves alone
            ends = np.array(
                [last + (ends[0] - last) / 1.5, ends[1] + (ends[0] - ends[1]) / 1.5, ends[1]]
            )
        if code == path.CLOSEPOLY:
            text += "h\n"
            continue
        operator = {path.MOVETO: "m", path.LINETO: "l"}.get(code, "c")
        text += " ".join(f"{value:.1f}" for value in ends.ravel()) + f" {operator}\n"
        last = ends[-1]
    return text
