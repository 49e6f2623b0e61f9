"""Commands that are run by their application alone begin as main() lets them."""

from __future__ import annotations

import pytest

from ballbar.terminal import reset_terminal


@pytest.fixture(autouse=True)
def fresh_terminal() -> None:
    """An earlier test of this process may have had --quiet or --json."""
    reset_terminal()
