"""Runs the sweeps behind claims, each once a parameter set; judges every claim by its checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.extended_yaml import with_changes
from ballbar.cell.schema_errors import nearest
from ballbar.cell.strict_yaml import YamlDocument
from ballbar.claims.checks import CheckOutcome, judge, measured
from ballbar.claims.file import Claim, ClaimFile, Quick, Word, load_claims
from ballbar.claims.table import ClaimEvidence, identifiability_evidence, runs_evidence
from ballbar.ident.thesis.names import ML, ParameterSet
from ballbar.sweep.check import LoadedSweep, load_sweep
from ballbar.sweep.chunk import Task
from ballbar.sweep.file import flattened
from ballbar.sweep.plan import Plan
from ballbar.sweep.run import Progress, Workers, run_sweep
from ballbar.trial.trial import run_trial

FOLDER = Path("scenarios/claims")  # claims of the project, relative to its folder
FAILS = "fails its check"
RESTS_ON: ParameterSet = "core"  # the set that the verdict rests on; why: ballbar.claims.show
COST = "identify.cost"

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
class ClaimVerdict:
    """Result of a claim."""

    claim: Claim
    outcomes: Mapping[ParameterSet, tuple[CheckOutcome, ...]]  # one for each check
    guards: tuple[CheckOutcome, ...]  # of our finding, core set
    ml: tuple[str, ...]  # results of the default cost, as text

    def comes_out(self, parameters: ParameterSet) -> Word:
        """The verdict with one parameter set, whatever was expected."""
        return "holds" if all(x.met for x in self.outcomes[parameters]) else "differs"

    @property
    def passed(self) -> bool:
        as_expected = (self.comes_out(x) == self.claim.expects(x) for x in self.outcomes)
        return all(as_expected) and all(guard.met for guard in self.guards)

    @property
    def word(self) -> str:
        return self.comes_out(RESTS_ON) if self.passed else FAILS


@dataclass(frozen=True, eq=False)
class Judged:
    """Verdicts on the claims of one file, and their evidence."""

    topic: Topic
    evidence: Mapping[ParameterSet, ClaimEvidence]
    verdicts: tuple[ClaimVerdict, ...]
    runs: int  # of the sweep with all its parameter sets, if there is one


def topics(names: Sequence[str]) -> list[Topic]:
    """The claims with these names or files, or all of FOLDER, in the order of the thesis.

    Raises InputError for an unknown name, DescriptionError for a file that is wrong.
    """
    if not names and not FOLDER.is_dir():
        remedy = "Change to the project's folder, or name files of claims."
        raise InputError.at(FOLDER, f"no such folder in {Path.cwd()}.", remedy)
    paths = [_file_of(name) for name in names] or sorted(FOLDER.glob("*.yaml"))
    read = [Topic(path.stem, path, *load_claims(path)) for path in paths]
    return sorted(read, key=lambda topic: topic.file.order)


def judge_all(
    chosen: Sequence[Topic], folder: Path, workers: WorkersOf, *, quick: bool, showing: ProgressOf
) -> list[Judged]:
    """Runs each sweep once with each parameter set, into folders below `folder`; judges all claims.

    Raises InputError and DescriptionError for errors in a file, SweepError when workers die.
    """
    sweeps = [_sweeps_of(topic, quick=quick) for topic in chosen]
    tables: dict[str, Path] = {}
    for sweep in (sweep for sets in sweeps for sweep in sets.values()):
        plan = sweep.plan
        if plan.digest not in tables:
            with showing(plan) as progress:
                below = folder / plan.digest[:12]
                outcome = run_sweep(sweep, below, run_trial, workers, progress=progress)
            if not outcome.finished:
                raise KeyboardInterrupt
            tables[plan.digest] = outcome.folder.table
    return [_judged(topic, sets, tables) for topic, sets in zip(chosen, sweeps, strict=True)]


def _judged(
    topic: Topic, sweeps: Mapping[ParameterSet, LoadedSweep], tables: Mapping[str, Path]
) -> Judged:
    file = topic.file
    evidence: Mapping[ParameterSet, ClaimEvidence] = {RESTS_ON: ClaimEvidence()}
    if sweeps:
        with _located(topic, "size"):
            evidence = {
                parameters: runs_evidence(tables[sweep.plan.digest], file.size)
                for parameters, sweep in sweeps.items()
            }
    elif file.identifiability is not None:
        evidence = {RESTS_ON: identifiability_evidence(topic.path.parent / file.identifiability)}
    verdicts = tuple(_verdict(topic, i, evidence) for i in range(len(file.claims)))
    return Judged(topic, evidence, verdicts, sum(sweep.plan.runs for sweep in sweeps.values()))


def _verdict(topic: Topic, i: int, evidence: Mapping[ParameterSet, ClaimEvidence]) -> ClaimVerdict:
    claim = topic.file.claims[i]
    outcomes = {name: _outcomes(topic, i, "checks", runs) for name, runs in evidence.items()}
    ml = []
    for j, measure in enumerate(claim.ml):
        with _located(topic, "claims", i, "ml", j):
            ml.append(measured(measure, evidence[RESTS_ON]))
    guards = _outcomes(topic, i, "guards", evidence[RESTS_ON])
    return ClaimVerdict(claim, outcomes, guards, tuple(ml))


def _outcomes(
    topic: Topic, i: int, section: str, evidence: ClaimEvidence
) -> tuple[CheckOutcome, ...]:
    outcomes = []
    for key, j, check in topic.file.claims[i].sections:
        if key == section:
            with _located(topic, "claims", i, section, j):
                outcomes.append(judge(check, evidence))
    return tuple(outcomes)


def _sweeps_of(topic: Topic, *, quick: bool) -> dict[ParameterSet, LoadedSweep]:
    """The file's sweep with each of its parameter sets; empty without a sweep."""
    if topic.file.sweep is None:
        return {}
    sweep = load_sweep(topic.path.parent / topic.file.sweep)
    with _located(topic, "quick"):
        plan = _thinned(sweep.plan, topic.file.quick) if quick else sweep.plan
        plans = {"core": plan, "all": _with_all_parameters(plan)}
        return {name: replace(sweep, plan=plans[name]) for name in topic.file.sets}


def _with_all_parameters(plan: Plan) -> Plan:
    """The same runs with all parameters of thesis sec. 3.3, without those of ml."""
    data = plan.data
    scenario = with_changes(data.scenario, {"identify.parameters": "all"})
    together = [row for row in data.together if row.get(COST) != ML]
    vary = {
        key: [value for value in values if (key, value) != (COST, ML)]
        for key, values in data.vary.items()
    }
    changes = {"scenario": scenario, "together": together, "vary": vary}
    return Plan.of(data.model_copy(update=changes))


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
        raise DescriptionError(f"{topic.document.place_of(location)}: {error}.") from None
