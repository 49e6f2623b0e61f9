"""Identify a robot from arrays: angles of robot and ball-bar over time, each on its own clock.

    python examples/from_arrays.py

The simulated cell stands in for your loggers; replace the first part by your own arrays.
"""

import numpy as np

from ballbar import (
    BallBarLog,
    FitOptions,
    RobotLog,
    accuracy_grid,
    identify,
    load_scenario,
    scenario_file,
    simulate,
    tcp_error,
)

# Two minutes of an IRB 2400 with known errors. The loggers add 10 urad of noise; the ball-bar's
# clock starts 0.2 s after the robot's.
file = scenario_file("irb2400")
simulation = simulate(load_scenario(file), relative_to=file.parent)
rng = np.random.default_rng(1)
t_robot = np.arange(0.0, 119.0, 0.004)  # (N,) [s]
t_ballbar = np.arange(0.0, 118.0, 0.010)  # (M,) [s]
q = simulation.motion.shown_at(t_robot) + rng.normal(0.0, 1e-5, (t_robot.size, 6))  # [rad]
b = simulation.motion.bar_at(t_ballbar + 0.2) + rng.normal(0.0, 1e-5, (t_ballbar.size, 5))  # [rad]

# From here on as in a real cell. `joints` says which ball-bar joints have an encoder.
robot_log = RobotLog(t_robot, q)
ballbar_log = BallBarLog(t_ballbar, b, joints=(1, 2, 3, 4, 5))
result = identify(simulation.cell, robot_log, ballbar_log, options=FitOptions(model="dh"))

print(result.verdict.sentence)
for name in ("ra2", "rd4", "ralpha3", "rtheta5"):  # DH parameters of the robot, in mm and mrad
    value, sigma = result.robot.geometry[name] * 1e3, result.robot.sigma[name] * 1e3
    print(f"{name:8} {value:+10.4f} +- {sigma:.4f}")

grid = accuracy_grid(simulation.cell.robot)  # (G, 6) [rad] poses over the workspace
error = tcp_error(result.robot.geometry, simulation.truth.geometry, grid)
print(
    f"TCP error over the workspace: {error.mean * 1e3:.4f} mm, largest {error.maximum * 1e3:.4f} mm"
)
