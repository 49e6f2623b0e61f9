"""Hooks of mkdocs: search on pages from the disk."""

from __future__ import annotations

from typing import Any

# The theme's offline plugin loads this from another server; ours stands in docs/assets.
_FOREIGN_SHIM = "https://unpkg.com/iframe-worker/shim"
_OWN_SHIM = "assets/search_from_disk.js"


def on_post_page(output: str, page: Any, **_: object) -> str:
    """The page with the project's own script for search from the disk."""
    return output.replace(_FOREIGN_SHIM, "../" * page.url.count("/") + _OWN_SHIM)


def on_post_template(output_content: str, **_: object) -> str:
    """The output of `on_post_page`, for the page that a server shows for a wrong address."""
    return output_content.replace(_FOREIGN_SHIM, _OWN_SHIM)
