"""Uncertainty budget of the tool's position, by the GUM (JCGM 100:2008).

Each row is an input of the estimate: a noise of the logs, a length that a file states, a prior. Its
contribution is the root mean square over the workspace of the tool's error that one standard
uncertainty of it makes, and its sensitivity that over the standard uncertainty. Variances of rows
add up to that of the stated TCP uncertainty (5.1.2): what the latter states beyond all inputs,
since residuals are not white, is the row of the unmodelled part. The effective degrees of freedom
are those of Welch & Satterthwaite (G.4.1); the factor k that holds 95 % of the distances is that of
ballbar.ident.robot.coverage.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.board import SHAPE
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import ParameterTable, parameter_named
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.variance_parts import variance_parts
from ballbar.ident.robot.coverage import (
    coverage_factor,
    exact_squares,
    is_in_doubt,
    linear_squares,
    stated_of,
)
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.ident.robot.tool_covariance import ToolCovariance

UNMODELLED, LEFT_OUT, LEFT_OUT_TERMS, DOUBT = "unmodelled", "left_out", "left_out_terms", "doubt"
NOTHING = 1e-18  # share of the variance below which a row is none
MANY = 1e6  # degrees of freedom that count as infinite
ROUNDING = 1e-12  # added to a correlation that may have lost a direction
_DRAWS_SEED = 101  # the same for everyone
MIXED = "1"  # unit of inputs of different units: their standard uncertainties

Evaluated = Literal["A", "B"]  # by statistics of the data, or by other knowledge
Distribution = Literal["normal", "rectangular", "t"]


@dataclass(frozen=True)
class BudgetSource:
    """Words and kind of a row, whatever its size."""

    what: str
    unit: str
    evaluated: Evaluated = "B"
    distribution: Distribution = "normal"


SOURCES: dict[str, BudgetSource] = {
    "plate": BudgetSource("plate: length by its file, which is the scale", "m"),
    "temperature": BudgetSource("temperature: growth of the plate from 20 deg C", "m"),
    "rod": BudgetSource("rod: length by its file", "m"),
    "axes": BudgetSource("axes of the instrument: offsets and squareness", MIXED),
    "distance": BudgetSource("known distances between seats", "m"),
    "instrument": BudgetSource("noise of the instrument, as stated", "m"),
    "bearings": BudgetSource("noise of the instrument's angles, as stated", "rad"),
    "length_log": BudgetSource("noise of the sensed length", "m", "A"),
    "bar_log": BudgetSource("noise of the instrument's encoders", "rad", "A"),
    "bar": BudgetSource("encoders of the instrument beyond their noise", "rad", "A"),
    "joint_log": BudgetSource("noise and rounding of the joint angles", "rad", "A"),
    "stamps": BudgetSource("clock: jitter of the stamps", "s", "A"),
    "gear": BudgetSource("gears of axes 1 to 3 beyond the model", "rad", "A"),
    "wrist": BudgetSource("gears of the wrist beyond the model", "rad", "A"),
    "backlash": BudgetSource("backlash near reversals of the load", "rad", "B", "rectangular"),
    "rod_noise": BudgetSource("rod: length beyond a constant", "m", "A"),
    "position": BudgetSource("positions of still poses beyond the model", "m", "A"),
    "rotation": BudgetSource("orientations of still poses beyond the model", "rad", "A"),
    "force": BudgetSource("force in the rod", MIXED),
    "masses": BudgetSource("masses of links and tool", MIXED),
    "robot": BudgetSource("robot: catalogue values (prior)", MIXED),
    "lens": BudgetSource("lens of the camera, as its pictures show it", MIXED, "A"),
    "board": BudgetSource("board: size and flatness by its file, which is the scale", MIXED),
    "placement": BudgetSource("place and clock of the instrument (prior)", MIXED),
    "rounding": BudgetSource("rounding of counts and times", "m", "B", "rectangular"),
    LEFT_OUT: BudgetSource("poses left out of the fit: errors along each axis", "m", "A", "t"),
    LEFT_OUT_TERMS: BudgetSource("terms and ripple that the data do not rule out", MIXED, "A"),
    DOUBT: BudgetSource("lengths and priors that contradict the data", MIXED, "A"),
    UNMODELLED: BudgetSource("unmodelled part: residuals that are no white noise", "m", "A", "t"),
}


@dataclass(frozen=True)
class BudgetRow:
    """One input of the estimate, and its contribution to the tool's uncertainty."""

    name: str
    what: str
    evaluated: Evaluated
    distribution: Distribution
    standard_uncertainty: float  # [unit]
    unit: str
    contribution: float  # [m] root mean square over the workspace; below 0 it is taken off
    worst: float  # [m] largest in the workspace
    share: float  # of the variance
    degrees_of_freedom: float | None = None  # None: infinite

    @property
    def sensitivity(self) -> tuple[float, float]:
        """[m per unit] contribution for a unit of the input: over the workspace, and at worst."""
        size = self.standard_uncertainty
        return self.contribution / size, self.worst / size


@dataclass(frozen=True)
class Budget:
    """Rows whose variances add up to that of the stated TCP uncertainty, the largest first."""

    rows: tuple[BudgetRow, ...]
    combined: float  # [m] standard uncertainty, root mean square over the workspace
    mean: float  # [m] its mean
    worst: float  # [m] its largest
    degrees_of_freedom: float | None  # effective; None: infinite
    coverage_factor: float  # k that holds COVERAGE of the distances
    exact: bool  # whether the draws for it passed the exact kinematics

    @property
    def expanded(self) -> tuple[float, float]:
        """[m] expanded uncertainty U: root mean square over the workspace, and at worst."""
        return self.coverage_factor * self.combined, self.coverage_factor * self.worst


def budget(
    fit: Fit,
    robot: IdentifiedRobot,
    sigma: Array,
    unknowns: NDArray[np.intp],
    *,
    blocks: int,
    beyond: Mapping[str, Array] | None = None,
    rng: np.random.Generator | None = None,
) -> Budget:
    """The budget of a fit's tool.

    sigma : (G,) [m] stated over the workspace. unknowns : (U,) of the fit, which are the first ones
    of the covariance that `robot` states. blocks : of time or space that show the unmodelled part.
    beyond : (U, K) shifts of theirs that the stated covariance counts besides, by row.
    rng : of the draws; the same for everyone if not given.
    """
    stated = stated_of(robot)
    columns = stated.columns(robot)
    seen = np.flatnonzero(columns[:, : len(unknowns)].any(axis=0))
    moves = np.ascontiguousarray(columns[:, seen])
    inputs = [
        (part.row, ((moves @ part.covariance) * moves).sum(axis=1), part.size)
        for part in variance_parts(fit, unknowns[seen], partial(row_of, fit))
    ]
    for name, shifts in (beyond or {}).items():
        if shifts.any():
            inputs.append((name, ((columns[:, : len(unknowns)] @ shifts) ** 2).sum(axis=1), 1.0))
    for name, root, size in _beside(robot, len(unknowns)):
        inputs.append((name, ((columns @ root) ** 2).sum(axis=1), size))
    if isinstance(stated, PoseCovariance):
        each = stated.left_over
        inputs.append((LEFT_OUT, np.full(len(columns), each**2), each))
    variances, sizes = dict[str, Array](), dict[str, list[float]]()
    for name, squares, size in inputs:
        variances[name] = variances.get(name, 0.0) + squares.reshape(-1, 3).sum(axis=1)
        sizes.setdefault(name, []).append(size)
    _split_by_heat(robot, variances, sizes)
    left = sigma**2 - sum(variances.values())
    variances[UNMODELLED], sizes[UNMODELLED] = left, [float(np.sqrt(np.abs(left.mean())))]
    sentences = {c.name: c.sentence for c in fit.model.corrections}
    total = float((sigma**2).mean())
    freedoms = {"A": float(max(1, fit.degrees)), "t": float(max(1, blocks - 1))}
    rows = [
        _row(name, variance, sizes[name], total, sentences, freedoms)
        for name, variance in variances.items()
    ]
    rows = [row for row in rows if abs(row.share) > NOTHING or row.name == UNMODELLED]
    rows.sort(key=lambda row: -row.share)
    freedom = welch_satterthwaite(rows)
    rng = rng or np.random.default_rng(_DRAWS_SEED)
    exact = is_in_doubt(robot, float(np.sqrt(total)))
    draws = (
        exact_squares(robot, rng) if exact else linear_squares(stated.values, columns, sigma, rng)
    )
    factor = coverage_factor(draws, freedom, rng)
    return Budget(
        rows=tuple(rows),
        combined=float(np.sqrt(total)),
        mean=float(sigma.mean()),
        worst=float(sigma.max()),
        degrees_of_freedom=freedom,
        coverage_factor=factor,
        exact=exact,
    )


def _split_by_heat(
    robot: IdentifiedRobot, variances: dict[str, Array], sizes: dict[str, list[float]]
) -> None:
    """Gives the plate's length by its file and its growth rows of their own; in place."""
    plate = robot.description.plate if isinstance(robot.description, Cell) else None
    if plate is None or not plate.thermal_sigma or "plate" not in variances:
        return
    share = (plate.thermal_sigma / plate.length_sigma) ** 2
    whole = variances["plate"]
    variances |= {"temperature": share * whole, "plate": (1.0 - share) * whole}
    sizes["temperature"] = [plate.thermal_sigma]
    sizes["plate"] = [plate.length_sigma * float(np.sqrt(1.0 - share))]


def row_of(fit: Fit, source: str) -> str:
    """Name of the row in which a source of `variance_parts` stands."""
    layout = fit.model.unknowns
    if source == "rod":
        return "rod_noise"
    if source in SOURCES or source not in layout.names:
        return source
    i = layout.names.index(source)
    if i < layout.shared.size:
        return _row_of_parameter(source, layout.fixed.table)
    if i < layout.coefficients.stop:
        owners = (c.name for c in fit.model.corrections for _ in c.coefficients)
        return next(islice(owners, i - layout.coefficients.start, None))
    if any(part.start <= i < part.stop for part in layout.placed.common.values()):
        return "board" if source.endswith(SHAPE) else "lens"
    return "force" if source.startswith(("force_gain", "tension")) else "placement"


def _row_of_parameter(name: str, table: ParameterTable) -> str:
    if name == table.plate:
        return "plate"
    if name == "bd3":
        return "rod"
    return "axes" if parameter_named(name).side == "bar" else "robot"


def _beside(robot: IdentifiedRobot, count: int) -> Iterator[tuple[str, Array, float]]:
    """Row, (U, K) deviations and size of what a fit took as exact: of the instrument, and masses.

    count : of the unknowns, which come first. In a covariance `[[V + S S', S R'], [R S', R R']]`
    with the shifts S by independent inputs of deviations R, those are `[S; R]`.
    """
    stated = stated_of(robot)
    if not isinstance(stated, ToolCovariance):
        return
    values, held = stated.values, count + len(stated.held)
    if (known := np.arange(count, held)[np.diag(values)[count:held] > 0.0]).size:
        spread = np.sqrt(np.diag(values)[known])
        share = values[np.ix_(known, known)] / np.outer(spread, spread)
        root = spread[:, None] * np.linalg.cholesky(share + ROUNDING * np.eye(known.size))
        shifts = np.linalg.solve(root, values[known])
        for shift, i in zip(shifts, known, strict=True):
            name = _row_of_parameter(stated.held[i - count], robot.geometry.table)
            yield name, shift[:, None], float(np.sqrt(values[i, i]))
    if held < len(values):
        yield "masses", values[:, held:], 1.0


def _row(
    name: str,
    variance: Array,
    sizes: list[float],
    total: float,
    sentences: dict[str, str],
    freedoms: dict[str, float],
) -> BudgetRow:
    """A row of its variance (G,) [m^2] over the workspace.

    total : [m^2] mean square of the whole. freedoms : of what is evaluated as A, and of Student's.
    """
    source = SOURCES.get(name) or BudgetSource(f"{sentences[name]} (prior)", MIXED)
    mean, largest = float(variance.mean()), float(variance.max())
    kind = source.distribution if source.distribution in freedoms else source.evaluated
    return BudgetRow(
        name=name,
        what=source.what,
        evaluated=source.evaluated,
        distribution=source.distribution,
        standard_uncertainty=1.0 if source.unit == MIXED else rms(sizes),
        unit=source.unit,
        contribution=float(np.sign(mean) * np.sqrt(np.abs(mean))),
        worst=float(np.sqrt(max(0.0, largest))),
        share=mean / total,
        degrees_of_freedom=freedoms.get(kind),
    )


def welch_satterthwaite(rows: Iterable[BudgetRow]) -> float | None:
    """Effective degrees of freedom of all rows (JCGM 100:2008, G.4.1); None where infinite."""
    counted = [row for row in rows if row.degrees_of_freedom is not None]
    squares = sum(row.share**2 / (row.degrees_of_freedom or 1.0) for row in counted)
    return 1.0 / squares if squares > 1.0 / MANY else None
