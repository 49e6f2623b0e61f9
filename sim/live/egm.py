"""A robot controller on this machine that sends EGM feedback: a message for each row of its log."""

from __future__ import annotations

import socket
from types import TracebackType
from typing import Self

import numpy as np

from cell.descriptions import Robot
from cell.dialect import load_dialect
from sim.live.delivery import DeviceThread, Pace
from sim.live.device_logs import TextLog
from sim.logging.containers import egm_message
from sim.logging.robot_files import logged_angles, logged_torques

CYCLE = 2e-3  # [s]
EPOCH_NS = 1_795_000_000 * 10**9  # [ns] of the controller's clock at the log's zero: November 2026


class EgmRobot:
    """Messages of a log until the block ends, once the session is started.

    The axes' torques are test signals, as TestSignDefine has an ABB controller send them.
    """

    def __init__(self, port: int, log: TextLog, robot: Robot, pace: Pace) -> None:
        """port : of this machine, which listens. log : of motor angles [rad], torques behind."""
        dialect = load_dialect("abb-egm-torque")
        motors = np.stack([log.numbers(name) for name in log.scales], axis=1)
        axes = logged_angles(dialect, robot, motors)
        names = [name for name in load_dialect("abb-motor").torque_columns if log.has(name)]
        signals = np.zeros((len(axes), 0))
        if names:
            torques = np.stack([log.numbers(name) for name in names], axis=1)
            signals = logged_torques(dialect, robot, torques)
        stamps = EPOCH_NS + np.rint(log.cells[:, 0].astype(float) * 1e9).astype(np.int64)
        rows = zip(stamps.tolist(), axes.tolist(), signals.tolist(), strict=True)
        self._messages = [egm_message(k, *row) for k, row in enumerate(rows)]
        self._times, self._pace, self._port = log.t, pace, port
        self._sent = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._thread = DeviceThread(self._send, period=CYCLE)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._thread.end()
        self._socket.close()

    def start(self) -> None:
        """Starts the session."""
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Whether all messages were sent within `seconds`."""
        return self._thread.wait(seconds)

    def _send(self) -> bool:
        """Sends what is due, late messages as soon as possible; whether that was the last."""
        due = int(np.searchsorted(self._times, self._pace.delivered, side="right"))
        for message in self._messages[self._sent : due]:
            self._socket.sendto(message, ("127.0.0.1", self._port))
        self._sent = max(self._sent, due)
        return self._sent == len(self._messages)
