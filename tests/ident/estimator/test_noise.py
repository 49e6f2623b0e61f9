"""Noise levels as the logs show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.estimator.noise import ExcessNoise, log_noise
from tests.helpers.synthetic_recording import recording


def test_each_encoder_has_the_noise_of_its_channel_and_none_where_it_is_not_fitted() -> None:
    samples = recording(encoders=(2, 4, 5), stated=3e-6)
    ballbar = replace(samples.ballbar, noise=np.array([1e-6, 2e-6, 3e-6]))
    noise = log_noise(samples.robot, ballbar, (2, 4, 5))
    assert np.array_equal(noise.encoder, [0.0, 1e-6, 0.0, 2e-6, 3e-6])
    assert np.array_equal(noise.joint, np.full(6, 3e-6))


def test_a_ball_bar_without_encoders_has_no_noise() -> None:
    samples = recording(encoders=())
    assert not log_noise(samples.robot, None, ()).encoder.any()


def test_without_excess_noise_the_logs_say_it_all() -> None:
    assert ExcessNoise() == ExcessNoise(gear=0.0, wrist=0.0, bar=0.0, rod=0.0)
