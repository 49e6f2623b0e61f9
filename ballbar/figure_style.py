"""Style of all figures: colours, frame and grid; and a figure as the text of an SVG file."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType

INK, QUIET, FAINT, GRID = "#22303c", "#66727d", "#c4ccd3", "#dfe4e8"  # text, notes, aids, grid
BLUE, ORANGE, GREEN, PURPLE = "#1f66ad", "#d9740b", "#2a8f5b", "#8a4fa0"
RED, TEAL, BROWN, GREY = "#b03030", "#1a8a9a", "#8a6d1e", "#8a949c"
LINES = (BLUE, ORANGE, GREEN, PURPLE, RED, BROWN)  # of curves in one plot, in this order
BEFORE, AFTER = ORANGE, BLUE  # nominal and identified robot; distinct in colour blindness, too
DASHED = (0, (4, 3))  # line style of a limit
FRAME: dict[RcKeyType, Any] = {
    "svg.fonttype": "none",
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "text.parse_math": False,  # a $ in a name is a $
}


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour `#rrggbb`."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def logarithmic(axes: Axes, *names: Literal["x", "y"]) -> None:
    """Makes axes logarithmic, with plain numbers, since a $ in a text of ours is a $."""
    from matplotlib.ticker import LogFormatter  # noqa: PLC0415  colours alone need no matplotlib

    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))


def svg_text(figure: Figure) -> str:
    """The figure as an SVG file without date and program names: same figure, same text."""
    if layout := figure.get_layout_engine():
        layout.execute(figure)  # once: savefig would do it twice, half of the time of a figure
        figure.set_layout_engine("none")
    text = io.StringIO()
    metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(text, format="svg", metadata=metadata)
    return text.getvalue()


def to_hundredths(svg: str) -> str:
    """Coordinates cut to hundredths of a point: figures that are kept in the project stay small.

    What is written in them stays whole.
    """
    return re.sub(r"(\.\d\d)\d+(?![^<>]*</text>)", r"\1", svg)
