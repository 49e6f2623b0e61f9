"""A robot controller on this machine that sends EGM feedback: a message for each row of its log."""

from __future__ import annotations

import socket

import numpy as np

from cell.descriptions import Robot
from cell.dialect import load_dialect
from sim.live.delivery import Device, Pace
from sim.live.device_logs import TextLog
from sim.logging.containers import egm_message
from sim.logging.robot_files import logged_angles, logged_torques

CYCLE = 2e-3  # [s]
EPOCH_NS = 1_795_000_000 * 10**9  # [ns] of the controller's clock at the log's zero: November 2026


class EgmRobot(Device):
    """Messages of a log until the block ends, once the session is started.

    The axes' torques are test signals, as TestSignDefine has an ABB controller send them.
    """

    def __init__(self, port: int, log: TextLog, robot: Robot, pace: Pace) -> None:
        """port : of this machine, which listens. log : of motor angles [rad], torques behind."""
        super().__init__(CYCLE)
        dialect = load_dialect("abb-egm-torque")
        axes = logged_angles(dialect, robot, log.table(list(log.scales)))
        names = [name for name in load_dialect("abb-motor").torque_columns if log.has(name)]
        signals = logged_torques(dialect, robot, log.table(names)) if names else axes[:, :0]
        stamps = EPOCH_NS + np.rint(log.cells[:, 0].astype(float) * 1e9).astype(np.int64)
        rows = zip(stamps.tolist(), axes.tolist(), signals.tolist(), strict=True)
        self._messages = [egm_message(k, *row) for k, row in enumerate(rows)]
        self._times, self._pace, self._port, self._sent = log.t, pace, port, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def _cycle(self) -> bool:
        due = int(np.searchsorted(self._times, self._pace.delivered, side="right"))
        for message in self._messages[self._sent : due]:
            self._socket.sendto(message, ("127.0.0.1", self._port))
        self._sent = max(self._sent, due)
        return self._sent == len(self._messages)

    def _close(self) -> None:
        self._socket.close()
