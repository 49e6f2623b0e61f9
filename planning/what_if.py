"""What if the rig were another: expected TCP error with one thing changed at a time, on the same path.

A path that the changed rig cannot run (another rod, another plate) is adapted: the nearest one that it can, the ball-bar moved if need
be. A plate is a cantilever, so its tip stiffness goes with thickness^3 / length^3 (derivation in docs/planning.md).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import BallBar, Cell, Link, Plate
from cell.errors import InputError
from cell.schema_errors import nearest
from planning.candidate import Candidate, numbers_of, space_of
from planning.first import descent
from planning.judge import Judge, judge_of, judged
from planning.plan import Plan, scale_error
from planning.request import PlanRequest, Region
from planning.sample import VIOLATES

THICKNESS = 0.045  # [m] of the plates in cell/plates (thesis sec. 4.5)
ROOM = 0.3  # [m] by which the ball-bar may move when a path is adapted
ADAPTING_SEED = 1


@dataclass(frozen=True)
class Question:
    """One thing to vary."""

    key: str
    unit: str
    values: tuple[float | tuple[int, ...], ...]


@dataclass(frozen=True)
class Answer:
    """What one value would come to."""

    key: str
    value: str
    tcp: (
        float | None
    )  # [m] root mean square of the predicted TCP sigma; None where no path was found
    scale: float  # [m] what the plate's own length adds
    note: str

    @property
    def total(self) -> float | None:
        """[m] both together."""
        return None if self.tcp is None else float(np.hypot(self.tcp, self.scale))


Change = Callable[[PlanRequest, Cell, float], tuple[PlanRequest, Cell]]


def _sensor(name: str) -> Change:
    def change(request: PlanRequest, cell: Cell, value: float) -> tuple[PlanRequest, Cell]:
        return request.model_copy(
            update={"sensors": request.sensors.model_copy(update={name: value})}
        ), cell

    return change


def _duration(request: PlanRequest, cell: Cell, value: float) -> tuple[PlanRequest, Cell]:
    return request.model_copy(
        update={"timing": request.timing.model_copy(update={"duration_s": value})}
    ), cell


def _rod_length(request: PlanRequest, cell: Cell, value: float) -> tuple[PlanRequest, Cell]:
    return request, replace(cell, ballbar=_longer(cell.ballbar, value))


def _plate_length(request: PlanRequest, cell: Cell, value: float) -> tuple[PlanRequest, Cell]:
    return request, replace(cell, plate=_other_plate(cell.plate, value, THICKNESS))


def _plate_thickness(request: PlanRequest, cell: Cell, value: float) -> tuple[PlanRequest, Cell]:
    return request, replace(cell, plate=_other_plate(cell.plate, cell.plate.length, value))


CHANGES: dict[str, tuple[str, float, float, Change]] = {  # unit, least and largest value
    "encoder": ("rad", 1e-8, 1e-2, _sensor("encoder_sigma_rad")),
    "plate_length": ("m", 0.05, 1.0, _plate_length),
    "plate_thickness": ("m", 0.005, 0.2, _plate_thickness),
    "rod_length": ("m", 0.2, 3.0, _rod_length),
    "rate": ("Hz", 1.0, 1e5, _sensor("ballbar_rate_hz")),
    "duration": ("s", 20.0, 3600.0, _duration),
}
ENCODERS = "encoders"


def question(text: str) -> Question:
    """`encoder=5e-6,1e-5` or `encoders=1245,12345`. Raises InputError."""
    key, _, listed = text.partition("=")
    if key not in (*CHANGES, ENCODERS):
        raise InputError(
            f"--what-if {text}: there is no {key!r}.{nearest(key, [*CHANGES, ENCODERS], noun='name')}"
        )
    if key == ENCODERS:
        if not re.fullmatch(r"[1-5]{2,5}(,[1-5]{2,5})*", listed):
            raise InputError(
                f"--what-if {text}: give sets of at least two encoders, such as 1245,12345"
            )
        return Question(
            key, "", tuple(tuple(sorted({int(c) for c in part})) for part in listed.split(","))
        )
    unit, low, high, _ = CHANGES[key]
    try:
        values = tuple(float(part) for part in listed.split(","))
    except ValueError:
        raise InputError(
            f"--what-if {text}: give numbers in {unit}, such as {key}={low:g},{high:g}"
        ) from None
    if not all(low <= v <= high for v in values):
        raise InputError(
            f"--what-if {text}: values of {key} are in {unit}, from {low:g} to {high:g}"
        )
    return Question(key, unit, values)


def answers(plan: Plan, questions: Sequence[Question]) -> Iterator[Answer]:
    """One for each value of each question, in their order."""
    request, cell = plan.request, plan.judge.cell
    for asked in questions:
        for value in asked.values:
            if isinstance(value, tuple):
                sensors = request.sensors.model_copy(update={"encoders": value})
                changed, other, shown = (
                    request.model_copy(update={"sensors": sensors}),
                    cell,
                    " ".join(f"b{j}" for j in value),
                )
            else:
                changed, other = CHANGES[asked.key][3](request, cell, value)
                shown = f"{value:g} {asked.unit}"
            yield _answer(
                asked.key, shown, judge_of(changed, plan.rod, other), plan.found.candidate
            )


def _answer(key: str, shown: str, judge: Judge, candidate: Candidate) -> Answer:
    scale, note = scale_error(judge.predictor.grid, judge.cell), ""
    found = judged(judge, candidate)
    if found.violations:
        first = found.violations[0].sentence
        adapted = _adapted(judge, candidate)
        if adapted is None:
            return Answer(key, shown, None, scale, f"no path: {first}")
        found, note = judged(judge, adapted), "path adapted"
    return Answer(key, shown, found.tcp, scale, note)


def _adapted(judge: Judge, candidate: Candidate) -> Candidate | None:
    """The nearest candidate that the rig of `judge` can run."""
    here = candidate.position
    region = Region(lower=tuple((here - ROOM).tolist()), upper=tuple((here + ROOM).tolist()))
    around = judge.request.cell.model_copy(
        update={"ballbar_position_m": None, "ballbar_region_m": region}
    )
    freed = replace(judge, request=judge.request.model_copy(update={"cell": around}))
    space = space_of(freed.request)
    best, least = descent(freed, space, numbers_of(space, candidate), ADAPTING_SEED)
    return space.candidate(best) if least < VIOLATES else None


def _longer(bar: BallBar, length: float) -> BallBar:
    """The same ball-bar with another rod: tube and cardan are that much further out."""
    d, more = bar.d.copy(), length - bar.length
    d[2] = length
    shift = np.array([0.0, 0.0, 1.0])
    rod = bar.links[2]
    links = [
        *bar.links[:2],
        Link(
            rod.mass * length / bar.length,
            rod.com + 0.5 * more * shift,
            rod.inertia * (length / bar.length) ** 3,
        ),
    ]
    links += [Link(link.mass, link.com + more * shift, link.inertia) for link in bar.links[3:]]
    return replace(bar, d=d, links=tuple(links))


def _other_plate(plate: Plate, length: float, thickness: float) -> Plate:
    """Cantilever of the same width and material."""
    longer, thicker = length / plate.length, thickness / THICKNESS
    body = plate.body
    com: Array = body.com * np.array([longer, 1.0, 1.0])
    mass = longer * thicker
    return replace(
        plate,
        length=length,
        tip_stiffness=plate.tip_stiffness * thicker**3 / longer**3,
        body=Link(body.mass * mass, com, body.inertia * mass * max(1.0, longer) ** 2),
    )
