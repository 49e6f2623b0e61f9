"""Lenses against formulas of OpenCV's manual, central differences, and their own inverse."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.camera import NAMES, Lens, LensModel
from ballbar.cell.instrument import (
    CALIBRATED,
    CENTRE,
    DISTORTION,
    FOCAL,
    SQUARE,
    CameraFile,
    camera_of,
)

VALUES = {
    "brown": [800.0, 820.0, 630.0, 470.0, -0.21, 0.08, 2e-3, -3e-3, 0.02],
    "fisheye": [500.0, 510.0, 630.0, 470.0, -0.03, 0.01, -4e-3, 2e-3],
}
MODELS: tuple[LensModel, ...] = ("brown", "fisheye")


def lens(model: LensModel) -> Lens:
    return Lens(model, np.array(VALUES[model]))


def camera_file(**values: object) -> CameraFile:
    return CameraFile.model_validate({"image_px": [1280, 960]} | values)


def points(count: int = 40) -> Array:
    """(N, 3) [m] in front of the camera, the first on the optical axis."""
    tangents = np.random.default_rng(4).uniform(-0.5, 0.5, (count, 2))
    tangents[0] = 0.0
    depth = np.linspace(0.4, 2.0, count)[:, None]
    return np.hstack((tangents * depth, depth))


def by_hand(model: LensModel, point: Array) -> Array:
    """Pixels (2,) of one point, written out as in the manual of OpenCV."""
    fx, fy, cx, cy, *k = VALUES[model]
    x, y = point[0] / point[2], point[1] / point[2]
    r = np.sqrt(x**2 + y**2)
    if model == "brown":
        k1, k2, p1, p2, k3 = k
        radial = 1.0 + k1 * r**2 + k2 * r**4 + k3 * r**6
        u = x * radial + 2.0 * p1 * x * y + p2 * (r**2 + 2.0 * x**2)
        v = y * radial + p1 * (r**2 + 2.0 * y**2) + 2.0 * p2 * x * y
    else:
        angle = np.arctan(r)
        bent = angle * (1.0 + sum(c * angle ** (2 * i + 2) for i, c in enumerate(k)))
        u, v = (x * bent / r, y * bent / r) if r else (0.0, 0.0)
    return np.array([fx * u + cx, fy * v + cy])


@pytest.mark.parametrize("model", MODELS)
def test_a_lens_images_points_as_the_manual_of_opencv_writes_it(model: LensModel) -> None:
    assert len(NAMES[model]) == len(VALUES[model])
    expected = np.array([by_hand(model, point) for point in points()])
    assert lens(model).image(points())[0] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_by_point_and_lens_are_central_differences(model: LensModel) -> None:
    _, by_point, by_lens = lens(model).image(points())
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]  # [m]
        ends = [lens(model).image(points() + sign * step)[0] for sign in (1.0, -1.0)]
        # the fisheye lens is a pinhole within 1e-4 of the axis: 1e-8 of the focal length
        assert by_point[..., k] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6, abs=1e-4)
    for k, value in enumerate(VALUES[model]):
        step = 1e-6 * max(1.0, abs(value)) * np.eye(len(VALUES[model]))[k]
        ends = [Lens(model, np.array(VALUES[model]) + s * step).image(points())[0] for s in (1, -1)]
        expected = (ends[0] - ends[1]) / (2.0 * step[k])
        assert by_lens[..., k] == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_the_line_of_sight_of_a_pixel_meets_the_point_that_is_imaged_there(
    model: LensModel,
) -> None:
    seen = lens(model).image(points())[0].reshape(8, 5, 2)
    expected = (points()[:, :2] / points()[:, 2:]).reshape(8, 5, 2)
    assert lens(model).tangents(seen) == pytest.approx(expected, abs=1e-11)
    assert lens(model).tangents(np.empty((0, 2))).shape == (0, 2)


def test_what_is_behind_the_camera_is_imaged_as_if_it_were_just_before_it() -> None:
    behind = lens("brown").image(np.array([[1e-7, 2e-7, -3.0]]))[0]
    assert behind == pytest.approx(lens("brown").image(np.array([[1e-7, 2e-7, 1e-6]]))[0])


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("degrees", [40.0, 75.0])
def test_the_field_of_view_is_what_a_picture_is_wide(model: LensModel, degrees: float) -> None:
    """Half of the angle away from the axis is half of the width away from the middle."""
    camera = camera_of(camera_file(lens=model, field_of_view_deg=degrees))
    half = np.deg2rad(0.5 * degrees)
    pixels = camera.lens.image(np.array([[np.sin(half), 0.0, np.cos(half)], [0.0, 0.0, 1.0]]))[0]
    assert pixels == pytest.approx(np.array([[639.5 + 640.0, 479.5], [639.5, 479.5]]))


def test_what_is_known_of_a_lens_before_any_picture() -> None:
    values = {"lens_px": VALUES["fisheye"], "lens": "fisheye"}
    guessed = camera_of(camera_file(field_of_view_deg=60.0))
    fx, fy = guessed.lens.values[:2]
    same, square = FOCAL**2, SQUARE**2  # both focal lengths, and that of rows against columns
    expected = [[same * fx * fx, same * fx * fy], [same * fx * fy, (same + square) * fy * fy]]
    assert guessed.covariance[:2, :2] == pytest.approx(np.array(expected))
    assert np.diag(guessed.covariance)[2:4] == pytest.approx([(CENTRE * 1280) ** 2] * 2)
    assert np.diag(guessed.covariance)[4:] == pytest.approx(np.square(DISTORTION["brown"]))
    calibrated = camera_of(camera_file(**values))
    assert calibrated.lens.values == pytest.approx(VALUES["fisheye"])
    assert calibrated.covariance[2, 2] == pytest.approx((CALIBRATED * CENTRE * 1280) ** 2)
    stated = camera_of(camera_file(**values, lens_sigma_px=[1.0, 2.0, 3.0, 4.0, *[0.1] * 4]))
    assert stated.covariance == pytest.approx(np.diag([1.0, 4.0, 9.0, 16.0, *[0.01] * 4]))


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({}, "missing; or give lens_px"),
        ({"lens_px": VALUES["fisheye"]}, "expected fx, fy, cx, cy, k1, k2, p1, p2, k3"),
        ({"field_of_view_deg": 60.0, "lens_sigma_px": [1.0] * 9}, "expected fx, fy, cx, cy"),
    ],
)
def test_a_lens_that_is_not_stated_whole_is_refused(values: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        camera_file(**values)
