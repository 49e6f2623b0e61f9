"""Output of `ballbar claims`: every verdict with its numbers, and the page with its plots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from os.path import normpath
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from ballbar.claims.checks import CheckOutcome
from ballbar.claims.page import page_text
from ballbar.claims.plots import plot_svg
from ballbar.claims.run import FAILS, ClaimVerdict, Judged
from cell.files import write_whole

IMAGES = "images/claims"  # beside the page
_COLOURS = {"holds": "green", "differs": "yellow", FAILS: "bold red"}


def say_verdicts(out: Console, judged: Sequence[Judged]) -> bool:
    """Prints every verdict. Returns whether all checks passed."""
    for result in judged:
        out.print(f"[bold]{escape(result.topic.file.title)}[/] ({escape(result.topic.file.place)})")
        for verdict in result.verdicts:
            _say(out, verdict)
    counts = Counter(verdict.word for result in judged for verdict in result.verdicts)
    out.print(
        f"{counts.total()} claims: {counts['holds']} hold, {counts['differs']} differ as stated, "
        f"{counts[FAILS]} fail their checks"
    )
    return not counts[FAILS]


def _say(out: Console, verdict: ClaimVerdict) -> None:
    claim = verdict.claim
    word, source = f"[{_COLOURS[verdict.word]}]{verdict.word}[/]", escape(claim.source)
    out.print(f'  {word} {claim.name}, {source}: [dim]"{escape(claim.says)}"[/]')
    for parameters, outcomes in verdict.outcomes.items():
        if len(verdict.outcomes) > 1:
            out.print(f"      {parameters} parameters: {verdict.comes_out(parameters)}")
        _say_outcomes(out, outcomes)
    if verdict.guards:
        out.print("      our finding:")
        _say_outcomes(out, verdict.guards)
    for text in verdict.ml:
        out.print(f"      ml: {escape(text)}")
    if claim.finding:
        out.print(f"      {escape(claim.finding)}")


def _say_outcomes(out: Console, outcomes: Sequence[CheckOutcome]) -> None:
    for outcome in outcomes:
        mark = "" if outcome.met else "[red]not met:[/] "
        out.print(f"      {mark}{escape(outcome.result)} [dim]({escape(outcome.limits)})[/]")


def write_page(page: Path, judged: Sequence[Judged]) -> None:
    """Writes the page, and its plots into images/claims beside it.

    Raises InputError where a plot names runs or columns that do not exist.
    """
    images, commands = {}, {}
    for result in judged:
        name, file = result.topic.name, result.topic.file
        links = [f"{IMAGES}/{name}{f'_{k + 1}' if k else ''}.svg" for k in range(len(file.plots))]
        for link, plot in zip(links, file.plots, strict=True):
            write_whole(page.parent / link, plot_svg(plot, result.evidence))
        images[name] = links
        folder = result.topic.path.parent.as_posix()
        if file.sweep is not None:
            commands[name] = f"ballbar claims {name}"
        elif file.identifiability is not None:
            scenario = normpath(f"{folder}/{file.identifiability}")
            commands[name] = f"ballbar identifiability {scenario} --cost all"
    write_whole(page, page_text(judged, images, commands).encode())
