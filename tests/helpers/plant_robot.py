"""The true robot of a scenario, unloaded, held in the plant: what corrected targets reach."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import robot_frames
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.corrections.gear_ripple import harmonic_orders
from ballbar.ident.identify import identify_together
from ballbar.ident.options import DEFAULT_SAMPLES, FitOptions
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.inverse_calibration import TargetError, corrected_targets
from ballbar.sim.plant.effects import PlantEffects
from ballbar.sim.plant.held import hold_machine, pose_distance
from ballbar.sim.true_robot import TrueMachine, true_machine
from tests.helpers.drawn_robots import SCENARIOS, recorded, scenario_of

POSES = 200
GEARS = ("joint_compliance", "gear_backlash", "gear_ripple")


def known_robot(plant: TrueMachine) -> IdentifiedRobot:
    """The robot of a perfect identification: the plant's numbers as coefficients."""
    effects, robot = plant.effects, plant.cell.robot
    assert effects.gear_stiffness is not None
    waves = {(r.gear, r.order): r.amplitude * np.exp(1j * r.phase) for r in effects.ripples}
    for i, harmonics in enumerate(plant.resolvers.motors if plant.resolvers else ()):
        share = float(robot.transmission[i, i])
        for h in harmonics:  # what the controller reads too much, the gear stands behind
            order = h.order / abs(share)
            phase = h.phase_rad if share > 0.0 else np.pi - h.phase_rad
            waves[i, order] = waves.get((i, order), 0j) - share * h.amplitude_rad * np.exp(
                1j * phase
            )
    cell = known_cell(plant.cell, effects)
    found = [waves.get((gear, order), 0j) for gear, order, _ in harmonic_orders(cell.robot)]
    ripple = [part for z in found for part in (z.real, z.imag)]
    values = np.concatenate((1.0 / effects.gear_stiffness, effects.gear_backlash, ripple))
    return IdentifiedRobot(
        cell, plant.true, tuple(CORRECTIONS[name](cell, ()) for name in GEARS), values
    )


def known_cell(cell: Cell, effects: PlantEffects) -> Cell:
    """The cell with its true masses and with every order of its gears' ripple in its list."""
    loaded = cell if effects.masses is None else effects.masses.on(cell)
    gears = loaded.robot.required("gears")
    listed = [dict(harmonics) for harmonics in gears.harmonics]
    for ripple in effects.ripples:
        listed[ripple.gear].setdefault(ripple.order, ripple.amplitude)
    known = replace(gears, harmonics=tuple(tuple(orders.items()) for orders in listed))
    return replace(loaded, robot=replace(loaded.robot, gears=known))


def study(plant: TrueMachine, identified: IdentifiedRobot, poses: int) -> dict[str, object]:
    """Figures of one robot: pose errors of held targets, nominal and corrected."""
    q = accuracy_grid(plant.cell.robot)[:poses]
    while True:
        try:
            corrected = corrected_targets(identified, plant.nominal.robot, q)
            break
        except TargetError as error:  # at a singularity; counted
            q = np.delete(q, list(error.faults), axis=0)
    wanted = robot_frames(plant.nominal, q)
    before, after = hold_machine(plant, q), hold_machine(plant, corrected.q)
    known = pose_distance(
        wanted, hold_machine(plant, corrected_targets(known_robot(plant), plant.nominal.robot, q).q)
    )[0]
    aligned = position_error(wanted.tip.T, after.tool[:, :3, 3])
    (p0, a0), (p1, a1) = pose_distance(wanted, before), pose_distance(wanted, after)
    return {
        "poses": len(q),
        "refused": poses - len(q),
        "before_mean_mm": p0.mean() * 1e3,
        "before_max_mm": p0.max() * 1e3,
        "after_mean_mm": p1.mean() * 1e3,
        "after_max_mm": p1.max() * 1e3,
        "before_mean_mrad": a0.mean() * 1e3,
        "after_mean_mrad": a1.mean() * 1e3,
        "after_aligned_mean_mm": aligned.mean * 1e3,
        "after_scale_known_mean_mm": aligned.error_without_scale.mean() * 1e3,
        "known_mean_mm": known.mean() * 1e3,
        "known_max_mm": known.max() * 1e3,
        "predicted_before_mean_mm": corrected.position_before.mean() * 1e3,
        "readings_miss_urad": np.abs(after.miss).max() * 1e6,
    }


def robot_row(
    robot: str, seed: int, duration: float, *, poses: int = POSES, samples: int = DEFAULT_SAMPLES
) -> dict[str, object]:
    """One drawn robot: recorded, identified, corrected, held."""
    scenario = scenario_of(robot, "a", seed, duration)
    with tempfile.TemporaryDirectory() as folder:
        made = [recorded(scenario_of(robot, p, seed, duration), Path(folder) / p) for p in "ab"]
    options = FitOptions(model="complete", force="torque", samples=samples)
    found = identify_together(made[0][0], [logs for _, logs, _ in made], options=options)
    return {"robot": robot, "seed": seed} | study(
        true_machine(scenario, relative_to=SCENARIOS), found.robot.identified, poses
    )
