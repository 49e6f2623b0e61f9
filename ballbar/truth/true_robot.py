"""The TCP of a simulation's true robot without load: the reference of the TCP error.

Resolver errors, transmission errors, compliance under the weight of arm and plate, and backlash are
all part of the map from logged angles to the tool, and an identified robot is judged by that map.
Where hardly any weight loads a gear, its backlash is counted in the middle (notes/identification
sec. 1, metric).
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry, robot_frames
from ident.loads.at_rest import backlash_flanks
from ident.loads.gear_loads import mass_model, own_weight
from sim.truth import Truth


def true_tool(cell: Cell, truth: Truth, geometry: Geometry, q: Array) -> Array:
    """(N, 3) [m] tool positions in the robot's base frame, at logged joint angles q (N, 6) [rad].

    geometry : the true one, as the declared directions describe it (`reference_of`)
    """
    robot, plant = cell.robot, truth.plant
    motors = q @ np.linalg.inv(robot.transmission)
    read = motors.copy()
    if truth.logs.resolvers is not None:
        for i, harmonics in enumerate(truth.logs.resolvers.motors):
            motors[:, i] -= sum(h.at(read[:, i]) for h in harmonics)
    shown = motors @ robot.transmission @ robot.joint_to_gear
    gears = shown.copy()
    for _ in range(3):  # the ripple is that of the output's angle; each turn gains three digits
        error = np.zeros_like(gears)
        for r in plant.transmission_error:
            error[:, r.axis - 1] += r.amplitude_rad * np.sin(
                r.cycles_per_turn * gears[:, r.axis - 1] + r.phase_rad
            )
        gears = shown + error
    if plant.gear_stiffness_N_m_per_rad is not None:
        loaded = cell if plant.masses is None else plant.masses.on(cell)
        weight = own_weight(mass_model(loaded), geometry, q).gear.T
        side = backlash_flanks(weight.T).T
        gears = (
            gears
            - weight / np.array(plant.gear_stiffness_N_m_per_rad)
            - np.array(plant.gear_backlash_half_width_rad) * side
        )
    return robot_frames(geometry, gears @ robot.gear_to_joint).tip.T
