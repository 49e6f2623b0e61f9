"""True masses and centres of mass of one simulated machine.

Bodies are links 1..J of the robot, the offset plate, then links 1..5 of the ball-bar.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell, Link
from sim.errors.plant_errors import BodyMasses, Payload


@dataclass(frozen=True, eq=False)
class Masses:
    """Mass and centre of every body; centres in the frames of the description files."""

    names: tuple[str, ...]
    mass: Array  # (B,) [kg]
    centre: Array  # (B, 3) [m]

    def on(self, cell: Cell) -> Cell:
        """The cell with these masses; inertias about the centres grow with their mass."""
        links = [
            Link(mass, centre, link.inertia * (mass / link.mass if link.mass else 1.0))
            for link, mass, centre in zip(
                _bodies(cell), self.mass.tolist(), self.centre, strict=True
            )
        ]
        joints, robot = cell.robot.joints, cell.robot
        base = robot.required("links")[0]
        return replace(
            cell,
            robot=replace(robot, links=(base, *links[:joints])),
            plate=replace(cell.plate, body=links[joints]),
            ballbar=replace(cell.ballbar, links=tuple(links[joints + 1 :])),
        )

    def with_payload(self, payload: Payload, rng: np.random.Generator) -> Masses:
        """These bodies with a drawn payload on the plate."""
        i, z = self.names.index("plate"), rng.standard_normal(4)
        more = abs(payload.sigma_kg * z[0])
        mass, centre = self.mass.copy(), self.centre.copy()
        mass[i] += more
        centre[i] += payload.centre_sigma_m * z[1:] * more / mass[i]
        return replace(self, mass=mass, centre=centre)


def stated_masses(cell: Cell) -> Masses:
    """The masses and centres of the files."""
    bodies = _bodies(cell)
    return Masses(
        names=(
            *(f"link{i + 1}" for i in range(cell.robot.joints)),
            "plate",
            *(f"bar{i + 1}" for i in range(len(cell.ballbar.links))),
        ),
        mass=np.array([body.mass for body in bodies]),
        centre=np.stack([body.com for body in bodies]),
    )


def drawn_masses(errors: BodyMasses, cell: Cell, rng: np.random.Generator) -> Masses:
    """The masses and centres of the files with drawn deviations."""
    stated = stated_masses(cell)
    z = rng.standard_normal((len(stated.names), 4))
    return replace(
        stated,
        mass=stated.mass * np.exp(errors.spread * z[:, 0]),
        centre=stated.centre + errors.centre_sigma_m * z[:, 1:],
    )


def _bodies(cell: Cell) -> list[Link]:
    return [*cell.robot.required("links")[1:], cell.plate.body, *cell.ballbar.links]
