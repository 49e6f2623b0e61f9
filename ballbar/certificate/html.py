"""A certificate as one HTML file that prints on A4."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ballbar.certificate.page import Page

OPENING, CLOSING = b'<script type="application/json" id="content">{', b"</script>"


def html(page: Page, content: bytes) -> bytes:
    """The file; content : canonical JSON, which is in it as it is but for its signs `<`."""
    loader = PackageLoader("ballbar.certificate")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    # no tag of the page ends in it
    embedded = Markup(content.decode().replace("<", "\\u003c"))
    template = environment.get_template("certificate.html")
    return template.render(page=page, embedded=embedded).encode()
