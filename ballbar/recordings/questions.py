"""Questions of `ballbar new`: every answer is checked when it is given."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TypeVar

import numpy as np

from ballbar.acquisition.times import TIME_FORMS, forms_by_start
from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError

Ask = Callable[[str, str | None], str]  # (question, proposed answer) -> answer
T = TypeVar("T")
_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s]


def answer(
    given: str | None, question: str, proposal: str | None, check: Callable[[str], T], ask: Ask
) -> T:
    """The checked answer to a question: an option's, or the user's, who is asked again.

    Raises InputError for an option, or a proposal, that is wrong.
    """
    if given is not None:
        return check(given)
    reply = ask(question, proposal)
    while True:
        try:
            return check(reply)
        except InputError as error:
            if reply == proposal:
                raise
            reply = ask(f"{error}\n{question}", proposal)


def loaded(load: Callable[[str], T]) -> Callable[[str], tuple[str, T]]:
    """A check of an answer that names a description: the answer, and what it describes."""
    return lambda reply: (reply, load(reply))


def one_of(*choices: str) -> Callable[[str], str]:
    """A check of an answer that is one of several words."""

    def check(reply: str) -> str:
        if reply.strip() not in choices:
            words = " or ".join(filter(None, (", ".join(choices[:-1]), choices[-1])))
            raise InputError(f"{reply!r}: expected {words}.")
        return reply.strip()

    return check


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """A check of an answer that is a whole number of a range."""

    def check(reply: str) -> int:
        if not reply.strip().isdigit() or not least <= int(reply) <= most:
            raise InputError(f"{reply!r}: expected a whole number from {least} to {most}.")
        return int(reply)

    return check


def time_form(
    file: str,
    stamps: Array,
    *,
    periods: tuple[float, float],
    given: str | None,
    ask: Ask,
    proposed: Collection[str] = TIME_FORMS,
) -> str:
    """The form of time stamps (N,) that do not show it, from an option or the user's answer.

    periods : [s] least and largest of rows. Proposed is the unit in which the rows have one of
    them, if it is only one and among `proposed`.
    """
    period = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    units = [u for u, size in _TIME_UNITS.items() if periods[0] <= size * period <= periods[1]]
    proposal = units[0] if len(units) == 1 and units[0] in proposed else None
    apart = f"; rows are {period:g} apart" if period else ""
    forms = [f"  {start}: {', '.join(every)}" for start, every in forms_by_start().items()]
    question = f"{file}: what are the time stamps? They do not show it{apart}."
    lines = "\n".join([question, *forms, "Which form?"])
    return answer(given, lines, proposal, one_of(*TIME_FORMS), ask)
