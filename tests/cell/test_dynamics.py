"""Joint torques against the energy of the bodies, as central differences give it."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.descriptions import Link
from ballbar.cell.dynamics import joint_moments, joint_torques, torques_of_each
from ballbar.cell.rotation import rotvec_from_matrix

GRAVITY = np.array([1.2, -0.7, -9.7])  # [m/s^2] on a slope
RNG = np.random.default_rng(11)
CHAIN = Chain(*RNG.uniform(-0.8, 0.8, (5, 4)))
Q, SPEED, ACCELERATION = RNG.uniform(-1.5, 1.5, (3, 30, 4))


def body() -> Link:
    root = RNG.uniform(-0.3, 0.3, (3, 3))
    return Link(RNG.uniform(1.0, 5.0), RNG.uniform(-0.4, 0.4, 3), root @ root.T)


BODIES = [[body()], [], [body(), body()], [body()]]
EACH = [(joint, link) for joint, links in enumerate(BODIES) for link in links]


def places(q: Array) -> list[tuple[Array, Array]]:
    """Rotation (3, 3, N) and centre of mass (3, N) [m] of each body."""
    frames, out = forward(CHAIN, q), []
    for joint, link in EACH:
        x, y, z = frames.x[joint], frames.y[joint], frames.z[joint]
        cos, sin = np.cos(q[:, joint]), np.sin(q[:, joint])
        axes = np.stack((cos * x + sin * y, cos * y - sin * x, z), axis=1)
        out.append((axes, frames.origin[joint] + np.einsum("ijn,j->in", axes, link.com)))
    return out


def lagrangian(q: Array, speed: Array) -> tuple[Array, Array]:
    """(N,) [J] kinetic and potential energy of all bodies."""
    step = 1e-4  # [s] the error is of fourth order
    steps = (2.0, 1.0, -1.0, -2.0)
    ends = [places(q + each * step * speed) for each in steps]
    weights = np.array([-1.0, 8.0, -8.0, 1.0]) / (12.0 * step)
    kinetic, potential = np.zeros(len(q)), np.zeros(len(q))
    for k, ((_, link), (axes, com)) in enumerate(zip(EACH, places(q), strict=True)):
        velocity = sum(w * end[k][1] for w, end in zip(weights, ends, strict=True))
        omega = sum(
            w * rotvec_from_matrix(np.einsum("jin,jkn->ikn", axes, end[k][0]))
            for w, end in zip(weights, ends, strict=True)
        )  # in the body's frame
        kinetic += 0.5 * link.mass * (velocity**2).sum(axis=0)
        kinetic += 0.5 * np.einsum("in,ij,jn->n", omega, link.inertia, omega)
        potential -= link.mass * GRAVITY @ com
    return kinetic, potential


def test_at_rest_the_torques_are_the_slopes_of_the_potential_energy() -> None:
    torques = joint_torques(forward(CHAIN, Q), BODIES, Q, gravity=GRAVITY)
    for j in range(4):
        step = 1e-6 * np.eye(4)[j]
        ends = [lagrangian(Q + sign * step, np.zeros_like(Q))[1] for sign in (1.0, -1.0)]
        assert torques[j] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-7)


def test_the_power_of_the_torques_is_the_change_of_the_energy() -> None:
    torques = joint_torques(
        forward(CHAIN, Q), BODIES, Q, gravity=GRAVITY, speed=SPEED, acceleration=ACCELERATION
    )
    step = 1e-4
    ends = []
    for s in (-step, step):
        q = Q + s * SPEED + 0.5 * s**2 * ACCELERATION
        ends.append(sum(lagrangian(q, SPEED + s * ACCELERATION)))
    power = (ends[1] - ends[0]) / (2.0 * step)
    # [W] of about 500: curvature over the step leaves 1e-6 of it
    assert (torques.T * SPEED).sum(axis=1) == pytest.approx(power, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("moving", [True, False])
def test_torques_are_the_sum_of_what_each_body_asks_for(moving: bool) -> None:
    frames = forward(CHAIN, Q)
    motion = {"speed": SPEED, "acceleration": ACCELERATION} if moving else {}
    each = torques_of_each(frames, EACH, Q, gravity=GRAVITY, **motion)
    assert each.shape == (4, 4, 30)
    assert not each[0, 1:].any()  # the joints beyond a body do not carry it
    total = joint_torques(frames, BODIES, Q, gravity=GRAVITY, **motion)
    assert each.sum(axis=0) == pytest.approx(total, abs=1e-12)
    moments = joint_moments(frames, BODIES, Q, gravity=GRAVITY, **motion)
    assert (moments * frames.z[:4]).sum(axis=1) == pytest.approx(total, abs=1e-12)


def test_at_rest_the_first_bearing_carries_the_moment_of_all_weights() -> None:
    frames = forward(CHAIN, Q)
    moments = joint_moments(frames, BODIES, Q, gravity=GRAVITY)
    expected = sum(
        np.cross(com - frames.origin[0], -link.mass * GRAVITY[:, None], axis=0)
        for (_, link), (_, com) in zip(EACH, places(Q), strict=True)
    )
    assert moments[0] == pytest.approx(expected, abs=1e-12)
