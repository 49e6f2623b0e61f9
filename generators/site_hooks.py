"""What mkdocs must be told about pages that are written for a repository's viewer too: Markdown inside of HTML tables."""

from __future__ import annotations

import re


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page with tables of HTML marked, so that Markdown in their cells is read (extension md_in_html)."""
    return re.sub(
        r"^<(table|tbody|tr|td)\b(?=[ >])", r'<\1 markdown="block"', markdown, flags=re.MULTILINE
    )
