"""Serve an identified robot to other programs: poses, joint angles, Jacobian, uncertainty.

    python examples/serve_kinematics.py runs/irb2400

A ROS 2 node keeps the object and answers in a callback; nothing else of this project is needed:

    robot = ballbar.load("runs/irb2400").kinematics()

    def on_joint_states(self, message: JointState) -> None:
        q = np.array([message.position[:6]])  # [rad], joints of the DH model
        x, y, z = robot.forward(q)[0, :3, 3]  # [m], robot base frame
        self.publisher.publish(PointStamped(header=message.header, point=Point(x=x, y=y, z=z)))
"""

import sys

import numpy as np

import ballbar

robot = ballbar.load(sys.argv[1]).kinematics()

axes = np.radians([[0.0, 10.0, 10.0, 30.0, 60.0, 20.0]])  # as the controller shows them
q = ballbar.controller_to_joints(robot.robot, axes)
pose = robot.forward(q)
print(f"tool at {np.round(pose[0, :3, 3] * 1e3, 3)} mm, with gears wound up by the arm's weight")

lifted = pose.copy()
lifted[0, 2, 3] += 0.05
solution = robot.nearest(lifted, q)
print(f"50 mm higher: {np.round(np.degrees(solution.q[0]), 3)} deg, reached {solution.reached[0]}")
every = robot.inverse(lifted)
print(f"configurations within the axis ranges: {int((every.reached & every.within).sum())}")
print(f"speed of the tool by joint 2: {np.round(robot.jacobian(q)[0, :3, 1], 3)} m/rad")
