"""The text of a robot's description file, from a draft."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Link
from ballbar.robot_file.draft import (
    ASSUMED_RANGE_DEG,
    DEGREE_DIGITS,
    LENGTH_DIGITS,
    LIMIT_DIGITS,
    RobotDraft,
)

GRAVITY = 9.81  # [m/s^2] standard gravity, rounded
_WIDTH = 98


def description_text(draft: RobotDraft) -> str:
    """YAML of schema ballbar-robot/1. What the draft does not state is left out."""
    return "".join(
        [
            *_comment(f"Made by `ballbar robot new` from {draft.source}"),
            f"schema: ballbar-robot/1\ntitle: {json.dumps(draft.title, ensure_ascii=False)}\n\n",
            *_transforms(draft),
            *_rows(draft),
            *_signs(draft.form.sign),
            *_limits(draft),
            *_links(draft),
            *_gravity(draft),
        ]
    )


def missing(draft: RobotDraft) -> list[tuple[str, str]]:
    """Keys that the source does not state, and what they are needed for."""
    lacking = []
    if draft.unlimited:
        axes = ", ".join(map(str, draft.unlimited))
        use = f"+-{ASSUMED_RANGE_DEG:g} deg stands in their place; correct it before planning"
        lacking.append((f"limits of axis {axes}", use))
    if not np.isfinite(draft.speed).all():
        lacking.append(("axis_speed_max_deg_per_s", "planning of paths, and motion at real speed"))
    if isinstance(draft.bodies, str):
        reason = f"dynamic simulation, planning of paths, loads of gears ({draft.bodies})"
        lacking.append(("links (masses)", reason))
    return [
        *lacking,
        ("motor_to_joint", "logs of motor angles, and gears; without it a motor is its joint"),
        ("gears", "dynamic simulation; errors by elasticity, friction, backlash and ripple"),
        ("servo, rotor_inertia_kg_m2", "dynamic simulation"),
    ]


def transform_lines(pose: Array) -> list[str]:
    """Three rows of a pose (4, 4) [m] as text."""
    return [f"[{', '.join(f'{value:.12g}' for value in row)}]" for row in pose[:3]]


def is_identity(pose: Array) -> bool:
    """Whether a pose (4, 4) [m] is no transform at all."""
    return bool((pose == np.eye(4)).all())


def _comment(text: str) -> Iterable[str]:
    """Lines of a comment; signs that end a line in YAML, in a joint's name, become blanks."""
    text = "".join(sign if sign.isprintable() else " " for sign in text)
    lines = textwrap.wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False)
    yield from (f"# {line}\n" for line in lines)


def _transforms(draft: RobotDraft) -> Iterable[str]:
    """Transforms that standard rows cannot hold, as comments: no computation reads them."""
    form = draft.form
    for name, pose, text in (
        ("T_base_dh", form.T_base_dh, "of the frame of row 1 in the source's base frame"),
        ("T_flange_tip", form.T_flange_tip, "of the source's tip in the frame of the last row"),
    ):
        if not is_identity(pose):
            yield from _comment(f"{name}, pose {text}; DH rows cannot hold it. Rotation, m:")
            yield from (f"#   {line}\n" for line in transform_lines(pose))


def _rows(draft: RobotDraft) -> Iterable[str]:
    chain = draft.form.chain
    yield "dh:\n"
    for i in range(chain.rows):
        a, d = (_number(v[i], LENGTH_DIGITS) for v in (chain.a, chain.d))
        alpha, theta = (
            _number(np.rad2deg(v[i]), DEGREE_DIGITS) for v in (chain.alpha, chain.theta)
        )
        yield f"  - {{a_m: {a}, d_m: {d}, alpha_deg: {alpha}, theta_deg: {theta}}}\n"


def _signs(sign: Array) -> Iterable[str]:
    if (sign > 0).all():
        return
    axes = ", ".join(str(i + 1) for i in np.flatnonzero(sign < 0))
    yield "\n"
    yield from _comment(f"Axis {axes}: counted in the other direction than about z of the DH row.")
    yield "controller_to_joint:\n"
    for row in np.diag(sign).astype(int) + 0:
        yield f"  - [{', '.join(map(str, row))}]\n"


def _limits(draft: RobotDraft) -> Iterable[str]:
    yield "\n"
    if draft.unlimited:
        axes = ", ".join(map(str, draft.unlimited))
        yield from _comment(
            f"Axis {axes}: the source states no limits; +-{ASSUMED_RANGE_DEG:g} deg is assumed. "
            "Take them from the data sheet."
        )
    stated = np.isfinite(draft.upper - draft.lower)
    lower = np.where(stated, np.rad2deg(draft.lower), -ASSUMED_RANGE_DEG)
    upper = np.where(stated, np.rad2deg(draft.upper), ASSUMED_RANGE_DEG)
    yield f"axis_lower_deg: {_list(lower, LIMIT_DIGITS)}\n"
    yield f"axis_upper_deg: {_list(upper, LIMIT_DIGITS)}\n"
    if np.isfinite(draft.speed).all():
        yield f"axis_speed_max_deg_per_s: {_list(np.rad2deg(draft.speed), LIMIT_DIGITS)}\n"


def _links(draft: RobotDraft) -> Iterable[str]:
    if isinstance(draft.bodies, str):
        return
    yield "\n"
    yield from _comment(
        "com in the robot base frame, inertia about the com with axes parallel to it, all joint "
        "angles zero; order xx yy zz xy xz yz."
    )
    yield "links:\n"
    T_base_dh = draft.form.T_base_dh
    turn, origin = T_base_dh[:3, :3], T_base_dh[:3, 3]
    for i, link in enumerate(draft.bodies):
        com = turn.T @ (link.com - origin)
        body = Link(link.mass, com, turn.T @ link.inertia @ turn)
        yield f"  {f'link{i}' if i else 'base'}: {_link(body)}\n"


def _link(link: Link) -> str:
    m = link.inertia
    inertia = np.array([m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]])
    inertia[np.abs(inertia) < 1e-9 * np.trace(m)] = 0.0  # rounding of the turn
    values = ", ".join(f"{value:.9g}" for value in inertia)
    return f"{{mass_kg: {link.mass:.9g}, com_m: {_list(link.com, 9)}, inertia_kg_m2: [{values}]}}"


def _gravity(draft: RobotDraft) -> Iterable[str]:
    """Gravity in the robot base frame, where this is not upright as the source's base is."""
    gravity = draft.form.T_base_dh[:3, :3].T @ np.array([0.0, 0.0, -GRAVITY])
    if np.abs(gravity[:2]).max() > 0.0:
        yield "\n"
        yield from _comment("The source's base is taken as upright.")
        yield f"gravity_m_per_s2: {_list(gravity, LENGTH_DIGITS)}\n"


def _list(values: Sequence[float] | Array, digits: int) -> str:
    return f"[{', '.join(_number(value, digits) for value in values)}]"


def _number(value: float, digits: int) -> str:
    return f"{round(float(value), digits) + 0.0:.15g}"
