"""ROS 2 bags (SQLite `.db3`, or MCAP) as a table: stamps and positions of the wanted joints.

The stamp is header.stamp, on the publisher's clock; the time of recording is the
network's. Several publishers may share a topic, each with joints of its own: read are the
JointState messages that name all wanted joints, in whatever order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ballbar.acquisition.formats.columns import one_file, wanted_columns
from ballbar.acquisition.report import Finding, finding
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table
from ballbar.acquisition.table.text import require_file
from ballbar.cell.errors import LogError, imports_for

if TYPE_CHECKING:
    import sqlite3

    from ballbar.acquisition.formats.ros_messages import JointState

_JOINT_STATE = "sensor_msgs/msg/JointState"
_SQLITE = b"SQLite format 3\0"
# Bytes; bags hold camera images too, and are never in memory as a whole.
_LARGEST_BAG = 100_000_000_000
_LARGEST_BLOB = 1_000_000  # bytes of one message; a JointState has some hundreds
_STEPS = 10_000  # of SQLite's machine between two checks of how long it has computed
# Reading takes a few checks a megabyte; a database that takes more computes something.
_CHECKS_PER_MB = 200


def read_ros_bag(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """Stamps [ns] and the wanted positions; the lines are message numbers within the topic, from 1.

    Messages without stamp (zero) are left out and reported, as are those of other joints.
    Raises LogError if the bag is damaged or several topics hold the joints, InputError if a package
    is missing.
    """
    _check_stored(path, file)
    findings: list[Finding] = []
    wanted = [name for name in layout.required if name != time]
    topic, states = _holder(_states(path, file, findings), wanted, time, layout, file)
    holds = np.array([set(wanted) <= set(state.positions) for state in states])
    stamps = np.array([state.stamp_ns for state in states], dtype=np.int64)
    table = one_file({time: stamps}, file, np.arange(1, holds.size + 1), findings)
    sentence = f"{topic}: messages without the joints {', '.join(wanted)}; left out."
    table = table.remarked("other joints", sentence, rows=~holds)
    sentence = "header.stamp is zero; message left out."
    table = table.remarked("no stamp", sentence, rows=holds & (stamps == 0))
    chosen = np.flatnonzero(holds & (stamps != 0))
    if not chosen.size:
        raise LogError(
            f"{file}: header.stamp is zero in all messages: stamp them in the publisher."
        )
    table = table.take(chosen)
    positions = {n: np.array([states[i].positions[n] for i in chosen]) for n in wanted}
    form = Form("CDR", "none", "none", holds.size)
    return replace(table, columns=table.columns | positions), form


def _check_stored(path: Path, file: str) -> None:
    """Raises LogError if there is no such file, or one of no size that a bag has."""
    require_file(path, file)
    size = path.stat().st_size
    if not size:
        raise LogError(f"{file}: the file is empty. Copy it again from the logger.")
    if size > _LARGEST_BAG:
        remedy = "Cut it, or name the right file."
        raise LogError(f"{file}: {size} bytes; a log has at most {_LARGEST_BAG}. {remedy}")


def _states(path: Path, file: str, findings: list[Finding]) -> dict[str, list[JointState]]:
    """The JointState messages of each topic; what is found on the way is appended to `findings`.

    Raises LogError if the bag or a message is damaged, or there are none.
    """
    with imports_for(f"{file}: a ROS bag", "ballbar-bench[ros]"):
        from ballbar.acquisition.formats.ros_messages import decode, mcap_messages  # noqa: PLC0415
    with path.open("rb") as opened:
        sqlite = opened.read(len(_SQLITE)) == _SQLITE
    messages = _sqlite_messages(path, file, findings) if sqlite else None
    topics: dict[str, list[JointState]] = {}
    for topic, message in messages or mcap_messages(path, file, _JOINT_STATE, findings):
        states = topics.setdefault(topic, [])
        try:
            states.append(decode(message))
        except LogError as error:
            number = len(states) + 1
            raise LogError(f"{file}: {topic}: message {number}: {error}") from None
    if not topics:
        what = f"the bag holds no message of type {_JOINT_STATE}."
        raise LogError.at(file, what, "Record the topic of the joint states.")
    return topics


def _holder(
    states: dict[str, list[JointState]], wanted: list[str], time: str, layout: Layout, file: str
) -> tuple[str, list[JointState]]:
    """The topic whose messages hold all wanted joints, and these messages.

    Raises LogError if there is none, or several.
    """
    holders = [
        topic
        for topic, several in states.items()
        if any(set(wanted) <= set(state.positions) for state in several)
    ]
    if len(holders) > 1:
        what = f"the joints stand on several topics: {', '.join(holders)}."
        raise LogError.at(file, what, "Keep one: `ros2 bag convert` filters topics.")
    if not holders:
        names = {name: None for several in states.values() for s in several for name in s.positions}
        wanted_columns(layout, time, list(names), file)  # says which are missing
        remedy = "Record them in one message, or correct the names in recording.yaml."
        raise LogError.at(file, f"no message holds all of the joints {', '.join(wanted)}.", remedy)
    return holders[0], states[holders[0]]


def _sqlite_messages(path: Path, file: str, findings: list[Finding]) -> Iterator[tuple[str, bytes]]:
    """Topic and CDR bytes of each JointState of a database, which is never written to."""
    import sqlite3  # noqa: PLC0415  slow to import, and needed here alone

    reads = {sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ}
    log = path.with_name(path.name + "-wal")
    if log.is_file() and log.stat().st_size:
        sentence = f"{log.name} holds messages not yet moved in: run `ros2 bag reindex`."
        findings.append(finding("write-ahead log", file, sentence, count=1))
    _check_size(path, file)
    checks = 1000 + _CHECKS_PER_MB * (path.stat().st_size // 1_000_000)
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        # No view, trigger or function runs, and nothing else runs long.
        checks_left = iter(range(checks))
        connection.set_progress_handler(lambda: int(next(checks_left, None) is None), _STEPS)
        for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "query_only = ON"):
            connection.execute(f"PRAGMA {pragma}")
        # An image of a camera passes, a bomb does not.
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 100 * _LARGEST_BLOB)
        connection.set_authorizer(
            lambda action, *_: sqlite3.SQLITE_OK if action in reads else sqlite3.SQLITE_DENY
        )
        _refuse_other_tables(connection, file)
        query = "SELECT id, name, serialization_format FROM topics WHERE type = ?"
        topics = {
            key: (str(name), form) for key, name, form in connection.execute(query, (_JOINT_STATE,))
        }
        for name, form in topics.values():
            if form != "cdr":
                what = f"topic {name} is encoded as {form!r}; ROS 2 writes cdr."
                raise LogError.at(file, what, "Record it again with ROS 2.")
        lost, last = 0, 0
        query = "SELECT id, topic_id, data FROM messages ORDER BY id"
        for number, key, data in connection.execute(query):
            if not isinstance(number, int):
                raise LogError(
                    f"{file}: a message has the number {number!r}, no whole one. Copy the bag "
                    "again, or convert it with `ros2 bag convert`."
                )
            lost, last = lost + (last > 0 and number != last + 1), number
            if key in topics:
                yield topics[key][0], _blob(data, f"{file}: {topics[key][0]}")
        if lost:
            sentence = "the numbers of the messages have gaps."
            findings.append(finding("missing messages", file, sentence, count=lost))
    except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
        what = f"the database cannot be read ({error}): damaged, or cut off."
        raise LogError.at(file, what, "SQLite's `.recover` may save it.") from None
    finally:
        connection.close()


def _refuse_other_tables(connection: sqlite3.Connection, file: str) -> None:
    query = "SELECT name, sql FROM sqlite_master WHERE type = 'table'"
    plain = ("topics", "messages")
    tables = {n: str(sql).lower() for n, sql in connection.execute(query) if n in plain}
    if len(tables) < 2 or any("virtual" in sql or "generated" in sql for sql in tables.values()):
        what = "a SQLite database without the plain tables `topics` and `messages` of a ROS 2 bag."
        raise LogError.at(file, what, "Copy the bag again, or name the dialect of what it is.")


def _check_size(path: Path, file: str) -> None:
    """Raises LogError if a database is not as long as its head says (SQLite format, sec. 1.3)."""
    with path.open("rb") as opened:
        head = opened.read(100)
    if len(head) < 100:
        raise LogError(f"{file}: the database is cut off within its head. Copy it again.")
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    claimed, size = (65_536 if page == 1 else page) * pages, path.stat().st_size
    if claimed != size:
        raise LogError(
            f"{file}: the database has {claimed} bytes by its head, the file {size}: cut off, or "
            "still open. Copy it again."
        )


def _blob(data: object, location: str) -> bytes:
    if not isinstance(data, bytes) or len(data) > _LARGEST_BLOB:
        what = f"a message that is no bytes, or more than {_LARGEST_BLOB}."
        raise LogError.at(location, what, "Copy the bag again.")
    if data[:4] == b"\x28\xb5\x2f\xfd":
        what = "messages are packed (compression_mode: message)."
        raise LogError.at(location, what, "Unpack the bag with `ros2 bag convert`.")
    return data
