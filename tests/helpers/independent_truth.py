"""Errors that priors and noise allow, and cover of stated intervals, for tests/independent.

Bound: errors of the machine's unknowns are drawn from the white covariance of the fit, that of
priors and noise without the inflation for autocorrelated residuals, and pushed through the Jacobian
of the unloaded tool, base aligned. The median over the draws of their mean and largest distance is
what a median robot of an ideal identification has (a Bayesian Cramer-Rao bound).
The noise is the one that the fit estimated; what no unknown of the model describes is not in it:
ripple of unlisted orders, errors of the masses. Plate and axis offset set the scale, which no path
shows, so over few machines the median is mostly that of their draws. The bound at drawn lengths is
that of the same machines with the errors of these two that they have.

Intervals: parameters that the fit calls identified, in the gauge that it holds fixed. rd1 and
rtheta1 move the base alone; rd3 goes to rd2, since axes 2 and 3 are parallel. The mean of a gear's
ripple counts as joint offset: no log tells them apart. The stiffness of gear 1 includes the bearing
of joint 2 about y, which turns about the same axis; that of gear 6 the plate's bending across,
which the model does not have: with a plate that is rigid across, gear 6 is 0.5 % off and not 2 %.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, mirrored, parameter_named
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import rigid_basis
from tests.independent.machine import Machine

DRAWS = 400
INTERVAL = 1.96  # standard deviations, 95 %
STEPS = 7200  # of a turn
EITHER_WAY = (2, 4)  # encoders whose direction no log shows
KINDS = ("a", "d", "alpha", "theta", "beta")
OFFSET = "ba5"  # of the ball-bar's last axis: as good as a length of the plate


def bound_draws(
    found: Identification, q: Array, seed: int, lengths: Machine | None = None
) -> Array:
    """(2, DRAWS) [m] mean and largest distance of the tool at q (N, J) [rad], draw by draw.

    lengths : machine whose errors of plate and axis offset all draws have; None draws them too.
    """
    robot, covariance = found.robot.identified, found.robot.covariance
    table = found.robot.geometry.table
    names = [name for name in covariance.names if name in table.index]
    moves = robot.jacobian(q, np.array([table.index[name] for name in names]))
    columns = moves.transpose(2, 1, 0).reshape(-1, len(moves))
    basis = rigid_basis(robot.tool(q))
    columns = columns - basis @ (basis.T @ columns)
    values, vectors = np.linalg.eigh(covariance.white)
    normal = np.random.default_rng(seed).standard_normal((values.size, DRAWS))
    errors = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * normal)
    if lengths is not None:
        of_scale = [k for k, name in enumerate(names) if name in (OFFSET, table.plate)]
        nominal, truth = found.robot.nominal, true_geometry(found.robot.nominal, lengths)
        known = np.array([nominal[names[k]] - truth[names[k]] for k in of_scale])
        per_length = np.linalg.solve(
            covariance.white[np.ix_(of_scale, of_scale)], covariance.white[of_scale]
        )
        errors += per_length.T @ (known[:, None] - errors[of_scale])
    distance = np.linalg.norm((columns @ errors).reshape(-1, 3, DRAWS), axis=1)
    return np.stack((distance.mean(axis=0), distance.max(axis=0)))


def geometry_errors(found: Identification, machine: Machine) -> Array:
    """(P,) errors of the identified parameters in standard deviations."""
    truth = true_geometry(found.robot.nominal, machine)
    first = found.recordings[0]
    for joint, direction in zip(first.encoders, first.directions, strict=True):
        # of the others a reversed direction is a sign that was declared wrongly
        truth = mirrored(truth, joint) if direction < 0 and joint in EITHER_WAY else truth
    return np.array(
        [
            _difference(name, found.robot.geometry[name], truth[name]) / sigma
            for name, sigma in found.robot.sigma.items()
        ]
    )


def stiffness_errors(found: Identification, machine: Machine) -> Array:
    """(J,) errors of the gears' compliances in standard deviations; empty where none was fitted."""
    entries = {c.name: c for group in found.robot.corrections for c in group.coefficients}
    expected = true_compliance(machine)
    chosen = [entries.get(f"compliance{i + 1}") for i in range(expected.size)]
    return np.array(
        [(c.value - x) / c.sigma for c, x in zip(chosen, expected, strict=True) if c is not None]
    )


def true_compliance(machine: Machine) -> Array:
    """(J,) [rad/(N m)] of the gears, with what yields about the same axis."""
    out = 1.0 / machine.stiffness
    out[0] += machine.effects.bearing[3]
    # the last two coordinates are the plate's shift along y and turn about z, at its tip
    out[5] += machine.compliance[-1, -2] / machine.rows[5, 0]
    return np.asarray(out)


def held(errors: Array) -> int:
    """How many errors, in standard deviations, a 95 % interval holds."""
    return int((np.abs(errors) < INTERVAL).sum())


def true_geometry(nominal: Geometry, machine: Machine) -> Geometry:
    """The machine's parameters with those of the gauge at their nominal values."""
    offsets = _ripple_means(machine)
    values: dict[str, float] = {}
    for side, rows in (("r", machine.rows), ("b", machine.bar_rows)):
        for row, numbers in enumerate(rows.tolist(), start=1):
            for kind, value in zip(KINDS, numbers, strict=True):
                values[f"{side}{kind}{row}"] = value
    for row, offset in enumerate(offsets.tolist(), start=1):
        values[f"rtheta{row}"] += offset
    # along the parallel axis; what is left is of second order
    shift, alpha, beta = values["rd3"] - nominal["rd3"], values["ralpha2"], values["rbeta2"]
    across = -np.sin(alpha) * np.cos(beta) * shift / values["ra2"]
    values["rd2"] += shift * np.cos(alpha) * np.cos(beta)
    values["ra2"] += shift * np.sin(beta)
    values["rtheta2"] += across
    values["rtheta3"] -= across
    own = ("btheta", *nominal.table.gauge)
    return nominal.replaced(
        {k: v for k, v in values.items() if k in nominal.table.index and not k.startswith(own)}
    )


def _ripple_means(machine: Machine) -> Array:
    """(J,) [rad] mean of each joint's error over a turn of its gear."""
    turn = np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False)
    gears = machine.ripple(np.repeat(turn[:, None], 6, axis=1)).mean(axis=0)
    return np.asarray(gears @ machine.to_joint)


def _difference(name: str, value: float, truth: float) -> float:
    difference = value - truth
    if parameter_named(name).is_length:
        return difference
    return float(np.arctan2(np.sin(difference), np.cos(difference)))
