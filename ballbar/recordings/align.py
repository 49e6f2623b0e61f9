"""`ballbar align`: clock offset and skew of two logs, as text for people or JSON for programs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.acquisition.channels import read_channels
from ballbar.acquisition.report import Finding, finding_line
from ballbar.cell.clock import UNSEEN_OFFSET, Clock
from ballbar.cell.errors import InputError
from ballbar.cell.logs import ChannelLog, SourceName
from ballbar.cell.number_text import clock_offset_text, clock_skew_text, significant_text
from ballbar.ident.channel_groups import Group
from ballbar.ident.channel_pair import ChannelPair
from ballbar.ident.log_alignment import LogAlignment, align_logs

SHOWN = 12  # pairs of channels that are listed
NO: Group = ((), ())
STILL = "the motion turns the body, or reaches, too little"


def aligned_logs(
    files: tuple[Path, Path],
    *,
    sources: tuple[SourceName | None, SourceName | None],
    times: tuple[str | None, str | None],
    channels: Sequence[str],
    vectors: Sequence[str] = (),
    rotations: Sequence[str] = (),
) -> tuple[LogAlignment, tuple[ChannelLog, ChannelLog], tuple[Finding, ...]]:
    """The alignment of logs A and B, both logs, and what was found in their files.

    sources, times : as in `read_channels`. channels, vectors, rotations : of A and of B, as `a=b`,
    or the names in both; a vector and a rotation are those of a pose.
    """
    pairs = [_named(text) for text in channels]
    for text, (a, b) in zip(channels, pairs, strict=True):
        if len(a) != 1 or len(b) != 1:
            raise InputError(f"channel {text!r} has several names: give --vector or --rotation.")
    groups = [
        (vector[0] + turn[0], vector[1] + turn[1])
        for vector, turn in zip_longest(map(_named, vectors), map(_named, rotations), fillvalue=NO)
    ]
    named = [[n for group in (*pairs, *groups) for n in group[k]] for k in (0, 1)]
    (log_a, of_a), (log_b, of_b) = (
        read_channels(file, source=source, time=time, channels=names)
        for file, source, time, names in zip(files, sources, times, named, strict=True)
    )
    single = [(a[0], b[0]) for a, b in pairs]
    return align_logs(log_a, log_b, single, groups), (log_a, log_b), (*of_a, *of_b)


def _named(text: str) -> Group:
    """The channels of A and of B in `a=b`, with commas between several."""
    a, equals, b = text.partition("=")
    if not a or (equals and not b):
        raise InputError(f"channel {text!r}: write a=b, the names in log A and in log B.")
    of_a, of_b = (
        tuple(name.strip() for name in side.split(",")) for side in (a, b if equals else a)
    )
    return of_a, of_b


def align_lines(
    alignment: LogAlignment, logs: tuple[ChannelLog, ChannelLog], findings: Sequence[Finding]
) -> list[str]:
    """Lines of text: logs, clocks, channels, remarks."""
    lines = ["LOGS"]
    for letter, log in zip("AB", logs, strict=True):
        lines.append(f"  {letter}  {log.name}: {log.t.size} rows over {log.t[-1]:.2f} s")
    clock = alignment.clock
    # between the rows of the slower log its channels show nothing
    longest = max(UNSEEN_OFFSET, *(float(np.median(np.diff(log.t))) for log in logs))
    begins = ""
    if alignment.offset_sigma <= longest:
        begins = (
            f": B begins {abs(clock.offset):.3f} s {'after' if clock.offset >= 0.0 else 'before'} A"
        )
    lines += [
        "CLOCKS  t_A = offset + (1 + skew) t_B, each from the first row of its log",
        f"  offset {clock_offset_text(clock, alignment.offset_sigma, longest=longest)}{begins}",
        f"  skew {clock_skew_text(clock, alignment.skew_sigma)}",
        f"  over {alignment.overlap:.1f} s in common; sigmas inflated {alignment.inflation:.2f} "
        "times for autocorrelated residuals",
    ]
    if (apart := stamps_apart(alignment, logs)) is not None:
        stated = clock_offset_text(Clock(apart, 0.0), alignment.middle_sigma, longest=longest)
        lines.append(f"  stamps as logged: t_A - t_B {stated} in the middle of that time")
    single = [pair for pair in alignment.pairs if len(pair.zero) == 1]
    lines += ["CHANNELS  A = gain B + zero"] if single else []
    for pair in single[:SHOWN]:
        lines.append(
            f"  {pair.a} = {pair.gain:+.6g} {pair.b} {pair.zero[0]:+.6g}: correlation "
            f"{pair.correlation[0]:+.6f}, residual {significant_text(pair.residual[0])} rms "
            f"({significant_text(pair.residual_share[0], 2)} of the rms of {pair.a})"
        )
    if len(single) > SHOWN:
        lines.append(f"  and {len(single) - SHOWN} more")
    vectors = [pair for pair in alignment.pairs if len(pair.zero) != 1]
    if vectors:
        lines.append(
            "VECTORS, ROTATIONS  p_A + R_A lever = gain turn p_B + zero, R_A hand = turn R_B"
        )
    for pair in vectors:
        lines += [f"  {pair.a} = {pair.b}", *(f"    {line}" for line in _map_lines(pair))]
    remarks = [*map(finding_line, findings), *alignment.remarks]
    return lines + (["REMARKS", *(f"  {remark}" for remark in remarks)] if remarks else [])


def _map_lines(pair: ChannelPair) -> list[str]:
    """Lines of text about the map of a vector, a rotation or a pose."""
    lines = []
    both = [("points", 1.0, "")] * bool(pair.zero.size) + [("rotations", 1e3, " mrad")]
    for k, (part, factor, unit) in enumerate(both[: len(pair.residual)]):
        lines.append(
            f"{part}: correlation of the speeds {pair.correlation[k]:+.4f}, residual "
            f"{significant_text(pair.residual[k] * factor)}{unit} rms "
            f"({significant_text(pair.residual_share[k], 2)} of the rms)"
        )
    for name, values in pair.constants().items():
        turn = values.size == 4
        numbers = ", ".join(f"{value:+.5g}" for value in values)
        sigmas = pair.sigma[name] * (1e3 if turn else 1.0)
        stated = ", ".join(significant_text(sigma, 2) for sigma in sigmas)
        unit = " mrad about the axes of A" if turn else ""
        lines.append(f"{name} {'x, y, z, w = ' if turn else ''}{numbers} (sigma {stated}{unit})")
    return [*lines, *(f"{what} is not determined: {STILL}" for what in pair.undetermined)]


def stamps_apart(alignment: LogAlignment, logs: tuple[ChannelLog, ChannelLog]) -> float | None:
    """[s] t_A - t_B of the stamps as logged, in the middle of the overlap; None without epochs."""
    a, b = (log.first_ns for log in logs)
    if a is None or b is None:
        return None
    middle = alignment.middle
    return (a - b) * 1e-9 + float(alignment.clock.robot_time(middle)) - middle


def align_data(
    alignment: LogAlignment, logs: tuple[ChannelLog, ChannelLog], findings: Sequence[Finding]
) -> dict[str, Any]:
    """The alignment as plain data of schema `ballbar-alignment/1`, in s."""
    return {
        "schema": "ballbar-alignment/1",
        "logs": {
            letter: {"name": log.name, "rows": int(log.t.size), "duration_s": float(log.t[-1])}
            for letter, log in zip("ab", logs, strict=True)
        },
        "clock": {
            "offset_s": alignment.clock.offset,
            "offset_sigma_s": alignment.offset_sigma,
            "skew": alignment.clock.skew,
            "skew_sigma": alignment.skew_sigma,
            "correlation": alignment.correlation,
            "middle_s": alignment.middle,
            "stamps_apart_s": stamps_apart(alignment, logs),
            "stamps_apart_sigma_s": alignment.middle_sigma,
        },
        "overlap_s": alignment.overlap,
        "samples": alignment.samples,
        "inflation": alignment.inflation,
        "channels": [
            {
                "a": pair.a,
                "b": pair.b,
                "correlation": pair.correlation[0],
                "gain": pair.gain,
                "zero": float(pair.zero[0]),
                "residual_rms": pair.residual[0],
                "residual_share": pair.residual_share[0],
            }
            for pair in alignment.pairs
            if len(pair.zero) == 1
        ],
        "vectors": [
            {
                "a": pair.a.split(","),
                "b": pair.b.split(","),
                "speed_correlation": list(pair.correlation),
                "residual_rms": list(pair.residual),
                "residual_share": list(pair.residual_share),
                **{name: values.tolist() for name, values in pair.constants().items()},
                "sigma": {name: values.tolist() for name, values in pair.sigma.items()},
                "undetermined": list(pair.undetermined),
            }
            for pair in alignment.pairs
            if len(pair.zero) != 1
        ],
        "remarks": [*map(finding_line, findings), *alignment.remarks],
    }
