"""A certificate as one HTML file that prints on A4."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from ballbar.certificate.content import Content, canonical, digest_of
from ballbar.certificate.words import Words

OPENING, CLOSING = b'<script type="application/json" id="content">{', b"</script>"


def html(content: Content) -> bytes:
    """The file, in which the content is as it is but for its signs `<`: no tag ends in it."""
    embedded = canonical(content).decode().replace("<", "\\u003c")
    return document(content, Markup(embedded)).encode()


def document(content: Content, embedded: str = "") -> str:
    """The printed certificate of a content, well-formed as XML."""
    words = {"w": Words(content["locale"]), "digest": digest_of(content), "embedded": embedded}
    return _template().render(content | words)


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("ballbar.certificate"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    return environment.get_template("certificate.html")
