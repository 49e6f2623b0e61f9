"""Typical masses, gears and servo gains of a robot of a given size, where its file is silent.

A robot's file may state no masses, gears, servo or rotors. Plans of the force in a ball-bar's rod
and the dynamic simulation then take typical values, each with the spread over published robots;
an identification has unknowns about them (ballbar.ident.corrections.typical_gears). Sizes are
scaled with the chain's length L (`arm_length`) and the robot's mass M. Every spread is the standard
deviation of a natural logarithm.

Sources: data sheets of 16 robots for their masses (below); [I] and [N], cell/robots/irb2400.yaml
and nj220.yaml with the sources that they name; [U] Universal Robots, ur_description,
physical_parameters.yaml of UR5e and UR10e; [K] iiwa_stack, iiwa14 URDF; [P] Gaz et al. 2019, doi
10.1109/LRA.2019.2931248 (Panda).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.descriptions import Gears, Key, Link, Robot, ServoGains
from ballbar.cell.geometry import nominal_chain

KEYS: tuple[Key, ...] = ("links", "servo", "gears", "rotor_inertia_kg_m2")
GRAVITY = 9.81  # [m/s^2] standard gravity, rounded

# Mass of the whole robot, over the data sheets. Arms whose shoulder stands off axis 1 are
# industrial ones: M = 45 kg (L / m)^3: irb1600 250 kg, irb2400 380, irb4600 435, irb6640 1310,
# kr10_r1100 54, kr210 1068, m20ia 250, gp25 250, nj220 1220. The others are light: M = 24 kg
# (L / m): irb120 25, ur5 18.4, ur5e 20.6, ur10 28.9, ur10e 33.5, panda 18, iiwa14 29.9. Spreads:
# 0.44 and 0.33 about these lines.
INDUSTRIAL, LIGHT = (45.0, 3.0, 0.45), (24.0, 1.0, 0.35)  # kg, power of L, spread
SHOULDER = 0.03  # share of L by which the shoulder of an industrial arm stands off axis 1 at least
# Share of the robot's mass that base and links have, over their place in the chain from 0, the
# base, to 1, the last link: geometric means of [I], [N], [U], [K] and [P], rounded.
PLACES, SHARES = (0.0, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6, 1.0), (30, 26, 16, 11, 8, 5, 1)
LINK_SPREAD = 0.4  # of one link beside the whole robot; the robots of SHARES have 0.3 to 0.7
DENSITY = 2000.0  # [kg/m^3] of a ball of the link's mass, for its inertia; assumed

# Stiffness of a main gear over M g L: [I] 95, [N] 79, [P] about 90 with the 14 kN m/rad that are in
# use for a Panda (recalled), KUKA KR 240-2 100 to 140 (Dumas et al. 2011, recalled).
STIFFNESS, STIFFNESS_SPREAD, GEAR_SPREAD = 92.0, 0.35, 0.2
# Of the gears from the base, over that of the first: [I] and [N]; of seven axes as the rated
# torques of a KUKA LBR iiwa 14 R820 (data sheet: 320, 320, 176, 176, 110, 40, 40 N m).
OF_AXES = {6: (1.0, 1.1, 0.85, 0.13, 0.11, 0.1), 7: (1.0, 1.0, 0.55, 0.55, 0.34, 0.12, 0.12)}
WRIST = 3  # axes at the end whose gears are small ones
DAMPING = (1e-3, 3e-4)  # [s] over stiffness, main axes and wrist: [I], [N]
LOST_MOTION_RAD = (1.35e-4, 2.0e-4)  # [rad] [I], [N]
# Friction over stiffness: Coulomb [rad], viscous [s]: [I], [N]
COULOMB, VISCOUS, STATIC = (6e-5, 1.5e-4), (2.7e-5, 1.1e-4), 1.4
FRICTION_SPREAD, STRIBECK = 0.5, (0.008, 0.017)  # the second in rad/s
RATIO = (130.0, 60.0)  # turns of the motor per turn of the output: [I], and of [N] 180 to 110
# [s^2] rotor, referred to the output, over stiffness: [I] 22 / 6e5 and 0.5 / 6e4, [N] 130 / 2.6e6
# and 38 / 4e5
ROTOR, ROTOR_SPREAD = (4.3e-5, 2.7e-5), 0.9
# Cycles a turn and [rad] of the harmonic errors, the last of the motor: [I], [N]
HARMONICS = (
    ((1.0, 6e-5), (40.0, 7e-5), (80.0, 2.7e-5), (RATIO[0], 3.5e-5)),
    ((1.0, 8e-5), (2.0, 3e-5), (RATIO[1], 6e-5)),
)
# Soft and stiff servo: kp over the gear's stiffness, and kv over kp [s] of main axes and wrist, as
# [I] assumes and [N] after it. A soft gain is a setting of the controller (ABB SoftServo, KUKA soft
# axes): SERVO_SPREAD is how far a setting may be off.
SERVO = {"soft": (1.0 / 15.0, (0.05, 0.02)), "stiff": (1.6, (0.01, 0.005))}
SERVO_SPREAD = 0.3


@dataclass(frozen=True, eq=False)
class Spread:
    """Keys that hold typical values, and how far a robot of its size may be from them."""

    keys: tuple[Key, ...]  # of the robot's file that are filled; none for a complete file
    mass: float = 0.0  # of the whole robot, standard deviation of the logarithm

    def drawn(self, robot: Robot, rng: np.random.Generator, scale: float = 1.0) -> Robot:
        """A robot of the spread about a typical one; scale : factor on every spread.

        What the robot's file states stays as it is.
        """
        n = robot.joints
        whole, links, stiff, gears, setting, rubs, rotors = (
            scale * rng.standard_normal(size) for size in (1, n + 1, 1, n, 1, n, n)
        )
        stiffness = np.exp(STIFFNESS_SPREAD * stiff + GEAR_SPREAD * gears)
        out = robot
        if "links" in self.keys:
            factors = np.exp(self.mass * whole + LINK_SPREAD * links)
            out = replace(out, links=tuple(map(_heavier, robot.required("links"), factors)))
        if "gears" in self.keys:
            g, rub = robot.required("gears"), stiffness * np.exp(FRICTION_SPREAD * rubs)
            parts = {name: stiffness * getattr(g, name) for name in ("stiffness", "damping")}
            parts |= {name: rub * getattr(g, name) for name in ("static", "coulomb", "viscous")}
            out = replace(out, gears=replace(g, **parts))
        if "servo" in self.keys:
            f = (stiffness if "gears" in self.keys else 1.0) * np.exp(SERVO_SPREAD * setting)
            gains = robot.required("servo").items()
            out = replace(out, servo={k: ServoGains(f * v.kp, f * v.kv) for k, v in gains})
        if "rotor_inertia_kg_m2" in self.keys:
            rotor = robot.required("rotor_inertia_kg_m2") * np.exp(ROTOR_SPREAD * rotors)
            out = replace(out, armature=rotor)
        return out


def arm_length(robot: Robot) -> float:
    """[m] length L of the chain from axis 1 to the last axis, the height of axis 1 left out."""
    return float(abs(robot.a[0]) + np.hypot(robot.a[1:-1], robot.d[1:-1]).sum())


def motor_turns(robot: Robot) -> Array:
    """(J,) turns of each motor per turn of what the robot's file takes for it.

    Typical ones where its matrix motor_to_joint states no gear, else 1.
    """
    stated = np.abs(np.diag(robot.transmission))
    return np.where(stated == 1.0, _by_axis(RATIO, robot.joints), 1.0)


def with_typical(robot: Robot) -> tuple[Robot, Spread]:
    """The robot with typical values for whatever its file lacks, and their spread.

    A complete robot is returned itself, with an empty spread.
    """
    lacking = tuple(key for key in KEYS if robot.lacks(key))
    if not lacking:
        return robot, Spread(())
    length = arm_length(robot)
    size, power, spread = INDUSTRIAL if abs(robot.a[0]) > SHOULDER * length else LIGHT
    mass, filled = size * length**power, robot
    if robot.links is None:
        filled = replace(filled, links=_links(robot, mass))
    else:
        mass, spread = sum(link.mass for link in robot.links), 0.0
    gears = filled.gears or _gears(robot, mass * GRAVITY * length)
    k = gears.stiffness
    filled = replace(filled, gears=gears, servo=filled.servo or _servo(k))
    if filled.armature is None:
        filled = replace(filled, armature=_by_axis(ROTOR, robot.joints) * k)
    return filled, Spread(lacking, spread)


def _by_axis(pair: tuple[float, float], joints: int) -> Array:
    """(J,) a value of the main axes, then that of the wrist."""
    return np.repeat(pair, (joints - WRIST, WRIST))


def _links(robot: Robot, mass: float) -> tuple[Link, ...]:
    """Base and links half way between their frames' origins, rods with balls at their centre."""
    n = robot.joints
    share = np.exp(np.interp(np.linspace(0.0, 1.0, n + 1), PLACES, np.log(SHARES)))
    frames = forward(nominal_chain(robot), np.zeros((1, n)))
    ends, out = frames.origin[:, :, 0], []
    for k, m in enumerate(mass * share / share.sum()):
        begin, end = ends[max(k - 1, 0)], ends[k]
        along = end - begin
        ball = 0.4 * m * (0.75 * m / (np.pi * DENSITY)) ** (2.0 / 3.0)
        rod = m / 12.0 * (along @ along * np.eye(3) - np.outer(along, along))
        out.append(Link(float(m), 0.5 * (begin + end), ball * np.eye(3) + rod))
    return tuple(out)


def _heavier(link: Link, factor: float) -> Link:
    return Link(link.mass * float(factor), link.com, link.inertia * factor)


def _gears(robot: Robot, moment: float) -> Gears:
    """Gears of a robot of weight times length `moment` [N m]."""
    n = robot.joints
    axes = np.interp(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, 6), OF_AXES[6])
    k = STIFFNESS * moment * np.array(OF_AXES.get(n, axes))
    coulomb = _by_axis(COULOMB, n) * k
    return Gears(
        stiffness=k,
        damping=_by_axis(DAMPING, n) * k,
        lost_motion=_by_axis(LOST_MOTION_RAD, n),
        static=STATIC * coulomb,
        coulomb=coulomb,
        viscous=_by_axis(VISCOUS, n) * k,
        stribeck=_by_axis(STRIBECK, n),
        harmonics=(HARMONICS[0],) * (n - WRIST) + (HARMONICS[1],) * WRIST,
    )


def _servo(stiffness: Array) -> Mapping[str, ServoGains]:
    """Gain sets over gears of a stiffness (J,) [N m/rad]."""
    return {
        name: ServoGains(share * stiffness, share * stiffness * _by_axis(lead, stiffness.size))
        for name, (share, lead) in SERVO.items()
    }
