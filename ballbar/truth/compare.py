"""An identified robot against the truth of its simulation, as ballbar.result.compare has it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, singledispatch
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import (
    Geometry,
    mirrored,
    nominal_chain,
    parameter_named,
    parameter_table,
    robot_frames,
    robot_geometry,
)
from ballbar.cell.recording import load_recording_file
from ballbar.cell.typical_machine import with_typical
from ballbar.ident.estimator.build_unknowns import arm_parameters
from ballbar.ident.loads.at_rest import backlash_flanks
from ballbar.ident.loads.gear_loads import mass_model, own_weight
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import accuracy_grid, position_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.table_estimate import TableEstimate
from ballbar.result.compare import Comparison, poses_within, robot_comparison, target_comparison
from ballbar.sim.settings import CellSettings
from ballbar.sim.true_robot import scenario_cell
from ballbar.sim.truth import PoseTruth, Truth, load_truth

if TYPE_CHECKING:  # a run compares what it has identified: it reads no result, nor simulates here
    from ballbar.result.calibration import Calibration
    from ballbar.sim.simulate import Simulation
    from ballbar.sim.still_poses import PoseSimulation


def result_against_truth(model: Calibration, truth_file: Path) -> Comparison:
    """A stored result against the truth that its recording or table was simulated from.

    Raises InputError where the truth is of something else than the result, or has not its target,
    and where its file fails.
    """
    return _of_result(load_truth(truth_file), model, truth_file)


@singledispatch
def _of_result(truth: Truth | PoseTruth, model: Calibration, file: Path) -> Comparison:
    raise NotImplementedError(truth, model, file)


@_of_result.register(Truth)
def _(truth: Truth, model: Calibration, file: Path) -> Comparison:
    if not model.of_logs:
        return _of_followed(truth, model, file)
    clock = model.file.logs[0].clock
    return compare_with_truth(
        model.identified_robot(),
        model.nominal,
        truth,
        model.file.identified,
        (clock.offset_s, clock.skew) if clock else None,
    )


@_of_result.register(PoseTruth)
def _(truth: PoseTruth, model: Calibration, file: Path) -> Comparison:
    if model.of_logs:
        raise _other_truth(file, "still poses", model, "recordings")
    name = next(iter(model.targets))
    if name not in truth.targets:
        raise InputError(
            f"target {name} is not in the truth, which has {', '.join(truth.targets)}. Name the "
            "truth file of this table."
        )
    arm, place = truth.arm(model.robot), truth.targets[name].position
    return _at_target(model, name, lambda q: arm.target(q, place), arm.chain)


def _of_followed(truth: Truth, model: Calibration, file: Path) -> Comparison:
    """The first target that an instrument followed. file : of the truth, beside the recording."""
    tracker, folder = truth.logs.tracker, file.with_name(file.name.removesuffix(".truth.yaml"))
    clock = next((group.clock for group in model.file.groups if group.clock), None)
    if tracker is None or clock is None:
        raise _other_truth(file, "recordings", model, "still poses")
    named, point, geometry = load_recording_file(folder), np.array(tracker.led_m), truth.geometry
    chosen = CellSettings(robot=named.robot, instrument=named.measured_by, plate=named.plate)
    actual = partial(true_tool, scenario_cell(chosen, relative_to=folder), truth, geometry)
    return replace(
        _at_target(model, next(iter(model.targets)), partial(actual, point=point), geometry.robot),
        offset=clock.offset_s - tracker.offset_s - sum(truth.logs.joint_lag_s[:1]),
        skew=clock.skew - tracker.skew,
    )


def _at_target(
    model: Calibration, name: str, actual: Callable[[Array], Array], chain: Chain
) -> Comparison:
    """A target over the fitted ranges; actual : where it is [m] at angles q. chain : the true."""
    robot = model.identified_robot(name)
    q, values = poses_within(robot.lower, robot.upper), _true_values(chain, robot.robot)
    compared = target_comparison(model, robot, q, actual(q), values)
    return replace(compared, target=name, predicted=(model.cross_validated,))


def _other_truth(file: Path, of_truth: str, model: Calibration, of_result: str) -> InputError:
    return InputError(
        f"{file}: is the truth of {of_truth}, and {model.path} is of {of_result}. Name the truth "
        "file of what the result was identified from."
    )


def compare_with_truth(
    model: IdentifiedRobot,
    nominal: Geometry,
    truth: Truth,
    names: Sequence[str],
    clock: tuple[float, float] | None,
) -> Comparison:
    """Model and nominal robot against what the recording was simulated from.

    clock : (offset [s], skew [-]) as identified, or None
    """
    reference = reference_of(truth)
    errors = (clock[0] - truth.clock.offset_s, clock[1] - truth.clock.skew) if clock else None
    actual = true_tool(model.cell, truth, reference, accuracy_grid(model.cell.robot))
    return robot_comparison(model, nominal, reference, actual, names, errors)


def against_simulation(result: Identification, made: Simulation | PoseSimulation) -> Comparison:
    """The result against the truth of what was simulated: poses, a recording, a followed robot."""
    if made.still is False and made.follower and result.poses:
        return followed_against_truth(result.poses, made.truth, made.cell)
    return identification_against_truth(result, made.truth)


def identification_against_truth(
    result: Identification, truth: Truth | PoseTruth, recording: int = 0
) -> Comparison:
    """The result against the truth that its poses, or one of its recordings, are simulated from."""
    return _of_identification(truth, result, recording)


@singledispatch
def _of_identification(
    truth: Truth | PoseTruth, result: Identification, recording: int
) -> Comparison:
    raise NotImplementedError(truth, result, recording)


@_of_identification.register
def _(truth: PoseTruth, result: Identification, _: int) -> Comparison:
    assert result.poses is not None, "tables of still poses were identified"
    return poses_against_truth(result.poses, truth)


@_of_identification.register
def _(truth: Truth, result: Identification, recording: int) -> Comparison:
    estimate = result.recordings[recording]
    clock = (estimate.clock.offset, estimate.clock.skew) if estimate.clock else None
    model = replace(result.robot.identified, geometry=estimate.geometry)
    names = [*result.robot.sigma, *estimate.sigma]
    return compare_with_truth(model, estimate.nominal, truth, names, clock)


def poses_against_truth(result: TableEstimate, truth: PoseTruth) -> Comparison:
    """The first target of a robot from still poses against the truth that they are simulated from.

    The nominal robot has its target fitted to the same poses.
    """
    name, model, before = result.target, result.identified_robot(), result.nominal
    q = model.workspace()
    actual = truth.arm(model.robot).target(q, truth.targets[name].position)
    target = before.model.unknowns.target(before.x, name)
    bare = replace(model.rigid(robot_geometry(model.robot)), target=target)
    return Comparison(
        {}, position_error(model.tool(q), actual), position_error(bare.tool(q), actual), target=name
    )


def followed_against_truth(result: TableEstimate, truth: Truth, cell: Cell) -> Comparison:
    """The target of a robot that a tracker followed against the truth of its recording.

    cell : that was simulated.
    """
    assert truth.logs.tracker is not None, "a tracker followed the robot"
    model, before, led = result.identified_robot(), result.nominal, truth.logs.tracker.led_m
    q, robot = model.workspace(), model.robot
    actual = true_tool(cell, truth, truth.geometry, q, np.array(led))
    target = before.model.unknowns.target(before.x, result.target)
    bare = replace(model.rigid(robot_geometry(robot)), target=target)
    clock, _ = next(iter(result.clocks.values()))  # of the first recording
    return Comparison(
        {},
        position_error(model.tool(q), actual),
        position_error(bare.tool(q), actual),
        offset=clock.offset - truth.logs.tracker.offset_s - sum(truth.logs.joint_lag_s[:1]),
        skew=clock.skew - truth.logs.tracker.skew,
        target=result.target,
    )


def reference_of(truth: Truth) -> Geometry:
    """The true geometry as the declared directions of b2 and b4 describe it.

    Which of the two directions is positive is a gauge: the logs do not tell.
    """
    geometry = truth.geometry
    for joint in (2, 4):
        if truth.directions.get(f"b{joint}") == -1:
            geometry = mirrored(geometry, joint)
    return geometry


def _true_values(chain: Chain, robot: Robot) -> dict[str, tuple[float, float]]:
    """True values, sigma 0; of parallel axes the first d has what the others differ by."""
    nominal = nominal_chain(robot)
    d = chain.d.copy()
    for name in reversed(parameter_table(robot).hayati[:-1]):
        row = parameter_named(name).row
        d[row] += d[row + 1] - nominal.d[row + 1]
    values = {"d": d, "a": chain.a, "alpha": chain.alpha, "theta": chain.theta, "beta": chain.beta}
    return {p.name: (float(values[p.kind][p.row]), 0.0) for p in arm_parameters(robot)}


def true_tool(
    cell: Cell, truth: Truth, geometry: Geometry, q: Array, point: Array | None = None
) -> Array:
    """(N, 3) [m] tool positions in the robot's base frame, at logged joint angles q (N, 6) [rad].

    It is the reference of the TCP error: the true robot without load. Resolver errors, transmission
    errors, compliance under the weight of arm and plate, and backlash are all part of the map from
    logged angles to the tool, and an identified robot is judged by that map. Where hardly any
    weight loads a gear, its backlash is counted in the middle (notes/identification sec. 1).

    geometry : the true one, as the declared directions describe it (`reference_of`). point : (3,)
    [m] in the tool's frame, in place of its origin.
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
        if plant.typical:  # masses and centres are all that counts, and those are stated
            cell = replace(cell, robot=with_typical(robot)[0])
        loaded = cell if plant.masses is None else plant.masses.on(cell)
        weight = own_weight(mass_model(loaded), geometry, q).gear.T
        side = backlash_flanks(weight.T).T
        gears = (
            gears
            - weight / np.array(plant.gear_stiffness_N_m_per_rad)
            - np.array(plant.gear_backlash_half_width_rad) * side
        )
    frames = robot_frames(geometry, gears @ robot.gear_to_joint)
    if point is None:
        return frames.tip.T
    return np.asarray(frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), point))
