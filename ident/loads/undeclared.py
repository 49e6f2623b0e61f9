"""Loads of the gears beside declared masses, by torque logs: other gravity, a force at the tool.

Loads are linear in the vector of gravity, and in a force at the tool, as of a hose or a cable. That
force may be constant: what changes in proportion to the tool's place on its sphere is along the
rod, and passes for tension. Each is tried in the regression of
ballbar.ident.loads.payload with masses as the files state them. One is the cause where it takes
away much of what the declared loads leave, and far more than other masses and the other one do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, cross
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.ident.loads.gear_loads import loads, mass_model
from ballbar.ident.loads.logged_tension import LoggedTorque

# Of the cost that declared masses leave. Sound robots have 0.001, with a wrong gain or late torques
# 0.006, on a floor that slopes by 0.7 degrees 0.14
EXPLAINS = 0.05
DECISIVE = 2.0  # times what any other explanation takes away
PRIORS = {"gravity": 10.0, "force": 100.0}  # [m/s^2], [N]


def undeclared_columns(
    cell: Cell, geometry: Geometry, frames: Frames, log: LoggedTorque
) -> dict[str, Array]:
    """(K, J, N) [N m] torques at the gears' outputs of each cause, for a unit of its unknowns.

    Of gravity, and of a force at the tool, along x, y, z of the base.
    """
    to_joint = cell.robot.gear_to_joint
    speed, acceleration = log.speed.T @ to_joint, log.acceleration.T @ to_joint
    gravity = []
    for axis in np.eye(3):
        robot = replace(cell.robot, gravity=cell.robot.gravity + axis)
        masses = mass_model(replace(cell, robot=robot))
        moved = loads(
            masses, geometry, q=log.q, b=log.ballbar, speed=speed, acceleration=acceleration
        )
        gravity.append(moved.gear - log.carried.gear)
    forces = [axis[:, None] + np.zeros_like(frames.tip) for axis in np.eye(3)]
    at_joints = np.array([
        [(frames.z[j] * cross(frames.tip - frames.origin[j], f)).sum(axis=0) for f in forces]
        for j in range(cell.robot.joints)
    ])  # fmt: skip
    # what the motors must exert against a pull
    pulled = -np.einsum("gj,jfn->fgn", to_joint, at_joints)
    return {"gravity": np.stack(gravity), "force": pulled}


def undeclared_load(
    cell: Cell, rest: Array, design: Array, columns: dict[str, Array], priors: Sequence[Array]
) -> str:
    """A sentence that names the cause; empty where there is none.

    rest : (J, N) whitened torques beyond the loads of declared masses. design : (P, J, N) columns
    of all unknowns. columns : of each cause, whitened too. priors : two covariances (P, P), with
    masses as declared, and with a tool and an arm that nobody declared.
    """
    declared, masses = (_fitted(rest, design, prior)[0] for prior in priors)
    decrease, estimate = {"masses": declared - masses}, {}
    for name, own in columns.items():
        count = len(priors[0])
        both = np.diag(np.append(np.ones(count), np.full(len(own), PRIORS[name] ** 2)))
        both[:count, :count] = priors[0]
        left, change = _fitted(rest, np.concatenate((design, own)), both)
        decrease[name], estimate[name] = declared - left, change[count:]
    best = max(estimate, key=decrease.__getitem__)
    others = max(value for name, value in decrease.items() if name != best)
    if decrease[best] < max(EXPLAINS * declared, DECISIVE * others):
        return ""
    if best == "gravity":
        stated = cell.robot.gravity
        shown = stated + estimate[best]
        shown *= np.linalg.norm(stated) / np.linalg.norm(shown)
        angle = np.rad2deg(np.arccos(np.clip(shown @ stated / (stated @ stated), -1.0, 1.0)))
        vector = ", ".join(f"{value:.2f}" for value in shown)
        return (
            "gravity does not point where the robot's file says: by the torque logs it is "
            f"{angle:.1f} degrees off. Is the robot on a slope or a wall? Write `gravity_m_per_s2: "
            f"[{vector}]` into its file"
        )
    return (
        f"a force of {np.linalg.norm(estimate[best]):.0f} N at the tool that no file states loads "
        "the robot, by the torque logs. Take off the cable, hose or spring that holds the tool, "
        "and record again"
    )


def _fitted(rest: Array, design: Array, prior: Array) -> tuple[float, Array]:
    """Cost of rest (J, N) with unknowns of covariance `prior` (P, P), and their estimate (P,)."""
    flat, half = design.reshape(len(design), -1), np.linalg.cholesky(prior)
    normal, slope = half.T @ (flat @ flat.T) @ half, half.T @ (flat @ rest.reshape(-1))
    change = np.linalg.solve(normal + np.eye(len(half)), slope)
    return float((rest * rest).sum() - slope @ change), half @ change
