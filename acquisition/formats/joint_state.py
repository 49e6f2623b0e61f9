"""One ROS 2 JointState message (sensor_msgs/msg/JointState) from CDR, the wire format of DDS.

Decoded by the library rosbags (the extra `ros`) with its own definition of the message. Those that
a bag brings along are left alone, and nothing in a bag is executed.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from cell.errors import LogError

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
        reason = str(error).rstrip(".")
        raise LogError(f"JointState: {reason}. {_REMEDY}") from None
    stamp, names, positions = state.header.stamp, state.name, state.position.tolist()
    if stamp.sec < 0 or stamp.nanosec >= 1_000_000_000:
        raise LogError(
            f"JointState: a stamp of {stamp.sec} s and {stamp.nanosec} ns cannot be. {_REMEDY}"
        )
    if len(set(names)) < len(names) or len(positions) not in {0, len(names)}:
        raise LogError(
            f"JointState: {len(positions)} positions for the joints {', '.join(names[:12])}. "
            f"{_REMEDY}"
        )
    if not all(map(math.isfinite, positions)):
        raise LogError(f"JointState: a position is not finite: {positions[:12]}. {_REMEDY}")
    stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
    return JointState(stamp_ns, dict(zip(names, positions, strict=False)))
