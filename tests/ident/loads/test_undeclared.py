"""Gravity that leans and a force at the tool are told from other masses by the motor torques."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import robot_frames
from ballbar.cell.payload import Payload, with_payload
from ballbar.ident.loads.gear_loads import loads, mass_model
from ballbar.ident.loads.logged_tension import LoggedTorque
from ballbar.ident.loads.payload import PayloadEstimate, payload_of_recordings
from ballbar.ident.loads.undeclared import undeclared_columns
from ballbar.ident.remarks import loaded_otherwise, offset_remark
from tests.helpers.logged_torques import logged
from tests.helpers.synthetic_recording import CELL, NOMINAL

OFFSET = 20.0  # [N m] of a motor's torque: its current sensor's


def leaning(degrees: float) -> Cell:
    turn = Rotation.from_rotvec(np.deg2rad([degrees, 0.0, 0.0]))
    gravity = turn.apply(np.array(CELL.robot.gravity))
    return replace(CELL, robot=replace(CELL.robot, gravity=gravity))


def found(log: LoggedTorque) -> PayloadEstimate:
    return payload_of_recordings(CELL, [NOMINAL], [log])


def pulled(log: LoggedTorque, force: Array) -> LoggedTorque:
    """The torques beside a constant force (3,) [N] at the tool."""
    frames = robot_frames(NOMINAL, log.q)
    arms = frames.tip - frames.origin[: CELL.robot.joints]  # (J, 3, N)
    moments = np.cross(arms.transpose(0, 2, 1), force)
    axes = frames.z[: CELL.robot.joints].transpose(0, 2, 1)
    at_joints = (axes * moments).sum(axis=2)
    return replace(log, torque=log.torque - CELL.robot.gear_to_joint @ at_joints)


def test_columns_of_gravity_are_what_its_change_adds_to_the_loads() -> None:
    level, log = logged(CELL), logged(leaning(90.0))
    columns = undeclared_columns(CELL, NOMINAL, robot_frames(NOMINAL, log.q), log)["gravity"]
    change = leaning(90.0).robot.gravity - CELL.robot.gravity
    to_joint = CELL.robot.gear_to_joint
    leant = loads(
        mass_model(leaning(90.0)),
        NOMINAL,
        q=log.q,
        b=log.ballbar,
        speed=log.speed.T @ to_joint,
        acceleration=log.acceleration.T @ to_joint,
    )
    expected = leant.gear - level.carried.gear
    np.testing.assert_allclose(np.einsum("k,kjn->jn", change, columns), expected, atol=1e-8)


@pytest.mark.parametrize("degrees", [1.0, 5.0, 90.0])
def test_gravity_beside_the_robots_file_is_found_with_its_direction(degrees: float) -> None:
    sentence = loaded_otherwise(found(logged(leaning(degrees))))
    assert "gravity does not point where the robot's file says" in sentence
    assert float(sentence.split("it is ")[1].split(" degrees")[0]) == pytest.approx(
        degrees, abs=0.02 * degrees + 0.1
    )
    vector = np.array(sentence.split("[")[1].split("]")[0].split(","), dtype=float)
    least = 9.81 * np.deg2rad(0.02 * degrees + 0.1)  # [m/s^2] of the same error of the angle
    np.testing.assert_allclose(vector, leaning(degrees).robot.gravity, atol=least)


def test_a_force_at_the_tool_is_found_with_its_size() -> None:
    sentence = loaded_otherwise(found(pulled(logged(CELL), np.array([0.0, 40.0, 30.0]))))
    assert "a force of " in sentence
    assert float(sentence.split("a force of ")[1].split(" N")[0]) == pytest.approx(50.0, rel=0.2)


def test_a_heavier_tool_and_an_offset_are_neither() -> None:
    body = CELL.plate.body
    heavier = with_payload(CELL, Payload(2.0 * body.mass, body.com))
    offset = logged(CELL)
    offset = replace(offset, torque=offset.torque + OFFSET)
    for log in (logged(CELL), logged(heavier), offset):
        assert found(log).undeclared == ""
    assert found(logged(heavier)).significant


def test_an_offset_of_the_torques_is_no_mass() -> None:
    log = logged(CELL)
    offset = replace(log, torque=log.torque + OFFSET * np.array([[0, 1, 0, 0, 0, 0]]).T)
    with_offset, without = found(offset), found(log)
    assert with_offset.payload.mass == pytest.approx(without.payload.mass, abs=0.3)
    assert offset_remark(without) == ""
    assert "logged torques have an offset: gear 2 by +19 N m" in offset_remark(with_offset)
