"""Command line of the package."""

from __future__ import annotations

import argparse

from generators.scenario_reference.figures import PLOTS, draw, measured_sizes, write_sizes
from generators.scenario_reference.page import PAGE, page_text
from generators.scenario_reference.sources import SOURCES


def main() -> None:
    """Writes page, plots and sizes."""
    parser = argparse.ArgumentParser(description="Writes docs/scenario_reference.md and its plots.")
    parser.add_argument("--text", action="store_true", help="the page alone")
    if not parser.parse_args().text:
        PLOTS.mkdir(parents=True, exist_ok=True)
        for source in SOURCES:
            draw(source)
        write_sizes(measured_sizes())
    PAGE.write_text(page_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
