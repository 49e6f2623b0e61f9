"""Messages of ROS 2: JointState from CDR, the wire format of DDS, and all of an MCAP bag.

A JointState (sensor_msgs/msg/JointState) is decoded by the library rosbags with its own definition
of the message. Those that a bag brings along are left alone, and nothing in a bag is executed.

MCAP bags are read as a stream by the library mcap: of a bag cut off by a crash, all complete
chunks; rosbags refuses it, and unpacks whatever a chunk holds. Chunks are unpacked here: what they
claim to unpack to is checked first, and no more is unpacked. Needs the extra `ros`. Source: MCAP
format specification, version 0.
"""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from ballbar.acquisition.report import Finding, finding
from ballbar.cell.errors import LogError

_TYPES = get_typestore(Stores.ROS2_HUMBLE)  # the message is the same in all releases
_REMEDY = "Copy the bag again, or correct the publisher and record again."


class JointState(NamedTuple):
    """Positions of some joints at one time."""

    stamp_ns: int  # header.stamp, not the time of recording
    positions: dict[str, float]  # [rad] by name: the order may change from message to message


def decode(message: bytes) -> JointState:
    """Stamp and positions of one message.

    Raises LogError if the bytes are no such message, a joint stands twice, or a position is not
    finite.
    """
    try:
        state: Any = _TYPES.deserialize_cdr(message, "sensor_msgs/msg/JointState")
    except SerdeError as error:
        raise LogError(f"JointState: {str(error).rstrip('.')}. {_REMEDY}") from None
    stamp, names, positions = state.header.stamp, state.name, state.position.tolist()
    if stamp.sec < 0 or stamp.nanosec >= 1_000_000_000:
        raise LogError(f"JointState: no stamp is {stamp.sec} s {stamp.nanosec} ns. {_REMEDY}")
    if len(set(names)) < len(names) or len(positions) not in {0, len(names)}:
        raise LogError(
            f"JointState: {len(positions)} positions for the joints {', '.join(names[:12])}. "
            f"{_REMEDY}"
        )
    if not all(map(math.isfinite, positions)):
        raise LogError(f"JointState: a position is not finite: {positions[:12]}. {_REMEDY}")
    stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
    return JointState(stamp_ns, dict(zip(names, positions, strict=False)))


_RECOVER = "The bag is damaged: copy it again, or save its other chunks with `mcap recover`."
_LARGEST_CHUNK = 100_000_000  # bytes unpacked; recorders make chunks of 1 to 4 MB
_MAGIC = b"\x89MCAP0\r\n"
_DAMAGE = (
    McapError,
    CRCValidationError,
    UnicodeDecodeError,
    struct.error,
    ValueError,
    OverflowError,
)


def mcap_messages(
    path: Path, file: str, kind: str, findings: list[Finding]
) -> Iterator[tuple[str, bytes]]:
    """Topic and CDR bytes of each message of one type, as they stand in the bag.

    A bag that is cut off is reported in `findings` once its last record is read.
    Raises LogError if the bag is damaged.
    """
    schemas: dict[int, str] = {}
    topics: dict[int, str] = {}
    with (
        path.open("rb") as opened,
        mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as stream,
    ):
        size, complete = len(stream), 0
        if stream[: len(_MAGIC)] != _MAGIC:
            what = f"no MCAP bag: it does not begin with {_MAGIC!r}."
            raise LogError.at(file, what, "Copy it again, or name the dialect of what it is.")
        try:
            for record in _records(stream, size):
                complete = stream.tell()
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel) and schemas.get(record.schema_id) == kind:
                    if record.message_encoding != "cdr":
                        raise LogError(
                            f"topic {record.topic} is encoded as {record.message_encoding!r}; ROS "
                            "2 writes cdr. Record it again with ROS 2."
                        )
                    topics[record.id] = record.topic
                elif isinstance(record, Message) and record.channel_id in topics:
                    yield topics[record.channel_id], record.data
        except LogError as error:
            raise LogError(f"{file}: behind byte {complete}: {error}") from None
        except _DAMAGE as error:
            if stream.tell() < size or not isinstance(error, (McapError, struct.error)):
                raise LogError(
                    f"{file}: damaged behind byte {complete}: {error}. {_RECOVER}"
                ) from None
            sentence = f"no whole record behind byte {complete} of {size}; what is before is read."
            findings.append(finding("torn end", file, sentence, count=1))


def _records(stream: mmap.mmap, size: int) -> Iterator[McapRecord]:
    """All records of the bag, those of the chunks included."""
    bag = cast("BinaryIO", stream)  # an mmap reads and seeks as a file does
    reader = StreamReader(bag, emit_chunks=True, validate_crcs=True, record_size_limit=size)
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        unpacked = replace(record, compression="", data=_unpack(record))
        try:
            content = breakup_chunk(unpacked)
        except _DAMAGE as error:
            raise LogError(f"a chunk is damaged: {error}. {_RECOVER}") from None
        yield from content


def _decompressed(chunk: Chunk, most: int) -> bytes:
    """The content of a chunk, up to `most` bytes of what was compressed."""
    match chunk.compression:
        case "zstd":
            return zstandard.ZstdDecompressor().stream_reader(chunk.data).read(most)
        case "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most))
        case "" | None:
            return chunk.data
    raise LogError(
        f"a chunk is packed with {chunk.compression!r}; lz4 and zstd are read. Pack it again with "
        "one of these."
    )


def _unpack(chunk: Chunk) -> bytes:
    """The content of a chunk: as long as it claims, and never more in memory."""
    claimed = chunk.uncompressed_size
    if claimed > _LARGEST_CHUNK:
        raise LogError(
            f"a chunk claims to unpack to {claimed} bytes; at most {_LARGEST_CHUNK} are read. "
            f"{_RECOVER}"
        )
    try:
        data = _decompressed(chunk, claimed + 1)
    except (zstandard.ZstdError, RuntimeError) as error:
        raise LogError(f"a chunk cannot be unpacked ({error}). {_RECOVER}") from None
    if len(data) != claimed:
        got = "more" if len(data) > claimed else len(data)
        raise LogError(f"a chunk that claims {claimed} bytes has {got}. {_RECOVER}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise LogError(f"the checksum of a chunk is wrong. {_RECOVER}")
    return bytes(data)
