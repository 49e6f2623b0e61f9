"""Output of `ballbar claims`: every verdict with its numbers, and the page docs/claims.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from posixpath import normpath

from rich.console import Console
from rich.markup import escape

from ballbar.cell.files import write_whole
from ballbar.cell.foreign_text import markdown
from ballbar.claims.checks import CheckOutcome
from ballbar.claims.kinds import EqualTable
from ballbar.claims.plots import plot_svg
from ballbar.claims.run import FAILS, RESTS_ON, ClaimVerdict, Judged
from ballbar.ident.thesis.names import ParameterSet

_HEAD = """# Claims: what the thesis says, and what comes out here

Written by `ballbar claims --out docs/claims.md` from `scenarios/claims/`; do not edit.
`ballbar claims NAME` runs one file of claims, `--quick` all with fewer points and seeds. The
command exits with 1 when a verdict is another than its file expects.

Brand & Nilsson 2016 (TFRT-6017), simulated as they did (sec. 3.1): exact kinematics, samples of
both logs paired, errors of Table 3.1, one kind of varying error at a time. Two things are not
theirs: the path, since theirs is not printed (its effect on sizes: Excitation); and signed
components of each cost (`vector`) where they minimised the printed scalar, unless it says
"printed" (its effect: Convergence). The experiments of sec. 5.4 are simulated with forces and go
through device files; why theirs failed is one picture under "Why the experiments failed".

Distance: Euclidean, over all identified parameters, from the truth, in mm and mrad mixed (sec.
3.4). Numbers are medians over the seeds unless it says otherwise. Plots: median, band from
smallest to largest seed, distance beside largest error; the dotted line is the 0.5 mm|mrad that the
thesis aims at.

**Two parameter sets.** Sec. 3.4 fits "all parameters that were identifiable". The column *all* does
so: every parameter of sec. 3.3 that the cost determines (23 with C_l, 31, 36, 39 with C_T). The
column *core* leaves out the fifth priority of sec. 3.3, the rows of the ball-bar but its rod (23,
25, 28, 29). Each sentence is judged with both. The verdict rests on *core*: of the 100 largest
errors that Table B.1 names, with C_T, none is of such a row, and on our path they take a fifth of
the places where they are fitted (see Largest errors). Which errors are largest belongs to the path,
so this is evidence and no proof; but sec. 3.3 too says that these parameters "can often be assumed
to be nominal", and sec. 5.4 leaves them out. In the plots *core* is solid, *all* dashed.

Verdicts: **holds** where every check of the thesis's sentence is met, **differs** where one is not,
with our finding, which checks of its own guard. The limits of recurring words: "significantly",
"much", "large" is at least 3 times; "similar", "same size", "no greater difference" within 2 times.
The column `ml`: the default cost on the same errors, with the clock as parameter.

"""
_COLUMNS: Mapping[ParameterSet, str] = {"core": "core set", "all": "all parameters"}
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
    counts = Counter(verdict.word for result in judged for verdict in result.verdicts)
    failed = f", {counts[FAILS]} come out otherwise than stated" if counts[FAILS] else ""
    other = sum(
        verdict.comes_out("all") != verdict.comes_out("core")
        for result in judged
        for verdict in result.verdicts
        if "all" in verdict.outcomes
    )
    summary = f"{counts['holds']} hold, {counts['differs']} differ{failed}"
    lines = [
        f"{_HEAD}{counts.total()} claims: {summary}. {other} have the other verdict with *all*."
    ]
    lines += ["", "| claim | thesis | verdict | with all parameters |", "|---|---|---|---|"]
    for result in judged:
        title = markdown(result.topic.file.title)
        plain = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
        anchor = plain.replace(" ", "-")  # as forges form it from the heading
        for v in result.verdicts:
            words = f"{v.word} | {v.comes_out('all') if 'all' in v.outcomes else ''}"
            link = f"[{title}](#{anchor}): {v.claim.name}"
            lines.append(f"| {link} | {_cell(v.claim.source)} | {words} |")
    for result in judged:
        name = result.topic.name
        lines += ["", *_section(result, images.get(name, ()), commands.get(name, ""))]
    return "\n".join(lines) + "\n"


def _section(result: Judged, images: Sequence[str], command: str) -> Iterator[str]:
    file = result.topic.file
    title = markdown(file.title)
    yield from (f"## {title}", "")
    runs = f" ({result.runs} runs)" if result.runs else ""
    sentences = (f"Thesis {file.place}.", file.about, command and f"`{command}`{runs}.")
    yield " ".join(filter(None, sentences))
    for image in images:
        yield from ("", f"![{title}]({image})")
    sets = file.sets
    titles = ["thesis", *([_COLUMNS[x] for x in sets] if len(sets) > 1 else ["here"])]
    titles += ["`ml`"] * any(verdict.ml for verdict in result.verdicts) + ["verdict"]
    yield from ("", f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}")
    for verdict in result.verdicts:
        cells = [f'"{verdict.claim.says}" ({verdict.claim.source})']
        cells += [_results(verdict.outcomes[parameters]) for parameters in sets]
        cells += ["<br>".join(verdict.ml)] * ("`ml`" in titles)
        yield f"| {' | '.join(_cell(text) for text in (*cells, _verdict(verdict)))} |"
    yield from ("", "<details><summary>Checks and their limits</summary>", "")
    for verdict in result.verdicts:
        yield from _checks(verdict)
    yield from ("", "</details>")


def _checks(verdict: ClaimVerdict) -> Iterator[str]:
    """The checks of a claim with their limits and stated exceptions."""
    outcomes = (*verdict.outcomes[RESTS_ON], *verdict.guards)
    for (key, _, check), outcome in zip(verdict.claim.sections, outcomes, strict=True):
        ours = " (our finding)" if key == "guards" else ""
        yield f"- {verdict.claim.name}{ours}: {check.what}, {outcome.limits}. {check.reason}"
        for difference in check.exceptions if isinstance(check, EqualTable) else ():
            sides = (("in the thesis", difference.thesis), ("here", difference.here))
            only = ", ".join(
                f"only {side} {' '.join(f'`{name}`' for name in names)}"
                for side, names in sides
                if names
            )
            yield f"  - {difference.entry}: {only}. {difference.why}"


def _results(outcomes: Sequence[CheckOutcome]) -> str:
    """Results of checks; those that are not met in italics."""
    texts = (outcome.result if outcome.met else f"*{outcome.result}*" for outcome in outcomes)
    return "<br>".join(dict.fromkeys(texts))


def _verdict(verdict: ClaimVerdict) -> str:
    word = f"**{verdict.word}**"
    if verdict.word == FAILS:
        return word
    if verdict.comes_out("all" if "all" in verdict.outcomes else RESTS_ON) != verdict.word:
        word += f" ({verdict.comes_out('all')} with all)"
    guards = _results(verdict.guards)
    finding = " ".join(filter(None, (verdict.claim.finding, guards and f"<br>{guards}")))
    return f"{word}. {finding}" if finding else word


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
