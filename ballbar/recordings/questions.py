"""Questions of `ballbar new`: every answer is checked when it is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from cell.errors import InputError

Ask = Callable[[str, str | None], str]  # (question, proposed answer) -> answer
T = TypeVar("T")


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


def one_of(*choices: str) -> Callable[[str], str]:
    """A check of an answer that is one of several words."""

    def check(reply: str) -> str:
        if reply not in choices:
            raise InputError(f"{reply!r}: expected {', '.join(choices[:-1])} or {choices[-1]}.")
        return reply

    return check


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """A check of an answer that is a whole number of a range."""

    def check(reply: str) -> int:
        if not reply.strip().isdigit() or not least <= int(reply) <= most:
            raise InputError(f"{reply!r}: expected a whole number from {least} to {most}.")
        return int(reply)

    return check
