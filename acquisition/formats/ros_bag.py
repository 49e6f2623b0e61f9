"""ROS 2 bags (SQLite `.db3`, or MCAP) as a table: stamps and joint positions of the JointState messages that hold the joints.

The stamp is header.stamp, on the clock of whoever published; the time of recording is the network's. Several publishers may
share a topic, each with joints of its own: read are the messages that name all wanted joints, in whatever order.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from acquisition.formats.columns import check_stored, one_file, wanted_columns
from acquisition.formats.joint_state import Form as MessageForm
from acquisition.formats.joint_state import JointState, decode_joint_state
from acquisition.report import Finding, finding
from acquisition.table.header import Layout
from acquisition.table.table import Form, Table
from cell.errors import DescriptionError, LogError

_JOINT_STATE = "sensor_msgs/msg/JointState"
_SQLITE = b"SQLite format 3\0"
_LARGEST_BAG = (
    100_000_000_000  # bytes; bags hold camera images too, and are never in memory as a whole
)
_LARGEST_BLOB = 1_000_000  # bytes of one message; a JointState has some hundreds
_STEPS = 10_000  # of SQLite's machine between two looks at the clockwork
_LOOKS_PER_MB = (
    200  # reading takes a few looks a megabyte; a database that takes more computes something
)


def read_ros_bag(
    path: Path, file: str, time: str, layout: Layout, findings: list[Finding]
) -> tuple[Table, Form]:
    """Stamps [ns] and the wanted positions. Its lines are message numbers within the topic, counted from 1.

    Messages without stamp (zero) are left out and reported, as are those of other joints.
    Raises LogError if the bag is damaged or several topics hold the joints, DescriptionError if a package is missing.
    """
    check_stored(path, file, largest=_LARGEST_BAG)
    topics: dict[str, list[bytes]] = {}
    for topic, message in _messages(path, file, findings):
        topics.setdefault(topic, []).append(message)
    if not topics:
        raise LogError(f"{file}: the bag holds no message of type {_JOINT_STATE}.")
    wanted = [name for name in layout.required if name != time]
    states = {topic: _decoded(messages, f"{file}: {topic}") for topic, messages in topics.items()}
    holding = {
        topic: [i for i, state in enumerate(found) if set(wanted) <= set(state.positions)]
        for topic, found in states.items()
    }
    holders = [topic for topic, rows in holding.items() if rows]
    if len(holders) > 1:
        raise LogError(
            f"{file}: the joints stand on several topics: {', '.join(holders)}. Keep one: `ros2 bag convert` filters topics."
        )
    if not holders:
        names = dict.fromkeys(
            name for found in states.values() for state in found for name in state.positions
        )
        wanted_columns(layout, time, list(names), file)  # says which are missing
        raise LogError(f"{file}: no message holds all of the joints {', '.join(wanted)}.")
    found, rows = states[holders[0]], holding[holders[0]]
    if len(rows) < len(found):
        sentence = f"{holders[0]}: messages without the joints {', '.join(wanted)}; left out."
        others = np.setdiff1d(np.arange(len(found)), rows) + 1
        findings.append(finding("other joints", "warning", file, sentence, lines=others))
    number = np.array(rows, dtype=np.int64) + 1
    stamps = np.array([found[i].stamp_ns for i in rows], dtype=np.int64)
    if not stamps.all():
        findings.append(
            finding(
                "no stamp",
                "repaired",
                file,
                "header.stamp is zero; message left out.",
                lines=number[stamps == 0],
            )
        )
    columns: dict[str, NDArray[Any]] = {time: stamps[stamps != 0]}
    if not columns[time].size:
        raise LogError(
            f"{file}: header.stamp is zero in all messages; the publisher must stamp them."
        )
    for name in wanted:
        columns[name] = np.array([found[i].positions[name] for i in rows])[stamps != 0]
    return one_file(columns, file, number[stamps != 0]), Form("CDR", "none", "none", len(found))


def _messages(path: Path, file: str, findings: list[Finding]) -> Iterator[tuple[str, bytes]]:
    with path.open("rb") as opened:
        start = opened.read(len(_SQLITE))
    if start == _SQLITE:
        return _sqlite_messages(path, file, findings)
    try:
        from acquisition.formats.mcap_file import mcap_messages  # noqa: PLC0415 - needs the extra `ros`
    except ImportError as error:
        install = "Install the extra: pip install 'ballbar-bench[ros]'"
        raise DescriptionError(
            f"{file}: MCAP bags need the package {error.name}, which is not installed. {install}"
        ) from None
    return mcap_messages(path, file, _JOINT_STATE, findings)


def _sqlite_messages(path: Path, file: str, findings: list[Finding]) -> Iterator[tuple[str, bytes]]:
    """Topic and CDR bytes of each JointState. The database is opened as it stands, and never written to."""
    log = path.with_name(path.name + "-wal")
    if log.is_file() and log.stat().st_size:
        sentence = f"{log.name} beside it holds messages that the recorder had not yet moved in; run `ros2 bag reindex` or convert."
        findings.append(finding("write-ahead log", "warning", file, sentence, count=1))
    _check_size(path, file)
    looks = 1000 + _LOOKS_PER_MB * (path.stat().st_size // 1_000_000)
    connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1", uri=True)
    try:
        _lock_down(connection, looks)
        kinds = dict(
            connection.execute(
                "SELECT name, sql FROM sqlite_master WHERE name IN ('topics', 'messages') AND type = 'table'"
            )
        )
        if len(kinds) < 2 or any(
            "virtual" in str(sql).lower() or "generated" in str(sql).lower()
            for sql in kinds.values()
        ):
            raise LogError(
                f"{file}: a SQLite database without the plain tables `topics` and `messages` of a ROS 2 bag."
            )
        query = "SELECT id, name, serialization_format FROM topics WHERE type = ?"
        topics = {
            key: (str(name), form) for key, name, form in connection.execute(query, (_JOINT_STATE,))
        }
        for name, form in topics.values():
            if form != "cdr":
                raise LogError(f"{file}: topic {name} is encoded as {form!r}; ROS 2 writes cdr.")
        lost, last = 0, 0
        for number, key, data in connection.execute(
            "SELECT id, topic_id, data FROM messages ORDER BY id"
        ):
            lost, last = lost + (last > 0 and number != last + 1), number
            if key in topics:
                yield topics[key][0], _blob(data, f"{file}: {topics[key][0]}")
        if lost:
            findings.append(
                finding(
                    "missing messages",
                    "warning",
                    file,
                    "the numbers of the messages have gaps.",
                    count=lost,
                )
            )
    except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
        raise LogError(
            f"{file}: the database cannot be read ({error}): damaged, or cut off. SQLite's `.recover` may save it."
        ) from None
    finally:
        connection.close()


def _check_size(path: Path, file: str) -> None:
    """The head of the database says how many pages it has (SQLite file format, section 1.3)."""
    with path.open("rb") as opened:
        head = opened.read(100)
    if len(head) < 100:
        raise LogError(f"{file}: the database is cut off within its head.")
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    claimed, size = (65_536 if page == 1 else page) * pages, path.stat().st_size
    if claimed != size:
        raise LogError(
            f"{file}: the database has {claimed} bytes by its head, the file {size}: cut off, or still open. Copy it again."
        )


def _lock_down(connection: sqlite3.Connection, looks: int) -> None:
    """A database can hold views, triggers and functions: none of them runs, and nothing computes for long."""
    left = iter(range(looks))
    connection.set_progress_handler(lambda: int(next(left, None) is None), _STEPS)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    connection.execute("PRAGMA query_only = ON")
    connection.setlimit(
        sqlite3.SQLITE_LIMIT_LENGTH, 100 * _LARGEST_BLOB
    )  # an image of a camera passes, a bomb does not
    connection.set_authorizer(_reads_only)


def _reads_only(action: int, *_: str | None) -> int:
    return (
        sqlite3.SQLITE_OK
        if action in {sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ}
        else sqlite3.SQLITE_DENY
    )


def _blob(data: object, place: str) -> bytes:
    if not isinstance(data, bytes) or len(data) > _LARGEST_BLOB:
        raise LogError(f"{place}: a message that is no bytes, or more than {_LARGEST_BLOB}.")
    if data[:4] == b"\x28\xb5\x2f\xfd":
        raise LogError(
            f"{place}: messages are packed (compression_mode: message). Unpack the bag with `ros2 bag convert`."
        )
    return data


def _decoded(messages: list[bytes], place: str) -> list[JointState]:
    states: list[JointState] = []
    known: list[MessageForm] = []
    for number, message in enumerate(messages, 1):
        try:
            states.append(decode_joint_state(message, known))
        except LogError as error:
            raise LogError(f"{place}: message {number}: {error}") from None
    return states
