"""Masses of the tool and of the arm's links, from logged motor torques.

    y = (1 + g) load + tool (m, m c) + s arm + links + friction + rotor qdd + w F

holds at every gear and instant, linear in everything unknown: what the tool weighs more than its
file says (m) and its first moment (m c) in the flange's frame, the arm's excess s, what each link
deviates beside it, friction (Coulomb, viscous, Stribeck's rise towards rest), gains g, rotor
inertias. The tension F is eliminated sample by sample (ident.loads.rod_tension). Gains multiply the
modelled load: on the logged torque they and s would run away together to where everything is zero
(notes/unknown_machines). Links taken as exact but for s draw the tool's mass by many times its
sigma.

The regression is solved twice. Without trust in the file's tool, and with a free factor s of the
arm, it tells whether another tool is mounted. Where none is, the tool deviates from its file as a
link does and s is 1; the estimate is then the posterior mean of usual deviations, and nearly all
that is gained is in the wrist: a centre of link 4 that is 3 mm off its file is 0.9 N m at gear 4,
which decides on which flank of its backlash the gear lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.arrays import Array
from cell.bodies import carried_bodies, flange_on_last_link, link_rotations
from cell.descriptions import Cell, Link
from cell.dynamics import joint_torques
from cell.geometry import Geometry, robot_frames
from cell.payload import Payload
from ident.estimator.uncertainty import block_numbers, block_sums
from ident.loads.logged_tension import LoggedTorque
from ident.loads.rod_tension import (
    ROTOR_PRIOR,
    STRIBECK_PRIOR,
    friction_sign,
    stribeck_rise,
    torque_sigma,
    without_tension,
)

MASS_PRIOR, MOMENT_PRIOR = 10.0, 3.0  # [kg], [kg m] a tool that nobody declared
ARM_PRIOR = 0.05  # of a catalogue arm's masses, with what hangs on it
LINK_PRIOR, CENTRE_PRIOR = 0.02, 3e-3  # of each link's mass; [m] of its centre; assumed
USUAL_ARM = 1e-3  # of an arm whose links deviate each by itself, with a tool as its file has it
GAIN_PRIOR = 0.02  # (notes/identification sec. 1)
NEAR = 0.01  # [m] from the flange to point masses that give the first moment; inertia 1e-4 kg m^2
# Standard deviation that no block of time shows, over the arm's mass: a correct tool of 4 kg on an
# arm of 360 kg was found 0.1 to 0.6 kg too heavy (notes/unknown_machines).
FLOOR = 1e-3
# Over the arm's mass: standard deviation from which recordings may be of different tools; 1.7e-3
# where they are of one, 7e-3 of two that are 5 kg apart
SCATTERED = 3e-3
SURE = 3.0  # deviations from which the found masses replace the file's


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """What the torque logs say of the masses."""

    payload: Payload  # without trust in the file's tool
    usual: Payload  # with the tool as its file has it, but for what is usual
    stated: float  # [kg] mass of the tool in the file
    mass_sigma: float  # [kg]
    arm_sigma: float
    added_load: Array  # (J,) [N m] rms that the found masses add at each gear
    each: tuple[float, ...] = ()  # [kg] tool of each recording, where they are not one tool

    @property
    def excess(self) -> float:
        """[kg] by which the tool is heavier than its file says."""
        return self.payload.mass - self.stated

    @property
    def masses(self) -> Payload:
        """Those that the fit uses."""
        return self.payload if self.significant else self.usual

    @property
    def significant(self) -> bool:
        """Whether the tool or the arm is another than in the files."""
        arm = abs(self.payload.arm - 1.0) > SURE * self.arm_sigma
        return arm or abs(self.excess) > SURE * self.mass_sigma


def payload_from_torque(
    cell: Cell, geometries: Sequence[Geometry], logs: Sequence[LoggedTorque]
) -> PayloadEstimate:
    """The masses that the torques of some recordings ask for.

    geometries : of the recordings, from their `dh` fits.
    """
    whitened = [_regression(cell, g, log) for g, log in zip(geometries, logs, strict=True)]
    rest, design = (np.concatenate([part[k] for part in whitened], axis=-1) for k in range(2))
    mean, prior = _priors(cell)
    rest = rest - np.einsum("pjn,p->jn", design, mean)
    change, covariance = _solved(design, rest, prior)
    scores = (design * (rest - np.einsum("pjn,p->jn", design, change))).sum(axis=1)
    # from the priors, and from the scores of blocks of time
    variance = ((covariance / prior) ** 2).sum(axis=1)
    variance += ((covariance @ _block_sums(scores, logs)) ** 2).sum(axis=1)
    sigma = np.sqrt(variance)
    body = cell.plate.body
    usual = np.array([LINK_PRIOR * body.mass, *[CENTRE_PRIOR * body.mass] * 3, USUAL_ARM])
    trusting, _ = _solved(design, rest, np.concatenate((usual, prior[usual.size :])))
    columns = np.concatenate(
        [_mass_columns(cell, g, log) for g, log in zip(geometries, logs, strict=True)], axis=-1
    )
    arm_mass = sum(link.mass for link in cell.robot.required("links")[1:])
    return PayloadEstimate(
        payload=_payload(cell, change),
        usual=_payload(cell, trusting),
        stated=body.mass,
        mass_sigma=float(np.hypot(sigma[0], FLOOR * arm_mass)),
        arm_sigma=float(sigma[4]),
        added_load=np.sqrt((np.einsum("pjn,p->jn", columns[:5], change[:5]) ** 2).mean(axis=1)),
    )


def payload_of_recordings(
    cell: Cell, geometries: Sequence[Geometry], logs: Sequence[LoggedTorque]
) -> PayloadEstimate:
    """As `payload_from_torque`; that of the first recording, where they are not of one tool."""
    together = payload_from_torque(cell, geometries, logs)
    arm_mass = sum(link.mass for link in cell.robot.required("links")[1:])
    if len(logs) == 1 or together.mass_sigma < SCATTERED * arm_mass:
        return together
    single = [
        payload_from_torque(cell, [g], [log]) for g, log in zip(geometries, logs, strict=True)
    ]
    masses = tuple(estimate.payload.mass for estimate in single)
    sigma = np.hypot.reduce([estimate.mass_sigma for estimate in single])
    if max(masses) - min(masses) < SURE * sigma:
        return together
    return replace(single[0], each=masses)


def _solved(design: Array, rest: Array, prior: Array) -> tuple[Array, Array]:
    """Posterior mean (P,) and covariance (P, P) of the unknowns.

    design : (P, J, N) whitened columns. rest : (J, N) whitened. prior : (P,) standard deviations.
    """
    flat = design.reshape(len(design), -1)
    covariance = np.linalg.inv(flat @ flat.T + np.diag(prior**-2.0))
    return np.asarray(covariance @ (flat @ rest.reshape(-1))), np.asarray(covariance)


def _payload(cell: Cell, change: Array) -> Payload:
    """The masses that differ from the cell's by unknowns in the order of `_priors`."""
    body, mass, arm = cell.plate.body, float(cell.plate.body.mass + change[0]), 1.0 + change[4]
    links = change[5 : 5 + 4 * cell.robot.joints].reshape(-1, 4).tolist()
    return Payload(
        mass,
        (body.mass * body.com + change[1:4]) / mass,
        float(arm),
        tuple((m, x, y, z) for m, x, y, z in links),
    )


def _priors(cell: Cell) -> tuple[Array, Array]:
    """Means and standard deviations of the unknowns, in the order of `_regression`."""
    gears, rotors = cell.robot.required("gears"), cell.robot.required("rotor_inertia_kg_m2")
    links = [LINK_PRIOR, *[CENTRE_PRIOR] * 3] * cell.robot.joints
    masses = np.array([MASS_PRIOR, *[MOMENT_PRIOR] * 3, ARM_PRIOR, *links])
    none, gain = np.zeros(cell.robot.joints), np.full(cell.robot.joints, GAIN_PRIOR)
    mean = (np.zeros(masses.size), gears.coulomb, gears.viscous, none, rotors, none)
    friction = (gears.coulomb, 2.0 * gears.viscous)
    rise = STRIBECK_PRIOR * gears.coulomb
    return np.concatenate(mean), np.concatenate(
        (masses, *friction, gain, ROTOR_PRIOR * rotors, rise)
    )


def _regression(cell: Cell, geometry: Geometry, log: LoggedTorque) -> tuple[Array, Array]:
    """Whitened torque beyond the modelled load (J, N) and columns (5 + 9 J, J, N), no tension."""
    side, rise = friction_sign(log.speed), stribeck_rise(cell, log.speed)
    terms = (side, log.speed, log.carried.gear, log.acceleration, rise)
    each = np.zeros((len(terms), cell.robot.joints, *log.torque.shape))
    for k in range(cell.robot.joints):
        each[:, k, k] = [term[k] for term in terms]
    columns = np.concatenate((_mass_columns(cell, geometry, log), *each))
    sigma, direction = torque_sigma(cell, log.speed), log.carried.gear_per_newton
    rest = without_tension((log.torque - log.carried.gear)[None], sigma, direction)[0]
    return rest, without_tension(columns, sigma, direction)


def _mass_columns(cell: Cell, geometry: Geometry, log: LoggedTorque) -> Array:
    """(5 + 4 J, J, N) torque at the gears' outputs of the masses in the order of `_priors`.

    Per kg and kg m of the tool; of the whole arm; of each link, and per metre of its centre along
    the axes of the base with all joint angles zero.
    """
    frames, joints = robot_frames(geometry, log.q), cell.robot.joints
    rotation, flange = flange_on_last_link(cell)
    speed, acceleration = (v.T @ cell.robot.gear_to_joint for v in (log.speed, log.acceleration))

    def torque(bodies: list[list[Link]]) -> Array:
        at_joints = joint_torques(
            frames,
            bodies,
            log.q,
            gravity=cell.robot.gravity,
            speed=speed,
            acceleration=acceleration,
        )
        return np.asarray(cell.robot.gear_to_joint @ at_joints)

    def of_link(joint: int, body: Link) -> Array:
        return torque([[body] if j == joint else [] for j in range(joints)])

    def of_point(joint: int, mass: float, com: Array, axes: Array) -> list[Array]:
        """Of a point mass, and per metre by which it moves along each of the axes."""
        none = np.zeros((3, 3))
        here = of_link(joint, Link(mass, com, none))
        shifted = [of_link(joint, Link(mass, com + NEAR * axis, none)) for axis in axes]
        return [here, *((there - here) / NEAR for there in shifted)]

    bodies = [links[0] for links in carried_bodies(cell)]
    links = [of_link(joint, body) for joint, body in enumerate(bodies)]
    columns = [*of_point(joints - 1, 1.0, flange, rotation.T), np.sum(links, axis=0)]
    turned = link_rotations(cell.robot)
    for joint, (body, whole) in enumerate(zip(bodies, links, strict=True)):
        columns += [whole, *of_point(joint, body.mass, body.com, turned[joint])[1:]]
    return np.stack(columns)


def _block_sums(scores: Array, logs: Sequence[LoggedTorque]) -> Array:
    """(P, B) scores (P, N) summed over blocks of time; no block spans two recordings."""
    numbers, blocks = [], 0
    for log in logs:
        numbers.append(block_numbers(log.times) + blocks)
        blocks = int(numbers[-1][-1]) + 1
    return block_sums(scores, np.concatenate(numbers))
