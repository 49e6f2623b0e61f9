"""The page docs/claims.md: every claim of the thesis beside our results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from ballbar.claims.kinds import Difference, EqualTable
from ballbar.claims.run import FAILS, Judged, Verdict
from cell.foreign_text import markdown

_HEAD = """# Claims: what the thesis says, and what comes out here

Written by `ballbar claims --out docs/claims.md` from `scenarios/claims/`; do not edit.
`ballbar claims NAME` runs one file of claims, `--quick` all with fewer points and seeds. The
command exits with 1 when a check fails.

Brand & Nilsson 2016 (TFRT-6017), simulated as they did (sec. 3.1): exact kinematics, samples of
both logs paired, errors of Table 3.1, one kind of varying error at a time. Two things are not
theirs: the path, since theirs is not printed (its effect on sizes: Excitation); and signed
components of each cost (`vector`) where they minimised the printed scalar, unless it says
"printed". Distance: Euclidean, over all identified parameters, from the truth, in mm and mrad mixed
(sec. 3.4). Numbers are medians over the seeds unless it says otherwise; bands in the plots go from
smallest to largest. The dashed line is the 0.5 mm|mrad that the thesis aims at.

Verdicts: **holds** where our results confirm the thesis's sentence. **differs** where they do not,
with our finding, which the check then guards. The column `ml`: the default cost on the same errors,
with the clock as parameter.

"""


def page_text(
    judged: Sequence[Judged], images: Mapping[str, Sequence[str]], commands: Mapping[str, str]
) -> str:
    """The page as Markdown.

    images, commands : name of a claim file -> its plots as links from the page, and the command
    that repeats its runs.
    """
    counts = Counter(verdict.word for result in judged for verdict in result.verdicts)
    failed = f", {counts[FAILS]} fail their checks" if counts[FAILS] else ""
    summary = f"{counts['holds']} hold, {counts['differs']} differ{failed}"
    lines = [f"{_HEAD}{counts.total()} claims: {summary}.", ""]
    lines += ["| claim | thesis | verdict |", "|---|---|---|"]
    for result in judged:
        title = markdown(result.topic.file.title)
        lines += [
            f"| [{title}](#{_anchor(title)}): {v.claim.name} | {_cell(v.claim.source)} | {v.word} |"
            for v in result.verdicts
        ]
    for result in judged:
        name = result.topic.name
        lines += ["", *_section(result, images.get(name, ()), commands.get(name, ""))]
    return "\n".join(lines) + "\n"


def _section(result: Judged, images: Sequence[str], command: str) -> Iterator[str]:
    file = result.topic.file
    title = markdown(file.title)
    yield from (f"## {title}", "")
    runs = f" ({result.plan.runs} runs)" if result.plan else ""
    sentences = (f"Thesis {file.place}.", file.about, command and f"`{command}`{runs}.")
    yield " ".join(filter(None, sentences))
    for image in images:
        yield from ("", f"![{title}]({image})")
    ml = any(verdict.ml for verdict in result.verdicts)
    yield from ("", f"| thesis | here |{' `ml` |' * ml} verdict |", f"|---|---|{'---|' * ml}---|")
    for verdict in result.verdicts:
        cells = [
            f'"{verdict.claim.says}" ({verdict.claim.source})',
            "<br>".join(dict.fromkeys(outcome.result for outcome in verdict.outcomes)),
        ]
        cells += ["<br>".join(verdict.ml)] * ml
        yield f"| {' | '.join(_cell(text) for text in (*cells, _verdict(verdict)))} |"
    yield from ("", "<details><summary>Checks and their limits</summary>", "")
    for verdict in result.verdicts:
        for check, outcome in zip(verdict.claim.checks, verdict.outcomes, strict=True):
            yield f"- {verdict.claim.name}: {check.what}, {outcome.limits}. {check.reason}"
            if isinstance(check, EqualTable):
                yield from (f"  - {_difference(difference)}" for difference in check.exceptions)
    yield from ("", "</details>")


def _difference(difference: Difference) -> str:
    sides = (("in the thesis", difference.thesis), ("here", difference.here))
    listed = [(side, " ".join(f"`{name}`" for name in names)) for side, names in sides if names]
    only = ", ".join(f"only {side} {names}" for side, names in listed)
    return f"{difference.entry}: {only}. {difference.why}"


def _verdict(verdict: Verdict) -> str:
    finding = "" if verdict.word == FAILS else verdict.claim.finding
    return f"**{verdict.word}**. {finding}" if finding else f"**{verdict.word}**"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _anchor(title: str) -> str:
    return "".join(c for c in title.lower() if c.isalnum() or c in " -_").replace(" ", "-")
