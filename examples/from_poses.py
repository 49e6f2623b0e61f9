"""Identify a robot from still poses as arrays: joint angles and measured points.

    python examples/from_poses.py

A drawn UR10 stands in for your measurement; replace the first part by your own arrays.
"""

from dataclasses import replace

import numpy as np

import ballbar
from ballbar import FitOptions, PoseGroup, PoseTable, load_robot
from ballbar.cell.chain import Chain, forward

# 150 poses of a UR10 whose joint 4 has its zero 2 mrad off and whose upper arm is 0.4 mm longer. A
# tracker at an unknown place measures a reflector with 20 um of noise along each axis.
robot = load_robot("ur10")
theta, a = robot.theta.copy(), robot.a.copy()
theta[3] += 2e-3
a[1] -= 0.4e-3
true = Chain(a, robot.d, robot.alpha, theta, np.zeros(6))
rng = np.random.default_rng(1)


def measured(q: np.ndarray) -> np.ndarray:
    """(N, 3) [m] points in the tracker's frame, at joint angles q (N, 6) [rad]."""
    frames = forward(true, q)
    reflector = frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), [0.05, 0.0, 0.1])
    return reflector - [2.0, -1.0, 0.5] + rng.normal(0.0, 2e-5, (len(q), 3))


def table_of(q: np.ndarray) -> PoseTable:
    """A table as `ballbar.read` makes it of files."""
    group = PoseGroup(
        measured="point",
        seat="tracker",
        target="reflector",
        q=q,
        values=measured(q),
        sigma=np.full((len(q), 3), 2e-5),
        rows=np.arange(1, len(q) + 1),
        file="arrays",
    )
    return PoseTable("example", robot, (group,))


table = table_of(rng.uniform(-2.0, 2.0, (150, 6)))
result = ballbar.identify(table, options=FitOptions(joint_errors="none"))
print(result.sentence)
print(f"joint 4 zero: {(result.chain.theta[3] - robot.theta[3]) * 1e3:+.3f} mrad")
print(f"upper arm: {(result.chain.a[1] - robot.a[1]) * 1e3:+.3f} mm")

q, arm = rng.uniform(-1.5, 1.5, (3, 6)), result.kinematics()  # of the robot with its reflector
points, sigmas = arm.forward(q)[:, :3, 3], arm.uncertainty(q).sigma  # [m] robot base frame
for point, sigma in zip(points, sigmas, strict=True):
    print(f"reflector at {np.round(point, 4)} m, sigma {sigma * 1e3:.3f} mm")

# A week later, joint 3 has lost its zero: ten poses tell.
shown = rng.uniform(-1.8, 1.8, (10, 6))
later = table_of(shown + np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0]))
later = replace(later, groups=(replace(later.groups[0], q=shown),))
print(ballbar.verify(result, later).sentence)
