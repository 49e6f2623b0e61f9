"""Identifiability of one cost on the path of a scenario: `ballbar identifiability`, in the notation of thesis Tables 3.2-3.4.

Dependencies are exact only on the nominal mechanism (a robot with 1 mrad of twist error tells rd2 from rd3 by a thousandth), so
they are judged there: nominal robot and ball-bar closed exactly along the reference path, signed components of each cost. The
thesis's printed scalars have no Jacobian there: it vanishes where the loop closes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition import read_recording
from ballbar.scenario import Scenario
from cell.errors import InputError
from cell.geometry import BAR_ROWS, INDEX, PARAMETERS, Geometry, bar_frames, nominal_geometry
from cell.inverse import refine
from cell.load import load_cell
from ident.estimator.closure import (
    bar_joint_jacobian,
    close_loop,
    parameter_jacobian,
    robot_joint_jacobian,
)
from ident.estimator.dependencies import (
    EXTRA_PARAMETERS,
    THESIS_PARAMETERS,
    Dependency,
    Group,
    Selection,
    Spectrum,
    groups,
    select,
    shortened,
    significant,
    spectrum,
)
from ident.estimator.whitening import covariance, whitening
from ident.thesis.costs import COSTS, ENCODERS_NEEDED, ML, cost_named
from sim.simulate import planned_path

Array = NDArray[np.float64]
Influences = dict[str, dict[str, float]]  # left out: kept ones that it moves

SAMPLES = 100  # instants of the path; null space the same, condition within 1 % of that from 1500
NOISE = 1e-5  # [rad] of every angle, thesis sec. 3.2: the metric in which ml removes joints without encoder
INTRODUCED = 1e-3  # [m, rad] error of the parameter left out, thesis sec. 3.3
SETTLED = 1e-9  # [m, rad] last step of a re-identification
ITERATIONS = 12  # three do
LEGEND = """Nominal mechanism along the scenario's path. a | b: one of them can be identified, the others must be given; a + b: they move
together. Kept in the order of thesis sec. 3.3. Null vectors in m and rad; left out: what an error in it does to those kept, mm|mrad."""
SHOWN = 8  # parameters named in one line of text: as many as there are lengths in the scale


@dataclass(frozen=True, eq=False)
class NominalLoop:
    """Robot and ball-bar without errors, closed at N instants of a path."""

    geometry: Geometry
    q: Array  # (N, 6) [rad]
    b: Array  # (N, 5) [rad]


@dataclass(frozen=True)
class Study:
    """What one cost can tell of the parameters asked for."""

    cost: str
    encoders: tuple[int, ...]  # that the cost uses
    asked: tuple[str, ...]
    spectrum: Spectrum
    groups: tuple[Group, ...]
    selection: Selection


def nominal_loop(scenario: Scenario, *, relative_to: Path, samples: int = SAMPLES) -> NominalLoop:
    """The nominal mechanism of a scenario at instants of its reference path.

    relative_to : folder of the scenario. samples : N, evenly spread over time.
    Raises InputError for a path that cannot be run, or that does not move.
    """
    chosen, timing = scenario.cell, scenario.path
    if timing.kind == "push_pull":
        raise InputError(
            "path.kind = push_pull: one held pose identifies nothing. Use a scenario whose path moves over the sphere."
        )
    cell = load_cell(chosen.robot, chosen.ballbar, chosen.plate, relative_to=relative_to)
    nominal = nominal_geometry(cell, np.array(chosen.ballbar_position_m))
    recorded = (
        read_recording(relative_to / timing.recording).robot_log if timing.recording else None
    )
    path = planned_path(timing, cell, nominal, relative_to=relative_to, recorded=recorded)
    some = np.linspace(0, path.t.size - 1, min(samples, path.t.size)).round().astype(int)
    return NominalLoop(nominal, path.q[some], path.b[some])


def parse_encoders(text: str) -> tuple[int, ...]:
    """`1,2,4,5` as numbers of ball-bar joints, `none` as no encoder. Raises InputError."""
    if text.strip() == "none":
        return ()
    parts = [part.strip() for part in text.split(",")]
    if not all(re.fullmatch(f"[1-{BAR_ROWS}]", part) for part in parts) or len(set(parts)) < len(
        parts
    ):
        raise InputError(
            f"--encoders {text}: give different ball-bar joints from 1 to {BAR_ROWS}, such as 1,2,4,5, or none"
        )
    return tuple(sorted(int(part) for part in parts))


def chosen_costs(name: str, encoders: Sequence[int]) -> tuple[list[str], dict[str, str]]:
    """The costs to look at, and why others of `all` are passed over.

    name : one of COSTS, or `all`. Raises InputError for another name, and where a single cost lacks encoders.
    """
    if name != "all" and name not in COSTS:
        raise InputError(f"--cost {name}: there are {', '.join(COSTS)} and all")
    asked = COSTS if name == "all" else (name,)
    fitted = ", ".join(f"b{j}" for j in encoders) or "none"
    lacking = {cost: [f"b{j}" for j in _needed(cost, ()) if j not in encoders] for cost in asked}
    passed_over = {
        cost: f"needs {', '.join(joints)}; fitted: {fitted}"
        for cost, joints in lacking.items()
        if joints
    }
    if name in passed_over:
        raise InputError(
            f"--cost {name}: {passed_over[name]}. Use --encoders to choose others, or --cost ml, which takes any."
        )
    return [cost for cost in asked if cost not in passed_over], passed_over


def study(loop: NominalLoop, cost: str, encoders: tuple[int, ...], *, complete: bool) -> Study:
    """Zero Jacobians, dependencies, and what to keep.

    cost : one of COSTS. encoders : those fitted; the thesis's costs use those they need.
    complete : Hayati angles and the tilt of the ball-bar's base, which the thesis has not, are asked for too.
    """
    used = _needed(cost, encoders)
    asked = THESIS_PARAMETERS + (EXTRA_PARAMETERS if complete else ())
    columns = cost_columns(loop, cost, used, asked)
    found, selection = groups(columns, asked, loop.geometry), select(columns, asked, loop.geometry)
    return Study(cost, used, asked, spectrum(columns, asked), found, selection)


def influences(loop: NominalLoop, found: Study) -> Influences:
    """For each parameter left out, the kept ones that an error of 1 mm|mrad in it moves by more than 0.05, in mm|mrad (Table 3.4)."""
    kept = found.selection.kept
    return {
        d.name: significant(reidentified(loop, found.cost, found.encoders, kept, d.name))
        for d in found.selection.dependent
    }


def cost_columns(
    loop: NominalLoop, cost: str, encoders: tuple[int, ...], names: Sequence[str]
) -> Array:
    """(P, M) Jacobian of a cost on the nominal mechanism, one row for each of `names`."""
    return _linearised(cost, encoders, loop.geometry, loop.q, loop.b, names)[1]


def reidentified(
    loop: NominalLoop, cost: str, encoders: tuple[int, ...], kept: Sequence[str], name: str
) -> dict[str, float]:
    """How far each kept parameter moves when `name` is off by 1 mm|mrad and its nominal value is believed (thesis Table 3.4).

    The mechanism with that error takes the same ball-bar angles; its exact angles are identified by Gauss-Newton from nominal.

    Returns errors in mm|mrad. Raises InputError where the iteration does not settle.
    """
    true = loop.geometry.replaced({name: loop.geometry[name] + INTRODUCED})
    q, b = refine(true.robot, loop.q, bar_frames(true, loop.b).poses()), loop.b
    rows = [INDEX[k] for k in kept]
    values = loop.geometry.values.copy()
    for _ in range(ITERATIONS):
        residual, columns, b = _linearised(cost, encoders, Geometry(values), q, b, kept)
        orthonormal, triangle = np.linalg.qr(columns.T)  # `kept` leaves no dependent columns
        step = np.linalg.solve(triangle, -(orthonormal.T @ residual))
        values[rows] += step
        if np.abs(step).max() < SETTLED:
            moved = (values - loop.geometry.values)[rows] / 1e-3
            return dict(zip(kept, moved.tolist(), strict=True))
    raise InputError(
        f"{cost}: with {name} off by 1 mm|mrad the other parameters do not settle; the path excites them too little"
    )


def _needed(cost: str, encoders: tuple[int, ...]) -> tuple[int, ...]:
    return next(
        (joints for name, joints in ENCODERS_NEEDED.items() if name == cost), encoders
    )  # ml takes what there is


def _linearised(
    cost: str,
    encoders: tuple[int, ...],
    geometry: Geometry,
    q: Array,
    b: Array,
    names: Sequence[str],
) -> tuple[Array, Array, Array]:
    """Residual (M,), columns (P, M), and ball-bar angles (N, 5) with those that nobody measures where they fit best."""
    parameters = [PARAMETERS[INDEX[name]] for name in names]
    signed = next((cost_named(name, "vector") for name in ENCODERS_NEEDED if name == cost), None)
    closure = close_loop(geometry, q, b)
    if signed is not None:
        return (
            signed.residual(closure).reshape(-1),
            signed.jacobian(closure, parameters).reshape(len(names), -1),
            b,
        )
    free = [j for j in range(BAR_ROWS) if j + 1 not in encoders]
    sigma = np.where(np.isin(np.arange(BAR_ROWS), free), 0.0, NOISE)
    ballbar = bar_joint_jacobian(closure)
    noise = np.concatenate((NOISE * robot_joint_jacobian(closure), sigma[:, None, None] * ballbar))
    weights = whitening(covariance(noise), ballbar[free])
    settled = b.copy()
    settled[:, free] += weights.unmeasured_step(closure.error).T
    return (
        weights(closure.error).reshape(-1),
        weights(parameter_jacobian(closure, parameters)).reshape(len(names), -1),
        settled,
    )


def study_lines(found: Study, moved: Influences) -> Iterator[str]:
    """The tables of one cost, to be read on a terminal. moved : as from `influences`."""
    s, spread = found.selection, found.spectrum
    fitted = ", ".join(f"b{j}" for j in found.encoders) or "none"
    count = f"{spread.rank} directions of {len(found.asked)} parameters"
    yield f"{TITLES[found.cost]}, encoders {fitted}: {count}, condition {spread.condition:.0f}"
    yield from _titled("no effect", [" ".join(shortened(s.without_effect)) or "none"])
    width = max((len(str(group)) for group in found.groups), default=0)
    yield from _titled(
        "dependent",
        [
            f"{group!s:<{width}}   {'; '.join(map(vector_text, group.vectors))}"
            for group in found.groups
        ],
    )
    yield from _titled(f"kept {len(s.kept)}", [" ".join(shortened(s.kept))])
    yield from _titled(
        "left out", [f"{d.name:<7}  {_influence_text(d, moved[d.name])}" for d in s.dependent]
    )


def _titled(title: str, lines: Sequence[str]) -> Iterator[str]:
    for k, line in enumerate(lines or ("none",)):
        yield f"  {'' if k else title:<10} {line}"


def _influence_text(dependency: Dependency, moved: dict[str, float]) -> str:
    named = [f"{name} {x:+.3f}" for name, x in moved.items()]
    more = f" and {len(named) - SHOWN} more" if len(named) > SHOWN else ""
    verb = "scales" if dependency.is_scale else "moves"
    return (
        f"+1 {unit_of(dependency.name):<4} {verb:<6} {', '.join(named[:SHOWN]) or 'nothing'}{more}"
    )


TITLES = {
    ML: "ml",
    "length": "length (C_l)",
    "position": "position (C_P)",
    "position_angles": "position and angles (C_Ptheta)",
    "transform": "transformation (C_T)",
}


def vector_text(vector: Dependency) -> str:
    """A null vector in one line: `rd1 = -oz`, `rtheta1 = -btheta1 - 0.7 oy`; units m and rad."""
    if vector.is_scale:
        return f"{vector.name} = scale, all lengths together"
    terms = [
        f"{'-' if x < 0 else '+'} {'' if abs(abs(x) - 1.0) < 5e-5 else f'{abs(x):.4g} '}{name}"
        for name, x in vector.partners.items()
    ]
    first, *rest = terms
    return f"{vector.name} = {' '.join([first.replace('+ ', '').replace('- ', '-'), *rest])}"


def unit_of(name: str) -> str:
    """`mm` or `mrad`."""
    return f"m{PARAMETERS[INDEX[name]].unit}"


def study_data(found: Study, moved: Influences) -> dict[str, object]:
    """All of a study as plain data: null vectors in m and rad; moved, as from `influences`, in mm|mrad."""
    s = found.selection
    left_out: list[dict[str, object]] = [
        {"name": name, "reason": "no effect"} for name in s.without_effect
    ]
    for d in s.dependent:
        reason = "scale" if d.is_scale else "depends on"
        left_out.append(
            {"name": d.name, "reason": reason, "on": dict(d.partners), "affected": moved[d.name]}
        )
    return {
        "cost": found.cost,
        "encoders": list(found.encoders),
        "asked": list(found.asked),
        "directions": found.spectrum.rank,
        "condition": found.spectrum.condition,
        "smallest_singular_value": found.spectrum.smallest_counted,
        "largest_ignored_singular_value": found.spectrum.largest_ignored,
        "zero_jacobian": list(s.without_effect),
        "groups": [
            {
                "text": str(group),
                "members": [list(m) for m in group.members],
                "vectors": {v.name: dict(v.partners) for v in group.vectors},
            }
            for group in found.groups
        ],
        "kept": list(s.kept),
        "left_out": left_out,
    }
