"""`ballbar align`: clock offset and skew of two logs, as text for people or JSON for programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.channels import read_channels
from acquisition.report import Finding, finding_line
from cell.clock import UNSEEN_OFFSET
from cell.errors import InputError
from cell.logs import ChannelLog, SourceName
from cell.number_text import clock_offset_text, clock_skew_text, significant_text
from ident.log_alignment import LogAlignment, align_logs

SHOWN = 12  # pairs of channels that are listed


def _pair(text: str) -> tuple[str, str]:
    """Names in log A and in log B of a channel `a=b`, or of one with the same name in both."""
    a, equals, b = text.partition("=")
    if not a or (equals and not b):
        raise InputError(f"channel {text!r}: write a=b, the names in log A and in log B.")
    return a, b if equals else a


def aligned_logs(
    files: tuple[Path, Path],
    *,
    sources: tuple[SourceName | None, SourceName | None],
    times: tuple[str | None, str | None],
    channels: Sequence[str],
) -> tuple[LogAlignment, tuple[ChannelLog, ChannelLog], tuple[Finding, ...]]:
    """The alignment of logs A and B, both logs, and what was found in their files.

    sources, times : as in `read_channels`. channels : of A and of B, as `a=b`, or the name of both.
    """
    pairs = [_pair(text) for text in channels]
    named = [list(side) for side in zip(*pairs, strict=True)] if pairs else [[], []]
    (log_a, of_a), (log_b, of_b) = (
        read_channels(file, source=source, time=time, channels=names)
        for file, source, time, names in zip(files, sources, times, named, strict=True)
    )
    return align_logs(log_a, log_b, pairs), (log_a, log_b), (*of_a, *of_b)


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
        "CHANNELS  A = gain B + zero",
    ]
    for pair in alignment.pairs[:SHOWN]:
        lines.append(
            f"  {pair.a} = {pair.gain:+.6g} {pair.b} {pair.zero:+.6g}: correlation "
            f"{pair.correlation:+.6f}, residual {significant_text(pair.residual)} rms "
            f"({significant_text(pair.residual_share, 2)} of the rms of {pair.a})"
        )
    if len(alignment.pairs) > SHOWN:
        lines.append(f"  and {len(alignment.pairs) - SHOWN} more")
    remarks = [*map(finding_line, findings), *alignment.remarks]
    return lines + (["REMARKS", *(f"  {remark}" for remark in remarks)] if remarks else [])


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
        },
        "overlap_s": alignment.overlap,
        "samples": alignment.samples,
        "inflation": alignment.inflation,
        "channels": [
            {
                "a": pair.a,
                "b": pair.b,
                "correlation": pair.correlation,
                "gain": pair.gain,
                "zero": pair.zero,
                "residual_rms": pair.residual,
                "residual_share": pair.residual_share,
            }
            for pair in alignment.pairs
        ],
        "remarks": [*map(finding_line, findings), *alignment.remarks],
    }
