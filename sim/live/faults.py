"""Faults of a cell that begin at an instant of a recording, as its device files would show them.

Each takes the logs, the instant [s] on the robot's clock and a generator, changes the rows from
there on in place, and returns the instant from which anyone could see it. The channel is drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.sim.live.device_logs import WORD, Logs, TextLog

Rng = np.random.Generator
Fault = Callable[[Logs, float, Rng], float]

DWELL = 4.0  # [s] longest dwell of the simulated paths: a robot may stand that long
WRIST = 3  # joints 4 and on
MOVING = 0.0125  # [rad] of any joint within two seconds
AT_REST = 1e-5  # [rad, m] noise of a channel that stands


def _behind(log: TextLog, at: float) -> NDArray[np.intp]:
    return np.flatnonzero(log.t >= at)


def _frozen(source: str, *, whole: bool = False) -> Fault:
    """Values that repeat: of one channel of a log, or of all."""

    def fault(logs: Logs, at: float, rng: Rng) -> float:
        log = logs[source]
        names, rows = list(log.scales), _behind(log, at)
        for name in names if whole else [str(rng.choice(names))]:
            column = log.column(name)
            log.cells[rows, column] = log.cells[rows[0] - 1, column]
        return at

    return fault


def _exchanged(source: str) -> Fault:
    """Two channels of a log that change places."""

    def fault(logs: Logs, at: float, rng: Rng) -> float:
        log = logs[source]
        names, rows = list(log.scales), _behind(log, at)
        i, j = (log.column(names[int(k)]) for k in sorted(rng.choice(len(names), 2, replace=False)))
        log.cells[rows[:, None], [i, j]] = log.cells[rows[:, None], [j, i]]
        return at

    return fault


def _scaled(factor: float) -> Fault:
    """An encoder that counts so many times as far."""

    def fault(logs: Logs, at: float, rng: Rng) -> float:
        log = logs["ballbar"]
        rows, name = _behind(log, at), str(rng.choice(list(log.scales)))
        counts = log.numbers(name)
        first = counts[rows[0] - 1]
        moved = (counts[rows] - first + 0.5 * WORD) % WORD - 0.5 * WORD
        log.put(rows, name, first + factor * moved)
        return at

    return fault


def _shifted(log: TextLog, at: float, name: str, sizes: tuple[float, float], rng: Rng) -> None:
    """Moves a channel by a drawn size [rad], either way."""
    rows, size = _behind(log, at), float(rng.uniform(*sizes)) * rng.choice([-1.0, 1.0])
    log.put(rows, name, log.numbers(name)[rows] + size * log.scales[name])


def slip(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder slips on its shaft by 1 to 5 mrad."""
    name = str(rng.choice(list(logs["ballbar"].scales)))
    _shifted(logs["ballbar"], at, name, (1e-3, 5e-3), rng)
    return at


def stamps_back(logs: Logs, at: float, rng: Rng) -> float:
    """The ball-bar's clock is set back by 1 to 10 s."""
    log = logs["ballbar"]
    rows = _behind(log, at)
    back = int(1e9 * rng.uniform(1.0, 10.0))
    log.cells[rows, 0] = [str(int(stamp) - back) for stamp in log.cells[rows, 0]]
    return at


def weak_signal(logs: Logs, at: float, rng: Rng) -> float:
    """An encoder's sine is too weak; its status word says so."""
    log = logs["ballbar"]
    rows, name = _behind(log, at), str(rng.choice(list(log.scales)))
    log.cells[rows, log.column(name.replace("b", "s"))] = str(1 << 4)
    return at


def tool_moved(logs: Logs, at: float, rng: Rng) -> float:
    """The zero of a wrist's motor moves by 2 to 5 mrad at the joint, as after a collision."""
    names = list(logs["robot"].scales)
    name = names[int(rng.integers(WRIST, len(names)))]
    _shifted(logs["robot"], at, name, (2e-3, 5e-3), rng)
    return at


def robot_stands(logs: Logs, at: float, rng: Rng) -> float:
    """The robot stops; the cause is there once it stands for longer than any dwell of the path."""
    for log in logs.values():
        rows = _behind(log, at)
        pair = slice(rows[0] - 1, rows[0] + 1)  # both logs stop at one instant
        for name, scale in log.scales.items():
            value = np.interp(at, log.t[pair], log.numbers(name)[pair])
            log.put(rows, name, value + rng.normal(0.0, AT_REST * scale, rows.size))
    return at + DWELL


def tracker_stops(logs: Logs, at: float, rng: Rng) -> float:
    """The tracker's program ends: no more rows."""
    del rng
    log = logs["tracker"]
    before = log.t < at
    logs["tracker"] = replace(log, cells=log.cells[before], t=log.t[before])
    return at


FAULTS: dict[str, Fault] = {
    "encoder_frozen": _frozen("ballbar"),  # an encoder's counter repeats its value
    "motor_frozen": _frozen("robot"),  # the angle of one motor does
    "robot_log_frozen": _frozen("robot", whole=True),  # all angles of the robot's log do
    "encoders_exchanged": _exchanged("ballbar"),  # two encoders change places
    "motors_exchanged": _exchanged("robot"),  # two motors do
    "encoder_reversed": _scaled(-1.0),  # an encoder counts in the other direction
    "line_count": _scaled(2.0),  # an encoder counts twice as far
    "tracker_frozen": _frozen("tracker", whole=True),  # a target that was lost keeps its place
    **{
        fault.__name__: fault
        for fault in (slip, stamps_back, weak_signal, tool_moved, robot_stands, tracker_stops)
    },
}
OF_TRACKER = ("tracker_frozen", "tracker_stops")
OF_ENCODERS = (
    "encoder_frozen", "encoders_exchanged", "encoder_reversed", "line_count", "slip",
    "stamps_back", "weak_signal",
)  # fmt: skip


def stands(logs: Logs, at: float) -> bool:
    """Whether the robot dwells about an instant [s]: nothing shows then, whatever is wrong."""
    log = logs["robot"]
    rows = (log.t > at - 0.5) & (log.t < at + 1.5)
    moved = [np.ptp(log.numbers(name)[rows]) / scale for name, scale in log.scales.items()]
    return max(moved, default=0.0) < MOVING


def moving_at(logs: Logs, at: float) -> float:
    """The first whole second from an instant [s] on at which the robot moves."""
    while stands(logs, at):
        at += 1.0
    return at
