"""What the thesis says of one figure or table, as its file says it: words, source, the runs behind them, and the checks.

    schema: ballbar-claim/1
    title: Joint noise
    place: sec. 3.5, Fig. 3.2
    sweep: sweeps/noise.yaml                # relative to this file; several files may name the same, it runs once
    quick: {seeds: {first: 1, count: 2}}    # what `--quick` replaces in the sweep
    size: [errors.joint_noise.sigma_rad]    # column `size` of a run: the largest of these
    plots: [{kind: curves, title: ..., lines: identify.cost, x: size, ...}]
    claims:
      - name: c_l_sensitive
        says: ...                           # the thesis's words
        source: sec. 3.5, Fig. 3.2
        expected: holds                     # or differs, with `finding`: the checks then guard what we found
        checks:
          - {kind: ratio, what: ..., of: {identify.cost: length}, over: {identify.cost: transform}, at_least: 3, reason: ...}
        ml: [{what: ..., rows: {identify.cost: ml}}]   # what the default cost makes of the same errors

Instead of a sweep, `identifiability` names a scenario; a calculation needs neither. The kinds of checks are those of
ballbar.claims.kinds.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ballbar.claims.kinds import DISTANCE, OF_RUNS, Check, EqualTable, Measure, Rows
from ballbar.sweep.file import Seeds
from cell.schema import Strict
from cell.schema_errors import wrong_key
from cell.strict_yaml import YamlDocument, load_yaml, parse_model


class Claim(Strict):
    """One sentence of the thesis, and what it comes to here."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9_]+$")]
    says: str = Field(description="The thesis's words.")
    source: str
    expected: Literal["holds", "differs"]
    finding: str = Field("", description="What we find instead, and why; of differs.")
    checks: Annotated[list[Check], Field(min_length=1)]
    ml: list[Measure] = Field(
        [], description="The same errors with cost ml, the clock a parameter."
    )

    @model_validator(mode="after")
    def _explained(self) -> Claim:
        if self.expected == "differs" and not self.finding:
            raise wrong_key("finding", message="say what is found instead, since it differs")
        return self


class Plot(Strict):
    """Curves over a varied value: the median, and a band from smallest to largest."""

    kind: Literal["curves"]
    title: str
    x: str
    x_label: str
    x_factor: float = Field(1.0, description="From the column's unit to that of the label.")
    lines: str = Field(description="Column that tells the lines apart.")
    rows: Rows = Field({})
    y: str = DISTANCE
    y_label: str = "distance [mm|mrad]"
    limit: float | None = Field(None, description="Drawn across: the thesis's 0.5 mm|mrad.")


class Ranking(Strict):
    """Bars: how often each parameter is among the largest errors of a run."""

    kind: Literal["ranking"]
    title: str
    places: Annotated[int, Field(ge=1)]
    rows: Rows = Field({})
    lines: str
    thesis: dict[str, int] = Field({}, description="How often in the thesis.")
    thesis_runs: Annotated[int, Field(ge=1)] = 1


class PlatePlot(Strict):
    """Deflection of the offset plate over its thickness (ballbar.plan.beam)."""

    kind: Literal["plate"]
    title: str


class Quick(Strict):
    """What `--quick` replaces in the sweep; a sweep's own keys, and `change` comes on top of its own."""

    change: dict[str, Any] = Field({})
    together: Annotated[list[dict[str, Any]], Field(min_length=1)] | None = None
    vary: dict[str, Annotated[list[Any], Field(min_length=1)]] | None = None
    draws: Annotated[int, Field(ge=1)] | None = None
    seeds: Seeds | None = None


class ClaimFile(Strict):
    """One YAML file of scenarios/claims/."""

    schema_: Annotated[Literal["ballbar-claim/1"], Field(alias="schema")]
    title: str
    place: str = Field(
        description="In the thesis, `sec. 3.5, Fig. 3.2`; files are shown in the order of its numbers."
    )
    about: str = Field("", description="What is simulated, in a sentence or two.")
    sweep: str | None = Field(None, description="Sweep file, relative to this file.")
    quick: Quick = Quick()
    identifiability: str | None = Field(
        None, description="Scenario whose nominal mechanism is judged, relative to this file."
    )
    size: list[str] = Field([], description="Varied keys whose largest is the column `size`.")
    plots: list[Annotated[Plot | Ranking | PlatePlot, Field(discriminator="kind")]] = Field([])
    claims: Annotated[list[Claim], Field(min_length=1)]

    @property
    def order(self) -> list[int]:
        """The numbers of its place."""
        return [int(number) for number in re.findall(r"\d+", self.place)]

    @model_validator(mode="after")
    def _one_kind_of_evidence(self) -> ClaimFile:
        if self.sweep is not None and self.identifiability is not None:
            raise wrong_key(
                "identifiability",
                message="the checks look at one table: name this or a sweep, and give the other a file",
            )
        return self

    @model_validator(mode="after")
    def _has_what_its_checks_look_at(self) -> ClaimFile:
        for i, claim in enumerate(self.claims):
            for j, check in enumerate(claim.checks):
                if isinstance(check, EqualTable) and self.identifiability is None:
                    raise wrong_key(
                        "claims",
                        i,
                        "checks",
                        j,
                        "kind",
                        message="looks at identifiability, which this file does not name",
                    )
                if (
                    isinstance(check, OF_RUNS)
                    and self.sweep is None
                    and self.identifiability is None
                ):
                    raise wrong_key(
                        "claims",
                        i,
                        "checks",
                        j,
                        "kind",
                        message="looks at runs: name a sweep or identifiability",
                    )
            if claim.ml and self.sweep is None:
                raise wrong_key(
                    "claims",
                    i,
                    "ml",
                    message="looks at the runs of a sweep, which this file does not name",
                )
        names = [claim.name for claim in self.claims]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise wrong_key(
                    "claims", i, "name", message="another claim of this file has that name"
                )
        for i, plot in enumerate(self.plots):
            if self.sweep is None and not isinstance(plot, PlatePlot):
                raise wrong_key(
                    "plots", i, message="shows the runs of a sweep, which this file does not name"
                )
        return self


def load_claims(path: Path) -> tuple[ClaimFile, YamlDocument]:
    """The checked file, and the document that knows its lines. Raises DescriptionError naming file, line and key."""
    document = load_yaml(path)
    return parse_model(document, ClaimFile), document
