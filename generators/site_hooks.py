"""Hooks of mkdocs: Markdown inside HTML tables, and search on pages from the disk."""

from __future__ import annotations

import re
from typing import Any

# The theme's offline plugin loads this from another server; ours stands in docs/assets.
_FOREIGN_SHIM = "https://unpkg.com/iframe-worker/shim"
_OWN_SHIM = "assets/search_from_disk.js"


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page with HTML tables marked, so that md_in_html reads the Markdown in their cells.

    A repository's viewer shows the same Markdown.
    """
    return re.sub(
        r"^<(table|tbody|tr|td)\b(?=[ >])", r'<\1 markdown="block"', markdown, flags=re.MULTILINE
    )


def on_post_page(output: str, page: Any, **_: object) -> str:
    """The page with the project's own script for search from the disk."""
    return output.replace(_FOREIGN_SHIM, "../" * page.url.count("/") + _OWN_SHIM)


def on_post_template(output_content: str, **_: object) -> str:
    """The output of `on_post_page`, for the page that a server shows for a wrong address."""
    return output_content.replace(_FOREIGN_SHIM, _OWN_SHIM)
