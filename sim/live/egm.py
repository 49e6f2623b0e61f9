"""A robot controller on this machine that sends EGM feedback: a message for each row of its log."""

from __future__ import annotations

import socket
import threading
from types import TracebackType
from typing import Self

import numpy as np

from cell.descriptions import Robot
from cell.robot_angles import joints_to_axes, motors_to_joints
from sim.live.device_logs import TextLog
from sim.live.pace import Pace
from sim.logging.containers import egm_message

CYCLE = 2e-3  # [s]
EPOCH_NS = 1_795_000_000 * 10**9  # [ns] of the controller's clock at the log's zero: November 2026


class EgmRobot:
    """Messages of a log until the block ends, once the session is started."""

    def __init__(self, port: int, log: TextLog, robot: Robot, pace: Pace) -> None:
        """port : of this machine, which listens. log : of motor angles [rad]."""
        motors = np.stack([log.numbers(name) for name in log.scales], axis=1)
        axes = np.degrees(joints_to_axes(robot, motors_to_joints(robot, motors)))
        stamps = EPOCH_NS + np.rint(log.cells[:, 0].astype(float) * 1e9).astype(np.int64)
        rows = zip(stamps.tolist(), axes.tolist(), strict=True)
        self._messages = [egm_message(k, stamp, angles) for k, (stamp, angles) in enumerate(rows)]
        self._times, self._pace, self._port = log.t, pace, port
        self._stop = threading.Event()
        self._task = threading.Thread(target=self._send, daemon=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        if self._task.is_alive():
            self._task.join()

    def start(self) -> None:
        """Starts the session."""
        self._task.start()

    def wait(self, seconds: float) -> bool:
        """Whether all messages were sent within `seconds`."""
        self._task.join(seconds)
        return not self._task.is_alive()

    def _send(self) -> None:
        """Sends what is due, late messages as soon as possible."""
        sent = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while sent < len(self._messages) and not self._stop.wait(CYCLE):
                due = int(np.searchsorted(self._times, self._pace.delivered, side="right"))
                for message in self._messages[sent:due]:
                    out.sendto(message, ("127.0.0.1", self._port))
                sent = max(sent, due)
