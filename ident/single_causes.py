"""Single changes of a machine since its identification that may explain what is measured today.

One table of what may change, how large it may be, and how it is worded; recordings and still poses
differ in which of them they can show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import parameter_named, parameter_table
from ballbar.ident.corrections.base import GEAR
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.least_sizes import WANDER_LENGTH, WANDER_ZERO
from ballbar.ident.result import Machine

# [rad], [m] standard deviations of changes: a resolver exchanged or a motor taken off, a tool
# bolted on anew or bent, a rod or a plate exchanged
ZERO, SHIFT, TURN, LENGTH = 2e-3, 5e-4, 2e-3, 1e-4
SCALE = 5e-4  # [1] of a length sensor that was exchanged
# [rad], [m] standard deviations of what an unchanged machine is apart by
WANDERS = {"axis": WANDER_ZERO} | dict.fromkeys(
    ("tool", "rod", "length", "plate", "geometry", "ball-bar"), WANDER_LENGTH
)
# What changed, what usually is behind it, and the unit of its size; none of what has no common one
WORDS = {
    "axis": ("zero of axis {}", "resolver or motor exchanged?", "mrad"),
    "tool": ("tool", "bolted on anew, or bent?", ""),
    "rod": ("length of the rod", "exchanged?", "um"),
    "plate": ("length of the plate", "exchanged?", "um"),
    "length": ("zero of the measured length", "exchanged?", "um"),
    "scale": ("scale of the measured values", "exchanged?", "ppm"),
    "gear": ("gear of axis {}", "transmission error, compliance or backlash; gear exchanged?", ""),
    "geometry": ("parameter {}", "bent?", "um"),
    "ball-bar": ("axes of the ball-bar", "bent, or taken apart?", ""),
    "target": ("target {}", "moved?", "um"),
    "pose": ("pose {}", "measured wrongly?", "um"),
    "seat": ("base of the ball-bar", "moved?", "um"),
    "loads": ("compliance of all gears", "another tool or payload?", ""),
    "robot": ("geometry of the robot", "another robot, or repaired?", ""),
}


@dataclass(frozen=True, eq=False)
class Cause:
    """One change since the identification that may explain a measurement."""

    kind: str  # as in WORDS
    name: str  # axis or gear from 1, target, parameter, file and row of a pose; else ""
    columns: Array  # (C, K) change of what is compared per unit
    prior: Array  # (K,) standard deviation of each unit: of an axis zero [rad]
    names: tuple[str, ...] = ()  # of the machine's unknowns that it moves

    @property
    def axis(self) -> int:
        """From 1, of an axis or a gear; else 0."""
        return int(self.name) if self.kind in ("axis", "gear") else 0


@dataclass(frozen=True, eq=False)
class Explanation:
    """One cause and how well it explains a measurement."""

    cause: Cause
    size: Array  # (K,) [rad], [m] or SI of the coefficients
    sigma: Array  # (K,)
    evidence: float  # logarithm of the Bayes factor against no change
    gain: float  # decrease of the sum of squares with this size

    @property
    def sentence(self) -> str:
        """The cause, its size, and what usually is behind it."""
        return worded(self.cause.kind, self.cause.name, self.size, self.sigma)


def worded(kind: str, name: str, size: Array, sigma: Array | None = None) -> str:
    """Words for a change of a size (K,) [rad], [m] or [1], and its usual reason."""
    words, behind, unit = WORDS[kind]
    words = words.format(name)
    if not unit:
        return f"{words} ({behind})"
    if kind == "geometry" and not parameter_named(name).is_length:
        unit = "urad"
    factor, digits = (1e3, 2) if unit == "mrad" else (1e6, 0)
    sign = "+" if size.size == 1 else ""  # else the length of a vector
    value = float(size[0]) if sign else float(np.linalg.norm(size))
    known = ""
    if sigma is not None:
        known = f"sigma {factor * float(np.linalg.norm(sigma)):.{digits}f} {unit}; "
    return f"{words} by {factor * value:{sign}.{digits}f} {unit} ({known}{behind})"


def single_causes(machine: Machine, free: Fit) -> tuple[Cause, ...]:
    """The single causes that move unknowns of a free fit; those of gears where it has them.

    Beside the usual ones every other parameter of the arm, and those of the ball-bar together: the
    many coefficients of a gear would take up a change of these.
    """
    robot, layout = machine.robot.cell.robot, free.model.unknowns
    place = {name: k for k, name in enumerate(free_names(machine, free))}
    table = parameter_table(robot)
    made: list[Cause] = []

    def add(kind: str, name: str, moved: Sequence[tuple[Mapping[str, float], float]]) -> None:
        """moved : unknowns and their shares for each unit, and the unit's prior."""
        known = [(shares, s) for shares, s in moved if shares and all(n in place for n in shares)]
        if known:
            columns = np.zeros((len(place), len(known)))
            for k, (shares, _) in enumerate(known):
                columns[[place[n] for n in shares], k] = list(shares.values())
            names = tuple(dict.fromkeys(n for shares, _ in known for n in shares))
            made.append(Cause(kind, name, columns, np.array([s for _, s in known]), names))

    sensed = machine.robot.cell.ballbar.stroke is not None
    # joint angles that the zero of each axis moves, and by how much; of axis 1 the base alone
    zeros = {
        axis: {f"rtheta{j}": float(share) for j, share in enumerate(row, start=1) if share}
        for axis, row in enumerate(robot.controller_to_joint, start=1)
    }
    last = [f"r{kind}{robot.joints}" for kind in ("d", "a", "theta", "alpha", "beta")]
    for axis, shares in zeros.items():
        add("axis", str(axis), [(shares, ZERO)])
    sizes = [SHIFT, SHIFT, TURN, TURN, TURN]
    add("tool", "", [({name: 1.0}, s) for name, s in zip(last, sizes, strict=True)])
    add("length" if sensed else "rod", "", [({"bd3": 1.0}, LENGTH)])
    if not sensed:
        add("plate", "", [({table.plate: 1.0}, LENGTH)])
    sigma = dict(zip(layout.names, layout.sigma.tolist(), strict=True))
    for gear in range(robot.joints):
        own = [
            ({c.name: 1.0}, float(np.sqrt(2.0)) * sigma[c.name])
            for correction in machine.robot.corrections
            for c in correction.coefficients
            if c.channel == GEAR + gear
        ]
        if own:  # and with the gear, the zero of its axis
            add("gear", str(gear + 1), [*own, (zeros[gear + 1], ZERO)])
    usual = {name for c in made for name in c.names}
    others = [p for p in table.parameters if p.name in place and p.name not in usual]
    moves = {p.name: ({p.name: 1.0}, SHIFT if p.is_length else TURN) for p in others}
    for p in others:
        if p.side == "robot":
            add("geometry", p.name, [moves[p.name]])
    add("ball-bar", "", [moves[p.name] for p in others if p.side == "bar"])
    if sensed:  # a length that has to be scaled up shows a robot that is too small until it is
        lengths = [p.name for p in table.parameters if p.name in place and p.is_length]
        shares = {n: -machine.robot.geometry[n] for n in lengths if n.startswith("r")}
        add("scale", "", [(shares, SCALE)])
    return tuple(made)


def free_names(machine: Machine, free: Fit) -> list[str]:
    """Names of the machine's unknowns that were free, in the order of its covariance."""
    return [name for name in machine.names if name in free.model.unknowns.names]


def covariance_of_wander(causes: Sequence[Cause], unknowns: int) -> Array:
    """(U, U) covariance of what an unchanged machine is apart by `WANDERS`."""
    shifts = [c.columns * WANDERS[c.kind] for c in causes if c.kind in WANDERS]
    each = np.concatenate([np.zeros((unknowns, 1)), *shifts], axis=1)
    return np.asarray(each @ each.T)


def exchangeable(cell: Cell) -> dict[str, tuple[float, float]]:
    """[m] standard deviations of a change and of what its file states, of parameters that an
    identification takes as exact.

    Of a sensed length these are the tool's length and the zero of the length: a tool that was
    bolted on again would otherwise pass for a change of the arm.
    """
    if cell.ballbar.stroke is None:
        return {}
    plate = parameter_table(cell.robot).plate
    return {plate: (SHIFT, cell.plate.length_sigma), "bd3": (LENGTH, cell.ballbar.length_tolerance)}


def with_exchangeable(machine: Machine) -> Machine:
    """The machine with `exchangeable` parameters among its unknowns, as well as files state."""
    exact = {
        name: stated
        for name, (_, stated) in exchangeable(machine.robot.cell).items()
        if name not in machine.names
    }
    covariance = block_diag(machine.covariance, np.diag(np.array([*exact.values()]) ** 2))
    return replace(machine, names=(*machine.names, *exact), covariance=covariance)
