"""Ball-bar encoders: EL5021 counter words to angles, with the faults that the terminal admits.

The terminal counts periods and fractions of them in one 32-bit word, `2**bits` counts a line, which
starts near 0 at power-up: the first backward motion reads 4294967295. It has no overflow bits, so
the difference of two words is read as a signed 32-bit number. Status bits: EL5021 documentation,
objects 6000 and 6001.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.faults.damaged_values import with_damaged
from ballbar.acquisition.faults.jumps import find_jumps
from ballbar.acquisition.flags import RowFlag, usable
from ballbar.acquisition.sources import Fitted
from ballbar.acquisition.table.table import Table
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.neighbours import Mask
from ballbar.cell.recording import EncoderName

Counts = NDArray[np.int64]

# [rad/s] half of what an EL5021 follows at 13 bits (40 kHz, 3600 lines); a ball-bar moves at
# about 1 rad/s.
SPEED_LIMIT = 35.0
WORD = 2**32  # values of the counter
SHORT_WORD = 2**16  # values of one that was cut to 16 bits
SOME_WRAPS = 2  # of a cut one; so many may be two damaged rows
SET_COUNTER_DONE = 1 << 2
# Bits of the status word that make a row useless.
FAULTS = {
    1 << 3: (
        RowFlag.FREQUENCY,
        "frequency error",
        "the encoder turned faster than the terminal follows",
    ),
    1 << 4: (RowFlag.AMPLITUDE, "amplitude error", "the sine signal was too weak"),
    1 << 14: (
        RowFlag.INVALID,
        "invalid process data",
        "the terminal marked its own data as suspect",
    ),
}
SYNC_ERROR = 1 << 13
TOGGLE = 1 << 15
# Of the rows: then every bus cycle is logged, and a toggle bit that does not change means old data.
_TOGGLES = 0.9
# Lines that an encoder may have turned since power-up to be taken for just switched on.
BURST = 0.1  # of the mean step of the stamps
_NEAR_ZERO = 4


def unwrap_counter(counter: Counts, valid: Mask | None = None) -> Counts:
    """(N,) [counts] without wraps, of counter words (N,) logged as UDINT or DINT.

    valid : (N,) rows to count from one to the next; the words of the others are taken from the
        valid row
        before, and a garbage word between two good ones adds no wrap.
    The first word is read as signed. Correct while the counter moves by less than 2**31 counts (145
    turns at 12 bits of 3600 lines) between two rows.
    """
    if valid is None or valid.all():
        return np.asarray(np.cumsum(signed_word(np.diff(counter, prepend=np.int64(0)))))
    rows = np.flatnonzero(valid)
    counts = np.zeros(counter.size, dtype=np.int64)
    if not rows.size:
        return counts
    counts[rows] = unwrap_counter(counter[rows])
    before = np.searchsorted(rows, np.arange(counter.size), side="right") - 1
    base = rows[np.clip(before, 0, None)]
    return np.asarray(counts[base] + signed_word(counter - counter[base]))


def signed_word(difference: Counts) -> Counts:
    """(N, ...) [counts] differences (N, ...) of counter words as signed 32-bit numbers."""
    return difference.astype(np.int32).astype(np.int64)  # the low 32 bits


def counts_to_rad(counts: Counts, *, lines: int, bits: int, sign: int) -> Array:
    """(N, ...) [rad] encoder angles of counts (N, ...); zero is where the counter was zero.

    sign : +1 or -1, direction of the encoder.
    """
    per_count = 2.0 * np.pi / float(lines * 2**bits)
    return counts.astype(np.float64) * (sign * per_count)


def with_status_checked(table: Table, status: Mapping[EncoderName, str]) -> Table:
    """The table of one file with flags and findings for the faults in its status words.

    status : column of each encoder's status word; columns may be absent.
    Rows at which a counter was preset have the flag PRESET.
    Raises LogError for a number that is no status word.
    """
    silent = [encoder for encoder, column in status.items() if column not in table.columns]
    if silent:
        sentence = f"encoders {', '.join(silent)} have no status column: their faults are not seen."
        table = table.remarked("no status word", sentence, count=len(silent))
    for encoder, column in status.items():
        if encoder not in silent:
            table = _with_status_word_checked(table, encoder, column)
    return table


def _with_status_word_checked(table: Table, encoder: EncoderName, column: str) -> Table:
    word = table.columns[column]
    outside = np.flatnonzero((word < 0) | (word > 0xFFFF))
    if outside.size:
        raise LogError(
            f"{table.location(outside[0])}: column {column}: {word[outside[0]]} is no 16-bit "
            "status word. Log the status word as UINT, 0 to 65535."
        )
    preset = np.flatnonzero(np.diff(word & SET_COUNTER_DONE) > 0) + 1
    sentence = f"the counter of encoder {encoder} was preset here; a new segment."
    table = table.remarked("counter preset", sentence, rows=preset, flag=RowFlag.PRESET)
    late = (word & SYNC_ERROR) != 0
    sentence = f"encoder {encoder} missed the bus cycle; its sample may be one cycle old."
    table = table.remarked("sync error", sentence, rows=late, flag=RowFlag.SYNC)
    for bit, (flag, kind, meaning) in FAULTS.items():
        sentence = f"encoder {encoder}: {meaning}; rows left out."
        table = table.remarked(kind, sentence, rows=(word & bit) != 0, flag=flag)
    stale = np.concatenate(([False], np.diff(word & TOGGLE) == 0))
    if stale.sum() > (1.0 - _TOGGLES) * len(table):
        return table  # not every bus cycle is logged
    sentence = f"the toggle bit of encoder {encoder} stands still: data of the row before."
    return table.remarked("stale process data", sentence, rows=stale, flag=RowFlag.STALE)


def counter_scales(fitted: Fitted) -> dict[str, float]:
    """[rad] that a count of each fitted encoder's column is worth."""
    return {
        encoder.column: 2.0 * np.pi / float(encoder.lines * 2**encoder.bits)
        for encoder in fitted.values()
    }


def counter_words(table: Table, fitted: Fitted) -> Counts:
    """(N, E) [counts] counter words of the fitted encoders.

    Raises LogError for a word that is no 32-bit counter, or a counter that wraps as one of 16 bits.
    """
    for encoder in fitted.values():
        counter = table.columns[encoder.column]
        # UDINT, or DINT once there is a negative word.
        limit = WORD if counter.min() >= 0 else WORD // 2
        outside = np.flatnonzero((counter >= limit) | (counter < -WORD // 2))
        if outside.size:
            what = f"column {encoder.column}: {counter[outside[0]]} is no 32-bit counter word."
            raise LogError.at(table.location(outside[0]), what, "Log it as UDINT or DINT.")
        rows = np.flatnonzero(usable(table.flags))
        counter = counter[rows]
        wraps = np.flatnonzero(np.abs(np.diff(counter)) > SHORT_WORD // 2)
        if wraps.size > SOME_WRAPS and np.ptp(counter) < SHORT_WORD:
            raise LogError(
                f"{table.location(rows[wraps[0] + 1])}: column {encoder.column}: {wraps.size} "
                "wraps as of the lower 16 bits of a counter. Log the whole word, UDINT or DINT."
            )
    return np.stack([table.columns[encoder.column] for encoder in fitted.values()]).T


def with_jumps_checked(table: Table, t: Array, words: Counts, fitted: Fitted) -> Table:
    """The table with rows flagged to which no motion leads, or from which a counter counts again.

    t : (N,) [s]. words : (N, E) counter words. Rows with excluding flags are not looked at.
    Raises LogError if the encoders would turn too fast throughout.
    """
    scale = np.array(list(counter_scales(fitted).values()))
    rows = np.flatnonzero(usable(table.flags))
    if rows.size < 2:
        return table
    words, names = words[rows], list(fitted)
    limits = np.full(scale.size, SPEED_LIMIT)
    jumps = find_jumps(t[rows], words, limits, lambda a, b: signed_word(a - b) * scale)
    if jumps.many():
        row, steps = int(jumps.fast[0]), signed_word(np.diff(words, axis=0)) * scale
        k = int(np.abs(steps[row - 1]).argmax())
        ms = float(t[rows[row]] - t[rows[row - 1]]) * 1e3
        if 1e-3 * ms < BURST * float(t[-1] - t[0]) / t.size:
            what = f"{jumps.fast.size} rows come with or right behind the row before, in bursts: "
            what += "the stamps are those of arrival, and no motion leads from row to row."
            raise LogError.at(
                table.location(rows[row]), what, "Log the time at which the counters were read."
            )
        raise LogError(
            f"{table.location(rows[row])}: encoder {names[k]} jumps by {steps[row - 1, k]:.4g} rad "
            f"within {ms:.4g} ms ({jumps.speed[0].max():.3g} rad/s; a ball-bar stays below "
            f"{SPEED_LIMIT:g}). {jumps.fast.size} such rows. Was the counter reset, are lines and "
            "bits of the encoder declared wrong, or the time column in another unit? Correct these "
            "in recording.yaml, or cut the log before this line."
        )
    if jumps.damaged.any():
        table = with_damaged(table, rows[jumps.damaged])
    if not jumps.lasting.size:
        return table
    row = jumps.lasting[0]
    size = np.abs(signed_word(words[row] - words[row - 1])) * scale
    jumped = names[int(size.argmax())]
    sentence = f"encoder {jumped} jumps by {size.max():.4g} rad: reset, or moved on unseen."
    reset, flag = rows[jumps.lasting], RowFlag.PRESET
    return table.remarked("counter jumped", sentence, rows=reset, flag=flag)


def powered_up(words: Counts, fitted: Fitted, before: int | None, behind: int | None) -> bool:
    """Whether all counters start near zero at a row while at least one was far from it before.

    words : (N, E) counter words. before, behind : rows, if there are any.
    """
    if before is None or behind is None:
        return False
    limit = np.array([_NEAR_ZERO * 2**encoder.bits for encoder in fitted.values()])
    starts = (np.abs(signed_word(words[behind])) <= limit).all()
    return bool(starts and (np.abs(signed_word(words[before])) > 10 * limit).any())


def encoder_angles(words: Counts, valid: Mask, fitted: Fitted) -> Array:
    """(N, E) [rad] unwrapped angles of the fitted encoders, with their declared direction.

    words : (N, E) counter words. valid : (N,) rows to count from one to the next.
    """
    columns = [
        counts_to_rad(unwrap_counter(words[:, k], valid), lines=e.lines, bits=e.bits, sign=e.sign)
        for k, e in enumerate(fitted.values())
    ]
    return np.stack(columns).T


def refuse_standing(table: Table, words: Counts, fitted: Fitted, *, robot_moves: bool) -> None:
    """Raises LogError for a counter that stands while others, or the robot, move.

    words : (N, E) counter words.
    """
    valid = usable(table.flags)
    first = words[int(np.argmax(valid))]
    standing = [k for k, column in enumerate(words.T) if (column[valid] == first[k]).all()]
    if standing and (robot_moves or len(standing) < len(fitted)):
        name, encoder = list(fitted.items())[standing[0]]
        what = f"encoder column without counts: column {encoder.column} of encoder {name} is "
        what += f"{first[standing[0]]} in every row while the others or the robot move."
        remedy = "Check the cable, or remove the encoder from recording.yaml."
        raise LogError.at(table.files[0], what, remedy)
