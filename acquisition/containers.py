"""Device files by the kind of container they are: one reader each, all giving the same table."""

from __future__ import annotations

from pathlib import Path

from acquisition.dialect import Dialect
from acquisition.layout import Layout
from acquisition.report import Finding
from acquisition.table import Form, Table, read_table


def read_file(path: Path, file: str, dialect: Dialect, layout: Layout, findings: list[Finding]) -> tuple[Table, Form]:
    """The wanted columns of one device file; repairs and warnings are appended to `findings`.

    file : the name that errors and findings give it.
    Raises LogError naming file, line and column if the file cannot be trusted.
    """
    match dialect.container:
        case "text":
            return read_table(path, file, layout, findings)
