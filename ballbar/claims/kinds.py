"""The kinds of checks of a claim, and the numbers they use.

The set is closed: no expression in a claim is evaluated.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ballbar.cell.geometry import ParameterTable
from ballbar.cell.schema import Strict
from ballbar.cell.schema_errors import nearest, wrong_key
from ballbar.ident.estimator.thesis_names import thesis_parameters
from ballbar.plan.beam import CALCULATIONS

Scalar = str | int | float | bool | None
Rows = dict[str, Scalar | list[Scalar]]  # column -> value, or values, of the selected runs
# largest: largest absolute value; spread: standard deviation, relative_spread: over the mean
Statistic = Literal["median", "mean", "min", "max", "rms", "largest", "spread", "relative_spread"]
TableName = Literal["3.2", "3.3", "3.4", "3.5", "sec. 3.3"]

DISTANCE, LARGEST = "distance_mm_mrad", "largest_mm_mrad"
SIX_AXES = 6  # of both robots of the thesis


class Reasoned(Strict):
    """A check with its reason."""

    what: str
    """Text before the number."""
    reason: str


class Limited(Reasoned):
    """A check whose numbers lie within limits."""

    at_least: float | None = None
    at_most: float | None = None

    @model_validator(mode="after")
    def _limited(self) -> Limited:
        if self.at_least is None and self.at_most is None:
            raise ValueError("give at_least, at_most, or both")
        return self


class Measure(Strict):
    """A statistic of the selected runs."""

    what: str
    """Text before the number."""
    statistic: Statistic = "median"
    column: str = DISTANCE
    rows: Rows = Field({}, description="Selected runs: column and value, or values.")
    each: str | None = Field(None, description="One number for every value of this column.")


class Bound(Measure, Reasoned):
    """Every number lies on one side of a limit."""

    kind: Literal["at_most", "at_least"]
    limit: float

    @property
    def at_least(self) -> float | None:
        return self.limit if self.kind == "at_least" else None

    @property
    def at_most(self) -> float | None:
        return self.limit if self.kind == "at_most" else None


class Quotient(Strict):
    """Runs whose number is divided by that of other runs."""

    of: Rows
    over: Rows


class Ratio(Quotient, Measure, Limited):
    """The number of some runs over that of other runs lies within limits."""

    kind: Literal["ratio"]
    than: Quotient | None = None
    """Runs by whose ratio this one is divided: how much more `of` gains."""


class Ordered(Measure, Reasoned):
    """The numbers of groups of runs rise from group to group."""

    kind: Literal["ordered"]
    by: str = Field(description="Column that tells the groups apart.")
    order: Annotated[list[Scalar], Field(min_length=2)]
    """Its values, smallest number first."""
    apart: Annotated[float, Field(gt=0.0)] = 1.0
    """Least factor from a group to the next."""


class Monotonic(Measure, Reasoned):
    """A number rises, or falls, with a varied value."""

    kind: Literal["monotonic"]
    over: str
    direction: Literal["rising", "falling"]
    tolerance: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    """Relative step in the other direction that is accepted."""


class Apart(Limited):
    """Distance between the identified errors of two recordings, over their mean size.

    Identified errors are identified minus nominal, without origin and encoder offsets (sec. 5.4).
    """

    kind: Literal["apart"]
    rows: Rows = Field({})
    first: Rows
    """Runs of one recording, one for each seed and `each`."""
    second: Rows
    """Runs of the other recording, as many."""
    each: str = "identify.cost"
    """One number for every value of this column."""


class AmongLargest(Reasoned):
    """Share of the largest errors of each run that belong to the named parameters."""

    kind: Literal["among_largest"]
    rows: Rows = Field({})
    places: Annotated[int, Field(ge=1)]
    parameters: Annotated[list[str], Field(min_length=1)]
    """Names, or their beginning: `btheta`. One that is not fitted has no error."""
    at_least: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    at_most: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0

    @model_validator(mode="after")
    def _of_the_thesis(self) -> AmongLargest:
        names = thesis_parameters(ParameterTable(SIX_AXES, ()))
        for name in self.parameters:
            if not any(parameter.startswith(name) for parameter in names):
                message = f"no parameter of thesis sec. 3.3 is, or begins with, {name}"
                raise wrong_key("parameters", message=message)
        return self


class TableDifference(Strict):
    """One entry of a printed table that differs from ours."""

    entry: str = Field(description="Row of the table: a cost, or the parameter left out.")
    thesis: list[str] = Field([], description="Printed, and not found here.")
    here: list[str] = Field([], description="Found here, and not printed.")
    why: str


class EqualTable(Reasoned):
    """A table of ballbar.ident.thesis.tables equals ours, apart from the exceptions stated."""

    kind: Literal["equal_table"]
    table: TableName
    exceptions: list[TableDifference] = Field([])


class Formula(Reasoned):
    """A calculation from first principles (ballbar.plan.beam) gives the printed value."""

    kind: Literal["formula"]
    figure: str
    value: float
    unit: Literal["mm", "um", "urad"]
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(description="Relative.")

    @model_validator(mode="after")
    def _known(self) -> Formula:
        if self.figure not in CALCULATIONS:
            hint = nearest(self.figure, CALCULATIONS, noun="figure")
            raise wrong_key("figure", message=f"there is no such figure.{hint}")
        return self


Check = Annotated[
    Bound | Ratio | Ordered | Monotonic | Apart | AmongLargest | EqualTable | Formula,
    Field(discriminator="kind"),
]
OF_RUNS = (Bound, Ratio, Ordered, Monotonic, Apart, AmongLargest)
