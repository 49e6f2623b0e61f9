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
        "`L = K e`; the log shows `m`, the joint stands at `q = m + e`. Gear i is combination i of "
        "the joints (`joint_to_gear`).",
        "Plant: a second hinge `e` behind each motor hinge `m`, spring and damper on the gear's "
        "combination of the hinges.",
        "Robot file: Manutec r3 (same class) and RV catalogue rigidity; no identified stiffness of "
        "an IRB 2400 was found.",
        "The loop does not close by a smooth millimetre that follows gravity; the part the rod's "
        "force makes comes on top.",
        residual_plot(error("joint_compliance")),
        of_machine=("N m/rad", lambda cell: cell.robot.gears.stiffness),
    ),
    Source(
        "errors.gear_backlash",
        "Total width w. Dead band: `L = K (e - clip(e, -w/2, w/2))`. Hysteresis: beside `K e` a "
        "friction element, "
        f"{HYSTERESIS_STIFFNESS:g} times as stiff, that slips at `K w/2`.",
        "Plant: spring of the gear. Not without `joint_compliance`.",
        "Robot file: below the catalogues' bound of 1 arcmin (Nabtesco RV-E, recalled; Harmonic "
        "Drive doc. 1018854).",
        "Dead band: a step of w where the load changes sign. Hysteresis: up to w/2 to one side "
        "while the load rises, "
        "to the other while it falls.",
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
        of_machine=("rad, total width", lambda cell: cell.robot.gears.lost_motion),
    ),
    Source(
        "errors.transmission_error",
        "`delta(g) = sum A_k sin(n_k g + phi_k)`, g the gear's output; the motor shows `g - "
        "delta(g)`. Phases drawn.",
        "Encoder and servo: the log shows `g - delta(g)`, and the servo, which sees the same, "
        "turns the gear unevenly.",
        "Robot file: below 1 arcmin peak to peak, what RV reducers are allowed; the split over the "
        "orders is assumed.",
        "Residual with the gear's orders over its angle; independent of load.",
        gear_plot({"": error("transmission_error")}, window=(3.0, 9.0), points=450),
        of_machine=(
            "rad, axis 1; orders are in the file",
            lambda cell: [a for _, a in cell.robot.gears.harmonics[0]],
        ),
    ),
    Source(
        "errors.cycloid_ripple",
        "Harmonic: `A sin(N g + phi)`. Cusped: `A pi/2 (abs(sin(x/2)) - 2/pi)`, `x = N g + phi`: "
        "zero mean, unit peak at the cusp, "
        f"by its first {CUSP_TERMS} harmonics `-2 A cos(k x) / (4 k^2 - 1)`.",
        "As transmission_error; harmonics of one order add up.",
        "Assumed: amplitude and pin count. Waveform: Yang & Blanche 1990, Mech. Mach. Theory "
        "25(5); thesis Fig. 2.4.",
        "N cycles a turn; harmonics 2 N, 3 N tell the cusped wave from the sine.",
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
        "`A sin(n g + phi)`; n = 1 on the output side, n = gear ratio on the input side.",
        "As transmission_error.",
        "Assumed: of the order of the robot files' first harmonic; thesis sec. 2.3 gives the "
        "shape.",
        "Output side: a slow wave that a path of less than a turn can mistake for joint offset and "
        "geometry. "
        "Input side: one cycle a motor turn.",
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
        "`A sin(n g + phi)`, n drawn for each gear from the whole numbers "
        f"{UNLISTED_ORDERS[0]} to {UNLISTED_ORDERS[-1]} that its list does not hold.",
        "As transmission_error.",
        "Assumed: an identified list of orders leaves out what is small.",
        "A wave of an order that no model of the gears has; a fit must look for it.",
        gear_plot({"": error("unlisted_ripple")}, window=(3.0, 9.0)),
    ),
    Source(
        "errors.gear_friction",
        "`sign(w) (Fc + (Fs - Fc) exp(-(w/ws)^2)) + Fv w` against the speed w; `Fs = Fc` unless "
        "`stribeck`. Before it slips, a bristle of "
        f"at least {BRISTLE_TRAVEL * 1e6:g} urad of travel (LuGre), longer where it would chatter "
        "with the rotor.",
        "Plant: between servo and motor hinge.",
        "Robot file: friction table of Obal & Gierlak 2025 (IRB 2400); the NJ 220's is scaled from "
        "it.",
        "Torque log: a step at each reversal of the axis. Angles: a soft servo stops short by `Fc "
        "/ kp`; the log sees it, "
        "so the loop closes all the same.",
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
        "`m = nominal exp(spread z)`, inertia with m; `com = nominal + centre_sigma_m z` in x, y "
        "and z. The servo's feed-forward and the identifier know the nominal ones.",
        "Plant: bodies of robot, plate and ball-bar.",
        "Assumed: what a weighed or modelled part leaves open.",
        "The arm leans on the soft servo and the rod; elastic gears yield otherwise than the "
        "files' masses say.",
        Plot(
            signals.time,
            signals.torque(2),
            (T, "torque of axis 2, change [N m]"),
            {"": error("masses")},
        ),
    ),
    Source(
        "errors.payload",
        "`m = abs(sigma_kg z)` more on the plate, its centre `centre_sigma_m z` from the plate's "
        "in x, y and z. Feed-forward and identifier know nothing of it.",
        "Plant: body of the plate.",
        "Assumed: a tenth of the plate's 4.3 kg; hoses and cables.",
        "A tool that is heavier than its file; the torques show it, the geometry does not.",
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
        "Plant: actuators on the motor hinges.",
        "Robot file, assumed: the soft one (SoftServo 80 %) keeps the rod's force below the "
        "thesis's 150 N (notes/parameters, experiment).",
        "With a wrong geometry the stiff servo presses some twenty times as hard on the ball-bar; "
        "the compliance shows in the residual.",
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
        "Adds `tau_g / kp` to the command, the weight of the nominal robot with its plate at the "
        "reference.",
        "Servo command.",
        "On: a controller knows its arm's weight.",
        "Off: the arm sags on the soft servo until the ball-bar holds part of it. The log sees the "
        "sag.",
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
        "`F = k s`, s the rod's elongation, `1 / k` the sum over rod, gimbal and universal joint; "
        "without it a rod of 1e10 N/m, 0.01 um at 100 N.",
        "Plant: spring of the rod's slide.",
        "Ball-bar file: thesis sec. 5.3 and Fig. 5.8, at 150 N 2.7 um of the rod and 2.8 um of "
        "each joint, 8.3 um together.",
        "The rod's length follows its force.",
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
        "`F = k (s - clip(s, -w/2, w/2))`, s the rod's elongation, k its stiffness, w the sum over "
        "gimbal and universal joint.",
        "Plant: spring of the rod's slide.",
        "Ball-bar file: half of what thesis sec. 5.3 bounds it by, 5 um a joint; Fig. 5.9.",
        "The rod's length jumps by w where its force changes sign.",
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
        of_machine=("m, total width", lambda cell: cell.ballbar.backlash),
    ),
    Source(
        "errors.bar_friction",
        "LuGre with `Fc = Fs`, the stated torque, at each of the five joints; before it slips, an "
        "elastic bristle.",
        "Plant: ball-bar hinges.",
        "Ball-bar file, assumed.",
        "Nothing in the residual: steps of some urad where a ball-bar joint reverses, in both logs "
        "equally.",
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
        "Cantilever: deflection `F / k`, tilt `3 F / (2 k L)` by a hinge of `k (2 L / 3)^2`, L / 3 "
        "from the sixth axis.",
        "Plant: hinge about the plate's y.",
        "Plate file: thesis secs. 4.5 and 5.4, about 10 um per 100 N; plate_250_thin is the 60 um "
        "one of the Comau experiment.",
        "Residual across the plate that follows the rod's force.",
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
        "`x = F / k`, equally in x, y and z.",
        "Plant: three slides under the ball-bar's base.",
        "Assumed: a steel adapter on a bolted plate. Thesis Fig. 5.8 measured base movement.",
        "Residual along the rod's force, as if the rod were softer.",
        residual_plot(error("base_compliance"), um=True),
    ),
)
