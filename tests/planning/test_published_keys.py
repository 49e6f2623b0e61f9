"""Defaults and limits of the keys of a plan's request are those of the published page."""

from __future__ import annotations

from generators.schema_pages import PAGES


def test_the_keys_of_the_schema_are_those_of_the_page() -> None:
    (page,) = (page for page in PAGES if page.name == "plan_request.md")
    assert page.path.read_text() == page.text(), "run python -m generators.schema_pages"
