"""Ball-bar encoders: EL5021 counter words to unwrapped counts to radians, with the faults that the terminal admits.

The terminal counts periods and fractions of them in one 32-bit word, `2**bits` counts a line, which starts near 0 at
power-up: the first backward motion reads 4294967295. It has no overflow bits, so the difference of two words is read as a
signed 32-bit number. Status bits: EL5021 documentation, objects 6000 and 6001.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from acquisition.faults.jumps import find_jumps
from acquisition.flags import Flags, RowFlag, usable
from acquisition.report import Finding, finding
from acquisition.table.table import Table
from cell.errors import LogError
from cell.recording import EncoderFitting, EncoderName

Array = NDArray[np.float64]

SPEED_LIMIT = 35.0  # [rad/s] half of what an EL5021 follows at 13 bits (40 kHz, 3600 lines); a ball-bar moves at about 1 rad/s
WORD = 2**32  # values of the counter
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
_TOGGLES = 0.9  # of the rows: then every bus cycle is logged, and a toggle that stands still tells of old data
_NEAR_ZERO = (
    4  # lines that an encoder may have turned since power-up to be taken for just switched on
)


def unwrap_counter(
    counter: NDArray[np.int64], sound: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """(N,) counts without wraps, of counter words logged as UDINT or DINT; the first word is read as signed.

    sound : (N,) rows to count from one to the next; the words of the others are taken from the sound row before, and a garbage
    word between two good ones adds no wrap. Correct while the counter moves by less than 2**31 counts (145 turns at 12 bits
    of 3600 lines) between two rows.
    """
    if sound is None or sound.all():
        return np.asarray(np.cumsum(signed_word(np.diff(counter, prepend=np.int64(0)))))
    rows = np.flatnonzero(sound)
    counts = np.zeros(counter.size, dtype=np.int64)
    if not rows.size:
        return counts
    counts[rows] = unwrap_counter(counter[rows])
    base = rows[np.clip(np.searchsorted(rows, np.arange(counter.size), side="right") - 1, 0, None)]
    return np.asarray(counts[base] + signed_word(counter - counter[base]))


def signed_word(difference: NDArray[np.int64]) -> NDArray[np.int64]:
    """Differences of counter words as signed 32-bit numbers."""
    return difference.astype(np.int32).astype(np.int64)  # the low 32 bits


def counts_to_rad(
    counts: NDArray[np.int64], *, lines: int, bits: int, sign: int
) -> NDArray[np.float64]:
    """(N,) [rad] encoder angle; its zero is where the counter was zero, and means nothing."""
    per_count = 2.0 * np.pi / float(lines * 2**bits)
    return counts.astype(np.float64) * (sign * per_count)


def status_flags(
    table: Table, status: Mapping[EncoderName, str], findings: list[Finding]
) -> tuple[Flags, NDArray[np.intp]]:
    """(N,) flags of the rows of one file, and the rows at which a counter was preset; what is found is appended to `findings`."""
    silent = [encoder for encoder, column in status.items() if column not in table.columns]
    if silent:
        sentence = (
            f"encoders {', '.join(silent)} have no status column, so their faults cannot be seen."
        )
        findings.append(
            finding("no status word", "warning", table.files[0], sentence, count=len(silent))
        )
    flags = np.zeros(len(table), dtype=np.uint32)
    preset: list[NDArray[np.intp]] = []
    for encoder, column in status.items():
        if encoder not in silent:
            flags |= _status_flags(table, encoder, column, findings)
            preset.append(np.flatnonzero(np.diff(table.columns[column] & SET_COUNTER_DONE) > 0) + 1)
    rows = (
        np.unique(np.concatenate(preset)).astype(np.intp) if preset else np.zeros(0, dtype=np.intp)
    )
    flags[rows] |= np.uint32(RowFlag.PRESET)
    return flags, rows


def _status_flags(
    table: Table, encoder: EncoderName, column: str, findings: list[Finding]
) -> Flags:
    word, file = table.columns[column], table.files[0]
    outside = np.flatnonzero((word < 0) | (word > 0xFFFF))
    if outside.size:
        raise LogError(
            f"{table.place(outside[0])}: column {column}: {word[outside[0]]} is no 16-bit status word."
        )
    flags = np.zeros(len(table), dtype=np.uint32)
    preset = np.flatnonzero(np.diff(word & SET_COUNTER_DONE) > 0) + 1
    if preset.size:
        sentence = f"the counter of encoder {encoder} was preset here; a new segment."
        findings.append(
            finding("counter preset", "warning", file, sentence, lines=table.line[preset])
        )
    late = (word & SYNC_ERROR) != 0
    if late.any():
        sentence = f"encoder {encoder} missed the bus cycle; its sample may be one cycle old."
        findings.append(finding("sync error", "warning", file, sentence, lines=table.line[late]))
        flags[late] |= np.uint32(RowFlag.SYNC)
    for bit, (flag, kind, meaning) in FAULTS.items():
        rows = (word & bit) != 0
        if rows.any():
            findings.append(
                finding(
                    kind,
                    "repaired",
                    file,
                    f"encoder {encoder}: {meaning}; rows left out.",
                    lines=table.line[rows],
                )
            )
            flags[rows] |= np.uint32(flag)
    stale = np.concatenate(([False], np.diff(word & TOGGLE) == 0))
    if 0 < stale[1:].sum() <= (1.0 - _TOGGLES) * len(table):
        sentence = f"the toggle bit of encoder {encoder} stands still: its data are those of the row before."
        findings.append(
            finding("stale process data", "warning", file, sentence, lines=table.line[stale])
        )
        flags[stale] |= np.uint32(RowFlag.STALE)
    return flags


def counter_words(table: Table, fitted: Mapping[EncoderName, EncoderFitting]) -> NDArray[np.int64]:
    """(N, E) counter words of the fitted encoders.

    Raises LogError for a word that is no 32-bit counter.
    """
    for encoder in fitted.values():
        counter = table.columns[encoder.column]
        limit = (
            WORD if counter.min() >= 0 else WORD // 2
        )  # UDINT, or DINT once there is a negative word
        outside = np.flatnonzero((counter >= limit) | (counter < -WORD // 2))
        if outside.size:
            raise LogError(
                f"{table.place(outside[0])}: column {encoder.column}: {counter[outside[0]]} is no 32-bit counter word. "
                f"Expected UDINT, 0 to {WORD - 1}, or DINT, {-WORD // 2} to {WORD // 2 - 1}."
            )
    return np.stack([table.columns[encoder.column] for encoder in fitted.values()]).T


def jump_flags(
    table: Table,
    t: Array,
    words: NDArray[np.int64],
    sound: NDArray[np.bool_],
    fitted: Mapping[EncoderName, EncoderFitting],
    findings: list[Finding],
) -> tuple[Flags, NDArray[np.intp]]:
    """(N,) flags of rows to which no motion leads, and the rows from which a counter counts from elsewhere.

    t : (N,) [s]. words : (N, E). sound : (N,) rows to look at.
    Raises LogError if the encoders would turn too fast throughout.
    """
    scale = np.array([2.0 * np.pi / float(one.lines * 2**one.bits) for one in fitted.values()])
    rows = np.flatnonzero(sound)
    flags, reset = np.zeros(len(table), dtype=np.uint32), np.zeros(0, dtype=np.intp)
    if rows.size < 2:
        return flags, reset
    found = find_jumps(
        t[rows],
        words[rows],
        np.full(scale.size, SPEED_LIMIT),
        lambda late, early: signed_word(late - early) * scale,
    )
    if found.many():
        row = int(found.fast[0])
        step = signed_word(words[rows[row]] - words[rows[row - 1]]) * scale
        channel = int(np.argmax(np.abs(step)))
        time = float(t[rows[row]] - t[rows[row - 1]])
        raise LogError(
            f"{table.place(rows[row])}: encoder {list(fitted)[channel]} jumps by {step[channel]:.4g} rad within {time * 1e3:.4g} ms "
            f"({found.speed[0, channel]:.3g} rad/s; a ball-bar stays below {SPEED_LIMIT:g}). {found.fast.size} such rows. "
            "Was the counter reset, are lines and bits of the encoder declared wrong, or the time column in another unit?"
        )
    if found.damaged.any():
        damaged = rows[found.damaged]
        flags[damaged] |= np.uint32(RowFlag.IMPLAUSIBLE)
        report_damaged(table, damaged, [f"encoder {name}" for name in fitted], None, findings)
    if found.elsewhere.size:
        reset = rows[found.elsewhere]
        flags[reset] |= np.uint32(RowFlag.PRESET)
        step = signed_word(words[reset] - words[rows[found.elsewhere - 1]]) * scale
        names = [list(fitted)[int(k)] for k in np.argmax(np.abs(step), axis=1)]
        sentence = f"the counter of encoder {names[0]} jumps by {np.abs(step).max(axis=1)[0]:.4g} rad: reset, or moved on unseen."
        findings.append(
            finding(
                "counter jumped",
                "warning",
                table.files[table.file[reset[0]]],
                sentence,
                lines=table.line[reset],
            )
        )
    return flags, reset


def report_damaged(
    table: Table,
    rows: NDArray[np.intp],
    names: list[str],
    channels: NDArray[np.intp] | None,
    findings: list[Finding],
) -> None:
    """One finding for the rows of each file whose values no motion explains."""
    for index, file in enumerate(table.files):
        here = rows[table.file[rows] == index]
        if here.size:
            which = (
                "" if channels is None else f" ({', '.join(names[k] for k in np.unique(channels))})"
            )
            sentence = f"the rows around it lead elsewhere{which}: a damaged number; row left out."
            findings.append(
                finding("implausible value", "repaired", file, sentence, lines=table.line[here])
            )


def powered_up(
    words: NDArray[np.int64],
    fitted: Mapping[EncoderName, EncoderFitting],
    before: int | None,
    behind: int | None,
) -> bool:
    """Whether all counters start near zero at a row while at least one was far from it before."""
    if before is None or behind is None:
        return False
    near = np.array([_NEAR_ZERO * 2**one.bits for one in fitted.values()])
    return bool(
        (np.abs(signed_word(words[behind])) <= near).all()
        and (np.abs(signed_word(words[before])) > 10 * near).any()
    )


def encoder_angles(
    words: NDArray[np.int64], sound: NDArray[np.bool_], fitted: Mapping[EncoderName, EncoderFitting]
) -> Array:
    """(N, E) [rad] unwrapped angles of the fitted encoders, declared sign applied; words : (N, E)."""
    columns = [
        counts_to_rad(
            unwrap_counter(words[:, k], sound), lines=one.lines, bits=one.bits, sign=one.sign
        )
        for k, one in enumerate(fitted.values())
    ]
    return np.stack(columns).T


def refuse_standing(
    table: Table,
    words: NDArray[np.int64],
    flags: Flags,
    fitted: Mapping[EncoderName, EncoderFitting],
    *,
    robot_moves: bool,
) -> None:
    """Raises LogError for a counter that stands while others, or the robot, move."""
    sound = usable(flags)
    first = words[int(np.argmax(sound))]
    standing = [k for k, column in enumerate(words.T) if (column[sound] == first[k]).all()]
    if standing and (robot_moves or len(standing) < len(fitted)):
        name, encoder = list(fitted.items())[standing[0]]
        raise LogError(
            f"{table.files[0]}: encoder column without counts: column {encoder.column} of encoder {name} is {first[standing[0]]} "
            "in every row while the others or the robot move. Check the cable, or remove the encoder from recording.yaml."
        )
