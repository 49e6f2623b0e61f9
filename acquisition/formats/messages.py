"""Messages, one a line, as the rows of a table: KUKA RSI and JSON.

    <Rob Type="KUKA"><AIPos A1="0.0" A2="-90.0" .../>...<IPOC>4208163634</IPOC></Rob>

KUKA.RobotSensorInterface, as a receiver on the network stores it. AIPos are the measured axis
angles [deg], ASPos the commanded ones, IPOC counts milliseconds. Source: its manual, 3.x.

    {"J1": -12.34, ..., "J10": 0.0, "time": 1650000000123456}

One object a sample, as the MQTT driver of a Comau C5G Open publishes them. `time` is whole
microseconds of the PC's clock. Position, velocity and target come on topics of their own: a file
must hold one topic only, and two samples of one time are refused. Source:
CNR-STIIMA-IRAS/comau_c5gopen.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table, text_table
from ballbar.acquisition.table.text import LogText, read_text
from ballbar.cell.errors import LogError

_ELEMENT = re.compile(r"<(\w+)((?:\s+\w+=\"[^\"<>]*\")+)\s*/?>|<(\w+)>([^<>]*)</\3>")
_ATTRIBUTE = re.compile(r"(\w+)=\"([^\"]*)\"")
_END = "</Rob>"
_LONGEST_LINE = 10_000  # characters; a sample has about 300, and nesting that deep is an attack


def read_rsi(path: Path, file: str, _time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted values of every message.

    Raises LogError as other tables do: lines that are no whole message are torn lines.
    """
    return _read(rsi_text(read_text(path, file)), layout, "XML")


def rsi_text(text: LogText) -> LogText:
    """A table with the values of each message, named as `AIPos.A1` and `IPOC`."""
    return _as_table(text, _rsi_values, "message <Rob ...>...</Rob> of KUKA RSI")


def read_json_lines(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted keys of every object, the time as whole numbers.

    Raises LogError as `read_rsi`, and if one time has two samples.
    """
    text = _as_table(read_text(path, file), _json_values, "JSON object with numbers", layout)
    table, form = _read(text, layout, "JSON")
    stamps = table.columns[time]
    order = np.argsort(stamps, kind="stable")
    same = np.flatnonzero(np.diff(stamps[order]) == 0)
    for name, values in table.columns.items():
        differs = same[values[order][same] != values[order][same + 1]]
        if differs.size:
            row = int(order[differs[0] + 1])
            raise LogError(
                f"{table.location(row)}: time {stamps[row]} has two samples, and {name} differs. "
                "Position, velocity and target in one file? Record one topic a file."
            )
    return table, form


def _read(text: LogText, layout: Layout, form: str) -> tuple[Table, Form]:
    table, read = text_table(text, replace(layout, separators=("\t",), decimal="point"))
    # A message has dozens of values.
    findings = tuple(entry for entry in table.findings if entry.kind != "column not used")
    return replace(table, findings=findings), replace(read, separator=form)


def _as_table(
    text: LogText,
    values_of: Callable[[str], dict[str, str]],
    what: str,
    layout: Layout | None = None,
) -> LogText:
    """A table with the values of each message by the names of the first one.

    A message that is cut or lacks a value that the layout requires, or any one without a layout,
    gives a line of another width.
    """
    messages = [values_of(line) for line in text.lines]
    first = next((k for k, values in enumerate(messages) if values), None)
    if first is None:
        raise LogError(
            f"{text.file}:{text.number[0]}: {text.lines[0][:60]!r} is no {what}. Store one a line, "
            "copy the file again, or name its dialect."
        )
    names = list(messages[first])
    needed = set(names).intersection(layout.required if layout else names)
    rows = [
        "\t".join(values.get(name, "") for name in names) if values.keys() >= needed else "torn"
        for values in messages
    ]
    number = np.concatenate((text.number[[first]], text.number))
    return replace(text, lines=["\t".join(names), *rows], number=number, quoted=False)


def _rsi_values(line: str) -> dict[str, str]:
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


def _json_values(line: str) -> dict[str, str]:
    """The numbers of an object by key; empty if the line is no object, or has a key twice."""
    if len(line) > _LONGEST_LINE:
        return {}
    try:
        parsed = json.loads(line, object_pairs_hook=_json_numbers, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return {}
    return parsed if isinstance(parsed, dict) else {}


def _json_numbers(pairs: list[tuple[str, Any]]) -> dict[str, str]:
    """Numbers that fit a column, as text that reads back the same."""
    if len({key for key, _ in pairs}) < len(pairs):
        raise ValueError("a key stands twice")
    return {k: repr(v) for k, v in pairs if type(v) in (int, float) and abs(v) < 2**63}


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")
