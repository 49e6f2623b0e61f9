"""A section of the report: its text, and the links that lead to it.

Text from files is escaped, and a value that a template lacks is an error.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup, escape

from ballbar.cell.foreign_text import markdown
from ballbar.report.numbers import capitalised, significant
from ballbar.report.recording_figures import norms_over_time
from ballbar.result.run_data import RunData

MACHINE = "Machine"  # row of the navigation


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    html: Markup
    links: tuple[tuple[str, str], ...]  # anchor and words of each
    row: str = ""  # of the navigation, by its title


def section(template_name: str, links: dict[str, str], row: str = "", **content: object) -> Section:
    """The section of a template; links : words by anchor, empty ones left out."""
    html = Markup(template(template_name).render(**content))
    return Section(html, tuple((k, v) for k, v in links.items() if v), row)


def machine_row(run: RunData) -> str:
    """Row of what recordings have in common; a page of still poses has a single row."""
    return MACHINE if run.recordings else ""


def template(name: str) -> Template:
    """A page or a part of one, of ballbar/report/templates."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("ballbar.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"significant": significant, "norms_over_time": norms_over_time}
    environment.filters["with_code"] = _with_code
    environment.filters["markdown"] = markdown
    environment.filters["capitalised"] = capitalised
    environment.filters["ended"] = lambda sentence: f"{sentence.removesuffix('.')}."
    return environment


def _with_code(text: str) -> Markup:
    """A sentence, escaped, with what stands between backticks as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))
