"""Identifiability of one cost along the path of a scenario, as in thesis Tables 3.2 to 3.4.

Dependencies between parameters are exact on the nominal mechanism only: on a robot with 1 mrad of
twist error the columns of rd2 and rd3 differ by a thousandth. So robot and ball-bar without errors
are closed exactly along the reference path, and each cost is taken by its signed components. The
scalars that the thesis prints have no Jacobian there: it vanishes where the loop closes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames, parameter_named
from ballbar.cell.inverse import refine
from ballbar.ident.estimator.closure import (
    bar_joint_jacobian,
    close_loop,
    parameter_jacobian,
    robot_joint_jacobian,
)
from ballbar.ident.estimator.dependencies import (
    Dependency,
    Group,
    Selection,
    Spectrum,
    groups,
    select,
    significant,
    spectrum,
)
from ballbar.ident.estimator.thesis_names import extra_parameters, shortened, thesis_parameters
from ballbar.ident.estimator.whitening import covariance, whitening
from ballbar.ident.thesis.costs import cost_named
from ballbar.ident.thesis.names import ENCODERS_NEEDED, ML
from ballbar.scenario import Scenario
from ballbar.trial.nominal_path import nominal_path, spread_rows

Influences = dict[str, dict[str, float]]  # parameter left out: {selected parameter: its change}

SAMPLES = 100  # instants of the path: same null space, condition within 1 % of that from 1500
NOISE = 1e-5  # [rad] of every angle, thesis sec. 3.2: the metric that removes unmeasured joints
INTRODUCED = 1e-3  # [m, rad] error of the parameter left out, thesis sec. 3.3
CONVERGED = 1e-9  # [m, rad] last step of a re-identification
ITERATIONS = 12  # of a re-identification; three suffice on the thesis's path
LEGEND = """\
Nominal mechanism along the scenario's path. a | b: one of them can be identified, the others must
be given; a + b: they move together. Kept in the order of thesis sec. 3.3. Null vectors in m and
rad. Left out: the effect of an error in it on those selected, in mm|mrad."""
SHOWN = 8  # parameters named in one line of text: as many as there are lengths in the scale
TITLES = {
    ML: "ml",
    "length": "length (C_l)",
    "position": "position (C_P)",
    "position_angles": "position and angles (C_Ptheta)",
    "transform": "transformation (C_T)",
}


@dataclass(frozen=True, eq=False)
class KinematicLoop:
    """Geometry of robot and ball-bar, and their joint angles at N instants of a path."""

    geometry: Geometry
    q: Array  # (N, 6) [rad] robot joint angles
    b: Array  # (N, 5) [rad] ball-bar joint angles


@dataclass(frozen=True)
class Study:
    """Parameters that one cost can identify, of those considered."""

    cost: str
    encoders: tuple[int, ...]  # ball-bar joints whose angles the cost uses
    parameters: tuple[str, ...]
    spectrum: Spectrum
    groups: tuple[Group, ...]
    selection: Selection


def nominal_loop(scenario: Scenario, *, relative_to: Path, samples: int = SAMPLES) -> KinematicLoop:
    """The nominal mechanism of a scenario at instants of its reference path.

    relative_to : folder of the scenario file. samples : N, evenly spread over time.

    Raises InputError for a path that the mechanism cannot follow, or that does not move.
    """
    if scenario.needed_path.kind == "push_pull":
        raise InputError(
            "path.kind = push_pull: one held pose identifies nothing. Use a scenario whose path "
            "moves over the sphere."
        )
    if scenario.cell.instrument is not None:
        raise InputError(
            f"cell.instrument = {scenario.cell.instrument}: the thesis's costs are of a ball-bar. "
            "Use a scenario with cell.ballbar; `ballbar run` says what a length leaves open."
        )
    _, nominal, path = nominal_path(scenario.cell, scenario.needed_path, relative_to)
    rows = spread_rows(path, samples)
    return KinematicLoop(nominal, path.q[rows], path.b[rows])


def encoders_used(cost: str, fitted: tuple[int, ...]) -> tuple[int, ...]:
    """The encoders whose angles a cost uses: those it needs, and for ml those that are fitted."""
    return next((needed for name, needed in ENCODERS_NEEDED.items() if name == cost), fitted)


def study(loop: KinematicLoop, cost: str, fitted: tuple[int, ...], *, complete: bool) -> Study:
    """Parameters without effect, dependencies between the others, and a choice of what to keep.

    cost : one of ballbar.ident.thesis.costs.COSTS. fitted : ball-bar joints with an encoder.
    complete : also Hayati angles and the tilt of the ball-bar's base, which the thesis leaves out.
    """
    encoders = encoders_used(cost, fitted)
    table = loop.geometry.table
    names = thesis_parameters(table) + (extra_parameters(table) if complete else ())
    columns = cost_columns(loop, cost, encoders, names)
    return Study(
        cost=cost,
        encoders=encoders,
        parameters=names,
        spectrum=spectrum(columns, names),
        groups=groups(columns, names, loop.geometry),
        selection=select(columns, names, loop.geometry),
    )


def influences(loop: KinematicLoop, result: Study) -> Influences:
    """Effect of an error of 1 mm|mrad in each parameter left out on the selected ones (Table 3.4).

    Returns the changes above 0.05 mm|mrad, in mm|mrad.
    """
    identified = result.selection.selected
    return {
        d.name: significant(reidentified(loop, result.cost, result.encoders, identified, d.name))
        for d in result.selection.dependent
    }


def cost_columns(
    loop: KinematicLoop, cost: str, encoders: tuple[int, ...], names: Sequence[str]
) -> Array:
    """(P, M) [per m, rad] Jacobian of a cost on a loop, one row for each of `names`."""
    return _linearised(loop, cost, encoders, names)[1]


def reidentified(
    loop: KinematicLoop, cost: str, encoders: tuple[int, ...], identified: Sequence[str], name: str
) -> dict[str, float]:
    """Change of each identified parameter when `name` is off by 1 mm|mrad and held at nominal.

    The mechanism with that error takes the same ball-bar angles; from its exact robot angles the
    other parameters are identified by Gauss-Newton, starting at nominal (thesis Table 3.4).

    Returns changes in mm|mrad. Raises InputError where the iteration does not converge.
    """
    true = loop.geometry.replaced({name: loop.geometry[name] + INTRODUCED})
    q = refine(true.robot, loop.q, bar_frames(true, loop.b).poses())
    model, rows = replace(loop, q=q), [true.table.index[parameter] for parameter in identified]
    values = loop.geometry.values.copy()
    for _ in range(ITERATIONS):
        model = replace(model, geometry=true.with_values(values))
        residual, columns, b = _linearised(model, cost, encoders, identified)
        orthonormal, triangle = np.linalg.qr(columns.T)  # a selection leaves no dependent columns
        step = np.linalg.solve(triangle, -(orthonormal.T @ residual))
        values[rows] += step
        if np.abs(step).max() < CONVERGED:
            changes = (values - loop.geometry.values)[rows] / INTRODUCED
            return dict(zip(identified, changes.tolist(), strict=True))
        model = replace(model, b=b)
    raise InputError(
        f"{cost}: with {name} off by 1 mm|mrad the other parameters do not converge; the path "
        "excites them too little. Use a path that covers more of the sphere."
    )


def _linearised(
    loop: KinematicLoop, cost: str, encoders: tuple[int, ...], names: Sequence[str]
) -> tuple[Array, Array, Array]:
    """Residual (M,), Jacobian (P, M), and ball-bar angles b (N, 5) [rad] that the cost estimates.

    Of ml the angles of joints without encoder are unknown: b holds those that fit best.
    """
    parameters = [parameter_named(name) for name in names]
    closure = close_loop(loop.geometry, loop.q, loop.b)
    signed = next((cost_named(name, "vector") for name in ENCODERS_NEEDED if name == cost), None)
    if signed is not None:
        residual = signed.residual(closure).reshape(-1)
        return residual, signed.jacobian(closure, parameters).reshape(len(names), -1), loop.b
    unmeasured = [j for j in range(BAR_ROWS) if j + 1 not in encoders]
    bar_columns, measured = bar_joint_jacobian(closure), [j - 1 for j in encoders]
    noise = (NOISE * robot_joint_jacobian(closure), NOISE * bar_columns[measured])
    weights = whitening(covariance(np.concatenate(noise)), bar_columns[unmeasured])
    b = loop.b.copy()
    b[:, unmeasured] += weights.unmeasured_step(closure.error).T
    columns = weights(parameter_jacobian(closure, parameters)).reshape(len(names), -1)
    return weights(closure.error).reshape(-1), columns, b


def study_lines(result: Study, changes: Influences) -> Iterator[str]:
    """The tables of one cost as lines of text. changes : result of `influences`."""
    selection = result.selection
    encoders = ", ".join(f"b{j}" for j in result.encoders) or "none"
    count = f"{result.spectrum.rank} directions of {len(result.parameters)} parameters"
    condition = f"condition {result.spectrum.condition:.0f}"
    yield f"{TITLES[result.cost]}, encoders {encoders}: {count}, {condition}"
    yield from _titled("no effect", [" ".join(shortened(selection.without_effect)) or "none"])
    width = max((len(str(group)) for group in result.groups), default=0)
    dependent = [
        f"{group!s:<{width}}   {'; '.join(map(vector_text, group.vectors))}"
        for group in result.groups
    ]
    yield from _titled("dependent", dependent)
    yield from _titled(
        f"selected {len(selection.selected)}", [" ".join(shortened(selection.selected))]
    )
    left_out = [f"{d.name:<7}  {_influence_text(d, changes[d.name])}" for d in selection.dependent]
    yield from _titled("left out", left_out)


def study_data(result: Study, changes: Influences) -> dict[str, object]:
    """All of a study as plain data: null vectors in m and rad, `changes` in mm|mrad."""
    selection = result.selection
    return {
        "cost": result.cost,
        "encoders": list(result.encoders),
        "parameters": list(result.parameters),
        "directions": result.spectrum.rank,
        "condition": result.spectrum.condition,
        "smallest_singular_value": result.spectrum.smallest_counted,
        "largest_ignored_singular_value": result.spectrum.largest_ignored,
        "zero_jacobian": list(selection.without_effect),
        "groups": [
            {
                "text": str(group),
                "members": [list(m) for m in group.members],
                "vectors": {v.name: dict(v.partners) for v in group.vectors},
            }
            for group in result.groups
        ],
        "selected": list(selection.selected),
        "left_out": _left_out(selection, changes),
    }


def _left_out(selection: Selection, changes: Influences) -> list[dict[str, object]]:
    """Parameters that are not identified, and why; `changes` in mm|mrad."""
    left_out: list[dict[str, object]] = [
        {"name": name, "reason": "no effect"} for name in selection.without_effect
    ]
    for d in selection.dependent:
        reason = "scale" if d.is_scale else "depends on"
        on, affected = dict(d.partners), changes[d.name]
        left_out.append({"name": d.name, "reason": reason, "on": on, "affected": affected})
    return left_out


def vector_text(vector: Dependency) -> str:
    """A null vector in one line: `rd1 = -oz`, `rtheta1 = -btheta1 - 0.7 oy`; units m and rad."""
    if vector.is_scale:
        return f"{vector.name} = scale, all lengths together"
    terms = [
        f"{'-' if x < 0 else '+'} {'' if abs(abs(x) - 1.0) < 5e-5 else f'{abs(x):.4g} '}{name}"
        for name, x in vector.partners.items()
    ]
    first, *others = terms
    return f"{vector.name} = {' '.join([first.replace('+ ', '').replace('- ', '-'), *others])}"


def unit_of(name: str) -> str:
    """Display unit of a parameter: `mm` or `mrad`."""
    return f"m{parameter_named(name).unit}"


def _titled(title: str, lines: Sequence[str]) -> Iterator[str]:
    for k, line in enumerate(lines or ("none",)):
        yield f"  {'' if k else title:<10} {line}"


def _influence_text(dependency: Dependency, changes: dict[str, float]) -> str:
    terms = [f"{name} {x:+.3f}" for name, x in changes.items()]
    more = f" and {len(terms) - SHOWN} more" if len(terms) > SHOWN else ""
    verb = "scales" if dependency.is_scale else "moves"
    unit = unit_of(dependency.name)
    return f"+1 {unit:<4} {verb:<6} {', '.join(terms[:SHOWN]) or 'nothing'}{more}"
