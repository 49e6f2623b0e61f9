"""Output of `ballbar claims`: every verdict with its numbers, and the page docs/claims.md."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from posixpath import normpath

from rich.console import Console
from rich.markup import escape

from ballbar.cell.files import write_whole
from ballbar.cell.foreign_text import markdown
from ballbar.claims.checks import CheckOutcome
from ballbar.claims.plots import plot_svg
from ballbar.claims.run import FAILS, RESTS_ON, ClaimVerdict, Judged

_HEAD = """# Claims: what the thesis says, and what comes out here

Written by `ballbar claims --out docs/claims.md` from `scenarios/claims/`; do not edit.
`ballbar claims NAME` runs one file of claims and prints every check with its limits, both parameter
sets, the default cost `ml` and our findings. It exits with 1 when a verdict is another than its
file expects.

Brand & Nilsson 2016 (TFRT-6017), simulated as they did (sec. 3.1): exact kinematics, samples of
both logs paired, errors of Table 3.1, one kind of varying error at a time. Two things are not
theirs: the path, which is not printed, and signed components of each cost in place of the printed
scalar. The experiments of sec. 5.4 are simulated with forces and go through device files.

Distance: Euclidean, over all identified parameters, from the truth, in mm and mrad mixed (sec.
3.4); medians over the seeds. A claim **holds** where every check of its sentence is met; shown is
the first that is not, or the first. "Significantly" and "large" are at least 3 times, "similar" is
within 2. Verdicts rest on the *core* set of parameters, without the fifth priority of sec. 3.3,
which Table B.1 never names; "with all" are all that the cost determines.

"""
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


def page_text(
    judged: Sequence[Judged], images: Mapping[str, Sequence[str]], commands: Mapping[str, str]
) -> str:
    """The page as Markdown.

    images, commands : name of a claim file -> its plots as links from the page, and the command
    that repeats its runs.
    """
    verdicts = [verdict for result in judged for verdict in result.verdicts]
    counts = Counter(verdict.word for verdict in verdicts)
    failed = f", {counts[FAILS]} come out otherwise than stated" if counts[FAILS] else ""
    both = [verdict for verdict in verdicts if "all" in verdict.outcomes]
    other = sum(verdict.comes_out("all") != verdict.comes_out("core") for verdict in both)
    summary = f"{counts['holds']} hold, {counts['differs']} differ{failed}"
    page = f"{_HEAD}{len(verdicts)} claims: {summary}. {other} have the other verdict with *all*.\n"
    for result in judged:
        name = result.topic.name
        lines = _section(result, images.get(name, ()), commands.get(name, ""))
        page += "\n" + "\n".join(lines) + "\n"
    return page


def _section(result: Judged, images: Sequence[str], command: str) -> Iterator[str]:
    file = result.topic.file
    yield from (f"## {markdown(file.title)}", "")
    runs = f" ({result.runs} runs)" if result.runs else ""
    yield " ".join(filter(None, (f"Thesis {file.place}.", command and f"`{command}`{runs}.")))
    if images:
        yield from ("", *(f"![{result.topic.name}]({image})" for image in images))
    yield from ("", "|thesis|here|verdict|", "|---|---|---|")
    for verdict in result.verdicts:
        claim = verdict.claim
        source = "" if claim.source == file.place else f" ({claim.source})"
        says = f'`{claim.name}`: "{claim.says}"{source}'
        cells = (says, _first(verdict.outcomes[RESTS_ON]), _verdict(verdict))
        yield f"|{'|'.join(map(_cell, cells))}|"


def _first(outcomes: Sequence[CheckOutcome]) -> str:
    """Result of the first check that is not met, or else of the first; of a table its counts."""
    result = next((each for each in outcomes if not each.met), outcomes[0]).result
    return result.split("; not equal: ")[0]


def _verdict(verdict: ClaimVerdict) -> str:
    """The verdict, that with all parameters if it is another, and our finding's first sentence."""
    word = verdict.word
    if word != FAILS and "all" in verdict.outcomes and verdict.comes_out("all") != word:
        word += f" ({verdict.comes_out('all')} with all)"
    finding = re.split(r"(?<=[.]) ", " ".join(verdict.claim.finding.split()))[0].rstrip(".")
    return f"{word}. {finding}" if finding and verdict.word == "differs" else word


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
