"""Product and pages stay small and of small pieces; every public class name means one thing."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from ballbar import PACKAGES
from tests.project.size import LONG_MODULE, SHORT_FUNCTION, Size, size_of

CODE = 61_075
MODULE, LONG_MODULES = 500, 8  # lines of any module; modules that may have more than LONG_MODULE
FUNCTION = 80  # lines, signature and docstring included
SHORT_FUNCTIONS = 0.89  # share of the functions that have at most SHORT_FUNCTION lines
WORDS, PAGES = 55_000, 40  # of docs/, as `wc -w` counts them, generated pages included


@cache
def product() -> Size:
    """Size of all packages."""
    return size_of(*PACKAGES)


@pytest.mark.slow
def test_a_public_class_name_stands_once() -> None:
    """A reader who searches for it finds what he reads of, and one import cannot shadow another."""
    twice = {name for name, count in product().classes.items() if count > 1}
    assert not twice


@pytest.mark.slow
def test_a_module_is_one_idea() -> None:
    lines = {str(file): n for file, n in product().modules.items()}
    assert not {file: n for file, n in lines.items() if n > MODULE}
    above = {file: n for file, n in lines.items() if n > LONG_MODULE}
    assert len(above) <= LONG_MODULES, above


@pytest.mark.slow
def test_a_function_fits_on_a_screen_or_two() -> None:
    functions = product().functions
    assert not {name: n for name, n in functions.items() if n > FUNCTION}
    short = sum(n <= SHORT_FUNCTION for n in functions.values())
    assert short / len(functions) >= SHORT_FUNCTIONS


def test_the_pages_are_within_their_budget() -> None:
    """A new subject takes the place of what another page says already."""
    pages = [*(Path(__file__).parents[2] / "docs").rglob("*.md")]
    assert len(pages) <= PAGES
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= WORDS


@pytest.mark.slow
def test_the_product_is_within_its_budget() -> None:
    """An addition takes the place of something; a release sets the number to what it has."""
    assert product().code <= CODE
