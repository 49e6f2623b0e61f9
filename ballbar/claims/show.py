"""What `ballbar claims` shows and writes: every verdict with its numbers, and the page with its figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from os.path import normpath
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from ballbar.claims.page import page_text
from ballbar.claims.plots import drawn
from ballbar.claims.run import FAILS, Judged, Verdict
from cell.files import write_whole

IMAGES = "images/claims"  # beside the page
_COLOURS = {"holds": "green", "differs": "yellow", FAILS: "bold red"}


def say_verdicts(out: Console, judged: Sequence[Judged]) -> bool:
    """Prints every verdict. Returns whether all checks passed."""
    for one in judged:
        out.print(f"[bold]{escape(one.topic.file.title)}[/] ({escape(one.topic.file.place)})")
        for verdict in one.verdicts:
            _say(out, verdict)
    counts = Counter(verdict.word for one in judged for verdict in one.verdicts)
    out.print(
        f"{counts.total()} claims: {counts['holds']} hold, {counts['differs']} differ as stated, {counts[FAILS]} fail their checks"
    )
    return not counts[FAILS]


def _say(out: Console, verdict: Verdict) -> None:
    claim = verdict.claim
    out.print(
        f'  [{_COLOURS[verdict.word]}]{verdict.word}[/] {claim.name}, {escape(claim.source)}: [dim]"{escape(claim.says)}"[/]'
    )
    for outcome in verdict.outcomes:
        mark = "" if outcome.met else "[red]not met:[/] "
        out.print(f"      {mark}{escape(outcome.found)} [dim]({escape(outcome.asked)})[/]")
    for text in verdict.ml:
        out.print(f"      ml: {escape(text)}")
    if claim.finding:
        out.print(f"      {escape(claim.finding)}")


def write_page(page: Path, judged: Sequence[Judged]) -> None:
    """Writes the page, and its figures into images/claims beside it. Raises InputError for a plot of what is not there."""
    images, commands = {}, {}
    for one in judged:
        name, file = one.topic.name, one.topic.file
        links = [f"{IMAGES}/{name}{f'_{k + 1}' if k else ''}.svg" for k in range(len(file.plots))]
        for link, plot in zip(links, file.plots, strict=True):
            write_whole(page.parent / link, drawn(plot, one.evidence))
        images[name] = links
        folder = one.topic.path.parent.as_posix()
        if file.sweep is not None:
            commands[name] = f"ballbar sweep {folder}/{file.sweep}"
        elif file.identifiability is not None:
            commands[name] = (
                f"ballbar identifiability {normpath(f'{folder}/{file.identifiability}')} --cost all"
            )
    write_whole(page, page_text(judged, images, commands).encode())
