"""The tool's mass and centre, and the arm's masses by one factor, from logged motor torques.

    y = (1 + g) load + tool (m, m c) + s arm + links + friction + rotor qdd + w F

holds at every gear and instant, linear in everything unknown: what the tool weighs more than its
file says (m) and its first moment (m c) in the flange's frame, the arm's excess s, what each link
deviates beside it, friction (Coulomb, viscous, Stribeck's rise towards rest), offsets, gains g,
rotor inertias. The tension F is eliminated sample by sample (ballbar.ident.loads.rod_tension).
Gains multiply the modelled load: on the logged torque they and s would run away together to where
everything is zero (notes/identification sec. 7). Links taken as exact but for s draw the tool's
mass by many times its sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.payload import TOOL, Masses, payload_of
from ballbar.ident.estimator.priors import PULL
from ballbar.ident.estimator.time_blocks import block_numbers, block_sums
from ballbar.ident.loads.logged_tension import LoggedTorque
from ballbar.ident.loads.mass_uncertainty import ARM, mass_columns, stated_covariance
from ballbar.ident.loads.rod_tension import (
    ROTOR_PRIOR,
    STRIBECK_PRIOR,
    TORQUE_GAIN,
    TORQUE_OFFSET,
    friction_sign,
    from_motor_torque,
    stribeck_rise,
    torque_sigma,
    without_tension,
)
from ballbar.ident.loads.undeclared import undeclared_columns, undeclared_load

MASS_PRIOR, MOMENT_PRIOR = 10.0, 3.0  # [kg], [kg m] a tool that nobody declared
ARM_PRIOR = 0.05  # of a catalogue arm's masses, with what hangs on it
# Standard deviation that no block of time shows, over the arm's mass: a correct tool of 4 kg on an
# arm of 360 kg was found 0.1 to 0.6 kg too heavy (notes/identification sec. 7). So masses that are
# beside their files by less than SURE times that are never named, whatever the rows.
FLOOR = 1e-3
EXACT = 1e-9  # of the arm's factor where the links deviate one by one
SURE = 3.0  # deviations from which the found masses replace the file's


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """Masses as the torque logs give them, with their uncertainty."""

    payload: Masses
    stated: float  # [kg] mass of the tool in the file
    mass_sigma: float  # [kg]
    arm_sigma: float
    added_load: Array  # (J,) [N m] rms that the found masses add at each gear
    significant: bool  # whether tool or arm are beside their files, as no file's tolerance explains
    covariance: Array  # (4 + 4 J, 4 + 4 J) of the masses (ballbar.ident.loads.mass_uncertainty)
    each: tuple[float, ...] = ()  # [kg] tool of each recording, where they are not one tool
    undeclared: str = ""  # what else than masses loads the gears, as a sentence
    offsets: dict[int, float] = field(default_factory=dict)  # [N m] of gears, from 1, far from none

    @property
    def excess(self) -> float:
        """[kg] by which the tool is heavier than its file says."""
        return self.payload.mass - self.stated


def payload_of_recordings(
    cell: Cell, geometries: Sequence[Geometry], logs: Sequence[LoggedTorque]
) -> PayloadEstimate:
    """The masses that the torques of recordings ask for; of the first where tools are not the same.

    geometries : of the recordings, their lengths those of the files (RecordingFit.as_built). A tool
    that nobody declared is tried first; where it is none, tool and links are what the files say
    within their tolerance.
    """
    recordings = _of_recordings(cell, geometries, logs)
    if cause := _undeclared(cell, recordings):
        return replace(_estimate(cell, recordings, declared=True), undeclared=cause)
    if len(recordings) > 1:
        single = [_estimate(cell, [recording]) for recording in recordings]
        masses = tuple(estimate.payload.mass for estimate in single)
        sigma = np.hypot.reduce([estimate.mass_sigma for estimate in single])
        if max(masses) - min(masses) > SURE * sigma:
            return replace(single[0], each=masses)
    return _estimate(cell, recordings)


@dataclass(frozen=True, eq=False)
class _Recording:
    """The torques of one recording as the regression sees them."""

    log: LoggedTorque
    masses: Array  # (5 + 4 J, J, N) columns of the masses
    rest: Array  # (J, N) whitened torque beyond the modelled load
    design: Array  # (P, J, N) whitened columns
    undeclared: dict[str, Array]  # (K, J, N) whitened columns of other loads


def _of_recordings(
    cell: Cell, geometries: Sequence[Geometry], logs: Sequence[LoggedTorque]
) -> list[_Recording]:
    out = []
    for geometry, log in zip(geometries, logs, strict=True):
        frames = robot_frames(geometry, log.q)
        masses = mass_columns(cell, frames, log.q, log.speed.T, log.acceleration.T)
        sigma, direction = torque_sigma(cell, log.speed), log.carried.gear_per_newton
        others = {
            name: without_tension(columns, sigma, direction)
            for name, columns in undeclared_columns(cell, geometry, frames, log).items()
        }
        out.append(_Recording(log, masses, *_regression(cell, masses, log), others))
    return out


def _undeclared(cell: Cell, recordings: Sequence[_Recording]) -> str:
    """The sentence of `undeclared_load`."""
    mean, prior = _priors(cell)
    rest = np.concatenate([r.rest - np.einsum("pjn,p->jn", r.design, mean) for r in recordings], -1)
    design = np.concatenate([recording.design for recording in recordings], axis=-1)
    others = {
        name: np.concatenate([recording.undeclared[name] for recording in recordings], axis=-1)
        for name in recordings[0].undeclared
    }
    return undeclared_load(cell, rest, design, others, (_declared(cell, prior), prior))


def _estimate(
    cell: Cell, recordings: Sequence[_Recording], *, declared: bool = False
) -> PayloadEstimate:
    """The masses; declared : whether they are the files' within their tolerance for sure."""
    rest = np.concatenate([recording.rest for recording in recordings], axis=-1)
    design = np.concatenate([recording.design for recording in recordings], axis=-1)
    logs = [recording.log for recording in recordings]
    mean, prior = _priors(cell)
    regression = _Regression(rest - np.einsum("pjn,p->jn", design, mean), design, logs)
    change, blocked = regression.solved(prior)
    sigma = np.sqrt(np.diag(blocked))
    arm_mass = sum(link.mass for link in cell.robot.required("links")[1:])
    mass_sigma, arm_sigma = float(np.hypot(sigma[0], FLOOR * arm_mass)), float(sigma[ARM])
    arm_off = SURE * np.hypot(arm_sigma, FLOOR)
    beyond = abs(change[0]) > SURE * mass_sigma or abs(change[ARM]) > arm_off
    significant = bool(beyond) and not declared
    if not significant:
        change, blocked = regression.solved(_declared(cell, prior))
        mass_sigma = float(np.sqrt(blocked[0, 0]))
    own = change[: ARM + 1]
    added = np.concatenate(
        [np.einsum("pjn,p->jn", recording.masses[: ARM + 1], own) for recording in recordings],
        axis=-1,
    )
    bodies = _bodies(cell)
    with_arm = np.eye(change.size)[bodies]
    with_arm[TOOL::4, ARM] = 1.0  # the arm's factor is a deviation of every link's mass
    return PayloadEstimate(
        payload=payload_of(cell, change[bodies], 1.0 + float(change[ARM])),
        stated=cell.plate.body.mass,
        mass_sigma=mass_sigma,
        arm_sigma=arm_sigma,
        added_load=np.sqrt((added**2).mean(axis=1)),
        significant=significant,
        covariance=with_arm @ blocked @ with_arm.T,
        offsets=_offsets(cell, change),
    )


def _offsets(cell: Cell, change: Array) -> dict[int, float]:
    """[N m] of gears, from 1, whose logged torque is off by far more than its prior allows."""
    coulomb = cell.robot.required("gears").coulomb
    every = zip(change[-coulomb.size :], coulomb, strict=True)
    return {
        gear: float(offset)
        for gear, (offset, friction) in enumerate(every, start=1)
        if abs(offset) > PULL * TORQUE_OFFSET * friction
    }


@dataclass(frozen=True, eq=False)
class _Regression:
    """Whitened torques beyond the modelled load, linear in what is unknown."""

    rest: Array  # (J, N)
    design: Array  # (P, J, N)
    logs: Sequence[LoggedTorque]

    def solved(self, prior: Array) -> tuple[Array, Array]:
        """Estimate (P,), and its covariance (P, P) from the prior and blocks of time."""
        flat = self.design.reshape(len(self.design), -1)
        normal = flat @ flat.T
        half = np.linalg.cholesky(prior)
        inner = np.linalg.inv(half.T @ normal @ half + np.eye(len(half)))
        covariance = half @ inner @ half.T
        change = covariance @ (flat @ self.rest.reshape(-1))
        left = self.rest - np.einsum("pjn,p->jn", self.design, change)
        influence = covariance @ _block_sums((self.design * left).sum(axis=1), self.logs)
        from_prior = half @ inner
        return change, from_prior @ from_prior.T + influence @ influence.T


def _priors(cell: Cell) -> tuple[Array, Array]:
    """Mean (P,) and covariance (P, P) of the unknowns, in the order of `_regression`.

    A tool that nobody declared and an arm of another weight are allowed for.
    """
    gears, rotors = cell.robot.required("gears"), cell.robot.required("rotor_inertia_kg_m2")
    none, gain = np.zeros(cell.robot.joints), np.full(cell.robot.joints, TORQUE_GAIN)
    masses = np.zeros(ARM + 1 + 4 * cell.robot.joints)
    mean = (masses, gears.coulomb, gears.viscous, none, rotors, none, none)
    friction = (gears.coulomb, 2.0 * gears.viscous)
    rise = STRIBECK_PRIOR * gears.coulomb
    offset = TORQUE_OFFSET * gears.coulomb
    sigma = np.concatenate((masses, *friction, gain, ROTOR_PRIOR * rotors, rise, offset))
    prior = _declared(cell, np.diag(sigma**2))
    tool = np.array([MASS_PRIOR, *[MOMENT_PRIOR] * 3, ARM_PRIOR])
    prior[: ARM + 1, : ARM + 1] = np.diag(tool**2)
    return np.concatenate(mean), prior


def _declared(cell: Cell, prior: Array) -> Array:
    """The prior covariance with bodies as the files state them, within their tolerance."""
    out, stated = prior.copy(), stated_covariance(cell)
    out[ARM, ARM] = EXACT**2
    bodies = _bodies(cell)
    out[np.ix_(bodies, bodies)] = stated
    return out


def _bodies(cell: Cell) -> NDArray[np.intp]:
    """Where the deviations of tool and links stand among the unknowns."""
    return np.delete(np.arange(ARM + 1 + 4 * cell.robot.joints), ARM)


def _regression(cell: Cell, masses: Array, log: LoggedTorque) -> tuple[Array, Array]:
    """Whitened torque beyond the modelled load (J, N) and columns (5 + 10 J, J, N), no tension.

    masses : (5 + 4 J, J, N) columns of the masses. A gain is one of the whole load, the rod's share
    included: as a gain of the arm's weight alone it passes for other masses.
    """
    side, rise = friction_sign(log.speed), stribeck_rise(cell, log.speed)
    tension = from_motor_torque(cell, log.torque, log.carried, log.speed, log.acceleration).force
    loads = log.carried.gears(tension)
    terms = (side, log.speed, loads, log.acceleration, rise, np.ones_like(loads))
    each = np.zeros((len(terms), cell.robot.joints, *log.torque.shape))
    for k in range(cell.robot.joints):
        each[:, k, k] = [term[k] for term in terms]
    columns = np.concatenate((masses, *each))
    sigma = torque_sigma(cell, log.speed)
    direction = log.carried.gear_per_newton
    rest = without_tension((log.torque - log.carried.gear)[None], sigma, direction)[0]
    return rest, without_tension(columns, sigma, direction)


def _block_sums(scores: Array, logs: Sequence[LoggedTorque]) -> Array:
    """(P, B) scores (P, N) summed over blocks of time; no block spans two recordings."""
    numbers, blocks = [], 0
    for log in logs:
        numbers.append(block_numbers(log.times) + blocks)
        blocks = int(numbers[-1][-1]) + 1
    return block_sums(scores, np.concatenate(numbers))
