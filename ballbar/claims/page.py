"""docs/claims.md: every claim of the thesis beside what comes out here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from ballbar.claims.kinds import Difference, EqualTable
from ballbar.claims.run import FAILS, Judged, Verdict

_HEAD = """# Claims: what the thesis says, and what comes out here

Written by `ballbar claims --out docs/claims.md` from `scenarios/claims/`; do not edit. `ballbar claims NAME` runs one file of claims,
`--quick` all with fewer points and seeds. The command exits with 1 when a check fails.

Brand & Nilsson 2016 (TFRT-6017), simulated as they did (sec. 3.1): exact kinematics, samples of both logs paired, errors of Table 3.1,
one kind of varying error at a time. What is not theirs: the path, since theirs is not printed (what that means for sizes: Excitation);
and signed components of each cost (`vector`) where they minimised the printed scalar, unless it says "printed". Distance: Euclidean, over
all identified parameters, from the truth, in mm and mrad mixed (sec. 3.4). Numbers are medians over the seeds unless it says otherwise;
bands in the figures go from smallest to largest. The dashed line is the 0.5 mm|mrad that the thesis aims at.

Verdicts: **holds**, the thesis's sentence is what comes out here too. **differs**, it is not, with what does; the check then guards our
finding. The column `ml`: the default cost on the same errors, with the clock as parameter.

"""


def page_text(
    judged: Sequence[Judged], images: Mapping[str, Sequence[str]], commands: Mapping[str, str]
) -> str:
    """The page.

    images : of each file of claims, links from the page. commands : of each, what repeats its runs.
    """
    counts = Counter(verdict.word for one in judged for verdict in one.verdicts)
    failed = f", {counts[FAILS]} fail their checks" if counts[FAILS] else ""
    lines = [
        _HEAD
        + f"{counts.total()} claims: {counts['holds']} hold, {counts['differs']} differ{failed}.\n"
    ]
    lines += ["| claim | thesis | verdict |", "|---|---|---|"]
    for one in judged:
        title = one.topic.file.title
        lines += [
            f"| [{title}](#{_anchor(title)}): {v.claim.name} | {_cell(v.claim.source)} | {v.word} |"
            for v in one.verdicts
        ]
    for one in judged:
        lines += [
            "",
            *_section(one, images.get(one.topic.name, ()), commands.get(one.topic.name, "")),
        ]
    return "\n".join(lines) + "\n"


def _section(one: Judged, images: Sequence[str], command: str) -> Iterator[str]:
    file = one.topic.file
    yield from (f"## {file.title}", "")
    runs = f" ({one.plan.runs} runs)" if one.plan else ""
    yield " ".join(
        part
        for part in (f"Thesis {file.place}.", file.about, command and f"`{command}`{runs}.")
        if part
    )
    for image in images:
        yield from ("", f"![{file.title}]({image})")
    beside = any(verdict.ml for verdict in one.verdicts)
    yield from (
        "",
        f"| thesis | here |{' `ml` |' * beside} verdict |",
        f"|---|---|{'---|' * beside}---|",
    )
    for verdict in one.verdicts:
        cells = [
            f'"{verdict.claim.says}" ({verdict.claim.source})',
            "<br>".join(dict.fromkeys(outcome.found for outcome in verdict.outcomes)),
        ]
        cells += ["<br>".join(verdict.ml)] * beside
        yield f"| {' | '.join(_cell(text) for text in (*cells, _verdict(verdict)))} |"
    yield from ("", "<details><summary>Checks and their limits</summary>", "")
    for verdict in one.verdicts:
        for check, outcome in zip(verdict.claim.checks, verdict.outcomes, strict=True):
            yield f"- {verdict.claim.name}: {check.what}, {outcome.asked}. {check.reason}"
            if isinstance(check, EqualTable):
                yield from (f"  - {_difference(difference)}" for difference in check.exceptions)
    yield from ("", "</details>")


def _difference(difference: Difference) -> str:
    sides = (("in the thesis", difference.thesis), ("here", difference.here))
    only = [
        f"only {side} {' '.join(f'`{name}`' for name in names)}" for side, names in sides if names
    ]
    return f"{difference.entry}: {', '.join(only)}. {difference.why}"


def _verdict(verdict: Verdict) -> str:
    word = f"**{verdict.word}**"
    return (
        f"{word}. {verdict.claim.finding}"
        if verdict.claim.finding and verdict.word != FAILS
        else word
    )


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _anchor(title: str) -> str:
    return "".join(c for c in title.lower() if c.isalnum() or c in " -_").replace(" ", "-")
