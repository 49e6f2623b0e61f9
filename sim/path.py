"""Reference paths: ball-bar angles over time, and the robot's command from inverse kinematics.

The five ball-bar angles are the five degrees of freedom of the closed mechanism, so a path written
in them stays on the sphere and away from the ball-bar's singularities by construction: `b_k = c_k +
A_k sin(2 pi n_k s + phi_k)`, with the phase s running from 0 to 1 (notes/plant sec. 10). The phase
is constant at the start, at the end and in every dwell between, and its acceleration is continuous,
so that both logs see the same dwells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import ARM_AXES, has_closed_form, robot_branches
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import BAR_ROWS, Geometry, bar_frames
from ballbar.cell.numerical_inverse import best_branches, in_range, led, polished
from ballbar.cell.robot_angles import joints_to_axes

FOLLOWED = 2  # configurations of an arm without closed form that a path is followed in
PER_CYCLE, LEAST_PHASES = 24, 96  # phases at which such an arm is led to the path
LEAST_AXES = 6  # that bring a tool to any pose
LARGEST_STEP = 1.0  # [rad] between two phases; more is a jump to another configuration
BRANCH = (True, True)  # b2 and b4 negative, as in the path files of this project
RAMP = 2.0  # [s] from a dwell to the cruising speed of the phase, and back: below 1 Hz


@dataclass(frozen=True)
class RodHarmonic:
    """One harmonic of the length of a telescoping rod: amplitude * sin(2 pi cycles s + phase)."""

    amplitude: float  # [m]
    cycles: int  # per run
    phase: float  # [rad]


@dataclass(frozen=True, eq=False)
class Lissajous:
    """Harmonics of the five ball-bar angles, and of the commanded rod; or those of several paths.

    Where the rod telescopes, it follows. Where it is rigid and the angles are held, the soft servo
    pulls and pushes on it (thesis Fig. 5.8).
    """

    centre: Array  # (..., 5) [rad]
    amplitude: Array  # (..., 5) [rad]
    cycles: Array  # (..., 5) whole numbers per run
    phase: Array  # (..., 5) [rad]
    rod: tuple[RodHarmonic, ...] = ()

    def angles(self, s: Array, share: float = 1.0) -> Array:
        """(..., N, 5) [rad] at phases s (N,), the motion scaled by a share of 1."""
        centre, amplitude, cycles, phase = (
            value[..., None, :] for value in (self.centre, self.amplitude, self.cycles, self.phase)
        )
        swing = np.sin(2.0 * np.pi * cycles * s[:, None] + phase)
        return np.asarray(centre + share * amplitude * swing)

    def lengthening(self, s: Array) -> Array:
        """(N,) [m] elongation of the commanded rod; 0 for a path on the sphere."""
        turn = 2.0 * np.pi * s
        waves = (h.amplitude * np.sin(h.cycles * turn + h.phase) for h in self.rod)
        return np.asarray(sum(waves, np.zeros_like(s)))


@dataclass(frozen=True, eq=False)
class ReferencePath:
    """The command of the controller."""

    t: Array  # (K,) [s] uniform, from 0
    b: Array  # (K, 5) [rad] ball-bar angles the nominal mechanism would take
    q: Array  # (K, 6) [rad] joint command, nominal inverse kinematics
    speed: Array  # (K, 6) [rad/s]


def phase_over_time(t: Array, *, duration: float, dwell: float, stops: int) -> Array:
    """(N,) phase 0..1 at times t (N,) [s] of a run of `duration` seconds.

    The phase dwells for `dwell` seconds at both ends and at `stops` places between, which divide it
    into equal pieces. Raises InputError when the dwells leave no time to move.
    """
    pieces = stops + 1
    moving = (duration - (stops + 2) * dwell) / pieces
    if moving <= 2.0 * RAMP:
        raise InputError(
            f"path.duration_s = {duration}: with {stops + 2} dwells of {dwell} s {moving:.1f} s "
            f"are left for each piece of the path, and {2 * RAMP} s go into its ramps. Take more "
            f"than {(stops + 2) * dwell + pieces * 2.0 * RAMP:g} s, or a shorter path.dwell_s."
        )
    phase = np.zeros_like(t)
    for k in range(pieces):
        phase += _piece((t - dwell - k * (moving + dwell)), moving) / pieces
    return phase


def _piece(t: Array, length: float) -> Array:
    """(N,) 0 to 1 over `length` seconds at times t (N,) [s] from its start.

    The speed rises and falls over RAMP with the smooth step 10x^3 - 15x^4 + 6x^5.
    """
    cruise = 1.0 / (length - RAMP)
    t = np.clip(t, 0.0, length)
    rising, falling = np.minimum(t, RAMP) / RAMP, np.maximum(0.0, t - (length - RAMP)) / RAMP
    between = np.clip(t, RAMP, length - RAMP) - RAMP
    ramps = RAMP * _ramp_integral(rising) + between + RAMP * (falling - _ramp_integral(falling))
    return cruise * ramps


def _ramp_integral(x: Array) -> Array:
    """Integral of the smooth step from 0 to x."""
    return np.asarray(2.5 * x**4 - 3.0 * x**5 + x**6)


def reference_path(
    robot: Robot,
    nominal: Geometry,
    shape: Lissajous,
    *,
    duration: float,
    dwell: float,
    stops: int,
    step: float,
    beginning: Array | None = None,
) -> ReferencePath:
    """The command of one run, sampled every `step` seconds; other times as in `phase_over_time`.

    beginning : (J,) [rad] joint angles near which it begins, which choose the configuration of the
        arm; by default the first that keeps the axis ranges.

    Raises InputError naming time, joint and value where the path leaves the robot's reach, an axis
    range or a speed limit.
    """
    t: Array = np.arange(round(duration / step) + 1, dtype=np.float64) * step
    phase = phase_over_time(t, duration=duration, dwell=dwell, stops=stops)
    b = shape.angles(phase)
    branches = branches_along(robot, nominal, shape, phase)
    if not branches:
        raise _out_of_reach(nominal, shape, t, phase)
    if beginning is not None:
        turned = [float(np.abs(np.angle(np.exp(1j * (q[0] - beginning)))).max()) for q in branches]
        branches = [branches[int(np.argmin(turned))]]
    closed = has_closed_form(nominal.robot)
    if closed:  # the arm less whole turns
        branches = [q - 2.0 * np.pi * np.round(q.mean(axis=0) / (2.0 * np.pi)) for q in branches]
    branches = [in_range(robot, q, first=ARM_AXES if closed else 0) for q in branches]
    q = _branch_in_range(robot, t, branches)
    speed = CubicSpline(t, q).derivative()(t)
    check_speeds(robot, t, speed)
    return ReferencePath(t, b, q, speed)


def tool_poses(nominal: Geometry, shape: Lissajous, s: Array, share: float = 1.0) -> Array:
    """(N, 4, 4) tool frames of a path at phases s (N,), or of its motion scaled by a share of 1.

    Of several paths (M N, 4, 4), one after the other.
    """
    b = shape.angles(s, share).reshape(-1, BAR_ROWS)
    frames, lengthening = bar_frames(nominal, b), share * shape.lengthening(s)
    poses = frames.poses()
    poses[:, :3, 3] += np.tile(lengthening, len(b) // s.size)[:, None] * frames.z[2].T
    return poses


def branches_along(robot: Robot, nominal: Geometry, shape: Lissajous, s: Array) -> list[Array]:
    """Joint angles (N, J) [rad] at phases s (N,) in the configurations that reach all of a path.

    In closed form where the arm has one: then they continue from sample to sample. Otherwise the
    arm is led from the middle of the path, at which its best configurations are searched, to all
    phases at once as the motion grows to its size, which keeps it continuous.

    Raises InputError for a robot of fewer than six axes, which cannot turn the tool as it goes.
    """
    chain = nominal.robot
    if has_closed_form(chain):
        every = robot_branches(chain, tool_poses(nominal, shape, s))
        return [np.unwrap(branch, axis=0) for branch in every if not np.isnan(branch).any()]
    if chain.rows < LEAST_AXES:
        raise InputError(
            f"robot {robot.name} has {chain.rows} axes; a path of the tool in place and direction "
            f"needs {LEAST_AXES}. Measure still poses, or take a path that was recorded."
        )
    grid = np.linspace(0.0, 1.0, max(LEAST_PHASES, PER_CYCLE * int(shape.cycles.max())) + 1)
    middle = tool_poses(nominal, shape, grid[:1], 0.0)
    starts = best_branches(robot, chain, middle, count=FOLLOWED)[:, 0]
    starts = starts[~np.isnan(starts).any(axis=1)]
    begin = np.repeat(starts, grid.size, axis=0)

    def at(share: float) -> Array:
        return np.tile(tool_poses(nominal, shape, grid, share), (len(starts), 1, 1))

    out, poses = [], tool_poses(nominal, shape, s)
    for coarse in led(chain, begin, at).reshape(len(starts), grid.size, chain.rows):
        if not np.isnan(coarse).any() and np.abs(np.diff(coarse, axis=0)).max() < LARGEST_STEP:
            q = polished(chain, CubicSpline(grid, coarse)(s), poses)
            out += [] if np.isnan(q).any() else [q]
    return out


def _out_of_reach(nominal: Geometry, shape: Lissajous, t: Array, phase: Array) -> InputError:
    """Says where a path that no configuration reaches is lost."""
    remedy = "move the ball-bar (cell.ballbar_position_m, metres) or shrink the path"
    if not has_closed_form(nominal.robot):
        return InputError(f"path: out of reach, or through a singular posture; {remedy}")
    lost = np.isnan(robot_branches(nominal.robot, tool_poses(nominal, shape, phase))).any(axis=2)
    first = int(lost.all(axis=0).argmax())
    angles = np.degrees(shape.angles(phase[first : first + 1])[0]).round(1)
    return InputError(
        f"path: out of reach at t = {t[first]:.2f} s (ball-bar angles {angles} deg); {remedy}"
    )


def _branch_in_range(robot: Robot, t: Array, branches: list[Array]) -> Array:
    """(N, J) [rad] of the first configuration that keeps the axis ranges."""
    faults = []
    for q in branches:
        fault = axis_range_fault(robot, t, q)
        if fault is None:
            return q
        faults.append(fault)
    raise InputError(
        "path: every configuration of the arm that it may take leaves an axis range; "
        f"the nearest to feasible: {min(faults)[1]}"
    )


def axis_range_fault(robot: Robot, t: Array, q: Array) -> tuple[float, str] | None:
    """How far [rad] the worst sample leaves an axis range, and a sentence that says where.

    t : (N,) [s]. q : (N, 6) [rad] joint angles. Returns None where all axes stay in their ranges.
    """
    axes = joints_to_axes(robot, q)
    excess = np.maximum(robot.axis_lower - axes, axes - robot.axis_upper)
    if excess.max() <= 0.0:
        return None
    k, axis = (int(i) for i in np.unravel_index(int(excess.argmax()), excess.shape))
    limits = f"{np.degrees(robot.axis_lower[axis]):.0f}..{np.degrees(robot.axis_upper[axis]):.0f}"
    return (
        float(excess.max()),
        f"axis {axis + 1} at t = {t[k]:.2f} s: {np.degrees(axes[k, axis]):.1f} deg "
        f"outside {limits} deg; move the ball-bar or shrink the path",
    )


def check_speeds(robot: Robot, t: Array, speed: Array) -> None:
    """Raise InputError where joint speeds (N, 6) [rad/s] at times (N,) [s] exceed a limit."""
    ratio = np.abs(speed @ robot.joint_to_axis) / robot.axis_speed_max
    if ratio.max() > 1.0:
        k, axis = (int(i) for i in np.unravel_index(int(ratio.argmax()), ratio.shape))
        limit = np.degrees(robot.axis_speed_max[axis])
        raise InputError(
            f"path: axis {axis + 1} at t = {t[k]:.2f} s turns at "
            f"{ratio[k, axis] * limit:.0f} deg/s, limit {limit:.0f} deg/s; run it slower"
        )
