"""Terms that a complete model has only where the data ask for them: planted ones are found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.chain import joint_screws, screw
from ballbar.cell.geometry import robot_frames
from ballbar.cell.logs import RobotLog
from ballbar.cell.robot_angles import joints_to_motors, motors_to_joints
from ballbar.ident.complete_fit import fit_complete, refit
from ballbar.ident.corrections import ON_EVIDENCE, supported_corrections
from ballbar.ident.corrections.gear_ratio import GEAR_RATIO
from ballbar.ident.corrections.gear_softening import GEAR_SOFTENING, gear_softening, knees_of
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.model_choice import lasting, unsupported
from ballbar.ident.options import SILENT, FitOptions
from ballbar.ident.recording_fit import Logs, fit_recording
from ballbar.ident.remarks import change_remarks, wrong_ratios
from ballbar.ident.softening import fit_softening, moved_knees, search_knees
from tests.helpers.known_loads import motion_at, tension_at
from tests.helpers.minute_logs import minute_logs
from tests.helpers.synthetic_recording import CELL, NOMINAL

OPTIONS = FitOptions(model="complete", samples=400)
STIFFNESS = CELL.robot.required("gears").stiffness


def elastic(*, seed: int = 0) -> Logs:
    """Gears as elastic as the catalogue's, motor torques logged."""
    return minute_logs(compliance=1.0, torque=True, seed=seed)


def changed(logs: Logs, change: Callable[[Array, Array], Array]) -> Logs:
    """The logs with joint angles (N, 6) [rad] changed; change : of times and angles."""
    log = logs.robot
    return replace(logs, robot=RobotLog(log.t, change(log.t, log.q), torque=log.torque))


def fitted(*logs: Logs) -> Fit:
    recordings = [fit_recording(CELL, one, OPTIONS) for one in logs]
    return fit_complete(CELL, recordings, supported_corrections(CELL.robot), OPTIONS)


def found(fit: Fit) -> dict[str, float]:
    return dict(zip(fit.model.unknowns.names, fit.x.tolist(), strict=True))


def names(fit: Fit) -> set[str]:
    return {correction.name for correction in fit.model.corrections}


@pytest.fixture(scope="module")
def sound() -> Fit:
    return fitted(elastic(), elastic(seed=1))


def test_a_machine_that_needs_none_of_them_gets_none(sound: Fit) -> None:
    assert not names(sound) & set(ON_EVIDENCE)
    assert search_knees(sound) == []


def test_lags_of_single_joints_are_found_relative_to_the_first() -> None:
    """Filters of the first order; together they shift the clock."""
    lags = np.array([8e-3, 10e-3, 12e-3, 8e-3, 10e-3, 12e-3])

    def late(t: Array, q: Array) -> Array:
        out = q.copy()
        step = float(t[1] - t[0])
        for joint, lag in enumerate(lags):
            share = step / (lag + step)
            for row in range(1, len(t)):
                out[row, joint] = (1.0 - share) * out[row - 1, joint] + share * q[row, joint]
        return out

    fit = fitted(changed(elastic(), late))
    assert "joint_lag" in names(fit)
    values = found(fit)
    gears = lags @ np.abs(CELL.robot.joint_to_gear) / np.abs(CELL.robot.joint_to_gear).sum(axis=0)
    for gear in (1, 4):  # those that a coupled joint does not mix
        assert values[f"lag{gear + 1}"] == pytest.approx(gears[gear] - gears[0], abs=5e-4)
    assert fit.chi2_per_dof < 1.3


def scaled(logs: Logs, factor: float) -> Logs:
    """The logs with motor 6 turning by a factor further."""

    def change(_: Array, q: Array) -> Array:
        motors = joints_to_motors(CELL.robot, q)
        motors[:, 5] *= factor
        return motors_to_joints(CELL.robot, motors)

    return changed(logs, change)


def test_a_motor_that_is_scaled_is_a_gear_of_another_ratio() -> None:
    fit = fitted(scaled(elastic(), 1.001))
    assert GEAR_RATIO in names(fit)
    assert found(fit)["ratio6"] == pytest.approx(-1e-3, rel=0.05)
    sigma = np.sqrt(np.diag(fit.covariance))
    assert "gear 6 turns 0.999" in wrong_ratios(fit, sigma)


def test_what_a_slow_error_of_a_joint_looks_like_is_no_other_ratio() -> None:
    """1e-4 rad of the third order over part of a turn; such a term doubled the TCP error."""
    assert GEAR_RATIO not in names(fitted(scaled(elastic(), 1.0004)))


def test_bearings_that_tilt_are_found_and_their_loss_is_the_free_robots_too() -> None:
    compliance = 3e-7  # [rad/(N m)] of every axis

    def tilted(t: Array, q: Array) -> Array:
        motion = motion_at(t)
        moments = motion.carried.bearings(tension_at(t))
        frames = robot_frames(NOMINAL, q)
        moved = np.zeros((6, t.size))
        for joint in range(3):
            for kind, moment in zip(("alpha", "beta"), moments[joint], strict=True):
                moved -= compliance * moment * screw(frames, kind, joint - 1)
        columns = joint_screws(frames).transpose(2, 1, 0)
        return q - np.linalg.solve(columns, moved.T[:, :, None])[:, :, 0]

    fit = fitted(changed(elastic(), tilted))
    assert "bearing_tilt" in {c.name for c in lasting(fit)}
    values = found(fit)
    for name in ("tilt1x", "tilt1y", "tilt2x"):
        assert values[name] == pytest.approx(compliance, rel=0.1), name
    assert "tilt2y" not in values  # gear 1 holds it
    assert "bearing_tilt" not in unsupported(fit)
    x = fit.x.copy()
    x[fit.model.unknowns.names.index("tilt1x")] = -compliance
    negative = replace(fit, linear=replace(fit.linear, x=x))
    assert "bearing_tilt" in unsupported(negative)


def test_a_remounted_tool_and_links_that_grow_are_found_and_named() -> None:
    shift = 5e-5  # [m] along the plate

    def grown(t: Array, q: Array) -> Array:
        return q + _steps(q, {"ra2": 4e-5 * t / 60.0})

    def remounted(t: Array, q: Array) -> Array:
        return q + _steps(q, {"ra6": np.full_like(t, shift)})

    fit = fitted(changed(elastic(), grown), changed(elastic(seed=1), remounted))
    assert {"link_growth", "remounted_tool"} <= names(fit)
    values = found(fit)
    assert values["remount_ra6@2"] == pytest.approx(shift, abs=3e-6)
    remarks = " ".join(change_remarks(fit, fit.covariance))
    assert "a2 grew by +4" in remarks or "a2 grew by +3" in remarks
    assert "the tool sits elsewhere in recording 2 than in the first, by 5" in remarks


def _steps(q: Array, grown: dict[str, Array]) -> Array:
    """(N, 6) [rad] by which joints move when links grow and the tool has to stay."""
    frames, moved = robot_frames(NOMINAL, q), np.zeros((6, len(q)))
    table = NOMINAL.table
    for name, size in grown.items():
        parameter = table.parameters[table.index[name]]
        moved += size * screw(frames, parameter.kind, parameter.row)
    columns = joint_screws(frames).transpose(2, 1, 0)
    return -np.linalg.solve(columns, moved.T[:, :, None])[:, :, 0]


def softer_below(gear: int, knee: float) -> Logs:
    """Logs of a gear, from 0, that is half as stiff below a knee [N m]."""

    def softer(t: Array, q: Array) -> Array:
        load = motion_at(t).carried.gears(tension_at(t))
        more = np.zeros_like(load)
        more[gear] = np.clip(load[gear], -knee, knee) / STIFFNESS[gear]
        return q + more.T @ CELL.robot.gear_to_joint

    return changed(elastic(), softer)


def test_a_gear_that_is_softer_below_a_knee_is_found_with_its_knee() -> None:
    gear, knee = 1, 120.0  # [N m]
    recording = fit_recording(CELL, softer_below(gear, knee), OPTIONS)
    fit = fit_complete(CELL, [recording], supported_corrections(CELL.robot), OPTIONS)
    fit = fit_softening(CELL, fit, SILENT)
    (correction,) = (c for c in fit.model.corrections if c.name == GEAR_SOFTENING)
    ((where, at),) = knees_of(c.name for c in correction.coefficients)
    assert where == gear
    assert at == pytest.approx(knee, rel=0.1)
    assert found(fit)[correction.coefficients[0].name] == pytest.approx(
        1.0 / STIFFNESS[gear], rel=0.15
    )


def test_a_knee_that_is_off_moves_to_where_the_gear_has_it() -> None:
    """Most of the way at once; a small one moves by no more than two fifths."""
    gear, knee = 1, 120.0  # [N m]
    recording = fit_recording(CELL, softer_below(gear, knee), OPTIONS)
    fit = fit_complete(CELL, [recording], ["joint_compliance"], OPTIONS)
    for begin, end in ((110.0, knee), (60.0, 1.4 * 60.0)):
        ((where, at),) = moved_knees(refit(fit, [gear_softening(CELL.robot, [(gear, begin)])]))
        assert where == gear
        assert at == pytest.approx(end, rel=0.05)
