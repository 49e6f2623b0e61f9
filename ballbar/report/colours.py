"""Colours of the viewer: those of `figure_style`, brighter for its dark background."""

from __future__ import annotations

from ballbar import figure_style

Colour = tuple[int, int, int]


def on_dark(colour: str, white: float = 0.25) -> Colour:
    """A colour of `figure_style` mixed with a share of white, for the viewer's dark background."""
    red, green, blue = (round(c + white * (255 - c)) for c in figure_style.rgb(colour))
    return red, green, blue


def shades(colour: str) -> list[Colour]:
    """Three shades of a colour, of the components x, y, z."""
    return [on_dark(colour, white) for white in (0.1, 0.35, 0.6)]


BEFORE_COLOUR, AFTER_COLOUR = on_dark(figure_style.BEFORE), on_dark(figure_style.AFTER)
TRUE_COLOUR = on_dark(figure_style.GREEN)
WARNING_COLOUR = on_dark(figure_style.RED)
LINES = [on_dark(colour) for colour in figure_style.LINES]  # of curves in one plot
STEEL: Colour = (178, 184, 192)
BACKGROUND: Colour = (30, 34, 42)  # of scenes
