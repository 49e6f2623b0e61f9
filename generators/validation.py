"""Measured figures of the product, one table a study: docs/validation.md.

    python -m generators.validation

`validation.yaml` lists the studies: what was done, the commands that make the rows, and how a table
is made of rows in docs/studies. A study without rows of its own has its lines in figures.csv there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from ballbar.cell.files import write_whole

DOCS = Path(__file__).parents[1] / "docs"
PAGE, STUDIES, LISTED = (
    DOCS / "validation.md",
    DOCS / "studies",
    Path(__file__).with_suffix(".yaml"),
)
HEAD = """# Validation: what was measured

Written by `python -m generators.validation` from the rows in `docs/studies`, of
[figures.csv](studies/figures.csv) where no other file is named; do not edit. Every table names the
command that makes it, with commit and date. Machine: two cores. All but [real
robots](real_robots.md) is simulated ([Limits](limits.md)).

TCP errors are those of the unloaded robot over held-out poses, base frames aligned
([Conventions](conventions.md)), in mm, mean / largest. "Everything on" is every error source of a
real cell at the sizes of the [parameter notes](notes/plant.md), drawn for each robot, but
thermal growth, which a check on a held-out recording cannot tell from a wrong robot. "Stated" is
one stated standard deviation; "over stated" is the error over it, rms over the robots; sought are
0.8 to 1.2. "Held" is the share of 95 % intervals that hold the truth; sought are 93 to 97 %.
"""
STATISTICS: Mapping[str, Callable[[pd.Series], float]] = {
    "median": pd.Series.median,
    "mean": pd.Series.mean,
    "largest": pd.Series.max,
    "least": pd.Series.min,
    "sum": pd.Series.sum,
    "rms": lambda values: float(np.sqrt(np.mean(np.square(values)))),
}


@dataclass(frozen=True)
class Study:
    """One section of the page: an item of LISTED.

    by : columns whose values share a line of the table; without it all rows are one line.
    columns : heading -> statistics, as `cell` reads them.
    names : words for values of `by`.
    """

    title: str
    says: str
    made_by: Sequence[str]  # `command · commit · date`
    level: int = 2
    rows: Sequence[str] = ()
    where: str = ""
    by: Sequence[str] = ()
    columns: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)


def page_text() -> str:
    """The page."""
    studies = [Study(**item) for item in yaml.safe_load(LISTED.read_text(encoding="utf-8"))]
    unused = set(figures().study) - {study.title for study in studies}
    if unused:
        raise ValueError(f"figures.csv: {LISTED.name} has no study {', '.join(sorted(unused))}")
    return HEAD + "".join(map(section, studies))


def section(study: Study) -> str:
    """Heading, sentences, commands and table of a study."""
    links = ", ".join(f"[{name}](studies/{name}.csv)" for name in study.rows)
    made = "<br>\n".join(map(_made, study.made_by)) + (f": {links}" if links else "")
    lines = [_line(row) for row in (table(study) if study.rows else figure_rows(study.title))]
    lines.insert(1, "|" + "---|" * (lines[0].replace("\\|", "").count("|") - 1))
    text = "\n".join(lines)
    return f"\n{'#' * study.level} {study.title}\n\n{study.says}\n\n{made}\n\n{text}\n"


def table(study: Study) -> Iterator[list[str]]:
    """Headings, then a line for each value of `by`."""
    every = pd.concat([pd.read_csv(STUDIES / f"{name}.csv") for name in study.rows])
    every = every.query(study.where) if study.where else every
    if study.names:  # values that have one name share a line
        every = every.assign(**{c: every[c].astype(str).replace(study.names) for c in study.by})
    yield [*(" " for _ in study.by[:1]), *study.columns]
    groups = every.groupby([*study.by], sort=False) if study.by else [((), every)]
    for values, rows in groups:
        label = ", ".join(map(str, values))
        cells = [cell(rows, text) for text in study.columns.values()]
        yield [*([label] if study.by else []), *cells]


def cell(rows: pd.DataFrame, text: str) -> str:
    """A cell from text such as `median tcp_mean_mm .4f / largest tcp_max_mm .3f`.

    Each part is `count QUERY`, a number of rows; `value COLUMN`, of the first row; `counts COLUMN`,
    of each value; `share EXPRESSION`, of the rows where it is true, or the mean of shares, in per
    cent; or a key of STATISTICS with an expression of columns and a format. Other words stay.
    """
    parts = re.split(r"( / | to | of |, )", text)
    return "".join(_part(rows, part) for part in parts)


def _part(rows: pd.DataFrame, text: str) -> str:
    word, _, rest = text.partition(" ")
    if word == "count":
        return str(len(rows.query(rest)) if rest else len(rows))
    if word == "value":
        return str(rows[rest].iloc[0])
    if word == "counts":
        return ", ".join(f"{n} {value}" for value, n in rows[rest].value_counts().items())
    if word == "share":
        return f"{100.0 * float(np.mean(rows.eval(rest))):.1f} %"
    if word not in STATISTICS:
        return text
    expression, _, layout = rest.rpartition(" ")
    values = rows.eval(expression).dropna()
    return format(STATISTICS[word](values), layout) if len(values) else "-"


@cache
def figures() -> pd.DataFrame:
    """Measured figures of studies without rows of their own: study, what, measured, sought."""
    return pd.read_csv(STUDIES / "figures.csv", dtype=str, keep_default_na=False)


def figure_rows(title: str) -> Iterator[Sequence[str]]:
    """Headings and lines of a study in figures.csv; what was sought only where something was."""
    rows = figures()[figures().study == title]
    columns = ["what", "measured", *(["sought"] if rows.sought.any() else [])]
    yield [" ", *columns[1:]]
    yield from rows[columns].to_numpy().tolist()


def _made(made_by: str) -> str:
    """`command · commit · date` as the page has it."""
    command, commit, date = made_by.split(" · ")
    return f"`{command}` ({commit.removeprefix('commit ')}, {date})"


def _line(cells: Sequence[str]) -> str:
    shown = (str(text).replace("|", "\\|") for text in cells)
    return f"|{'|'.join(shown)}|"


if __name__ == "__main__":
    write_whole(PAGE, page_text().encode())
