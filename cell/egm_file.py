"""Files of raw EGM messages: FILE_START, then one frame a message.

A frame is length (uint32), CRC-32 of length and message (uint32), message; little-endian. The sum
is there because a flipped bit in a double is a joint angle like any other.
"""

from __future__ import annotations

import struct
import zlib

FILE_START = b"EGM-RAW/1\r\n"  # the line end shows a copy in text mode
LONGEST_MESSAGE = 65_507  # bytes that fit a UDP datagram; a real message has about a hundred
FRAME = struct.Struct("<II")  # length and sum


def frame(message: bytes) -> bytes:
    """A message as it stands in a file, behind FILE_START.

    Raises ValueError if it is empty or longer than a datagram.
    """
    if not 0 < len(message) <= LONGEST_MESSAGE:
        raise ValueError(f"an EGM message has 1 to {LONGEST_MESSAGE} bytes, not {len(message)}")
    length = len(message).to_bytes(4, "little")
    return FRAME.pack(len(message), zlib.crc32(message, zlib.crc32(length))) + message
