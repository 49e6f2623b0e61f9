"""Questions of the command line, answered as at a terminal."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from ballbar.commands import recordings

Asked = list[tuple[str, str | None]]  # each question with its proposal


def at_the_terminal(
    patch: pytest.MonkeyPatch, reply: Callable[[str, str | None], str | None]
) -> Asked:
    """Answers questions by their words and proposals, the proposal in place of no reply."""
    asked: Asked = []

    def prompt(question: str, default: str | None, *, show_default: bool, err: bool) -> str:
        assert not err
        assert not show_default, "a proposal from a file is a part of the question"
        asked.append((question, default))
        return reply(question, default) or str(default)

    patch.setattr(recordings.typer, "prompt", prompt)
    patch.setattr(recordings.sys.stdin, "isatty", lambda: True, raising=False)
    return asked


def in_turn(*replies: str) -> Callable[[str, str | None], str]:
    """Replies one after the other."""
    following = iter(replies)
    return lambda _question, _proposal: next(following)
