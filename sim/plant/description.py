"""What a plant simulates: a nominal cell, its true geometry, its effects and its servo."""

from __future__ import annotations

from dataclasses import dataclass

from cell.descriptions import Cell, Robot, ServoGains
from cell.errors import InputError
from cell.geometry import Geometry
from sim.plant.effects import PlantEffects


@dataclass(frozen=True, eq=False)
class Plant:
    """One machine to simulate."""

    cell: Cell  # nominal, which the servo's feed-forward knows
    geometry: Geometry  # true parameters; encoder offsets belong to the encoders and are not here
    effects: PlantEffects
    gains: ServoGains

    @property
    def loaded(self) -> Cell:
        """The cell with its true masses."""
        masses = self.effects.masses
        return self.cell if masses is None else masses.on(self.cell)


def servo_gains(robot: Robot, name: str, *, key: str = "plant.servo") -> ServoGains:
    """The gain set of a robot with that name.

    key : of the file that names it, for the message. Raises InputError if there is no such set.
    """
    gains = robot.required("servo")
    if name not in gains:
        raise InputError(
            f"{key} = {name!r}: robot {robot.name} has no such gain set; it has {', '.join(gains)}"
        )
    return gains[name]
