"""Schema of a claim file: statements of the thesis, their source, the runs behind them, the checks.

    schema: ballbar-claim/1
    title: Joint noise
    place: sec. 3.5, Fig. 3.2
    sweep: sweeps/noise.yaml                # relative to this file; runs once for all files with it
    quick: {seeds: {first: 1, count: 2}}    # what `--quick` replaces in the sweep
    size: [errors.joint_noise.sigma_rad]    # column `size` of a run: the largest of these
    plots: [{kind: curves, title: ..., lines: identify.cost, x: size, ...}]
    claims:
      - name: c_l_sensitive
        says: ...                           # quotation from the thesis
        source: sec. 3.5, Fig. 3.2
        expected: holds                     # or differs, or {core: holds, all: differs}
        checks:                             # the sentence: it holds where all of them are met
          - kind: ratio
            what: ...
            of: {identify.cost: length}
            over: {identify.cost: transform}
            at_least: 3
            reason: ...
        finding: ...                        # where it differs: our result, which `guards` check
        guards: [{kind: at_most, ...}]
        ml: [{what: ..., rows: {identify.cost: ml}}]   # the default cost with the same errors

A sweep runs with both parameter sets (identify.parameters), and every sentence is judged with each.
Instead of a sweep, `identifiability` names a scenario; a calculation needs neither. The kinds of
checks are those of ballbar.claims.kinds.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from ballbar.cell.schema import Line, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import YamlDocument, load_yaml, parse_model
from ballbar.claims.kinds import DISTANCE, OF_RUNS, Check, EqualTable, Measure, Rows
from ballbar.ident.thesis.names import ParameterSet
from ballbar.sweep.file import Seeds

Word = Literal["holds", "differs"]


class Expected(Strict):
    """Verdict with each parameter set."""

    core: Word
    all: Word


class Claim(Strict):
    """One sentence of the thesis, and how it is checked."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9_]+$")]
    says: str = Field(description="Quotation from the thesis.")
    source: str
    expected: Word | Expected = Field(description="One word is the verdict with both sets.")
    finding: str = Field("", description="Our result and its reason, where the claim differs.")
    checks: Annotated[list[Check], Field(min_length=1, description="Checks of the sentence.")]
    guards: list[Check] = Field([], description="Checks of `finding`, with the core set.")
    ml: list[Measure] = Field(
        [], description="Results of cost ml, with the clock as parameter, on the same errors."
    )

    @property
    def sections(self) -> list[tuple[str, int, Check]]:
        """Every check with its key and its place below it."""
        groups = (("checks", self.checks), ("guards", self.guards))
        return [(key, j, check) for key, checks in groups for j, check in enumerate(checks)]

    def expects(self, parameters: ParameterSet) -> Word:
        """The verdict that is expected with one parameter set."""
        if isinstance(self.expected, Expected):
            return self.expected.core if parameters == "core" else self.expected.all
        return self.expected

    @model_validator(mode="after")
    def _explained(self) -> Claim:
        if "differs" in map(self.expects, get_args(ParameterSet)) and not self.finding:
            raise wrong_key("finding", message="state our result, since the claim differs")
        return self


class RunsPlot(Strict):
    """A plot of selected runs."""

    title: Line
    rows: Rows = Field({})
    lines: str = Field(description="Column whose values are the lines, or the colours of bars.")


class CurvesPlot(RunsPlot):
    """Curves over a varied value: the median, and a band from the smallest to the largest.

    Solid with the core set, dashed with all parameters. The distance has the largest error beside
    it, as in the thesis's figures.
    """

    kind: Literal["curves"]
    x: str
    x_label: str
    x_factor: float = Field(1.0, description="Factor from the column's unit to the label's.")
    y: str = DISTANCE
    y_label: str = "distance [mm|mrad]"
    limit: float | None = Field(None, description="Horizontal line: the thesis's 0.5 mm|mrad.")


class Ranking(RunsPlot):
    """Bars: how often each parameter is among the largest errors of a run."""

    kind: Literal["ranking"]
    places: Annotated[int, Field(ge=1)]
    thesis: dict[str, int] = Field({}, description="Counts of the thesis.")
    thesis_runs: Annotated[int, Field(ge=1)] = 1


class IdentifiedPlot(RunsPlot):
    """Bars: identified minus nominal of each parameter, a colour for each recording.

    As thesis Figs. 5.12 to 5.17; of the first seed.
    """

    kind: Literal["identified"]


class GroupedBars(RunsPlot):
    """Bars in groups, on a logarithmic scale: the median over the seeds."""

    kind: Literal["bars"]
    groups: str = Field(description="Column whose values are the groups.")
    y: str
    y_label: str
    limit: float | None = Field(None, description="Horizontal line.")


class PlatePlot(Strict):
    """Deflection of the offset plate over its thickness (ballbar.plan.beam)."""

    kind: Literal["plate"]
    title: Line


AnyPlot = CurvesPlot | Ranking | IdentifiedPlot | GroupedBars | PlatePlot


class Quick(Strict):
    """Keys of the sweep that `--quick` replaces; `change` is added to the sweep's own."""

    change: dict[str, Any] = Field({})
    together: Annotated[list[dict[str, Any]], Field(min_length=1)] | None = None
    vary: dict[str, Annotated[list[Any], Field(min_length=1)]] | None = None
    draws: Annotated[int, Field(ge=1)] | None = None
    seeds: Seeds | None = None


class ClaimFile(Strict):
    """One YAML file of scenarios/claims/."""

    schema_: Annotated[Literal["ballbar-claim/1"], Field(alias="schema")]
    title: Line
    place: str
    """Place in the thesis, `sec. 3.5, Fig. 3.2`; its numbers order the files."""
    about: str = Field("", description="The simulation in one or two sentences.")
    sweep: str | None = Field(None, description="Sweep file, relative to this file.")
    quick: Quick = Quick()
    identifiability: str | None = None
    """Scenario whose nominal mechanism is studied, relative to this file."""
    core_alone: bool = False
    """Whether its runs fit the core set only, as sec. 5.4 does."""
    size: list[str] = Field([], description="Varied keys; the column `size` is their largest.")
    plots: list[Annotated[AnyPlot, Field(discriminator="kind")]] = Field([])
    claims: Annotated[list[Claim], Field(min_length=1)]

    @property
    def sets(self) -> tuple[ParameterSet, ...]:
        """Parameter sets that its runs fit; core alone where there is no sweep, or none else."""
        both = self.sweep is not None and not self.core_alone
        return get_args(ParameterSet) if both else ("core",)

    @property
    def order(self) -> list[int]:
        """The numbers of its place in the thesis."""
        return [int(number) for number in re.findall(r"\d+", self.place)]

    @model_validator(mode="after")
    def _one_kind_of_evidence(self) -> ClaimFile:
        if self.sweep is not None and self.identifiability is not None:
            raise wrong_key(
                "identifiability",
                message="the checks look at one table: name either this or a sweep",
            )
        return self

    @model_validator(mode="after")
    def _has_what_its_checks_look_at(self) -> ClaimFile:
        swept, studied = self.sweep is not None, self.identifiability is not None
        for i, claim in enumerate(self.claims):
            for section, j, check in claim.sections:
                kind = ("claims", i, section, j, "kind")
                if isinstance(check, EqualTable) and not studied:
                    message = "looks at identifiability, which this file does not name"
                    raise wrong_key(*kind, message=message)
                if isinstance(check, OF_RUNS) and not (swept or studied):
                    message = "looks at runs: name a sweep or identifiability"
                    raise wrong_key(*kind, message=message)
            if claim.ml and not swept:
                message = "looks at the runs of a sweep, which this file does not name"
                raise wrong_key("claims", i, "ml", message=message)
            if claim.name in (other.name for other in self.claims[:i]):
                message = "another claim of this file has that name; change one of them"
                raise wrong_key("claims", i, "name", message=message)
        for i, plot in enumerate(self.plots):
            if not swept and not isinstance(plot, PlatePlot):
                message = "shows the runs of a sweep, which this file does not name"
                raise wrong_key("plots", i, message=message)
        return self


def load_claims(path: Path) -> tuple[ClaimFile, YamlDocument]:
    """The checked file, and the document that knows its lines.

    Raises DescriptionError naming file, line and key.
    """
    document = load_yaml(path)
    return parse_model(document, ClaimFile), document
