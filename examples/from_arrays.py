"""Identify a robot from arrays: angles of robot and ball-bar over time, each on its own clock.

    python examples/from_arrays.py

The simulated cell stands in for your loggers; replace the first part by your own arrays.
"""

import numpy as np

import ballbar
from ballbar import BallBarLog, FitOptions, Logs, RobotLog, accuracy_grid, tcp_error

# Two minutes of an IRB 2400 with known errors. The loggers add 10 urad of noise; the ball-bar's
# clock starts 0.2 s after the robot's.
simulation = ballbar.simulate("irb2400")
rng = np.random.default_rng(1)
t_robot = np.arange(0.0, 119.0, 0.004)  # (N,) [s]
t_ballbar = np.arange(0.0, 118.0, 0.010)  # (M,) [s]
q = simulation.motion.shown_at(t_robot) + rng.normal(0.0, 1e-5, (t_robot.size, 6))  # [rad]
b = simulation.motion.bar_at(t_ballbar + 0.2) + rng.normal(0.0, 1e-5, (t_ballbar.size, 5))  # [rad]

# From here on as in a real cell. `joints` says which ball-bar joints have an encoder.
logs = Logs(RobotLog(t_robot, q), BallBarLog(t_ballbar, b, joints=(1, 2, 3, 4, 5)))
result = ballbar.identify(logs, cell=simulation.cell, options=FitOptions(model="dh"))

print(result.sentence)
print(result.to_frame().loc[""].loc[["ra2", "rd4", "ralpha3", "rtheta5"]])  # m and rad

grid = accuracy_grid(simulation.cell.robot)  # (G, 6) [rad] poses over the workspace
error = tcp_error(result.geometry, simulation.truth.geometry, grid)
print(
    f"TCP error over the workspace: {error.mean * 1e3:.4f} mm, largest {error.maximum * 1e3:.4f} mm"
)
