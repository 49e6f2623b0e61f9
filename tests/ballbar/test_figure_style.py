"""Figures that are kept in the project."""

from ballbar.figure_style import to_hundredths


def test_coordinates_are_cut_and_what_is_written_is_not() -> None:
    svg = '<path d="M 12.3456 7.8L 0.001 3"/><text x="1.23456">0.00125 of 0.001</text>'
    cut = '<path d="M 12.34 7.8L 0.00 3"/><text x="1.23">0.00125 of 0.001</text>'
    assert to_hundredths(svg) == cut
