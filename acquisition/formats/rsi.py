"""Messages of KUKA.RobotSensorInterface, one a line, as a receiver on the network stores them.

    <Rob Type="KUKA"><AIPos A1="0.0" A2="-90.0" .../>...<IPOC>4208163634</IPOC></Rob>

AIPos are the measured axis angles [deg], ASPos the commanded ones, IPOC counts milliseconds.
Source: KUKA.RobotSensorInterface 3.x manual.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition.table.header import Layout
from acquisition.table.table import Form, Table, text_table
from acquisition.table.text import LogText, read_text
from cell.errors import LogError

_ELEMENT = re.compile(r"<(\w+)((?:\s+\w+=\"[^\"<>]*\")+)\s*/?>|<(\w+)>([^<>]*)</\3>")
_ATTRIBUTE = re.compile(r"(\w+)=\"([^\"]*)\"")
_END = "</Rob>"


def read_rsi(path: Path, file: str, _time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted values of every message.

    Raises LogError as other tables do: lines that are no whole message are torn lines.
    """
    tabs = replace(layout, separators=("\t",), decimal="point")
    table, form = text_table(rsi_text(read_text(path, file)), tabs)
    # A message has dozens of values.
    findings = tuple(entry for entry in table.findings if entry.kind != "column not used")
    return replace(table, findings=findings), replace(form, separator="XML")


def rsi_text(text: LogText) -> LogText:
    """A table with the values of each message, named as `AIPos.A1` and `IPOC`.

    A message that is cut or has other values gives a line of another width.
    """
    messages = [_values(line) for line in text.lines]
    names = next((list(values) for values in messages if values), None)
    if names is None:
        raise LogError(
            f"{text.file}:{text.number[0]}: {text.lines[0][:60]!r} is no message <Rob ...>...</Rob>"
            " of KUKA RSI. Store one message a line."
        )
    rows = ["\t".join(values.values()) if list(values) == names else "torn" for values in messages]
    number = np.concatenate(([0], text.number))
    return replace(text, lines=["\t".join(names), *rows], number=number, quoted=False)


def _values(line: str) -> dict[str, str]:
    """Values of one message by element and attribute; empty if the line is no whole message."""
    if not (line.lstrip().startswith("<Rob") and line.rstrip().endswith(_END)):
        return {}
    values: dict[str, str] = {}
    for element in _ELEMENT.finditer(line):
        if element[3]:
            values[element[3]] = element[4].strip()
        elif element[1] != "Rob":
            for name, value in _ATTRIBUTE.findall(element[2]):
                values[f"{element[1]}.{name}"] = value.strip()
    return values
