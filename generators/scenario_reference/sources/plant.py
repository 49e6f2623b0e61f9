"""Sources in the plant: gears, servo, ball-bar and offset plate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ballbar.cell.descriptions import Cell
from ballbar.sim.plant.effects import CUSP_TERMS, UNLISTED_ORDERS
from ballbar.sim.plant.mjcf import BRISTLE_TRAVEL, HYSTERESIS_STIFFNESS
from generators.scenario_reference import signals
from generators.scenario_reference.plots import Plot, Source, T, error, gear_plot, residual_plot


def _kp(name: str) -> Callable[[Cell], ArrayLike]:
    return lambda cell: cell.robot.servo[name].kp


GEARS = (
    Source(
        "errors.joint_compliance",
        "`L = K e`; the log shows `m`. Gear i is combination i of the joints (`joint_to_gear`).",
        "robot file: Manutec r3, RV catalogues.",
        residual_plot(error("joint_compliance")),
        of_machine=("N m/rad", lambda cell: cell.robot.gears.stiffness),
    ),
    Source(
        "errors.gear_backlash",
        "Dead band: `L = K (e - clip(e, -w/2, w/2))`. Hysteresis: beside `K e` a "
        "friction element, "
        f"{HYSTERESIS_STIFFNESS:g} times as stiff, that slips at `K w/2`.",
        "robot file, below the catalogues' 1 arcmin.",
        Plot(
            signals.torque(2),
            signals.behind_gear_urad(2),
            ("torque of axis 2 [N m]", "joint - log, change [urad]"),
            {
                "dead_band": {"errors": {"joint_compliance": {}, "gear_backlash": {}}},
                "hysteresis": {
                    "errors": {"joint_compliance": {}, "gear_backlash": {"kind": "hysteresis"}}
                },
            },
            error("joint_compliance"),
            points=450,
        ),
        of_machine=("rad", lambda cell: cell.robot.gears.lost_motion),
    ),
    Source(
        "errors.transmission_error",
        "`delta(g) = sum A_k sin(n_k g + phi_k)`; the motor shows `g - delta(g)`.",
        "robot file, below 1 arcmin peak to peak.",
        gear_plot({"": error("transmission_error")}, window=(3.0, 9.0), points=450),
        of_machine=(
            "rad, axis 1, first and last order",
            lambda cell: [a for _, a in cell.robot.gears.harmonics[0]],
        ),
    ),
    Source(
        "errors.cycloid_ripple",
        "Harmonic: `A sin(N g + phi)`. Cusped: `A pi/2 (abs(sin(x/2)) - 2/pi)`, `x = N g + phi`, "
        f"by its first {CUSP_TERMS} harmonics `-2 A cos(k x) / (4 k^2 - 1)`.",
        "",
        gear_plot(
            {
                "cusped": error("cycloid_ripple"),
                "harmonic": error("cycloid_ripple", waveform="harmonic"),
            },
            window=(5.0, 8.0),
        ),
    ),
    Source(
        "errors.sinusoidal_gear_error",
        "`A sin(n g + phi)`, n = 1 or the gear ratio.",
        "",
        gear_plot(
            {
                "output": error("sinusoidal_gear_error"),
                "input": error("sinusoidal_gear_error", side="input"),
            },
            window=(3.0, 9.0),
        ),
    ),
    Source(
        "errors.unlisted_ripple",
        f"`A sin(n g + phi)`, n drawn from {UNLISTED_ORDERS[0]} to {UNLISTED_ORDERS[-1]}.",
        "",
        gear_plot({"": error("unlisted_ripple")}, window=(3.0, 9.0)),
    ),
    Source(
        "errors.gear_friction",
        "`sign(w) (Fc + (Fs - Fc) exp(-(w/ws)^2)) + Fv w` of the speed w; `Fs = Fc` unless "
        f"`stribeck`. Before it slips, a bristle of at least {BRISTLE_TRAVEL * 1e6:g} urad of "
        "travel, longer where it would chatter with the rotor.",
        "robot file: Obal & Gierlak 2025 (IRB 2400), scaled for the NJ 220.",
        Plot(
            signals.gear_speed(1),
            signals.torque(1),
            ("speed of axis 1 [deg/s]", "torque, change [N m]"),
            {"stribeck": error("gear_friction", stribeck=True), "default": error("gear_friction")},
            points=250,
            marks=True,
        ),
        of_machine=("N m, Coulomb", lambda cell: cell.robot.gears.coulomb),
    ),
    Source(
        "errors.masses",
        "`m = nominal exp(spread z)`, `com = nominal + centre_sigma_m z`. Servo and identifier "
        "know the nominal ones.",
        "",
        Plot(
            signals.time,
            signals.torque(2),
            (T, "torque of axis 2, change [N m]"),
            {"": error("masses")},
        ),
    ),
    Source(
        "errors.payload",
        "`m = abs(sigma_kg z)`, its centre `centre_sigma_m z` from the plate's.",
        "",
        Plot(
            signals.time,
            signals.torque(2),
            (T, "torque of axis 2, change [N m]"),
            {"": error("payload")},
        ),
    ),
    Source(
        "plant.servo",
        "`tau = kp (u - shown) - kv m'`, no integral action; `u = g + kv/kp g'` of the reference "
        "(+ weight / kp).",
        "robot file: soft keeps the rod's force below the thesis's 150 N.",
        Plot(
            signals.time,
            signals.rod_force,
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
        "Adds `tau_g / kp` to the command, the weight of nominal robot and plate at the reference.",
        "",
        Plot(
            signals.time,
            lambda view: 1e3 * view.q[:, 1:3],
            (T, "logged, off - on [mrad]"),
            {"": {"plant": {"gravity_compensation": False}}},
            columns=("q2", "q3"),
        ),
    ),
)

BAR = (
    Source(
        "errors.rod_strain",
        "`F = k s`, `1 / k` the sum over the three; without it a rod of 1e10 N/m.",
        "ball-bar file: thesis sec. 5.3, Fig. 5.8.",
        Plot(
            signals.rod_force,
            signals.rod_stretch_um,
            ("rod force [N]", "rod elongation [um]"),
            {"": error("rod_strain")},
            points=450,
        ),
        of_machine=("N/m", lambda cell: cell.ballbar.axial_stiffness),
    ),
    Source(
        "errors.rod_backlash",
        "`F = k (s - clip(s, -w/2, w/2))`, w the sum of both widths.",
        "ball-bar file: half of the bound of thesis sec. 5.3.",
        Plot(
            signals.rod_force,
            signals.rod_stretch_um,
            ("rod force [N]", "rod elongation [um]"),
            {"with backlash": {"errors": {"rod_strain": {}, "rod_backlash": {}}}},
            {"errors": {"rod_strain": {}}},
            minus_off=False,
            show_off="without",
            points=450,
        ),
        of_machine=("m", lambda cell: cell.ballbar.backlash),
    ),
    Source(
        "errors.bar_friction",
        "`Fc = Fs` at each of the five joints.",
        "ball-bar file.",
        Plot(
            signals.time,
            signals.robot_angle(1, 1e6),
            (T, "q1, change [urad]"),
            {"": error("bar_friction")},
        ),
        of_machine=("N m", lambda cell: cell.ballbar.friction_torque),
    ),
    Source(
        "errors.plate_bending",
        "Deflection `F / k`, tilt `3 F / (2 k L)`, by a hinge of `k (2 L / 3)^2`, L / 3 from axis "
        "6.",
        "plate file: thesis secs. 4.5 and 5.4.",
        Plot(
            signals.time,
            lambda view: 1e6 * np.linalg.norm(view.residual, axis=1),
            (T, "tool, bar - robot [um]"),
            {
                "1.67e6 N/m": error("plate_bending", tip_stiffness_N_per_m=1.67e6),
                "1e7 N/m": error("plate_bending", tip_stiffness_N_per_m=1.0e7),
            },
        ),
        of_machine=("N/m", lambda cell: cell.plate.tip_stiffness),
    ),
    Source(
        "errors.base_compliance",
        "`x = F / k`.",
        "a steel adapter on a bolted plate, assumed.",
        residual_plot(error("base_compliance"), um=True),
    ),
)
