"""The uncertainty budget in calibration.yaml: the fields of ballbar.ident.robot.budget in order."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ballbar.cell.schema import NotNegative, Positive, Strict
from ballbar.ident.robot.budget import Budget, BudgetRow, Distribution, Evaluated


class BudgetRowEntry(Strict):
    """One input of the estimate, and its contribution to the tool's uncertainty."""

    name: str
    what: str
    evaluated: Evaluated  # A: by statistics of the data, B: by other knowledge (JCGM 100)
    distribution: Distribution
    # [unit]; 1 of inputs of several units, which count in their standard uncertainties
    standard_uncertainty: NotNegative
    unit: str
    contribution_m: float  # root mean square over the workspace; below 0 it is taken off
    worst_m: NotNegative  # largest in the workspace
    share: float  # of the variance
    degrees_of_freedom: Positive | None = None  # absent where infinite


class BudgetEntry(Strict):
    """The parts of the stated TCP uncertainty over the workspace."""

    rows: Annotated[tuple[BudgetRowEntry, ...], Field(min_length=1)]  # the largest first
    combined_m: NotNegative  # standard uncertainty, root mean square
    mean_m: NotNegative  # its mean
    worst_m: NotNegative  # its largest
    degrees_of_freedom: Positive | None = None  # effective; absent where infinite
    coverage_factor: Positive  # holds 95 % of the distances, all directions together
    exact: bool  # whether it was drawn through the exact kinematics, not by the linear law

    @property
    def budget(self) -> Budget:
        """The budget as the identification gave it."""
        rows = tuple(BudgetRow(*(value for _, value in row)) for row in self.rows)
        return Budget(rows, *(value for key, value in self if key != "rows"))
