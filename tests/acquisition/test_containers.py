"""Logs that are no plain tables: what was written comes back, and every kind of damage is seen."""

from __future__ import annotations

import gzip
import json
import sqlite3
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from ballbar.acquisition.formats.egm import read_frames
from ballbar.acquisition.formats.registry import read_file
from ballbar.acquisition.formats.ros_messages import decode
from ballbar.acquisition.recording import read_ballbar, read_robot
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Table
from ballbar.cell.dialect import load_dialect
from ballbar.cell.egm_file import FILE_START, frame
from ballbar.cell.errors import DescriptionError, InputError, LogError
from ballbar.cell.load import load_robot
from ballbar.cell.logs import RobotLog
from ballbar.cell.recording import EncoderFitting, SourceFile
from ballbar.cell.robot_angles import joints_to_axes
from tests.helpers.container_files import (
    AXES,
    EPOCH_NS,
    JOINTS,
    ROWS,
    Written,
    angles_deg,
    counts,
    db3,
    egm,
    egm_message,
    egm_torque,
    joint_state,
    json_lines,
    mcap,
    mpe,
    rsi,
    scope,
)
from tests.helpers.damaged_files import campaign, families
from tests.helpers.scope_exports import FILETIME

ROBOT = load_robot("irb2400")


def read(
    folder: Path, written: Written, content: bytes | None = None
) -> tuple[Table, list[tuple[str, str]]]:
    """The table of a file with that content, and kind and severity of each finding."""
    path = folder / ("log" + written.suffix)
    path.write_bytes(written.content if content is None else content)
    dialect = load_dialect(written.dialect)
    time = dialect.time.column
    columns = {
        time: dialect.time.type,
        **dict.fromkeys(dialect.axes, "float"),
        **dict.fromkeys(written.integers, "integer"),
    }
    torques = dialect.torque_columns
    layout = Layout((), columns, dict.fromkeys(torques, "float"), together=torques)
    table, _ = read_file(path, path.name, dialect, layout)
    return table, [(entry.kind, entry.severity) for entry in table.findings]


def equal(table: Table, written: Written, rows: slice = slice(None)) -> bool:
    columns, wanted = (
        table.columns,
        {name: values[rows] for name, values in written.columns.items()},
    )
    return columns.keys() == wanted.keys() and all(
        columns[name].dtype == values.dtype and np.array_equal(columns[name], values)
        for name, values in wanted.items()
    )


ALL: dict[str, Callable[[Path], Written]] = {
    "scope": lambda _: scope(),
    "scope, semicolons and decimal commas": lambda _: scope(
        separator=";", decimal=",", own_times=True, eof=True
    ),
    "scope, commas": lambda _: scope(separator=","),
    "scope, colons": lambda _: scope(separator=":"),
    "json lines": lambda _: json_lines(),
    "rsi": lambda _: rsi(),
    "egm": lambda _: egm(),
    "db3": db3,
    "mcap": lambda _: mcap(),
    "mcap, lz4": lambda _: mcap(packed="LZ4"),
    "mcap, not packed": lambda _: mcap(packed="NONE"),
    "mpe": lambda _: mpe(),
}


@pytest.mark.parametrize("kind", ALL)
def test_every_value_and_time_comes_back_exactly(kind: str, tmp_path: Path) -> None:
    written = ALL[kind](tmp_path)
    table, findings = read(tmp_path, written)
    assert equal(table, written)
    assert findings == []


@pytest.mark.parametrize("kind", ALL)
def test_every_cut_is_seen(kind: str, tmp_path: Path) -> None:
    """All before the cut is read as it was written, with a finding, or the file is refused."""
    written = ALL[kind](tmp_path)
    for stop in range(0, len(written.content), max(len(written.content) // 40, 1)):
        try:
            table, findings = read(tmp_path, written, written.content[:stop])
        except InputError:
            continue
        assert equal(table, written, slice(len(table)))
        assert findings or len(table) == ROWS or between_records(written, stop)


@pytest.mark.parametrize("kind", ["scope", "json lines", "rsi", "egm", "mpe"])
def test_packed_files_are_read_as_well(kind: str, tmp_path: Path) -> None:
    written = ALL[kind](tmp_path)
    packed = Written(
        written.dialect,
        written.suffix + ".gz",
        gzip.compress(written.content),
        written.columns,
        written.integers,
    )
    table, findings = read(tmp_path, packed)
    assert equal(table, written)
    assert findings == []


def between_records(written: Written, stop: int) -> bool:
    """Whether a file without mark of its end, cut there, is a shorter one and nothing else."""
    match written.suffix:
        case ".jsonl" | ".xml":
            return written.content[stop - 1 : stop] == b"\n"
        case ".egm":
            return read_frames(written.content[:stop]).torn is None
        case ".bin":
            return (len(written.content) - stop) % 32 == 0
    return False


# ---- TwinCAT Scope


def test_scope_times_may_be_filetimes(tmp_path: Path) -> None:
    written = scope()
    head, _, data = written.content.decode().partition("\n\n\n")
    metadata, _, rows = data.partition("\n\n")
    stamped = []
    for row in rows.splitlines():
        cells = row.split("\t")
        stamped.append(
            "\t".join(
                str(FILETIME + round(1e4 * float(cell))) if i in (0, 3) and cell.strip() else cell
                for i, cell in enumerate(cells)
            )
        )
    content = "\n".join([head, "", "", metadata, "", *stamped, ""]).encode()
    assert equal(read(tmp_path, written, content)[0], written)


SCOPE_REFUSED = {
    "blanks between the fields": (lambda t: t.replace("\t", " "), "Export again with tabs"),
    "no such file": (lambda t: "time;b1\n" + t, "no TwinCAT Scope export"),
    "two channels of one name": (lambda t: t.replace("fast", "b1"), "2 channels are called 'b1'"),
    "a channel missing": (lambda t: t.replace("\tb1\t", "\tbar1\t"), "b1 missing"),
    "a scaled counter": (
        lambda t: t.replace("ScaleFactor\t1\t1", "ScaleFactor\t1\t-1", 1),
        "channel 'b2' is scaled",
    ),
    "a counter in a float": (
        lambda t: t.replace("Data-Type\tUINT32", "Data-Type\tREAL32"),
        "channel 'b1' is REAL32",
    ),
    "a counter beyond its type": (
        lambda t: t.replace("20\t200", "20\t99999999200", 1),
        "is no UINT32",
    ),
    "both decimal marks": (
        lambda t: t.replace("2.5\t0.625", "2,5\t0.625"),
        "decimal commas and decimal points",
    ),
    "a time that goes back": (lambda t: t.replace("\n30\t", "\n10\t"), "does not lie behind '20'"),
    "a second export behind": (lambda t: t + "EOF\n" + t, "Two exports in one file"),
    "no data": (lambda t: t[: t.index("\n0\t") + 1], "no data below"),
    # found by benchmarks.mutated_containers: its first row was lost in silence
    "a row above the names": (
        lambda t: t.replace("\n\n\nName", "\n0\t2000000\t4294967291\t0\t0\n\nName"),
        ":5: a row of data stands in the preamble",
    ),
}


@pytest.mark.parametrize("what", SCOPE_REFUSED)
def test_scope_export_is_refused_in_words(what: str, tmp_path: Path) -> None:
    change, words = SCOPE_REFUSED[what]
    written = scope()
    with pytest.raises(LogError, match=words):
        read(tmp_path, written, change(written.content.decode()).encode())


def test_decimal_commas_with_comma_separators_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="Decimal commas with comma separators"):
        read(tmp_path, scope(), scope(separator=",", decimal=",").content)


def test_a_torn_scope_row_is_dropped_and_reported(tmp_path: Path) -> None:
    written = scope()
    lines = written.content.decode().splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("30\t"))
    lines[row] = lines[row][:5]
    table, findings = read(tmp_path, written, "\n".join([*lines, ""]).encode())
    assert ("torn line", "repaired") in findings
    assert np.array_equal(table.columns["b1"], np.delete(written.columns["b1"], 3))


# ---- JSON lines


JSON_REFUSED = {
    "positions and velocities in one file": (
        lambda t: t + t.replace('"J1": ', '"J1": 1'),
        "Record one topic a file",
    ),
    "times that are no whole numbers": (
        lambda t: t.replace('"time": 165', '"time": 0.165'),
        "is not a whole number",
    ),
    "no joints": (lambda t: t.replace('"J3"', '"K3"'), "J3 missing"),
    "no JSON": (lambda t: t.replace("{", ""), "is no JSON object"),
    "nothing but NaN": (lambda t: t.replace('"J10": 0.0', '"J10": NaN'), "is no JSON object"),
    "nested without end": (lambda _: "[" * 9000 + "\n", "is no JSON object"),
}


@pytest.mark.parametrize("what", JSON_REFUSED)
def test_json_lines_are_refused_in_words(what: str, tmp_path: Path) -> None:
    change, words = JSON_REFUSED[what]
    written = json_lines()
    with pytest.raises(LogError, match=words):
        read(tmp_path, written, change(written.content.decode()).encode())


@pytest.mark.parametrize(
    "line",
    [
        '{"J1": 1.0',
        "[" * 9000,
        "9" * 9000,
        '{"time": 1, "time": 2}',
        '{"J1": 1e999}',
        '"' + "x" * 20_000,
    ],
)
def test_one_damaged_json_line_is_dropped_and_reported(line: str, tmp_path: Path) -> None:
    written = json_lines()
    lines = written.content.decode().splitlines()
    table, findings = read(
        tmp_path, written, "\n".join([*lines[:40], line, *lines[40:], ""]).encode()
    )
    assert equal(table, written)
    assert findings == [("torn line", "repaired")]


# ---- ROS 2 bags: written by rosbags


@pytest.mark.parametrize(
    ("storage", "suffix"), [(StoragePlugin.SQLITE3, ".db3"), (StoragePlugin.MCAP, ".mcap")]
)
def test_bags_of_another_writer_come_back_exactly(
    storage: StoragePlugin, suffix: str, tmp_path: Path
) -> None:
    """Two publishers on the topic: a robot with changing order of joints, and a gripper.

    There is another topic beside them.
    """
    folder, written = tmp_path / "bag", mcap()
    bag(folder, written, storage)
    made = Written(
        written.dialect, suffix, next(folder.glob("*" + suffix)).read_bytes(), written.columns
    )
    table, findings = read(tmp_path, made)
    assert equal(table, written)
    assert findings == [("other joints", "warning")]
    assert list(table.line[:3]) == [1, 3, 5]


def bag(
    folder: Path,
    written: Written,
    storage: StoragePlugin,
    compression: CompressionMode = CompressionMode.NONE,
) -> None:
    types = get_typestore(Stores.ROS2_HUMBLE)
    state, text = types.types["sensor_msgs/msg/JointState"], types.types["std_msgs/msg/String"]
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    writer = BagWriter(folder, version=9, storage_plugin=storage)
    if compression is not CompressionMode.NONE:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        joints = writer.add_connection("/joint_states", state.__msgtype__, typestore=types)
        other = writer.add_connection("/chatter", text.__msgtype__, typestore=types)
        for i, ns in enumerate(written.columns["stamp"].tolist()):
            order = [(k + 5 * i) % 6 for k in range(6)]
            position = np.array([written.columns[JOINTS[k]][i] for k in order])
            head = header(stamp(ns // 10**9, ns % 10**9), "base_link")
            message = state(
                head, [JOINTS[k] for k in order], position, np.array([]), np.arange(6.0)
            )
            writer.write(joints, ns + 5_000_000, types.serialize_cdr(message, state.__msgtype__))
            gripper = state(head, ["finger"], np.array([0.02]), np.array([0.0]), np.array([]))
            writer.write(joints, ns + 5_000_001, types.serialize_cdr(gripper, state.__msgtype__))
            writer.write(other, ns, types.serialize_cdr(text("hello"), text.__msgtype__))


def test_packed_messages_are_refused_with_the_way_out(tmp_path: Path) -> None:
    written = mcap()
    bag(tmp_path / "bag", written, StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    made = Written(written.dialect, ".db3", next((tmp_path / "bag").glob("*.db3")).read_bytes(), {})
    with pytest.raises(LogError, match="ros2 bag convert"):
        read(tmp_path, made)


@pytest.mark.parametrize("package", ["mcap.exceptions", "rosbags.serde"])
def test_a_bag_without_the_extra_names_the_install_command(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "ballbar.acquisition.formats.ros_messages", raising=False)
    monkeypatch.setitem(sys.modules, package, None)
    remedy = rf"needs {package}, which is not installed: pip install 'ballbar-bench\[ros\]'"
    with pytest.raises(InputError, match=remedy):
        read(tmp_path, db3(tmp_path))


def test_a_big_endian_joint_state_is_read_as_well(tmp_path: Path) -> None:
    """From a publisher on another machine; the numbers are the same, the bytes swapped."""
    body = struct.pack(">iI", 5, 6) + struct.pack(">I", 1) + b"\0" + bytes(3)
    body += struct.pack(">II", 1, 3) + b"j1\0" + bytes(1) + struct.pack(">I", 1)
    body += bytes(-len(body) % 8) + struct.pack(">d", 0.25) + struct.pack(">II", 0, 0)
    state = decode(b"\0\0\0\0" + body)
    assert (state.stamp_ns, state.positions) == (5_000_000_006, {"j1": 0.25})


def in_db3(folder: Path, change: Callable[[sqlite3.Connection], object]) -> Written:
    written = db3(folder)
    connection = sqlite3.connect(folder / "making.db3")
    change(connection)
    connection.commit()
    connection.close()
    return Written(
        written.dialect, written.suffix, (folder / "making.db3").read_bytes(), written.columns
    )


def first_message(content: bytes) -> Callable[[sqlite3.Connection], object]:
    return lambda connection: connection.execute(
        "UPDATE messages SET data = ? WHERE id = 1", (content,)
    )


def script(text: str) -> Callable[[sqlite3.Connection], object]:
    return lambda connection: connection.executescript(text)


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"
GOOD = joint_state(EPOCH_NS, JOINTS, [0.0] * 6)
DB3_REFUSED = {
    "a view that never ends": (
        script(
            f"DROP TABLE messages; CREATE VIEW messages AS {ENDLESS} i AS id, 1 AS topic_id, 0 AS "
            "timestamp, x'' AS data FROM n"
        ),
        "without the plain tables",
    ),
    "a computed column": (
        script(
            "DROP TABLE messages; CREATE TABLE messages(id INTEGER, topic_id INTEGER, data BLOB "
            "GENERATED ALWAYS AS (zeroblob(999999999)))"
        ),
        "without the plain tables",
    ),
    "a huge message": (
        script("UPDATE messages SET data = zeroblob(2000000) WHERE id = 3"),
        "more than 1000000",
    ),
    "a huge message of another topic": (
        script("INSERT INTO messages VALUES (900, 7, 0, zeroblob(100000001))"),
        "too big",
    ),
    "text for a message": (script("UPDATE messages SET data = 'text' WHERE id = 3"), "no bytes"),
    "a message cut short": (first_message(GOOD[:60]), "message 1: JointState"),
    "a name without end": (
        first_message(GOOD[:12] + b"\xff\xff\xff\x7f" + GOOD[16:]),
        "message 1: JointState",
    ),
    "four thousand million joints": (
        first_message(GOOD.replace(struct.pack("<I", 6), b"\xff\xff\xff\xff")),
        "message 1: JointState",
    ),
    "a position that is no number": (
        first_message(joint_state(EPOCH_NS, JOINTS, [0.0] * 5 + [np.nan])),
        "not finite",
    ),
    "a joint twice": (
        first_message(joint_state(EPOCH_NS, ("a", "a"), [0.0, 0.0])),
        "2 positions for the joints a, a",
    ),
    "the joints on two topics": (
        script(
            "INSERT INTO topics SELECT 2, '/copy', type, serialization_format, '' FROM topics; "
            "UPDATE messages SET topic_id = 1 + id % 2"
        ),
        "on several topics: /copy, /joint_states",
    ),
}


@pytest.mark.parametrize("what", DB3_REFUSED)
def test_hostile_and_damaged_databases_are_refused(what: str, tmp_path: Path) -> None:
    change, words = DB3_REFUSED[what]
    with pytest.raises(LogError, match=words):
        read(tmp_path, in_db3(tmp_path, change))


def test_reading_a_database_leaves_it_and_its_folder_alone(tmp_path: Path) -> None:
    def hostile(connection: sqlite3.Connection) -> None:
        connection.executescript(
            "PRAGMA journal_mode = WAL; CREATE TABLE seen(i); CREATE VIEW v AS SELECT "
            "writefile('owned', 'x');CREATE TRIGGER t AFTER INSERT ON messages BEGIN INSERT INTO "
            "seen VALUES (1); END;"
        )

    written = in_db3(tmp_path, hostile)
    folder = tmp_path / "recording"
    folder.mkdir()
    table, _ = read(folder, written)
    assert equal(table, written)
    assert [path.name for path in folder.iterdir()] == ["log.db3"]
    assert (folder / "log.db3").read_bytes() == written.content


def test_messages_that_wait_in_a_write_ahead_log_are_reported(tmp_path: Path) -> None:
    (tmp_path / "log.db3-wal").write_bytes(b"x")
    assert read(tmp_path, db3(tmp_path))[1] == [("write-ahead log", "warning")]


def chunk(packing: str, claimed: int, data: bytes, checksum: int = 0) -> bytes:
    body = (
        struct.pack("<QQQII", 0, 0, claimed, checksum, len(packing))
        + packing.encode()
        + struct.pack("<Q", len(data))
        + data
    )
    return b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", len(body)) + body


def test_packing_bombs_are_not_unpacked(tmp_path: Path) -> None:
    import lz4.frame  # noqa: PLC0415
    import zstandard  # noqa: PLC0415

    zeros = bytes(400_000_000)
    bombs = {"zstd": zstandard.compress(zeros), "lz4": lz4.frame.compress(zeros)}
    del zeros
    for packing, data in bombs.items():
        for claimed, words in (
            (1000, "has more"),
            (2**40, "claims to unpack to 1099511627776 bytes"),
        ):
            with pytest.raises(LogError, match=words):
                read(tmp_path, mcap(), chunk(packing, claimed, data))


MCAP_REFUSED = {
    "no bag": (b"\x89PNG", "no MCAP bag"),
    "an unknown packing": (chunk("brotli", 10, b"x"), "packed with 'brotli'"),
    "a chunk that is no zstd": (chunk("zstd", 10, b"0123456789"), "cannot be unpacked"),
    "a chunk with a wrong checksum": (chunk("", 3, b"abc", 1), "checksum of a chunk is wrong"),
    "a record of 10^18 bytes": (
        b"\x89MCAP0\r\n\x05" + struct.pack("<Q", 10**18) + bytes(500),
        "exceeds limit",
    ),
}


@pytest.mark.parametrize("what", MCAP_REFUSED)
def test_hostile_and_damaged_mcap_bags_are_refused(what: str, tmp_path: Path) -> None:
    content, words = MCAP_REFUSED[what]
    with pytest.raises(LogError, match=words):
        read(tmp_path, mcap(), content)


def test_a_cut_mcap_bag_gives_its_complete_chunks(tmp_path: Path) -> None:
    written = mcap()
    table, findings = read(tmp_path, written, written.content[: len(written.content) * 6 // 10])
    assert findings == [("torn end", "repaired")]
    assert 10 < len(table) < ROWS
    assert equal(table, written, slice(len(table)))


def test_messages_without_stamp_are_left_out_and_reported(tmp_path: Path) -> None:
    written = in_db3(tmp_path, first_message(joint_state(0, JOINTS, [0.0] * 6)))
    table, findings = read(tmp_path, written)
    assert equal(table, written, slice(1, None))
    assert findings == [("no stamp", "repaired")]


# ---- EGM files


def messages() -> list[bytes]:
    return [
        egm_message(7 + i, EPOCH_NS + 4_032_000 * i, row)
        for i, row in enumerate(angles_deg().tolist())
    ]


def file_of(parts: list[bytes]) -> bytes:
    return FILE_START + b"".join(map(frame, parts))


def test_egm_messages_are_put_in_order_and_read_once(tmp_path: Path) -> None:
    parts = messages()
    mixed = [*parts[:10], parts[11], parts[10], *parts[11:]]  # 10 came late, 11 twice
    table, findings = read(tmp_path, egm(), file_of(mixed))
    assert equal(table, egm())
    assert findings == [("reordered message", "repaired"), ("repeated message", "repaired")]


def test_lost_egm_messages_and_zeros_before_the_first_feedback_are_reported(tmp_path: Path) -> None:
    parts = messages()
    zeros = [egm_message(5 + i, EPOCH_NS, [0.0] * 6) for i in range(2)]
    table, findings = read(tmp_path, egm(), file_of([*zeros, *parts[:30], *parts[33:]]))
    assert findings == [("lost messages", "warning"), ("leading zeros", "repaired")]
    assert np.array_equal(table.columns["J6"], np.delete(egm().columns["J6"], [30, 31, 32]))


def test_test_signals_are_read_where_the_dialect_calls_them_torques(tmp_path: Path) -> None:
    for signals in (6, 12):
        written = egm_torque(signals=signals)
        table, findings = read(tmp_path, written)
        assert equal(table, written)
        assert findings == []
    table, findings = read(tmp_path, egm(), egm_torque().content)
    assert set(table.columns) == {"time", *AXES}
    assert findings == []


def test_test_signals_of_zeros_or_of_some_messages_only_are_left_out_and_reported(
    tmp_path: Path,
) -> None:
    rows = angles_deg().tolist()
    zeros = [egm_message(7 + i, EPOCH_NS + 4_032_000 * i, r, [0.0] * 6) for i, r in enumerate(rows)]
    some = [egm_message(7, EPOCH_NS, rows[0], [5.0] * 6), *messages()[1:]]
    for parts in (zeros, some, messages()):
        table, findings = read(tmp_path, egm_torque(), file_of(parts))
        assert findings == [("no test signals", "warning")]
        assert set(table.columns) == {"time", *AXES}
    with pytest.raises(LogError, match="S5, S6 missing; the file has 'J1'"):
        read(tmp_path, egm_torque(), egm_torque(signals=4).content)


def test_a_damaged_egm_message_is_dropped_and_a_second_one_refused(tmp_path: Path) -> None:
    content = bytearray(egm().content)
    content[400] ^= 1
    table, findings = read(tmp_path, egm(), bytes(content))
    assert ("checksum", "repaired") in findings
    assert len(table) == ROWS - 1
    content[4000] ^= 1
    with pytest.raises(LogError, match="2 of 80 messages have a wrong checksum"):
        read(tmp_path, egm(), bytes(content))


EGM_REFUSED = {
    "another file": (lambda c: b"time,J1\n" + c, "no raw EGM messages"),
    "copied as text": (lambda c: c.replace(b"\r\n", b"\n"), "copied in text mode"),
    "a length of 2 GB": (
        lambda c: c[:11] + b"\xff\xff\xff\x7f" + c[15:],
        "claims 2147483647 bytes",
    ),
    "a length that swallows the rest": (
        lambda c: c[:11] + b"\x00\xf0\x00\x00" + c[15:],
        "damaged at byte 11",
    ),
    "no angles": (lambda _: file_of([egm_message(1, EPOCH_NS, [])]), "no message has joint angles"),
    "seven axes": (lambda _: file_of([egm_message(1, EPOCH_NS, [1.0] * 7)]), "7 joint angles"),
    "an axis that is not there": (
        lambda _: file_of([egm_message(1, EPOCH_NS, [1.0] * 5 + [9e9])]),
        "J6 is 9e",
    ),
    "one number twice": (
        lambda _: file_of(
            [egm_message(1, EPOCH_NS, [1.0] * 6), egm_message(1, EPOCH_NS + 1000, [1.0] * 6)]
        ),
        "sequence number 1 stands twice",
    ),
}


@pytest.mark.parametrize("what", EGM_REFUSED)
def test_egm_files_are_refused_in_words(what: str, tmp_path: Path) -> None:
    change, words = EGM_REFUSED[what]
    with pytest.raises(LogError, match=words):
        read(tmp_path, egm(), change(egm().content))


def test_a_power_loss_leaves_an_egm_file_readable(tmp_path: Path) -> None:
    for tail in (bytes(100_000), b"\x55\x00", egm().content[11:60]):
        table, findings = read(tmp_path, egm(), egm().content + tail)
        assert equal(table, egm())
        assert findings == [("torn end", "repaired")]


# ---- abb_motion_program_exec


def with_cell(row: int, column: int, value: float) -> Callable[[bytes], bytes]:
    at = len(mpe().content) - 4 * (8 * (ROWS - row) - column)
    return lambda content: content[:at] + struct.pack("<f", value) + content[at + 4 :]


MPE_REFUSED = {
    "another file": (lambda c: b"\x7fELF" + c, "not with a file version"),
    "a text of 10^9 bytes": (
        lambda c: c[:4] + struct.pack("<f", 1e9) + c[8:],
        "claims 1e[+]09 bytes",
    ),
    "a text that is NaN long": (
        lambda c: c[:4] + struct.pack("<f", np.nan) + c[8:],
        "claims nan bytes",
    ),
    "other columns": (lambda c: c.replace(b"J3", b"K3"), "J3 missing"),
    "an axis that is not there": (with_cell(5, 4, 9e9), ":6: J3 is 9e"),
    "an angle that is no number": (with_cell(5, 4, np.nan), ":6: J3 is nan"),
    "half a command": (with_cell(9, 1, 2.5), ":10: cmdnum 2.5"),
}


@pytest.mark.parametrize("what", MPE_REFUSED)
def test_mpe_logs_are_refused_in_words(what: str, tmp_path: Path) -> None:
    change, words = MPE_REFUSED[what]
    with pytest.raises(LogError, match=words):
        read(tmp_path, mpe(), change(mpe().content))


# ---- all of them


def in_folder(
    folder: Path, written: Written, content: bytes | None = None
) -> tuple[RobotLog, list[tuple[str, str]]]:
    """A robot's file behind all checks of the recording's reader."""
    name = "log" + written.suffix
    (folder / name).write_bytes(written.content if content is None else content)
    source = SourceFile(files=(name,), dialect=written.dialect)
    log, imported = read_robot(folder, source, ROBOT)
    return log, [(entry.kind, entry.severity) for entry in imported.findings]


ROBOTS = [kind for kind in ALL if not kind.startswith("scope")]


@pytest.mark.parametrize("kind", ROBOTS)
def test_a_robots_file_gives_joint_angles_on_its_own_clock(kind: str, tmp_path: Path) -> None:
    log, findings = in_folder(tmp_path, ALL[kind](tmp_path))
    axes = np.deg2rad(angles_deg().astype(np.float32) if kind == "mpe" else angles_deg())
    # axes of the IRB 2400: joint 3 turns with joint 2 (thesis App. A)
    assert np.allclose(
        joints_to_axes(ROBOT, log.q), axes, rtol=0.0, atol=1e-6 if kind == "mpe" else 1e-14
    )
    step = {"egm": 0.004032, "db3": 0.004000001}.get(
        kind, 0.004000001 if kind.startswith("mcap") else 0.004
    )
    assert np.allclose(
        log.t, step * np.arange(ROWS), rtol=0.0, atol=3e-8 if kind == "mpe" else 1e-15
    )
    assert findings == []


def changed_angle(written: Written, row: int) -> bytes:
    """J4 of one row off by 0.02 deg, the file otherwise as it was."""
    if written.suffix == ".bin":
        return with_cell(row, 5, float(written.columns["J4"][row]) + 0.02)(written.content)
    lines = [json.loads(line) for line in written.content.decode().splitlines()]
    lines[row]["J4"] += 0.02
    return ("\n".join(map(json.dumps, lines)) + "\n").encode()


@pytest.mark.parametrize("row", [0, 1, 2, 33, ROWS - 3, ROWS - 2, ROWS - 1])
@pytest.mark.parametrize("kind", ["json lines", "mpe"])
def test_one_changed_angle_is_reported_where_no_checksum_shows_it(
    kind: str, row: int, tmp_path: Path
) -> None:
    written = ALL[kind](tmp_path)
    log, findings = in_folder(tmp_path, written, changed_angle(written, row))
    assert findings[0][1] == "repaired"
    assert findings[1:] in ([], [("overrun", "warning")])  # where the row was
    assert len(log.t) == ROWS - 1


def test_a_changed_bit_in_an_mcap_bag_is_refused(tmp_path: Path) -> None:
    written = mcap(packed="NONE")
    content = bytearray(written.content)
    content[written.content.rindex(b"joint_3") + 40] ^= 0x10
    with pytest.raises(LogError, match="checksum"):
        read(tmp_path, written, bytes(content))


OTHER_UNITS: dict[str, Callable[[Path], Written]] = {
    "json lines": lambda _: json_lines(scale=np.pi / 180.0),
    "rsi": lambda _: rsi(scale=np.pi / 180.0),
    "egm": lambda _: egm(scale=np.pi / 180.0),
    "mpe": lambda _: mpe(scale=np.pi / 180.0),
    "db3": lambda folder: db3(folder, scale=180.0 / np.pi),
    "mcap": lambda _: mcap(scale=180.0 / np.pi),
}


@pytest.mark.parametrize("kind", OTHER_UNITS)
def test_angles_in_another_unit_than_the_container_has_are_refused(
    kind: str, tmp_path: Path
) -> None:
    with pytest.raises(LogError, match=r"(?i)(in rad|degrees).* where .* declared"):
        in_folder(tmp_path, OTHER_UNITS[kind](tmp_path))


def test_scope_counters_become_encoder_angles(tmp_path: Path) -> None:
    (tmp_path / "bar.csv").write_bytes(scope().content)
    fitted = {name: EncoderFitting(column=name, lines=3600, bits=12) for name in ("b1", "b2")}
    source = SourceFile(files=("bar.csv",), dialect="twincat-scope")
    log, _ = read_ballbar(tmp_path, source, fitted, robot_moves=True)
    trajectory = (counts() + 2**31) % 2**32 - 2**31
    assert np.allclose(
        np.diff(log.angles, axis=0),
        np.diff(trajectory, axis=0) * 2.0 * np.pi / (3600 * 2**12),
        rtol=0.0,
        atol=1e-12,
    )
    assert np.allclose(log.t, 0.01 * np.arange(ROWS), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("family", range(7))
def test_damaged_files_are_equal_reported_or_refused(family: int, tmp_path: Path) -> None:
    """A few files of the campaign in benchmarks.mutated_containers."""
    (tmp_path / "made").mkdir()
    written, mutations = list(families(tmp_path / "made").values())[family]
    tally = campaign(
        written, mutations, 5 * len(mutations), tmp_path / "made", np.random.default_rng(family)
    )
    bad = {"silent", "crash", "hang"}
    if written.dialect == "force-torque":  # no motion leads a load: another digit is as good
        bad -= {"silent"}
    assert not bad & tally.counts.keys(), tally.examples


def test_a_dialect_with_another_unit_of_time_is_refused(tmp_path: Path) -> None:
    dialect = load_dialect("abb-egm")
    wrong = dialect.model_copy(update={"time": dialect.time.model_copy(update={"unit": "us"})})
    (tmp_path / "log.egm").write_bytes(egm().content)
    with pytest.raises(DescriptionError, match="have type: integer, unit: ns"):
        read_file(
            tmp_path / "log.egm",
            "log.egm",
            wrong,
            Layout((), dict.fromkeys(("time", *AXES), "float")),
        )


def test_a_message_of_rsi_that_is_cut_is_a_torn_line(tmp_path: Path) -> None:
    written = rsi(rows=200)
    lines = written.content.decode().split("\n")
    lines[17] = lines[17][:90]
    table, findings = read(tmp_path, written, "\n".join(lines).encode())
    assert findings == [("torn line", "repaired")]
    assert len(table) == 199
    lines[40] = lines[41] = lines[42] = "<Rob>"
    with pytest.raises(LogError, match="4 of 200 rows do not have the header's number of fields"):
        read(tmp_path, written, "\n".join(lines).encode())
    with pytest.raises(LogError, match="is no message <Rob"):
        read(tmp_path, written, b'<Rob Type="KUKA">\n')
