"""Runs the sweeps behind claims, each once, and judges every claim by its checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ballbar.claims.checks import Outcome, judge, measured
from ballbar.claims.file import Claim, ClaimFile, Quick, load_claims
from ballbar.claims.table import Evidence, identifiability_evidence, runs_evidence
from ballbar.sweep.check import LoadedSweep, load_sweep
from ballbar.sweep.chunk import Task
from ballbar.sweep.file import flattened
from ballbar.sweep.plan import Plan, with_changes
from ballbar.sweep.run import Progress, run_sweep
from ballbar.sweep.workers import Workers
from ballbar.trial.trial import run_trial
from cell.errors import DescriptionError, InputError
from cell.schema_errors import nearest
from cell.strict_yaml import YamlDocument

FOLDER = Path("scenarios/claims")  # claims of the project, relative to its folder
FAILS = "fails its check"

WorkersOf = Callable[[Task], AbstractContextManager[Workers]]
ProgressOf = Callable[[Plan], AbstractContextManager[Progress]]  # of the runs of one sweep


@dataclass(frozen=True, eq=False)
class Topic:
    """One file of claims as read."""

    name: str
    path: Path
    file: ClaimFile
    document: YamlDocument


@dataclass(frozen=True, eq=False)
class Verdict:
    """Result of a claim."""

    claim: Claim
    outcomes: tuple[Outcome, ...]  # one for each check
    ml: tuple[str, ...]  # results of the default cost, as text

    @property
    def passed(self) -> bool:
        return all(outcome.met for outcome in self.outcomes)

    @property
    def word(self) -> str:
        return self.claim.expected if self.passed else FAILS


@dataclass(frozen=True, eq=False)
class Judged:
    """Verdicts on the claims of one file, and their evidence."""

    topic: Topic
    evidence: Evidence
    verdicts: tuple[Verdict, ...]
    plan: Plan | None  # of the sweep, if there is one


def topics(names: Sequence[str]) -> list[Topic]:
    """The claims with these names or files, or all of FOLDER, in the order of the thesis.

    Raises InputError for an unknown name, DescriptionError for a file that is wrong.
    """
    if not names and not FOLDER.is_dir():
        raise InputError(
            f"{FOLDER}: no such folder in {Path.cwd()}. Change to the project's folder, or name "
            "files of claims."
        )
    paths = [_file_of(name) for name in names] or sorted(FOLDER.glob("*.yaml"))
    return sorted((_read(path) for path in paths), key=lambda topic: topic.file.order)


def judge_all(
    chosen: Sequence[Topic], folder: Path, workers: WorkersOf, *, quick: bool, showing: ProgressOf
) -> list[Judged]:
    """Runs each sweep once, into a folder below `folder`, and judges every claim.

    Raises InputError and DescriptionError for errors in a file, SweepError when workers die.
    """
    sweeps = [
        _sweep_of(topic, quick=quick) if topic.file.sweep is not None else None for topic in chosen
    ]
    tables: dict[str, Path] = {}
    for sweep in filter(None, sweeps):
        plan = sweep.plan
        if plan.digest not in tables:
            with showing(plan) as progress:
                below = folder / plan.digest[:12]
                outcome = run_sweep(sweep, below, run_trial, workers, progress=progress)
            if not outcome.finished:
                raise KeyboardInterrupt
            tables[plan.digest] = outcome.folder.table
    return [_judged(topic, sweep, tables) for topic, sweep in zip(chosen, sweeps, strict=True)]


def _judged(topic: Topic, sweep: LoadedSweep | None, tables: dict[str, Path]) -> Judged:
    file, plan = topic.file, sweep.plan if sweep else None
    if plan is not None:
        with _located(topic, "size"):
            evidence = runs_evidence(tables[plan.digest], file.size)
    elif file.identifiability is not None:
        evidence = identifiability_evidence(topic.path.parent / file.identifiability)
    else:
        evidence = Evidence()
    verdicts = tuple(_verdict(topic, i, evidence) for i in range(len(file.claims)))
    return Judged(topic, evidence, verdicts, plan)


def _verdict(topic: Topic, i: int, evidence: Evidence) -> Verdict:
    claim = topic.file.claims[i]
    outcomes, ml = [], []
    for j, check in enumerate(claim.checks):
        with _located(topic, "claims", i, "checks", j):
            outcomes.append(judge(check, evidence))
    for j, measure in enumerate(claim.ml):
        with _located(topic, "claims", i, "ml", j):
            ml.append(measured(measure, evidence))
    return Verdict(claim, tuple(outcomes), tuple(ml))


def _sweep_of(topic: Topic, *, quick: bool) -> LoadedSweep:
    sweep = load_sweep(topic.path.parent / str(topic.file.sweep))
    with _located(topic, "quick"):
        return replace(sweep, plan=_thinned(sweep.plan, topic.file.quick)) if quick else sweep


def _thinned(plan: Plan, quick: Quick) -> Plan:
    """A sweep with fewer points and seeds."""
    changes: dict[str, object] = {
        "scenario": with_changes(plan.data.scenario, flattened(quick.change))
    }
    if quick.together is not None:
        changes["together"] = [flattened(row) for row in quick.together]
    for key in ("vary", "draws", "seeds"):
        if (value := getattr(quick, key)) is not None:
            changes[key] = value
    return Plan.of(plan.data.model_copy(update=changes))


def _read(path: Path) -> Topic:
    file, document = load_claims(path)
    return Topic(path.stem, path, file, document)


def _file_of(name: str) -> Path:
    """Path of claims by name: `noise` is a file of FOLDER, `mine.yaml` any file."""
    if name.endswith(".yaml"):
        return Path(name)
    path = FOLDER / f"{name}.yaml"
    if not path.is_file():
        hint = nearest(name, [file.stem for file in FOLDER.glob("*.yaml")], noun="name")
        raise InputError(f"{name}: there are no such claims in {FOLDER}.{hint}")
    return path


@contextmanager
def _located(topic: Topic, *location: str | int) -> Iterator[None]:
    """An InputError raised within gets the file and line of this location."""
    try:
        yield
    except DescriptionError:
        raise
    except InputError as error:
        line = topic.document.line_of(location)
        raise DescriptionError(f"{topic.path}:{line}: {error}.") from None
