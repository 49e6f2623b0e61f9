"""Coverage of a robot's stated uncertainty: the factor k that holds 95 % of the tool's errors.

Distances of tool and prediction, all directions together, are drawn from the stated covariance
(JCGM 101:2008), with the tails of Student's distribution of the effective degrees of freedom. Where
angles are so uncertain that the linear law is in doubt, draws pass the exact forward kinematics.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.ident.robot.tool_covariance import ToolCovariance

COVERAGE = 0.95
DRAWS = 100  # for each of the poses of the workspace
DOUBT = 0.01  # of the stated uncertainty: second-order error from which draws are exact
EXACT_DRAWS, EXACT_STEP = 60, 8  # draws, and every so many of the poses, of exact kinematics


def stated_of(robot: IdentifiedRobot) -> ToolCovariance | PoseCovariance:
    """The stated uncertainty of a robot, a covariance."""
    stated = robot.stated
    assert isinstance(stated, ToolCovariance | PoseCovariance), "nothing is stated of the robot"
    return stated


def coverage_factor(squares: Array, freedom: float | None, rng: np.random.Generator) -> float:
    """k that holds COVERAGE of drawn distances.

    squares : (D, n) [-] of n poses, squared and over their variance; with the tails of Student's
    distribution they get larger by one factor for each draw.
    """
    if freedom is not None:
        squares = squares * freedom / rng.chisquare(freedom, size=(len(squares), 1))
    return float(np.sqrt(np.quantile(squares, COVERAGE)))


def linear_squares(
    covariance: Array, columns: Array, sigma: Array, rng: np.random.Generator
) -> Array:
    """(DRAWS, G) [-] squared distances over the variance, by the linear law.

    covariance : (U, U) of what moves the tool by `columns` (3G, U). What sigma (G,) [m] is beyond
    it is equal in all directions.
    """
    by_pose = columns.reshape(len(sigma), 3, -1)
    spread = (columns @ covariance).reshape(by_pose.shape) @ by_pose.transpose(0, 2, 1)
    spread += ((sigma**2 - np.trace(spread, axis1=1, axis2=2)) / 3.0)[:, None, None] * np.eye(3)
    variances = np.maximum(np.linalg.eigvalsh(spread), 0.0)  # (G, 3)
    normal = rng.normal(size=(DRAWS, *variances.shape))
    return np.asarray((normal**2 * variances).sum(axis=2) / variances.sum(axis=1))


def is_in_doubt(robot: IdentifiedRobot, sigma: float) -> bool:
    """Whether the second order of the robot's uncertain angles is no small part of sigma [m]."""
    table, stated = robot.geometry.table, stated_of(robot)
    lever = float(np.linalg.norm(robot.poses(stated.poses(robot))[:, :3, 3], axis=1).max())
    angles = [k for k, i in enumerate(_parameters(robot)) if not table.parameters[i].is_length]
    second = 0.5 * np.diag(stated.values)[angles] * lever
    return float(np.linalg.norm(second)) > DOUBT * sigma


def _parameters(robot: IdentifiedRobot) -> NDArray[np.intp]:
    """(P,) indices into the table of the parameters that the stated covariance begins with."""
    stated, index = stated_of(robot), robot.geometry.table.index
    if isinstance(stated, PoseCovariance):
        return stated.parameters
    return np.array([index[name] for name in stated.names if name in index], dtype=np.intp)


def exact_squares(robot: IdentifiedRobot, rng: np.random.Generator) -> Array:
    """(EXACT_DRAWS, n) [-] squared distances over the variance, by the exact forward kinematics.

    What they add to the linear law is added to the linear errors of the stated covariance.
    """
    stated, parameters = stated_of(robot), _parameters(robot)
    chosen = slice(None, None, EXACT_STEP)
    q = stated.poses(robot)[chosen]
    columns = stated.columns(robot).reshape(-1, 3, len(stated.values))[chosen]
    values, vectors = np.linalg.eigh(stated.values)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    sigma = robot.sigma(q)
    rest = np.sqrt(np.maximum(0.0, sigma**2 - ((columns @ root) ** 2).sum(axis=(1, 2))) / 3.0)
    linear, here = robot.jacobian(q, parameters), robot.poses(q)[:, :3, 3]
    own, out = parameters.size, []
    for _ in range(EXACT_DRAWS):
        x = root @ rng.normal(size=len(root))
        geometry = robot.geometry.values.copy()
        geometry[parameters] += x[:own]
        moved = replace(
            robot,
            geometry=robot.geometry.with_values(geometry),
            values=robot.values + x[own : len(linear)],
        )
        beyond = moved.poses(q)[:, :3, 3] - here - np.einsum("u,ucn->nc", x[: len(linear)], linear)
        error = columns @ x + beyond + rest[:, None] * rng.normal(size=here.shape)
        out.append((error**2).sum(axis=1) / sigma**2)
    return np.array(out)
