"""Hook of mkdocs for pages that a repository's viewer shows too: Markdown inside HTML tables."""

from __future__ import annotations

import re


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page with HTML tables marked, so that md_in_html reads the Markdown in their cells."""
    return re.sub(
        r"^<(table|tbody|tr|td)\b(?=[ >])", r'<\1 markdown="block"', markdown, flags=re.MULTILINE
    )
