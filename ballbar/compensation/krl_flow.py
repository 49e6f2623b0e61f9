"""Where a KRL program sets the tool, base or load in force, and which lines that reaches.

A line is read once, in the order of the text. Where control can come from elsewhere (the end of a
branch, the beginning of a loop, a label, the return from a sub-program) what was set in between may
or may not be in force.

Source: KUKA System Software 8.3, Operating and Programming Instructions for System Integrators.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from ballbar.compensation.program_text import Token

LOOPS = ("for", "while", "loop", "repeat")
OPEN = (*LOOPS, "if", "switch", "spline", "ptp_spline")
CLOSE = ("endif", "endfor", "endwhile", "endloop", "until", "endswitch", "endspline")
BRANCHES = ("else", "case", "default")
EVERY = frozenset(("tool", "base", "load"))
_OWN = ("bas", "if", "while", "until", "switch", "wait", "case", "return")  # with a parenthesis
_BY_BAS = {"tool": frozenset(("tool", "load")), "base": frozenset(("base",))}
_ASSIGNED = re.compile(r"(?:^|(?<= ))([$\w]+)(?: \. \w+| \[[^\]]*\])* = (?!=)")


@dataclass(frozen=True)
class Flow:
    """What the lines of a file set, the extent of its blocks, and its routines."""

    settings: dict[str, list[int]]  # ascending lines that set the tool, the base, the load
    ends: dict[int, int]  # last lines of blocks by their first ones
    reach: dict[int, tuple[int, int]]  # by label: first GOTO or label, end of its routine
    routines: frozenset[str]  # lower-case names
    setters: frozenset[str]  # those of routines that set one of them

    def changed(self, first: int, last: int) -> frozenset[str]:
        """What the lines after `first` and before `last` set."""
        return frozenset(
            what
            for what, lines in self.settings.items()
            if bisect_right(lines, first) < bisect_left(lines, last)
        )

    def changed_by_jumps(self, label: int) -> frozenset[str]:
        """What the routine of a label sets from the first GOTO or label in it."""
        return self.changed(*self.reach[label])

    def called(self, tokens: Sequence[Token]) -> str:
        """Name of a routine of this file that a line calls and that sets one of them."""
        return next((name.upper() for name in calls(tokens) if name in self.setters), "")

    def foreign(self, tokens: Sequence[Token]) -> str:
        """Name of what a line calls that is no routine of this file; empty for other lines."""
        calling = calls(tokens[:2]) and tokens[-1].issymbol(")") and not tokens[0].isword(*_OWN)
        name = tokens[0].text
        return name if calling and name.lower() not in self.routines else ""


def flow_of(statements: Sequence[list[Token]]) -> Flow:
    """Of the lines of a file."""
    routines = _routines(statements)
    setters = _setters(routines)
    settings: dict[str, list[int]] = {what: [] for what in sorted(EVERY)}
    for tokens in statements:
        calling = not routine_name(tokens) and not setters.isdisjoint(calls(tokens))
        for what in EVERY if calling else _settings(tokens):
            settings[what].append(tokens[0].line)
    reach: dict[int, tuple[int, int]] = {}
    for _, lines in routines:
        jumps = [t[0].line for t in lines if is_label(t) or any(k.isword("goto") for k in t)]
        if jumps:
            reach |= dict.fromkeys(jumps, (jumps[0] - 1, lines[-1][0].line + 1))
    names = frozenset(name for name, _ in routines)
    return Flow(settings, _ends(statements), reach, names, setters)


def opens(tokens: Sequence[Token]) -> bool:
    """Whether a line begins a block that it does not end as well."""
    return tokens[0].isword(*OPEN) and not any(t.isword(*CLOSE) for t in tokens)


def is_label(tokens: Sequence[Token]) -> bool:
    """Whether a line is, or begins with, a place that GOTO goes to."""
    return len(tokens) > 1 and tokens[0].kind == "word" and tokens[1].issymbol(":")


def routine_name(tokens: Sequence[Token]) -> str:
    """Lower-case name of the routine or data list that a line begins; empty for other lines."""
    words = [t.text.lower() for t in tokens if t.kind == "word" and not t.isword("global")]
    if len(words) < 2 or words[0] not in ("def", "deffct", "defdat"):
        return ""
    return words[2] if words[0] == "deffct" and len(words) > 2 else words[1]


def assigned(tokens: Sequence[Token]) -> list[tuple[bool, str]]:
    """Names that a line assigns to, whole or in part, and whether they begin the line."""
    text = " ".join(t.text.lower() for t in tokens)
    return [(match.start() == 0, match[1]) for match in _ASSIGNED.finditer(text + " ")]


def calls(tokens: Sequence[Token]) -> list[str]:
    """Lower-case words before a parenthesis."""
    return [
        t.text.lower() for t, after in pairwise(tokens) if t.kind == "word" and after.issymbol("(")
    ]


def bas_command(tokens: Sequence[Token]) -> str:
    """TOOL of BAS(#TOOL,2), in lower case; empty for other lines."""
    if not tokens[0].isword("bas") or len(tokens) < 4:
        return ""
    return tokens[3].text.lower()


def _settings(tokens: Sequence[Token]) -> frozenset[str]:
    word, command = tokens[0].text.lower(), bas_command(tokens)
    if word in ("$tool", "$base", "$load"):
        return frozenset((word[1:],))
    if word == "fdat_act" or command in ("initmov", "ex_base"):
        return EVERY
    return _BY_BAS.get(command, frozenset())


def _ends(statements: Sequence[list[Token]]) -> dict[int, int]:
    ends: dict[int, int] = {}
    started: list[int] = []
    for tokens in statements:
        if opens(tokens):
            started.append(tokens[0].line)
        elif tokens[0].isword(*CLOSE) and started:
            ends[started.pop()] = tokens[0].line
    last = statements[-1][0].line + 1 if statements else 0
    return {**ends, **dict.fromkeys(started, last)}


def _routines(statements: Sequence[list[Token]]) -> list[tuple[str, list[list[Token]]]]:
    """Names and lines of routines; the first has none and the lines before them."""
    out: list[tuple[str, list[list[Token]]]] = [("", [])]
    for tokens in statements:
        if name := routine_name(tokens):
            out.append((name, []))
        out[-1][1].append(tokens)
    return out


def _setters(routines: Sequence[tuple[str, list[list[Token]]]]) -> frozenset[str]:
    """Routines that set the tool, base or load, themselves or by what they call."""
    callers: dict[str, set[str]] = {}
    for name, lines in routines:
        for called in (c for tokens in lines[1:] for c in calls(tokens)):
            callers.setdefault(called, set()).add(name)
    out: set[str] = set()
    new = [name for name, lines in routines if any(map(_settings, lines))]
    while new:
        name = new.pop()
        if name and name not in out:
            out.add(name)
            new += callers.get(name, ())
    return frozenset(out)
