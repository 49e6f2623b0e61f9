"""Devices that deliver a recording at a common pace, each in a thread of its own."""

from __future__ import annotations

import socket
import threading
import time
from abc import ABC, abstractmethod
from typing import Self

import numpy as np

from ballbar.cell.descriptions import Robot
from ballbar.cell.dialect import load_dialect
from ballbar.sim.live.device_logs import GrowingRecording, TextLog
from ballbar.sim.logging.containers import egm_message
from ballbar.sim.logging.robot_files import logged_angles, logged_torques

REAL_TIME = 1.0


class Pace:
    """Seconds of a recording that have been delivered; several devices share one."""

    def __init__(self, speed: float) -> None:
        """speed : times real time."""
        self._speed, self._rate = speed, 0.0
        self._since, self._before = time.monotonic(), 0.0  # when the rate was set; [s] until then
        self._lock = threading.Lock()

    @property
    def delivered(self) -> float:
        """[s] of the recording."""
        with self._lock:
            return self._before + self._rate * (time.monotonic() - self._since)

    def start(self) -> None:
        """The devices begin."""
        self._set(self._speed)

    def hold_back(self, *, wanted: bool) -> None:
        """Goes on in real time, or no longer; a speed below that stays as it is."""
        self._set(min(self._speed, REAL_TIME) if wanted else self._speed)

    def _set(self, rate: float) -> None:
        with self._lock:
            now = time.monotonic()
            self._before += self._rate * (now - self._since)
            self._since, self._rate = now, rate


class Device(ABC):
    """A device that works from its start until all is done, or until the block ends."""

    def __init__(self, period: float) -> None:
        """period : [s] of its cycle."""
        self._period, self._stop = period, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._close()

    def start(self) -> None:
        """Starts the device."""
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Whether all was done, or the device has ended, within `seconds`."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stop.wait(self._period) and not self._cycle():
            pass

    @abstractmethod
    def _cycle(self) -> bool:
        """Does what is due, also what is late; whether there is no more to do."""

    @abstractmethod
    def _close(self) -> None:
        """Ends the connections."""


CYCLE, WRITES = 2e-3, 0.02  # [s] of a controller, and of a program that writes a file
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


class GrowingFiles(Device):
    """Logs that their programs append to, row by row."""

    def __init__(self, growing: GrowingRecording, pace: Pace) -> None:
        super().__init__(WRITES)
        self._growing, self._pace = growing, pace

    def _cycle(self) -> bool:
        now = self._pace.delivered
        over = now >= max(float(log.t[-1]) for log in self._growing.logs.values())
        self._growing.write_until(np.inf if over else now)
        return over

    def _close(self) -> None:
        """No file is held open."""
