"""What all our figures share: ink, frame and grid, and how a figure becomes the text of an SVG file."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

INK, QUIET = "#22303c", "#66727d"
FRAME: dict[RcKeyType, Any] = {
    "svg.fonttype": "none",
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dfe4e8",
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
}


def svg_text(figure: Figure, *, transparent: bool = False) -> str:
    """The figure as an SVG file without date and names of programs: same figure, same text."""
    if (
        arrange := figure.get_layout_engine()
    ):  # once: savefig would arrange it twice, which is half of the time a figure takes
        arrange.execute(figure)
        figure.set_layout_engine("none")
    written = io.StringIO()
    figure.savefig(
        written,
        format="svg",
        metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        transparent=transparent,
    )
    return written.getvalue()


def to_hundredths(svg: str) -> str:
    """Coordinates to hundredths of a point: figures that are kept in the project stay small."""
    return re.sub(r"(\.\d\d)\d+", r"\1", svg)
