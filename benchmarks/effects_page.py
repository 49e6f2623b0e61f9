"""Writes docs/effects.md: every error source of a scenario, one row each, with a small plot of what it does to the logs.

    python -m benchmarks.effects_page           # page, plots and sizes, about half a minute
    python -m benchmarks.effects_page --text    # the page only, from the plots and sizes that are there

What each source is, its parameters and their defaults come from the pydantic models, sizes per machine from the description
files; formulas, origins and remarks stand here. A plot shows a run with one source minus the same run without it, unless its
axes say otherwise.
"""

from __future__ import annotations

import argparse
import csv
import inspect
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from cell.chain import Array
from cell.descriptions import Cell, load_cell
from cell.geometry import Geometry, bar_frames, robot_frames
from sim.clocks import ROBOT_PERIOD, SAMPLE_TASKS, TASK_NS
from sim.encoders import SURE_BITS, BarEncoder, motor_angles
from sim.load_logs import motor_torques, sensor_rows
from sim.mjcf import BRISTLE_TRAVEL, HYSTERESIS_STIFFNESS
from sim.plant_effects import CUSP_TERMS
from sim.sensor_effects import FREEZING_ONSET_HZ
from sim.settings import SimulationSettings
from sim.simulate import Simulation, simulate
from sim.static_errors import AXIS_ANGLES, AXIS_OFFSETS
from sim.streams import stream

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

ROOT = Path(__file__).parent.parent
PAGE, PLOTS = ROOT / "docs" / "effects.md", ROOT / "docs" / "images" / "effects"
SIZES = PLOTS / "sizes.csv"
WIDTH, HEIGHT = 320, 180  # [px]
POINTS = 300  # of a line; a plot is 250 px wide inside

Changes = Mapping[str, Mapping[str, Any]]
MACHINES = {"irb2400": "lund_600", "nj220": "lund_900"}
POSITION = [0.70, 0.0, 0.54]  # [m] of scenarios/irb2400.yaml
BASE: Changes = {
    "cell": {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": POSITION},
    "path": {"kind": "lissajous", "file": "paths/irb2400_a.yaml", "duration_s": 60.0, "dwell_s": 2.0, "stops": 1},
    "errors": {"static": {"table": "thesis_3_1"}},
}


# --- runs -------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Run:
    """A simulated run and what it was asked for."""

    settings: SimulationSettings
    simulation: Simulation


def run(changes: Changes) -> Run:
    """The main scenario in 60 s, without noise, with some settings changed."""
    return _run(json.dumps(_merged(BASE, changes), sort_keys=True))


@cache
def _run(asked: str) -> Run:
    settings = SimulationSettings.model_validate_json(asked)
    return Run(settings, simulate(settings, relative_to=ROOT / "scenarios"))


def _merged(base: Changes, changes: Changes) -> Changes:
    return {key: {**base.get(key, {}), **changes.get(key, {})} for key in sorted({*base, *changes})}


@dataclass(frozen=True, eq=False)
class View:
    """What stands in the logs of one run at times t (N,) [s], as if both devices took their rows at the same instants."""

    run: Run
    t: Array
    known: Geometry  # what an identifier would know: the geometry of the run without the source
    counted: bool  # whether the ball-bar angles go through the counters, whose steps would roughen a plot of micrometres

    @property
    def simulation(self) -> Simulation:
        return self.run.simulation

    @cached_property
    def true_angles(self) -> tuple[Array, Array]:
        """(N, 6), (N, 5) [rad] what the motors show and how the ball-bar stands, before any sensor."""
        return self.simulation.motion.at(self.t)

    @cached_property
    def q(self) -> Array:
        """(N, 6) [rad] robot angles by the log."""
        robot, settings = self.simulation.cell.robot, self.run.settings
        noise, rng = settings.errors.joint_noise, stream(settings.seed, "joint_noise")
        sigma = noise.sigma_rad if noise else 0.0
        motors = motor_angles(robot, self.true_angles[0], noise_sigma=sigma, rng=rng, resolvers=self.simulation.resolvers)
        return np.asarray(motors @ robot.transmission)

    @cached_property
    def b(self) -> Array:
        """(N, 5) [rad] ball-bar angles by the log, zeros known."""
        if not self.counted:
            return self.true_angles[1]
        return np.stack([self._counted(encoder) for encoder in self.simulation.encoders], axis=1)

    def _counted(self, encoder: BarEncoder) -> Array:
        rng = stream(self.run.settings.seed, f"encoder_noise_b{encoder.joint}")
        counts = encoder.counts(self.true_angles[1][:, encoder.joint - 1], self.t, rng).astype(np.int32)
        return np.asarray(encoder.sign * counts * (2.0 * np.pi / encoder.counts_per_turn) + encoder.zero)

    @property
    def residual(self) -> Array:
        """(N, 3) [m] tool by the ball-bar's log minus tool by the robot's log, with rigid kinematics."""
        return np.asarray((bar_frames(self.known, self.b).tip - robot_frames(self.known, self.q).tip).T)

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
        return np.stack([np.interp(self.t, self.simulation.motion.t, column) for column in values.T], axis=1)


# --- signals: (N,) or (N, K) of a view, in display units ------------------------------------------------------------------------

Signal = Callable[[View], Array]


def _time(view: View) -> Array:
    return view.t


def _residual_mm(view: View) -> Array:
    return 1e3 * view.residual


def _residual_um(view: View) -> Array:
    return 1e6 * view.residual


def _logged_gear_deg(gear: int) -> Signal:
    return lambda view: np.degrees(view.gears[:, gear - 1])


def _behind_gear_urad(gear: int) -> Signal:
    return lambda view: 1e6 * view.behind_gears[:, gear - 1]


def _torque(gear: int) -> Signal:
    return lambda view: view.torque[:, gear - 1]


def _gear_speed(gear: int) -> Signal:
    return lambda view: np.degrees(np.gradient(view.gears[:, gear - 1], view.t))


def _robot_angle(joint: int, scale: float) -> Signal:
    return lambda view: scale * view.q[:, joint - 1]


def _bar_angle(joint: int, scale: float) -> Signal:
    return lambda view: scale * view.b[:, joint - 1]


def _true_bar_deg(joint: int) -> Signal:
    return lambda view: np.degrees(view.true_angles[1][:, joint - 1])


def _bar_error_urad(joint: int) -> Signal:
    return lambda view: 1e6 * (view.b[:, joint - 1] - view.true_angles[1][:, joint - 1])


def _counts(joint: int) -> Signal:
    return lambda view: view.b[:, joint - 1] * (view.simulation.encoders[joint - 1].counts_per_turn / (2.0 * np.pi))


def _signal_frequency(joint: int) -> Signal:
    def frequency(view: View) -> Array:
        speed = np.gradient(view.true_angles[1][:, joint - 1], view.t)
        return np.asarray(np.abs(speed) * view.simulation.encoders[joint - 1].lines / (2.0 * np.pi))

    return frequency


def _weak_signal(joint: int) -> Signal:
    return lambda view: view.simulation.encoders[joint - 1].effects.weak_signal(view.t).astype(np.float64)


def _rod_force(view: View) -> Array:
    return view.rod_force


def _rod_stretch_um(view: View) -> Array:
    return 1e6 * view.rod_stretch


def _bar_row_time(view: View) -> Array:
    return view.simulation.times.bar_true


def _robot_row_time(view: View) -> Array:
    return view.simulation.times.robot_true


def _clock_difference(scale: float) -> Signal:
    """t_robot - t_bar of the rows of the ball-bar's log, each counted from the first row of its log."""

    def difference(view: View) -> Array:
        times = view.simulation.times
        t_bar = (times.bar_stamp - times.bar_stamp[0]).astype(np.float64) * 1e-9
        return np.asarray(np.round(scale * (times.bar_true - times.robot_true[0] - t_bar), 9))

    return difference


def _stamp_error(scale: float) -> Signal:
    """Stamp minus true time of the rows of the robot's log, both from the first row."""

    def error(view: View) -> Array:
        times = view.simulation.times
        return np.asarray(scale * (times.robot_stamp - times.robot_stamp[0] - times.robot_true + times.robot_true[0]))

    return error


def _robot_file_time(view: View) -> Array:
    rows = view.simulation.rows.robot
    return np.asarray(view.simulation.times.robot_true[rows[1:]])


def _robot_file_interval_ms(view: View) -> Array:
    rows = view.simulation.rows.robot
    return np.asarray(1e3 * np.diff(view.simulation.times.robot_stamp[rows]))


def _bar_file_rows(view: View) -> Array:
    return np.concatenate(view.simulation.rows.ballbar)


def _bar_file_time(view: View) -> Array:
    return np.asarray(view.simulation.times.bar_true[_bar_file_rows(view)[1:]])


def _bar_file_interval_ms(view: View) -> Array:
    return np.asarray(1e-6 * np.diff(view.simulation.times.bar_stamp[_bar_file_rows(view)]).astype(np.float64))


def _logged_and_true_torque(view: View) -> Array:
    """(N, 2) [N m at the motor] of axis 1."""
    log, robot = view.run.settings.logs.torque, view.simulation.cell.robot
    assert log is not None
    logged = motor_torques(robot, view.simulation.motion, view.t, log, view.run.settings.seed)[:, 0]
    return np.stack((logged, view.torque[:, 0] * robot.transmission[0, 0]), axis=1)


def _sensor_time(view: View) -> Array:
    stamps, _ = _sensor(view)
    return np.asarray(stamps - stamps[0] + 1.0)


def _sensor_force_and_truth(view: View) -> Array:
    """(N, 2) [N] along the flange's x."""
    _, readings = _sensor(view)
    motion = view.simulation.motion
    assert motion.wrench is not None
    return np.stack((readings[:, 0], np.interp(_sensor_time(view), motion.t, motion.wrench[:, 0])), axis=1)


def _sensor(view: View) -> tuple[Array, Array]:
    sensor = view.run.settings.logs.force_sensor
    assert sensor is not None
    return sensor_rows(view.simulation.motion, 1.0 - sensor.offset_s, 59.0, sensor, view.run.settings.seed)


# --- plots ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plot:
    """A signal over another, for one or more variants of a source."""

    x: Signal
    y: Signal
    axes: tuple[str, str]
    on: Mapping[str, Changes]  # label of the line: what is switched on
    off: Changes = field(default_factory=dict)
    minus_off: bool = True  # whether the run without the source is subtracted
    show_off: str = ""  # its label, when it is drawn beside instead
    columns: tuple[str, ...] = ()  # labels of the columns of y
    window: tuple[float, float] = (1.0, 59.0)  # [s]
    counted: bool = False  # ball-bar angles in steps of the counters
    rows: bool = False  # x and y are rows of a log, not values at chosen times
    points: int = POINTS
    marks: bool = False  # dots instead of a line


XYZ = ("x", "y", "z")
KINEMATIC: Changes = {"plant": {"kind": "kinematic"}}
T, RESIDUAL_MM, RESIDUAL_UM = "t [s]", "tool, bar - robot [mm]", "tool, bar - robot [um]"


def _error(name: str, /, **parameters: object) -> Changes:
    return {"errors": {name: parameters}}


def _residual(changes: Changes, *, off: Changes | None = None, um: bool = False) -> Plot:
    label, signal = (RESIDUAL_UM, _residual_um) if um else (RESIDUAL_MM, _residual_mm)
    return Plot(_time, signal, (T, label), {"": changes}, off or {}, columns=XYZ)


def _sensor_plot(joint: int, changes: Changes, *, x: str = "angle", **more: Any) -> Plot:
    signal, label = (_true_bar_deg(joint), f"b{joint} [deg]") if x == "angle" else (_time, T)
    return Plot(
        signal,
        _bar_angle(joint, 1e6),
        (label, f"b{joint}, change [urad]"),
        {"": _merged(KINEMATIC, changes)},
        KINEMATIC,
        counted=True,
        **more,
    )


def _clock(changes: Mapping[str, Any], unit: str, scale: float, **more: Any) -> Plot:
    on = {"": _merged(KINEMATIC, {"clocks": changes})}
    return Plot(
        _bar_row_time, _clock_difference(scale), (T, f"t_robot - t_bar [{unit}]"), on, KINEMATIC, minus_off=False, rows=True, **more
    )


def _rows(x: Signal, y: Signal, label: str, changes: Mapping[str, Any], **more: Any) -> Plot:
    on = {"": _merged(KINEMATIC, {"clocks": changes})}
    return Plot(x, y, (T, label), on, KINEMATIC, minus_off=False, rows=True, **more)


# --- sources ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Source:
    """One row of the page."""

    key: str  # in the scenario, with dots
    model: str
    enters: str
    origin: str  # of the default
    in_log: str
    plot: Plot
    what: str = ""  # where the settings have no model of its own
    of_machine: tuple[str, Callable[[Cell], ArrayLike]] | None = None  # unit and sizes of the description files


def _kp(name: str) -> Callable[[Cell], ArrayLike]:
    return lambda cell: cell.robot.servo[name].kp


GEARS = (
    Source(
        "errors.joint_compliance",
        "`L = K e`; the log shows `m`, the joint stands at `q = m + e`. Gear i is combination i of the joints (`joint_to_gear`).",
        "Plant: a second hinge `e` behind each motor hinge `m`, spring and damper on the gear's combination of the hinges.",
        "Robot file: Manutec r3 (same class) and RV catalogue rigidity; no identified stiffness of an IRB 2400 was found.",
        "The loop does not close by a smooth millimetre that follows gravity; the part the rod's force makes comes on top.",
        _residual(_error("joint_compliance")),
        of_machine=("N m/rad", lambda cell: cell.robot.gears.stiffness),
    ),
    Source(
        "errors.lost_motion",
        "Total width w. Dead band: `L = K (e - clip(e, -w/2, w/2))`. Hysteresis: beside `K e` a friction element, "
        f"{HYSTERESIS_STIFFNESS:g} times as stiff, that slips at `K w/2`.",
        "Plant: spring of the gear. Not without `joint_compliance`.",
        "Robot file: below the catalogues' bound of 1 arcmin (Nabtesco RV-E, recalled; Harmonic Drive doc. 1018854).",
        "Dead band: a step of w where the load changes sign. Hysteresis: up to w/2 to one side while the load rises, "
        "to the other while it falls.",
        Plot(
            _torque(2),
            _behind_gear_urad(2),
            ("torque of axis 2 [N m]", "joint - log, change [urad]"),
            {
                "dead_band": {"errors": {"joint_compliance": {}, "lost_motion": {}}},
                "hysteresis": {"errors": {"joint_compliance": {}, "lost_motion": {"kind": "hysteresis"}}},
            },
            _error("joint_compliance"),
            points=450,
        ),
        of_machine=("rad, total width", lambda cell: cell.robot.gears.lost_motion),
    ),
    Source(
        "errors.transmission_error",
        "`delta(g) = sum A_k sin(n_k g + phi_k)`, g the gear's output; the motor shows `g - delta(g)`. Phases drawn.",
        "Encoder and servo: the log shows `g - delta(g)`, and the servo, which sees the same, turns the gear unevenly.",
        "Robot file: below 1 arcmin peak to peak, what RV reducers are allowed; the split over the orders is assumed.",
        "Residual with the gear's orders over its angle; independent of load.",
        Plot(
            _logged_gear_deg(1),
            _behind_gear_urad(1),
            ("axis 1 [deg]", "joint - log, change [urad]"),
            {"": _error("transmission_error")},
            window=(3.0, 9.0),
            points=450,
        ),
        of_machine=("rad, axis 1; orders are in the file", lambda cell: [a for _, a in cell.robot.gears.harmonics[0]]),
    ),
    Source(
        "errors.cycloid_ripple",
        "Harmonic: `A sin(N g + phi)`. Cusped: `A pi/2 (abs(sin(x/2)) - 2/pi)`, `x = N g + phi`: zero mean, unit peak at the cusp, "
        f"by its first {CUSP_TERMS} harmonics `-2 A cos(k x) / (4 k^2 - 1)`.",
        "As transmission_error; harmonics of one order add up.",
        "Assumed: amplitude and pin count. Waveform: Yang & Blanche 1990, Mech. Mach. Theory 25(5); thesis Fig. 2.4.",
        "N cycles a turn; harmonics 2 N, 3 N tell the cusped wave from the sine.",
        Plot(
            _logged_gear_deg(1),
            _behind_gear_urad(1),
            ("axis 1 [deg]", "joint - log, change [urad]"),
            {"cusped": _error("cycloid_ripple"), "harmonic": _error("cycloid_ripple", waveform="harmonic")},
            window=(5.0, 8.0),
        ),
    ),
    Source(
        "errors.sinusoidal_gear_error",
        "`A sin(n g + phi)`; n = 1 on the output side, n = gear ratio on the input side.",
        "As transmission_error.",
        "Assumed: of the order of the robot files' first harmonic; thesis sec. 2.3 gives the shape.",
        "Output side: a slow wave that a path of less than a turn can mistake for joint offset and geometry. "
        "Input side: one cycle a motor turn.",
        Plot(
            _logged_gear_deg(1),
            _behind_gear_urad(1),
            ("axis 1 [deg]", "joint - log, change [urad]"),
            {"output": _error("sinusoidal_gear_error"), "input": _error("sinusoidal_gear_error", side="input")},
            window=(3.0, 9.0),
        ),
    ),
    Source(
        "errors.gear_friction",
        "`sign(w) (Fc + (Fs - Fc) exp(-(w/ws)^2)) + Fv w` against the speed w; `Fs = Fc` unless `stribeck`. Before it slips, a bristle of "
        f"at least {BRISTLE_TRAVEL * 1e6:g} urad of travel (LuGre), longer where it would chatter with the rotor.",
        "Plant: between servo and motor hinge.",
        "Robot file: friction table of Obal & Gierlak 2025 (IRB 2400); the NJ 220's is scaled from it.",
        "Torque log: a step at each reversal of the axis. Angles: a soft servo stops short by `Fc / kp`; the log sees it, "
        "so the loop closes all the same.",
        Plot(
            _gear_speed(1),
            _torque(1),
            ("speed of axis 1 [deg/s]", "torque, change [N m]"),
            {"stribeck": _error("gear_friction", stribeck=True), "default": _error("gear_friction")},
            points=250,
            marks=True,
        ),
        of_machine=("N m, Coulomb", lambda cell: cell.robot.gears.coulomb),
    ),
    Source(
        "plant.servo",
        "`tau = kp (u - shown) - kv m'`, no integral action; `u = g + kv/kp g'` of the reference (+ weight / kp).",
        "Plant: actuators on the motor hinges.",
        "Robot file, assumed: the soft one holds the rod near the 100-150 N of thesis Fig. 5.7 (SoftServo 80 %).",
        "With a wrong geometry the stiff servo presses some twenty times as hard on the ball-bar; what gives way shows in the residual.",
        Plot(
            _time,
            _rod_force,
            (T, "rod force [N]"),
            {"stiff": {"plant": {"servo": "stiff"}}},
            {"plant": {"servo": "soft"}},
            minus_off=False,
            show_off="soft",
        ),
        of_machine=("N m/rad, kp of soft", _kp("soft")),
    ),
    Source(
        "plant.gravity_compensation",
        "Adds `tau_g / kp` to the command, the weight of the nominal robot with its plate at the reference.",
        "Servo command.",
        "On: a controller knows its arm's weight.",
        "Off: the arm sags on the soft servo until the ball-bar holds part of it. The log sees the sag.",
        Plot(
            _time,
            lambda view: 1e3 * view.q[:, 1:3],
            (T, "logged, off - on [mrad]"),
            {"": {"plant": {"gravity_compensation": False}}},
            columns=("q2", "q3"),
        ),
    ),
)

BAR = (
    Source(
        "errors.rod_backlash",
        "`F = k (s - clip(s, -w/2, w/2))`, s the rod's stretch, k its stiffness (the rod gives way always).",
        "Plant: spring of the rod's slide.",
        "Ball-bar file: thesis sec. 5.3, below 5 um a joint; Fig. 5.9.",
        "The rod's length jumps by w where its force changes sign.",
        Plot(
            _rod_force,
            _rod_stretch_um,
            ("rod force [N]", "rod stretch [um]"),
            {"with play": _error("rod_backlash")},
            minus_off=False,
            show_off="without",
            points=450,
        ),
        of_machine=("m, total width", lambda cell: cell.ballbar.backlash),
    ),
    Source(
        "errors.bar_friction",
        "LuGre with `Fc = Fs`, the stated torque, at each of the five joints; before it slips, an elastic bristle.",
        "Plant: ball-bar hinges.",
        "Ball-bar file, assumed.",
        "Nothing in the residual: steps of some urad where a ball-bar joint reverses, in both logs alike.",
        Plot(_time, _robot_angle(1, 1e6), (T, "q1, change [urad]"), {"": _error("bar_friction")}),
        of_machine=("N m", lambda cell: cell.ballbar.friction_torque),
    ),
    Source(
        "errors.plate_bending",
        "Cantilever: deflection `F / k`, tilt `3 F / (2 k L)` by a hinge of `k (2 L / 3)^2`, L / 3 from the sixth axis.",
        "Plant: hinge about the plate's y.",
        "Plate file: thesis secs. 4.5 and 5.4, about 10 um per 100 N; plate_250_thin is the 60 um one of the Comau experiment.",
        "Residual across the plate that follows the rod's force.",
        Plot(
            _time,
            lambda view: 1e6 * np.linalg.norm(view.residual, axis=1),
            (T, "tool, bar - robot [um]"),
            {
                "1.67e6 N/m": _error("plate_bending", tip_stiffness_N_per_m=1.67e6),
                "1e7 N/m": _error("plate_bending", tip_stiffness_N_per_m=1.0e7),
            },
        ),
        of_machine=("N/m", lambda cell: cell.plate.tip_stiffness),
    ),
    Source(
        "errors.base_compliance",
        "`x = F / k` alike in x, y and z.",
        "Plant: three slides under the ball-bar's base.",
        "Assumed: a steel adapter on a bolted plate. Thesis Fig. 5.8 measured base movement.",
        "Residual along the rod's force, as if the rod were softer.",
        _residual(_error("base_compliance"), um=True),
    ),
)

STATIC_OFF: Changes = {"errors": {"static": None}, "plant": {"kind": "kinematic"}}
GEOMETRY = (
    Source(
        "errors.static",
        "`true = nominal + deviation`; of the table, or `sigma z` with z normal, one draw a parameter.",
        "Geometry: DH rows of robot and ball-bar, base position; encoder zeros are drawn anyhow.",
        "Table: thesis Table 3.1. Drawn: no default; thesis sec. 3.1 draws 1 mm and 1 mrad.",
        "What calibration is for: millimetres that follow the pose. Drawn: 1 mm, 1 mrad.",
        Plot(
            _time,
            lambda view: 1e3 * np.linalg.norm(view.residual, axis=1),
            (T, "tool, bar - robot [mm]"),
            {
                "Table 3.1": KINEMATIC,
                "drawn": _merged(KINEMATIC, _error("static", sigma_m=1e-3, sigma_rad=1e-3)),
                "drawn, all": _merged(KINEMATIC, _error("static", sigma_m=1e-3, sigma_rad=1e-3, parameters="all")),
            },
            STATIC_OFF,
        ),
    ),
    Source(
        "errors.ballbar_axes",
        f"`sigma_m z` on {', '.join(AXIS_OFFSETS)}; `sigma_rad z` on {', '.join(AXIS_ANGLES)}.",
        "Geometry: ball-bar rows.",
        "Assumed.",
        "Residual of the order of rod length times squareness error.",
        _residual(_merged(KINEMATIC, _error("ballbar_axes")), off=KINEMATIC, um=True),
    ),
    Source(
        "errors.base_tilt",
        "`otx, oty = sigma_rad z`, about x, then y.",
        "Geometry: base of the ball-bar.",
        "Assumed; the thesis's model has no base tilt.",
        "Residual of rod length times tilt, smooth over the sphere.",
        _residual(_merged(KINEMATIC, _error("base_tilt")), off=KINEMATIC),
    ),
    Source(
        "errors.plate_length",
        "`ra6 = nominal + sigma_m z`, one draw.",
        "Geometry: the one known length.",
        "Plate file, assumed: what a coordinate measuring machine gives.",
        "Its own size in the residual; a fit takes it for scale and gets all lengths wrong by the same share.",
        _residual(_merged(KINEMATIC, _error("plate_length")), off=KINEMATIC, um=True),
        of_machine=("m, standard deviation", lambda cell: cell.plate.length_sigma),
    ),
)

ROBOT_SENSORS = (
    Source(
        "errors.joint_noise",
        "`q + sigma z` at each row.",
        "Robot's log, before the motor angles are formed.",
        "No default; scenarios/irb2400.yaml takes the 10 urad of thesis sec. 3.5.",
        "White at the log's rate.",
        Plot(
            _time,
            _robot_angle(1, 1e6),
            (T, "q1, change [urad]"),
            {"sigma_rad: 1.0e-5": _merged(KINEMATIC, _error("joint_noise", sigma_rad=1e-5))},
            KINEMATIC,
            window=(10.0, 11.0),
            points=120,
            marks=True,
        ),
    ),
    Source(
        "errors.resolver_error",
        "`m + sum A_k sin(k m + phi_k)`, k = 1, 2, m the motor's angle; then rounded to the quantum.",
        "Robot's log. The servo is not misled.",
        "Resolvers of the +-10 arcmin class and converters of 16 bits (recalled).",
        "One and two cycles a motor turn, divided by the gear ratio; looks like gear error of the input side.",
        Plot(
            _robot_angle(1, 180.0 / np.pi),
            _robot_angle(1, 1e6),
            ("q1 [deg]", "q1, change [urad]"),
            {"": _merged(KINEMATIC, _error("resolver_error"))},
            KINEMATIC,
            window=(5.0, 7.5),
        ),
    ),
)

FAST: Changes = {"path": {"duration_s": 26.0}}  # the encoders' signals pass the onset of freezing
ENCODERS = (
    Source(
        "errors.mounting_eccentricity",
        "`b + A sin(b + phi)`, A = offset / radius of the restraint; phase drawn.",
        "Ball-bar encoder, first in its chain.",
        "Assumed: a mount that was not adjusted.",
        "One cycle a turn of the joint; larger than the encoder's own errors.",
        _sensor_plot(5, _error("mounting_eccentricity")),
    ),
    Source(
        "errors.encoder_eccentricity",
        "`s + sum A_k sin(k s + phi_k)`, k = 1..3, s the shaft's angle; phases drawn.",
        "Ball-bar encoder, after mounting and coupling.",
        "Sized to stay near the ERN 1080's 18 arcsec; shape: Renishaw, The accuracy of rotary encoders.",
        "Slow wave over the joint's angle, the same in both directions.",
        _sensor_plot(5, _error("encoder_eccentricity")),
    ),
    Source(
        "errors.subdivisional_error",
        "`s + A sin(lines s + phi)`, after eccentricity.",
        "Ball-bar encoder, last before noise and rounding.",
        "Assumed: 0.7 % of a signal period.",
        "Cycles of 0.1 deg. Plotted in rows of 10 ms as a motion begins: from 5 deg/s on they alias it into noise of the same size.",
        _sensor_plot(5, _error("subdivisional_error"), x="time", window=(2.0, 3.0), points=101),
    ),
    Source(
        "errors.frozen_bits",
        f"Low bits keep their last value from the onset up, one more each octave of signal frequency, {SURE_BITS} bits always live. "
        "Onset by bits: " + ", ".join(f"{bits}: {hz:g} Hz" for bits, hz in FREEZING_ONSET_HZ.items()) + ".",
        "Ball-bar counter.",
        "EL5021 documentation; +-15 % by the maker.",
        "A count at speed, three at twice the speed; no status says so. Plotted: a fast run of 26 s.",
        Plot(
            _signal_frequency(5),
            _counts(5),
            ("signal of b5 [Hz]", "b5, change [counts]"),
            {"": _merged(_merged(KINEMATIC, FAST), _error("frozen_bits"))},
            _merged(KINEMATIC, FAST),
            window=(1.0, 25.0),
            points=500,
            marks=True,
            counted=True,
        ),
    ),
    Source(
        "errors.amplitude_errors",
        "Status bits 4 and 14 from start_s to end_s.",
        "Ball-bar status words; the counts stay right.",
        "No default: a stated fault.",
        "Status word only.",
        Plot(
            _time,
            _weak_signal(2),
            (T, "s2, bits 4 and 14"),
            {"": _merged(KINEMATIC, {"errors": {"amplitude_errors": [{"encoder": 2, "start_s": 20.0, "end_s": 25.0}]}})},
            KINEMATIC,
            points=600,
        ),
    ),
    Source(
        "errors.slipped_periods",
        "`counts + periods 2^bits` from at_s.",
        "Ball-bar counter.",
        "No default: a stated fault. One period of 3600 lines is 1.745 mrad.",
        "A step of whole periods between two rows; the zero is another one afterwards.",
        _sensor_plot(2, {"errors": {"slipped_periods": [{"encoder": 2, "at_s": 20.0}]}}, x="time"),
    ),
    Source(
        "errors.coupling_slips",
        "`shaft + angle_rad` from at_s.",
        "Ball-bar encoder, between mounting and graduation.",
        "Assumed.",
        "A step that is no whole number of periods.",
        _sensor_plot(2, {"errors": {"coupling_slips": [{"encoder": 2, "at_s": 20.0}]}}, x="time"),
    ),
    Source(
        "encoders.bits",
        "`rint(angle lines 2^bits / 2 pi)`.",
        "Ball-bar counter.",
        "Thesis sec. 4.6.",
        "Steps of 6.8 urad at 8 bits, 0.4 urad at 12, 0.2 urad at 13; in motion they look like noise.",
        Plot(
            _time,
            _bar_error_urad(5),
            (T, "b5, log - true [urad]"),
            {"8 bits": _merged(KINEMATIC, {"encoders": {"bits": 8}}), "12 bits": KINEMATIC},
            KINEMATIC,
            minus_off=False,
            counted=True,
            window=(2.0, 3.0),
            points=101,
            marks=True,
        ),
        what="Quantisation of the ball-bar angles; always there.",
    ),
    Source(
        "encoders.noise_sigma_rad",
        "`scale + sigma z` at each row, before rounding.",
        "Ball-bar encoder.",
        "None. The ball-bar files assume 2 urad for the identifier; scenarios/irb2400.yaml takes 10 urad (thesis sec. 3.5).",
        "White at the log's rate.",
        _sensor_plot(5, {"encoders": {"noise_sigma_rad": 1e-5}}, x="time", window=(10.0, 11.0), points=100, marks=True),
        what="White noise of the ball-bar angles. Plotted: 1.0e-5.",
    ),
)

PERIOD_MS, TASK_MS = 1e3 * ROBOT_PERIOD, 1e-6 * TASK_NS
CLOCKS = (
    Source(
        "clocks.offset_s",
        "`t_robot = offset + (1 + skew) t_bar`, both from the first row of their log.",
        "Instants of the rows: the ball-bar's log begins later.",
        "None: both logs begin together.",
        "All ball-bar angles are shifted in time. Plotted: 0.137 s.",
        _clock({"offset_s": 0.137}, "ms", 1e3),
        what="One log begins later than the other.",
    ),
    Source(
        "clocks.skew",
        "As above: the ball-bar's clock runs slow by 1 + skew.",
        "Instants of the rows.",
        "None; quartz clocks differ by 20 to 100 ppm.",
        "The shift grows along the run. Plotted: 5.0e-5.",
        _clock({"skew": 5e-5}, "ms", 1e3),
        what="The two clocks run at different rates.",
    ),
    Source(
        "clocks.wander",
        "`rate = r w(t) + c exp(-t / T)`, w a random walk of unit RMS; its integral less the best straight line is added to t_robot.",
        "Instants of the rows.",
        "Usual for quartz oscillators without an oven.",
        "Microseconds that no straight line takes out.",
        Plot(
            _bar_row_time,
            _clock_difference(1e6),
            (T, "t_robot - t_bar [us]"),
            {
                "default": _merged(KINEMATIC, {"clocks": {"wander": {}}}),
                "warm_up_ppm: 5": _merged(KINEMATIC, {"clocks": {"wander": {"warm_up_ppm": 5.0}}}),
            },
            KINEMATIC,
            minus_off=False,
            rows=True,
        ),
    ),
    Source(
        "clocks.step",
        "`stamp + step_s` from at_s.",
        "Ball-bar stamps; the rows are taken as ever.",
        "NTP's step threshold, 128 ms.",
        "A gap in the stamps, or stamps that go back.",
        _clock({"step": {"at_s": 20.0}}, "ms", 1e3),
    ),
    Source(
        "clocks.quantum",
        "`rint(stamp / quantum) quantum`, from the first row.",
        "Stamps of both logs.",
        "EGM headers and SYSTEMTIME count whole ms.",
        f"The robot's {PERIOD_MS:.3f} ms period becomes 4, 4, .., 5 ms; the ball-bar's stamps, multiples of {TASK_MS:g} ms, do not change.",
        _rows(_robot_row_time, _stamp_error(1e3), "robot stamp - true [ms]", {"quantum": {}}, window=(5.0, 6.5)),
    ),
    Source(
        "clocks.jitter",
        "`stamp + sigma_s z`.",
        "Stamps of the robot's log.",
        "Assumed.",
        "White noise of the stamps: at 50 deg/s 0.2 ms is 175 urad.",
        _rows(_robot_row_time, _stamp_error(1e3), "robot stamp - true [ms]", {"jitter": {}}, window=(5.0, 6.0), marks=True),
    ),
)

LOGGERS = (
    Source(
        "clocks.overrun_probability",
        f"A row takes {SAMPLE_TASKS} tasks of {TASK_MS:g} ms, or one more.",
        "Instants and stamps of the ball-bar's rows.",
        "None; thesis sec. 4.6 reports overruns, the scenarios assume 0.005.",
        "Intervals of 15 ms among those of 10 ms; the stamps are right. Plotted: 0.005.",
        _rows(_bar_file_time, _bar_file_interval_ms, "ball-bar interval [ms]", {"overrun_probability": 0.005}, marks=True),
        what="A line of the ball-bar's log takes one task more.",
    ),
    Source(
        "clocks.dropped_rows",
        "Each row but the first is lost with the stated probability.",
        "Files of both logs.",
        "Assumed.",
        "Intervals of twice the period.",
        _rows(_robot_file_time, _robot_file_interval_ms, "robot interval [ms]", {"dropped_rows": {}}, marks=True),
    ),
    Source(
        "clocks.duplicated_rows",
        "Each row but the first is written twice with the stated probability.",
        "Files of both logs.",
        "Assumed.",
        "Intervals of zero, all columns equal.",
        _rows(_robot_file_time, _robot_file_interval_ms, "robot interval [ms]", {"duplicated_rows": {}}, marks=True),
    ),
    Source(
        "clocks.restart",
        "No rows from at_s to at_s + gap_s.",
        "Files of the ball-bar's log: two of them.",
        "Assumed.",
        "One long interval between ballbarOld.csv and ballbar.csv.",
        _rows(_bar_file_time, _bar_file_interval_ms, "ball-bar interval [ms]", {"restart": {"at_s": 20.0}}, marks=True),
    ),
)

LOADS = (
    Source(
        "logs.torque",
        "`(tau (1 + gain z_i) + noise z) / ratio`: columns tau1..tau6, N m at the motor.",
        "Robot's log.",
        "Assumed.",
        "Here axis 1: gravity does not load it, friction is off, so it shows servo and rod.",
        Plot(
            _time,
            _logged_and_true_torque,
            (T, "tau1 at the motor [N m]"),
            {"": {"logs": {"torque": {}}}},
            minus_off=False,
            columns=("logged", "true"),
            window=(10.0, 16.0),
        ),
    ),
    Source(
        "logs.force_sensor",
        "`load (1 + gain z_c) + bias z_c + noise z`: force and torque of plate and ball-bar on the flange, in its frame, about its origin.",
        "A third log, with its own rate, and a clock that begins offset_s after the robot's.",
        "Assumed, for a sensor like the JR3 of thesis sec. 5.3.",
        "The plate's weight turns with the wrist; the rod's force comes on top.",
        Plot(
            _sensor_time,
            _sensor_force_and_truth,
            (T, "fx [N]"),
            {"": {"logs": {"force_sensor": {}}}},
            minus_off=False,
            rows=True,
            columns=("logged", "true"),
            window=(10.0, 16.0),
        ),
    ),
)

GROUPS: dict[str, tuple[Source, ...]] = {
    "Plant: gears and servo": GEARS,
    "Plant: ball-bar and offset plate": BAR,
    "Geometry": GEOMETRY,
    "Robot's angle sensors": ROBOT_SENSORS,
    "Ball-bar encoders": ENCODERS,
    "Clocks and stamps": CLOCKS,
    "Loggers: which rows stand in the file": LOGGERS,
    "Logged loads": LOADS,
}
SOURCES = tuple(source for group in GROUPS.values() for source in group)


# --- settings ---------------------------------------------------------------------------------------------------------------

UNITS = {  # by the end of the parameter's name, the longest first
    "N_per_m": "N/m",
    "N_m": "N m",
    "_ppm": "ppm",
    "_rad": "rad",
    "_deg": "deg",
    "_hz": "Hz",
    "_m": "m",
    "_s": "s",
    "_N": "N",
}


def unit_of(name: str) -> str:
    """The unit that a parameter's name ends with; empty for none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def models_in(annotation: object) -> list[type[BaseModel]]:
    """Settings models that a field may hold, also inside tuples, options and choices."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def field_at(key: str) -> FieldInfo:
    """The field of the settings that a dotted key names."""
    model: type[BaseModel] = SimulationSettings
    *parents, last = key.split(".")
    for parent in parents:
        (model,) = models_in(model.model_fields[parent].annotation)
    return model.model_fields[last]


def value_text(value: object) -> str:
    """A value as one writes it in a scenario, to four digits."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.4g}"
    if "e" not in text and (value == 0.0 or 1e-3 < abs(value) < 1e4):
        return text if "." in text else text + ".0"
    mantissa, exponent = f"{value:.3e}".split("e")
    mantissa = mantissa.rstrip("0")
    return f"{mantissa}0e{int(exponent)}" if mantissa.endswith(".") else f"{mantissa}e{int(exponent)}"


def parameter_text(name: str, info: FieldInfo) -> str:
    """Name, default, unit and description of one parameter."""
    default = "required" if info.default is PydanticUndefined else value_text(info.default)
    parts = [f"`{name}: {default}`", unit_of(name), f"({' or '.join(choices)})" if (choices := _choices(info.annotation)) else ""]
    described = _description(info)
    return " ".join(part for part in parts if part) + (f": {described}" if described else "")


def _description(info: FieldInfo) -> str:
    return info.description or ""


def _choices(annotation: object) -> list[str]:
    parts = get_args(annotation)
    return [str(part) for part in parts] if parts and all(isinstance(part, str) for part in parts) else []


# --- page -------------------------------------------------------------------------------------------------------------------

HEAD = """# Effects: every error source of a scenario

Written by `python -m benchmarks.effects_page`; do not edit. Defaults and descriptions are those of the settings themselves
(`sim/`), sizes per machine those of the description files (`cell/`).

Every source is absent unless a scenario names it: `errors: {{joint_compliance: {{}}}}` switches one on at its default size. The
heading of a row is the key, the list in it the parameters with default and unit. What differs from unit to unit (phases, spread,
deviations) is drawn from the scenario's seed, one stream a source, so that switching one on leaves all others bit-identical. z is a
standard normal draw, phi a drawn phase.

Letters: `m` motor hinge, `e` elastic deflection, `q = m + e` joint; `g` output of a gear, `joints = gears @ gear_to_joint`
([conventions](conventions.md)); `L` load on a gear and `tau` torque of its servo, both at its output, at rest `tau = -L`; `b` ball-bar
angle; `s` stretch of the rod, or angle of an encoder's shaft; `F` force.

Plots: the IRB 2400 with the errors of thesis Table 3.1 on the 600 mm ball-bar, soft servo, 60 s, no noise; the run with the source minus
the same run without it, unless the axes say otherwise. Geometry, sensors and clocks are plotted with the kinematic plant. "Tool, bar -
robot" is the tool's position by the ball-bar's log minus that by the robot's, in the robot's base, with rigid kinematics and the geometry
of the run without the source: what is left when only geometry is identified.

{contents}
"""

ROW = """<tr>
<td width="60%" valign="top">

### {key}

{what}

{model}

{parameters}

{machine}Enters: {enters}<br>
Default from: {origin}

</td>
<td width="40%" valign="top">

<img src="images/effects/{key}.svg" width="320" height="180" alt="{key}: {label}">

{in_log}

</td>
</tr>
"""

SIZES_HEAD = """## How large

Largest change of what the logs say against the same run without the source, sizes as plotted above, measured by the same command
(`images/effects/sizes.csv`). Orders of magnitude: they depend on path, seed and servo. A rod force of - means the kinematic plant: the
ball-bar keeps its path and the robot follows.

| source | tool, bar - robot [um] | robot angle [urad] | ball-bar angle [urad] | rod force [N] |
|---|---:|---:|---:|---:|
"""

OTHER_HEAD = """
## Settings that are no error source

| key | default | |
|---|---|---|
"""


def page_text(sizes: list[dict[str, str]]) -> str:
    """The whole page; sizes : rows of sizes.csv."""
    contents = "\n".join(f"- {group}: " + ", ".join(f"[{s.key}](#{_anchor(s.key)})" for s in GROUPS[group]) for group in GROUPS)
    groups = "".join(f"\n## {group}\n\n<table>\n{''.join(map(_row, sources))}</table>\n" for group, sources in GROUPS.items())
    table = "".join(
        f"| [{r['source']}](#{_anchor(r['source'])}) {r['variant']} | {r['tool_um']} | {r['q_urad']} | {r['b_urad']} | {r['rod_N']} |\n"
        for r in sizes
    )
    return HEAD.format(contents=contents) + groups + "\n" + SIZES_HEAD + table + OTHER_HEAD + "".join(_other_rows())


def _anchor(key: str) -> str:
    return key.replace(".", "")  # as forges form it from the heading


def _row(source: Source) -> str:
    info = field_at(source.key)
    models = models_in(info.annotation)
    what = source.what or (inspect.getdoc(models[0]) if models else info.description) or ""
    return ROW.format(
        key=source.key,
        what=what.replace("\n", " "),
        model=source.model,
        parameters=_parameters(source.key, info, models),
        machine=_machine(source),
        enters=source.enters,
        origin=source.origin,
        label=source.plot.axes[1],
        in_log=source.in_log,
    )


def _parameters(key: str, info: FieldInfo, models: list[type[BaseModel]]) -> str:
    if not models:
        return "- " + parameter_text(key, info)
    notes = [note for note in (info.description, "A list, each with:" if info.default == () else "") if note]
    lines = [" ".join(notes), ""] if notes else []
    return "\n".join(lines + [f"- {parameter_text(name, field)}" for name, field in models[0].model_fields.items()])


def _machine(source: Source) -> str:
    if source.of_machine is None:
        return ""
    unit, sizes = source.of_machine
    texts = {robot: _numbers(sizes(load_cell(robot, bar, "plate_250"))) for robot, bar in MACHINES.items()}
    first, *others = texts.values()
    shown = first if all(other == first for other in others) else "; ".join(f"{robot} {text}" for robot, text in texts.items())
    return f"Size: {shown} ({unit})<br>\n"


def _numbers(values: ArrayLike) -> str:
    return ", ".join(value_text(float(f"{value:.3g}")).removesuffix(".0") for value in np.atleast_1d(np.asarray(values, dtype=float)))


def _other_rows() -> Iterator[str]:
    shown = {source.key for source in SOURCES}
    for section, info in SimulationSettings.model_fields.items():
        models = models_in(info.annotation)
        if not models:
            yield _other(section, info)
        for model in models:
            for name, inner in model.model_fields.items():
                if f"{section}.{name}" not in shown:
                    yield _other(f"{section}.{name}", inner)


def _other(key: str, info: FieldInfo) -> str:
    default = "required" if info.is_required() else f"`{value_text(info.default)}`"
    return f"| `{key}` | {default} | {' '.join([_description(info), *([' or '.join(c)] if (c := _choices(info.annotation)) else [])])} |\n"


# --- figures and sizes ------------------------------------------------------------------------------------------------------

BLUE, ORANGE, GREY = "#1f66ad", "#d9740b", "#8a949c"
_INK, _QUIET, _GRID = "#22303c", "#66727d", "#dfe4e8"
_STYLE: dict[RcKeyType, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "effects",
    "font.size": 8.0,
    "axes.edgecolor": _QUIET,
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREY]),
    "grid.color": _GRID,
    "grid.linewidth": 0.6,
    "xtick.color": _QUIET,
    "ytick.color": _QUIET,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.handlelength": 1.2,
    "lines.linewidth": 1.0,
    "lines.solid_capstyle": "round",
}


def draw(source: Source) -> None:
    """Writes the plot of one source."""
    plot = source.plot
    with matplotlib.rc_context({**_STYLE, "path.simplify": not plot.marks}):
        figure = Figure(figsize=(WIDTH / 96.0, HEIGHT / 96.0), layout="constrained")
        axes = figure.add_subplot()
        labelled = False
        for label, x, y in _lines(plot):
            axes.plot(*(_dots(x, y) if plot.marks else (x, y)), label=label, linewidth=1.8 if plot.marks else None)
            labelled |= bool(label)
        axes.set_xlabel(plot.axes[0])
        axes.set_ylabel(plot.axes[1])
        axes.margins(x=0.02)
        low, high = axes.get_ylim()
        if high - low < 1e-6 * abs(high):  # a constant
            axes.set_ylim(0.0, 1.3 * high)
        if labelled:
            figure.legend(loc="outside upper right", ncols=3, borderpad=0.0)
        written = io.StringIO()
        figure.savefig(written, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    hundredths = re.sub(r"(\.\d\d)\d+", r"\1", written.getvalue())  # of a point
    (PLOTS / f"{source.key}.svg").write_text(hundredths, encoding="utf-8")


def _dots(x: Array, y: Array) -> tuple[Array, Array]:
    """Lines of no length with round ends: a third of the bytes of markers."""
    gap = np.full_like(x, np.nan)
    return np.stack((x, x, gap), axis=1).ravel(), np.stack((y, y, gap), axis=1).ravel()


def _lines(plot: Plot) -> Iterator[tuple[str, Array, Array]]:
    """Label, x and y of every line."""
    t = np.linspace(*plot.window, plot.points)
    off = run(plot.off)
    known = off.simulation.motion.geometry
    without = View(off, t, known, plot.counted)
    for label, changes in plot.on.items():
        view = View(run(changes), t, known, plot.counted)
        x, y = plot.x(view), plot.y(view)
        y = y - plot.y(without) if plot.minus_off else y
        for name, column in zip(plot.columns or (label,), np.atleast_2d(y.T), strict=True):
            yield (name, *_thinned(x, column, plot))
    if plot.show_off:
        yield (plot.show_off, *_thinned(plot.x(without), plot.y(without), plot))


def _thinned(x: Array, y: Array, plot: Plot) -> tuple[Array, Array]:
    """The window of a log's rows, and of each of POINTS / 2 stretches only its smallest and largest value."""
    if not plot.rows:
        return x, y
    inside = (x >= plot.window[0]) & (x <= plot.window[1])
    x, y = x[inside], y[inside]
    if x.size <= POINTS:
        return x, y
    kept: set[int] = set()
    for part in np.array_split(np.arange(x.size), POINTS // 2):
        kept |= {int(part[y[part].argmin()]), int(part[y[part].argmax()])}
    order = sorted(kept)
    return x[order], y[order]


def measured_sizes() -> list[dict[str, str]]:
    """Largest changes of the logs, of every source that changes angles; the largest residual first."""
    rows = [
        {"source": source.key, "variant": label, **_sizes(changes, source.plot)}
        for source in SOURCES
        if source.key.startswith(("errors.", "plant.")) or source.key == "encoders.noise_sigma_rad"
        for label, changes in source.plot.on.items()
    ]
    return sorted(rows, key=lambda row: (-float(row["tool_um"]), -float(row["q_urad"])))


def _sizes(changes: Changes, plot: Plot) -> dict[str, str]:
    off, on = run(plot.off), run(changes)
    known, end = off.simulation.motion.geometry, off.settings.path.duration_s
    t = np.arange(1.0, end - 1.0, 0.01)
    a, b = (View(each, t, known, plot.counted) for each in (on, off))
    residual = np.linalg.norm(a.residual - b.residual, axis=1)
    with_forces = on.settings.plant.kind == "mujoco"
    return {
        "tool_um": _largest(residual, 1e6),
        "q_urad": _largest(a.q - b.q, 1e6),
        "b_urad": _largest(a.b - b.b, 1e6),
        "rod_N": _largest(a.rod_force - b.rod_force, 1.0) if with_forces else "-",
    }


def _largest(change: Array, scale: float) -> str:
    """The largest, to two digits."""
    return f"{float(f'{np.abs(change).max() * scale:.2g}'):g}"


def read_sizes() -> list[dict[str, str]]:
    """Rows of the committed sizes.csv."""
    with SIZES.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _write_sizes(rows: list[dict[str, str]]) -> None:
    with SIZES.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Writes page, plots and sizes."""
    parser = argparse.ArgumentParser(description="Writes docs/effects.md and its plots.")
    parser.add_argument("--text", action="store_true", help="the page only")
    if not parser.parse_args().text:
        PLOTS.mkdir(parents=True, exist_ok=True)
        for source in SOURCES:
            draw(source)
        _write_sizes(measured_sizes())
    PAGE.write_text(page_text(read_sizes()), encoding="utf-8")


if __name__ == "__main__":
    main()
