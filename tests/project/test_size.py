"""The product stays small and of small pieces, and every public class name means one thing."""

from __future__ import annotations

from functools import cache

import pytest

from ballbar import PACKAGES
from tests.project.size import Size, size_of


@cache
def product() -> Size:
    """Size of all packages."""
    return size_of(*PACKAGES)


@pytest.mark.slow
def test_a_public_class_name_stands_once() -> None:
    """A reader who searches for it finds what he reads of, and one import cannot shadow another."""
    twice = {name for name, count in product().classes.items() if count > 1}
    assert not twice
