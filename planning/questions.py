"""Questions of a what-if analysis: a property of the rig, and the values it could have.

A plate is a cantilever, so its tip stiffness is proportional to thickness^3 / length^3 (derivation
in docs/planning.md).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import BallBar, Cell, Link, Plate
from ballbar.cell.errors import InputError
from ballbar.cell.schema_errors import nearest

if TYPE_CHECKING:
    from ballbar.planning.request import PlanRequest

THICKNESS = 0.045  # [m] of the plates in cell/plates (thesis sec. 4.5)


@dataclass(frozen=True)
class Question:
    """One property to vary."""

    key: str
    unit: str
    values: tuple[float | tuple[int, ...], ...]


class Property(NamedTuple):
    """One property of the rig that can be changed."""

    unit: str
    smallest: float
    largest: float
    sensor: str = ""  # key of the request's sensors, where it is one


CHANGES = {
    "encoder": Property("rad", 1e-8, 1e-2, "encoder_sigma_rad"),
    "plate_length": Property("m", 0.05, 1.0),
    "plate_thickness": Property("m", 0.005, 0.2),
    "rod_length": Property("m", 0.2, 3.0),
    "rate": Property("Hz", 1.0, 1e5, "ballbar_rate_hz"),
    "duration": Property("s", 20.0, 3600.0),
    "length": Property("m", 1e-9, 1e-2, "length_sigma_m"),
    "rod_sigma": Property("m", 1e-7, 1e-2, "rod_sigma_m"),
}
ENCODERS = "encoders"
# What matters to one kind of instrument alone; nothing bends a plate that carries no force.
OF_BALLBAR = ("encoder", ENCODERS, "rate", "plate_thickness", "rod_sigma")
OF_TELESCOPING = ("length",)


def question(text: str) -> Question:
    """The question of a text such as `encoder=5e-6,1e-5` or `encoders=1245,12345`.

    Raises InputError for an unknown property or a value out of its range.
    """
    key, _, listed = text.partition("=")
    if key not in (*CHANGES, ENCODERS):
        hint = nearest(key, [*CHANGES, ENCODERS], noun="name")
        raise InputError(f"--what-if {text}: there is no {key!r}.{hint}")
    if key == ENCODERS:
        if not re.fullmatch(r"[1-5]{2,5}(,[1-5]{2,5})*", listed):
            raise InputError(
                f"--what-if {text}: give sets of at least two encoders, such as 1245,12345"
            )
        sets = (tuple(sorted({int(c) for c in part})) for part in listed.split(","))
        return Question(key, "", tuple(sets))
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


def check_questions(request: PlanRequest, questions: Sequence[Question]) -> None:
    """Raise InputError for a property that the request's instrument does not have."""
    kinds = ("a ball-bar with encoders", "an instrument that measures its length")
    wrong, kind, other = (
        (OF_BALLBAR, *kinds) if request.telescoping else (OF_TELESCOPING, *reversed(kinds))
    )
    for item in questions:
        if item.key in wrong:
            raise InputError(f"--what-if {item.key}: belongs to {kind}; the plan is for {other}")


def changed(
    request: PlanRequest, cell: Cell, key: str, value: float | tuple[int, ...]
) -> tuple[PlanRequest, Cell]:
    """The request and the cell with one property changed."""
    sensor = "encoders" if key == ENCODERS else CHANGES[key].sensor
    if sensor:
        sensors = request.sensors.model_copy(update={sensor: value})
        return request.model_copy(update={"sensors": sensors}), cell
    assert isinstance(value, float)
    if key == "duration":
        timing = request.timing.model_copy(update={"duration_s": value})
        return request.model_copy(update={"timing": timing}), cell
    if key == "rod_length":
        return request, replace(cell, ballbar=_with_rod(cell.ballbar, value))
    length, thickness = (value, THICKNESS) if key == "plate_length" else (cell.plate.length, value)
    return request, replace(cell, plate=_other_plate(cell.plate, length, thickness))


def _with_rod(bar: BallBar, length: float) -> BallBar:
    """The ball-bar with another rod, which moves tube and universal joint outwards."""
    d, more = bar.d.copy(), length - bar.length
    d[2] = length
    shift = np.array([0.0, 0.0, 1.0])
    rod, ratio = bar.links[2], length / bar.length
    tube = Link(
        rod.mass * length / bar.length, rod.com + 0.5 * more * shift, rod.inertia * ratio**3
    )
    outer = [Link(link.mass, link.com + more * shift, link.inertia) for link in bar.links[3:]]
    stroke = None if bar.stroke is None else (bar.stroke[0] + more, bar.stroke[1] + more)
    return replace(bar, d=d, links=(*bar.links[:2], tube, *outer), stroke=stroke)


def _other_plate(plate: Plate, length: float, thickness: float) -> Plate:
    """The plate as a cantilever of the same width and material."""
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
