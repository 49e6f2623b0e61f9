"""Parameters that a fit identifies, those that it takes as exact, and their priors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Parameter, ParameterTable, parameter_named, parameter_table
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.least_sizes import LITTLE_SHIFT, LITTLE_TURN

# Of a robot's parameter about its catalogue value, for recordings and still poses. With 0.3 mm and
# 1 mrad a robot as in thesis Table 3.1 is found worse (draw-wire: 0.297 for 0.259 mm), with 5 mm
# and 5 mrad one ten times better (0.357 for 0.317 mm; UR10 from 30 poses 0.430 for 0.417 mm); where
# data are many, nothing depends on them (benchmarks.priors, docs/real_robots).
LENGTH_PRIOR, ANGLE_PRIOR = 7e-4, 2e-3  # [m], [rad]
TAILS = 4.0  # degrees of freedom of their Student distribution
FAR = 5.0  # of these deviations: a joint's offset set wrongly, or another robot
PULL = 3.5  # prior deviations from which an unknown stands for something that is not in the model
AXIS_OFFSET_PRIOR = 5e-6  # [m] of gimbal and universal joint (notes/plant, joints_mechanical)
AXIS_ANGLE_PRIOR = 5e-5  # [rad] squareness of the two (as above)
KNOWN_LENGTH = 1e-5  # [m] standard deviation up to which a length of the cell is taken as exact
BASE_POSE = ("ox", "oy", "oz", "otx", "oty")


def belongs_to_recording(name: str) -> bool:
    """Whether a parameter is one recording's own: encoder offset or base pose of the ball-bar."""
    return name.startswith("btheta") or name in BASE_POSE


def shared_names(table: ParameterTable) -> tuple[str, ...]:
    """Parameters that all recordings have in common."""
    return tuple(name for name in table.names if not belongs_to_recording(name))


def declared_names(cell: Cell) -> tuple[str, ...]:
    """Parameters that stay as the files declare them, the lengths that fix the scale among them.

    Of a ball-bar that is the plate. A sensed length fixes the scale itself, so there the plate is
    declared only if its file says that it is known, and bd3 only if the sensor's zero was
    calibrated. What else is in the joints of such a bar its length does not show.
    """
    table, bar = parameter_table(cell.robot), cell.ballbar
    if bar.stroke is None:
        return (table.plate,)
    plate = (table.plate,) if cell.plate.length_sigma <= KNOWN_LENGTH else ()
    zero = ("bd3",) if bar.length_tolerance <= KNOWN_LENGTH else ()
    joints = (n for n in table.names if n.startswith(("ba", "bd", "balpha")) and n != "bd3")
    return (*plate, *zero, *joints)


def scale_sigma(cell: Cell) -> float:
    """Relative standard deviation of the scale, which no data show.

    The plate's length gives it and the universal joint's offset `ba5` along it, equivalent to each
    other; of a bar that measures its length, that to which it was calibrated. A zero of such a bar
    that is not known is among the unknowns.
    """
    bar, plate = cell.ballbar, cell.plate
    if bar.stroke is None:
        return float(np.hypot(plate.length_sigma, AXIS_OFFSET_PRIOR)) / plate.length
    return bar.length_tolerance / bar.length if bar.length_tolerance <= KNOWN_LENGTH else 0.0


def taken_as_exact(cell: Cell, layout: Unknowns) -> NDArray[np.intp]:
    """Indices into the table of the instrument's parameters that a fit took as exact.

    Plate and ball-bar, whose files state how well they are known. Of a bar between two balls there
    is nothing but its length.
    """
    table = parameter_table(cell.robot)
    bar = [n for n in shared_names(table) if n.startswith("b")]
    instrument = (table.plate, *(bar if cell.ballbar.stroke is None else ["bd3"]))
    left = [n for n in instrument if n not in layout.names]
    return np.array([table.index[name] for name in left], dtype=np.intp)


def held_names(cell: Cell) -> tuple[str, ...]:
    """Parameters of `declared_names` that stay as declared where every unknown has a prior.

    The plate of a ball-bar has the standard deviation of its file: held as exact, it would pass its
    own error on as scale that nobody states.
    """
    if cell.ballbar.stroke is None:
        return ()
    return declared_names(cell)


def fixed_names(table: ParameterTable, declared: Sequence[str] | None = None) -> tuple[str, ...]:
    """Parameters that are never identified: gauge, and those of `declared_names`; default plate."""
    return (*table.gauge, *((table.plate,) if declared is None else declared))


def priors(cell: Cell, table: ParameterTable, parameters: NDArray[np.intp]) -> Array:
    """(P,) [m, rad] prior sigma of parameters (P,), indices into the table.

    Infinite for those that belong to a recording.
    """
    names = [table.names[i] for i in parameters]
    return np.array(
        [np.inf if belongs_to_recording(name) else prior_sigma(cell, name, None) for name in names]
    )


def prior_sigma(cell: Cell, name: str, rod_sigma: float | None) -> float:
    """[m, rad] prior sigma of one shared parameter."""
    parameter = parameter_named(name)
    if name == parameter_table(cell.robot).plate:
        return cell.plate.length_sigma
    if name == "bd3":
        return cell.ballbar.length_tolerance if rod_sigma is None else rod_sigma
    if parameter.side == "bar":
        return AXIS_OFFSET_PRIOR if parameter.is_length else AXIS_ANGLE_PRIOR
    return robot_prior(parameter)


def robot_prior(parameter: Parameter) -> float:
    """[m, rad] prior sigma of one of the robot's parameters about its catalogue value."""
    return LENGTH_PRIOR if parameter.is_length else ANGLE_PRIOR


def robot_unknowns(layout: Unknowns) -> list[int]:
    """Unknowns of a fit that are the robot's own parameters, with a prior about the catalogue."""
    own = of_robot(layout.fixed.table, layout.parameters)
    return [int(i) for i in np.flatnonzero(own) if np.isfinite(layout.sigma[i])]


def of_robot(table: ParameterTable, parameters: Sequence[Parameter]) -> NDArray[np.bool_]:
    """(P,) whether parameters are the robot's own: of the instrument, plate included, files state
    how well they are known.
    """
    return np.array([p.side == "robot" and p.name != table.plate for p in parameters], dtype=bool)


def declared_sigma(layout: Unknowns) -> Array:
    """(P,) prior sigmas of a fit, those of the robot's parameters before any tail widened them."""
    sigma, robot = layout.sigma.copy(), robot_unknowns(layout)
    sigma[robot] = [robot_prior(layout.parameters[i]) for i in robot]
    return sigma


def beyond_priors(layout: Unknowns, x: Array) -> NDArray[np.intp]:
    """Unknowns of the machine further from their priors than chance explains, the furthest first.

    x : (P,) estimate. What is too small to matter to the tool is none.
    """
    machine = layout.machine
    off = np.abs(x[machine] - layout.mean[machine])
    least = np.full(machine.size, PULL)
    least[robot_unknowns(layout)] = FAR
    far = off / (least * declared_sigma(layout)[machine])
    little = np.zeros(machine.size)  # a prior of a coefficient is of a size that matters
    for i in range(layout.shared.size):
        length = parameter_named(layout.names[i]).is_length
        little[i] = LITTLE_SHIFT if length else LITTLE_TURN
    order = np.argsort(-far)
    return np.asarray(machine[order[(far[order] > 1.0) & (off[order] > little[order])]])


def with_tails(sigma: Array, off: Array) -> Array:
    """(P,) sigmas of normal priors that stand in for Student's where estimates are `off` (P,)."""
    return sigma * np.sqrt(np.maximum(1.0, (TAILS + (off / sigma) ** 2) / (TAILS + 1.0)))
