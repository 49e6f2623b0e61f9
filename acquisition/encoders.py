"""Ball-bar encoders: EL5021 counter words to unwrapped counts to radians, with the faults that the terminal admits.

The terminal counts periods and fractions of them in one 32-bit word, `2**bits` counts a line, which starts near 0 at
power-up: the first backward motion reads 4294967295. It has no overflow bits, so the difference of two words is read as a
signed 32-bit number. Status bits: EL5021 documentation, objects 6000 and 6001.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from acquisition.report import Finding, finding
from acquisition.table import Table
from cell.errors import LogError
from cell.recording import EncoderFitting, EncoderName

SPEED_LIMIT = 35.0  # [rad/s] half of what an EL5021 follows at 13 bits (40 kHz, 3600 lines); a ball-bar moves at about 1 rad/s
WORD = 2**32  # values of the counter
SET_COUNTER_DONE = 1 << 2
# Bits of the status word that make a row useless.
FAULTS = {
    1 << 3: ("frequency error", "the encoder turned faster than the terminal follows"),
    1 << 4: ("amplitude error", "the sine signal was too weak"),
    1 << 14: ("invalid process data", "the terminal marked its own data as suspect"),
}
SYNC_ERROR = 1 << 13


def unwrap_counter(counter: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) counts without wraps, of counter words logged as UDINT or DINT; the first word is read as signed.

    Correct while the counter moves by less than 2**31 counts (145 turns at 12 bits of 3600 lines) between two rows.
    """
    step = (np.diff(counter, prepend=np.int64(0)) + WORD // 2) % WORD - WORD // 2
    counts: NDArray[np.int64] = np.cumsum(step)
    return counts


def counts_to_rad(counts: NDArray[np.int64], *, lines: int, bits: int, sign: int) -> NDArray[np.float64]:
    """(N,) [rad] encoder angle; its zero is where the counter was zero, and means nothing."""
    per_count = 2.0 * np.pi / float(lines * 2**bits)
    return counts.astype(np.float64) * (sign * per_count)


def without_faults(table: Table, status: Mapping[EncoderName, str], findings: list[Finding]) -> Table:
    """The rows of one file that no encoder's status word marks as faulty; those left out are appended to `findings`.

    Left out before unwrapping: a garbage word between two good ones could add a whole wrap.
    Raises LogError if a counter was preset within the file.
    """
    silent = [encoder for encoder, column in status.items() if column not in table.columns]
    if silent:
        sentence = f"encoders {', '.join(silent)} have no status column, so their faults cannot be seen."
        findings.append(finding("no status word", "warning", table.files[0], sentence, count=len(silent)))
    faulty = np.zeros(len(table), dtype=bool)
    for encoder, column in status.items():
        if encoder not in silent:
            faulty |= _faulty_rows(table, encoder, column, findings)
    return table.take(~faulty) if faulty.any() else table


def _faulty_rows(table: Table, encoder: EncoderName, column: str, findings: list[Finding]) -> NDArray[np.bool_]:
    word, file = table.columns[column], table.files[0]
    outside = np.flatnonzero((word < 0) | (word > 0xFFFF))
    if outside.size:
        raise LogError(f"{table.place(outside[0])}: column {column}: {word[outside[0]]} is no 16-bit status word.")
    preset = np.flatnonzero(np.diff(word & SET_COUNTER_DONE) > 0) + 1
    if preset.size:
        raise LogError(f"{table.place(preset[0])}: the counter of encoder {encoder} was preset here. Split the file before this line.")
    late = np.flatnonzero(word & SYNC_ERROR)
    if late.size:
        sentence = f"encoder {encoder} missed the bus cycle; its sample may be one cycle old."
        findings.append(finding("sync error", "warning", file, sentence, lines=table.line[late]))
    faulty = np.zeros(len(table), dtype=bool)
    for bit, (kind, meaning) in FAULTS.items():
        rows = (word & bit) != 0
        if rows.any():
            findings.append(finding(kind, "repaired", file, f"encoder {encoder}: {meaning}; rows left out.", lines=table.line[rows]))
        faulty |= rows
    return faulty


def encoder_angles(
    table: Table, t: NDArray[np.float64], fitted: Mapping[EncoderName, EncoderFitting], *, robot_moves: bool
) -> NDArray[np.float64]:
    """(N, E) [rad] unwrapped angles of the fitted encoders, declared sign applied.

    t : (N,) [s]. robot_moves : whether standing counters are a fault.
    Raises LogError for a word that is no 32-bit counter, an implausible jump, or a column without counts.
    """
    columns = []
    for name, encoder in fitted.items():
        counter = table.columns[encoder.column]
        _refuse_other_words(table, encoder.column, counter)
        angle = counts_to_rad(unwrap_counter(counter), lines=encoder.lines, bits=encoder.bits, sign=encoder.sign)
        _refuse_jumps(table, t, angle, name)
        columns.append(angle)
    _refuse_standing(table, columns, fitted, robot_moves=robot_moves)
    return np.stack(columns, axis=1)


def _refuse_other_words(table: Table, column: str, counter: NDArray[np.int64]) -> None:
    limit = WORD if counter.min() >= 0 else WORD // 2  # UDINT, or DINT once there is a negative word
    outside = np.flatnonzero((counter >= limit) | (counter < -WORD // 2))
    if outside.size:
        raise LogError(
            f"{table.place(outside[0])}: column {column}: {counter[outside[0]]} is no 32-bit counter word. "
            f"Expected UDINT, 0 to {WORD - 1}, or DINT, {-WORD // 2} to {WORD // 2 - 1}."
        )


def _refuse_jumps(table: Table, t: NDArray[np.float64], angle: NDArray[np.float64], name: str) -> None:
    step, time = np.diff(angle), np.diff(t)
    # A jittered stamp may follow closely: never divide by less than half the usual time between rows.
    speed = np.abs(step) / np.maximum(time, 0.5 * np.median(time))
    jumps = np.flatnonzero(speed > SPEED_LIMIT)
    if jumps.size:
        row = int(jumps[0])
        raise LogError(
            f"{table.place(row + 1)}: encoder {name} jumps by {step[row]:.4g} rad within {time[row] * 1e3:.4g} ms "
            f"({speed[row]:.3g} rad/s; a ball-bar stays below {SPEED_LIMIT:g}). {jumps.size} such rows. "
            "Was the counter reset, are lines and bits of the encoder declared wrong, or the time column in another unit?"
        )


def _refuse_standing(
    table: Table, angles: list[NDArray[np.float64]], fitted: Mapping[EncoderName, EncoderFitting], *, robot_moves: bool
) -> None:
    standing = [name for name, angle in zip(fitted, angles, strict=True) if np.ptp(angle) == 0.0]
    if standing and (robot_moves or len(standing) < len(angles)):
        column = fitted[standing[0]].column
        value = table.columns[column][0]
        raise LogError(
            f"{table.files[0]}: encoder column without counts: column {column} of encoder {standing[0]} is {value} in every row while "
            "the others or the robot move. Check the cable, or remove the encoder from recording.yaml."
        )
