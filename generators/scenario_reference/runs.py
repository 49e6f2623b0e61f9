"""Runs of the main scenario with some settings changed, and what their logs say at chosen times."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, bar_frames, nominal_geometry, robot_frames
from ballbar.sim.errors.sample_errors import SampleErrors, delay_of
from ballbar.sim.kinematic_samples import KinematicSamples, kinematic_samples, sample_path_at
from ballbar.sim.logging.encoders import BarEncoder, motor_angles, read_counts
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.simulate import Simulation, simulate

ROOT = Path(__file__).parents[2]

Changes = Mapping[str, Mapping[str, Any]]
POSITION = [0.70, 0.0, 0.54]  # [m] of scenarios/irb2400.yaml
BASE: Changes = {
    "cell": {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": POSITION},
    "path": {
        "kind": "lissajous",
        "file": "paths/irb2400_a.yaml",
        "duration_s": 60.0,
        "dwell_s": 2.0,
        "stops": 1,
    },
    "errors": {"static": {"table": "thesis_3_1"}},
}


@dataclass(frozen=True, eq=False)
class Run:
    """A simulated run and its settings; errors of paired samples are those of `View.samples`."""

    settings: SimulationSettings
    simulation: Simulation

    @property
    def pairs(self) -> bool:
        """Whether an error source of paired samples is switched on."""
        return any(
            getattr(self.settings.errors, name) is not None for name in SampleErrors.model_fields
        )


def run(changes: Changes) -> Run:
    """The main scenario in 60 s, without noise, with some settings changed."""
    return _run(json.dumps(merged(BASE, changes), sort_keys=True))


@cache
def _run(changed: str) -> Run:
    settings = SimulationSettings.model_validate_json(changed)
    logged = settings.errors.model_copy(update=dict.fromkeys(SampleErrors.model_fields))
    return Run(
        settings,
        simulate(settings.model_copy(update={"errors": logged}), relative_to=ROOT / "scenarios"),
    )


def merged(base: Changes, changes: Changes) -> Changes:
    """The settings of base, section by section with the changes."""
    return {key: {**base.get(key, {}), **changes.get(key, {})} for key in sorted({*base, *changes})}


@dataclass(frozen=True, eq=False)
class View:
    """Content of the logs of one run at times t (N,) [s], the same for both devices."""

    run: Run
    t: Array
    known: Geometry  # what an identifier would know: the geometry of the run without the source
    counted: bool  # whether ball-bar angles go through the counters, whose steps roughen a plot

    @property
    def simulation(self) -> Simulation:
        return self.run.simulation

    @cached_property
    def true_angles(self) -> tuple[Array, Array]:
        """(N, 6), (N, 5) [rad] motor angles at the joints, ball-bar angles; before any sensor."""
        motion = self.simulation.motion
        return motion.shown_at(self.t), motion.bar_at(self.t)

    @cached_property
    def q(self) -> Array:
        """(N, 6) [rad] robot angles by the log."""
        if self.run.pairs:
            return self.samples.q
        robot, settings = self.simulation.cell.robot, self.run.settings
        motors = motor_angles(
            robot, self.true_angles[0], settings.errors, self.simulation.resolvers, settings.seed
        )
        return np.asarray(motors @ robot.transmission)

    @cached_property
    def b(self) -> Array:
        """(N, 5) [rad] ball-bar angles by the log, zeros known."""
        if self.run.pairs:
            return self.samples.b
        if not self.counted:
            return self.true_angles[1]
        return np.stack([self._counted(encoder) for encoder in self.simulation.encoders], axis=1)

    @cached_property
    def samples(self) -> KinematicSamples:
        """Paired samples of the run at these times."""
        settings, cell = self.run.settings, self.simulation.cell
        nominal = nominal_geometry(cell, settings.cell.position)
        path = sample_path_at(
            cell, nominal, self.simulation.path, self.t, delay=delay_of(settings.errors)
        )
        return kinematic_samples(settings, path)

    def _counted(self, encoder: BarEncoder) -> Array:
        settings, angle = self.run.settings, self.true_angles[1][:, encoder.joint - 1]
        read = read_counts(encoder, angle, self.t, settings.errors.signal_noise, settings.seed)
        counts = read.astype(np.int32)
        return np.asarray(
            encoder.direction * counts * (2.0 * np.pi / encoder.counts_per_turn) + encoder.offset
        )

    @property
    def residual(self) -> Array:
        """(N, 3) [m] tool by the ball-bar's log minus tool by the robot's log, rigid kinematics."""
        return np.asarray(
            (bar_frames(self.known, self.b).tip - robot_frames(self.known, self.q).tip).T
        )

    @property
    def gears(self) -> Array:
        """(N, 6) [rad] gear outputs by the log."""
        return np.asarray(self.q @ self.simulation.cell.robot.joint_to_gear)

    @property
    def behind_gears(self) -> Array:
        """(N, 6) [rad] what the gears really turn, minus what the log says."""
        motion = self.simulation.motion
        return self._sampled((motion.q - motion.shown) @ self.simulation.cell.robot.joint_to_gear)

    @property
    def torque(self) -> Array:
        """(N, 6) [N m] of the servos, at the gears' outputs."""
        assert self.simulation.motion.torque is not None
        return self._sampled(self.simulation.motion.torque)

    @property
    def rod_force(self) -> Array:
        """(N,) [N] tension positive."""
        return self._sampled(self.simulation.motion.rod_force[:, None])[:, 0]

    @property
    def rod_stretch(self) -> Array:
        """(N,) [m]."""
        return self._sampled(self.simulation.motion.rod_stretch[:, None])[:, 0]

    def _sampled(self, values: Array) -> Array:
        return np.stack(
            [np.interp(self.t, self.simulation.motion.t, column) for column in values.T], axis=1
        )
