"""Device files by the kind of container they are: one reader each, all giving the same table."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

from ballbar.acquisition.formats.egm_table import read_egm
from ballbar.acquisition.formats.messages import read_json_lines, read_rsi
from ballbar.acquisition.formats.mpe import VERSIONS, read_mpe
from ballbar.acquisition.formats.ros_bag import read_ros_bag
from ballbar.acquisition.formats.scope import read_scope
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table, read_table
from ballbar.cell.dialect import Container, Dialect
from ballbar.cell.egm_file import FILE_START
from ballbar.cell.errors import DescriptionError
from ballbar.cell.plugins import PluginTable

_Reader = Callable[[Path, str, str, Layout], tuple[Table, Form]]
_OWN: dict[str, tuple[_Reader, str, str]] = {
    "twincat-scope": (read_scope, "integer", "ns"),
    "json-lines": (read_json_lines, "integer", "us"),
    "egm": (read_egm, "integer", "ns"),
    "rosbag": (read_ros_bag, "integer", "ns"),
    "abb-mpe": (read_mpe, "float", "s"),
    "kuka-rsi": (read_rsi, "integer", "ms"),
}
# Reader of each container, with the type and unit of the times that it gives.
CONTAINERS = PluginTable("containers", _OWN, lambda entry: isinstance(entry, tuple))


def container_of(raw: bytes) -> Container:
    """The kind of container that the content of a device file begins like; else text."""
    begins: dict[bytes, Container] = {
        b"\x89MCAP0\r\n": "rosbag",
        b"SQLite format 3\0": "rosbag",
        FILE_START: "egm",
        b"{": "json-lines",
        b"<Rob": "kuka-rsi",
    }
    for start, container in begins.items():
        if raw.startswith(start):
            return container
    if len(raw) > 4 and struct.unpack_from("<f", raw)[0] in VERSIONS:
        return "abb-mpe"
    return "twincat-scope" if b"Starttime of export" in raw[:1000] else "text"


def read_file(path: Path, file: str, dialect: Dialect, layout: Layout) -> tuple[Table, Form]:
    """The wanted columns of one device file, with findings, and how they were written.

    file : the name that errors and findings give it.
    Raises LogError naming file and line if the file cannot be trusted, DescriptionError if the
    dialect does not fit it.
    """
    if dialect.container == "text":
        return read_table(path, file, layout)
    reader, kind, unit = CONTAINERS[dialect.container]
    if (dialect.time.type, dialect.time.unit) != (kind, unit):
        raise DescriptionError(
            f"{file}: times of {dialect.container} have type: {kind}, unit: {unit}; the dialect "
            "says otherwise. Write them so in the dialect."
        )
    return reader(path, file, dialect.time.column, layout)
