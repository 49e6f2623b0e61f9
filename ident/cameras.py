"""Cameras of a fit: lens and board as found, and what their pictures contradict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.board import SCALES
from ballbar.cell.poses import CommonErrors
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.priors import LENGTH_PRIOR, PULL

_PINHOLE = ("fx", "fy", "cx", "cy")
BEYOND = 3.0  # unexplained part of poses over what the noise of corners makes, that is named
IN_PROPORTION = 0.8  # of the changes of the robot's lengths, that one proportion explains
ALONG = 3.0  # errors along the line of sight over those across it, of the same


@dataclass(frozen=True, eq=False)
class CameraEstimate:
    """Lens and board of a camera, all that was measured considered."""

    errors: CommonErrors  # as the pictures alone show them
    values: Array  # (U,)
    sigma: Array  # (U,)

    @property
    def pull(self) -> Array:
        """(U,) deviations from what the files state, in their standard deviations."""
        stated, sigma = self.errors.declared.T
        return np.asarray((self.values - stated) / sigma)

    @property
    def sentence(self) -> str:
        """Noise, lens and board, with standard deviations."""
        values = zip(self.errors.names, self.values, self.sigma, strict=True)
        known = {name: (value, sigma) for name, value, sigma in values}
        lens = ", ".join(f"{n} {known[n][0]:.1f} ({known[n][1]:.1f})" for n in _PINHOLE)
        sizes = ", ".join(f"{n[-1]} {known[n][0]:+.2%} ({known[n][1]:.2%})" for n in SCALES)
        return (
            f"corners to {self.errors.noise:.2f} px; {lens} px; board against its file {sizes} "
            "(1 sigma in brackets)"
        )


def cameras_of(fit: Fit) -> dict[str, CameraEstimate]:
    """The cameras of a fit by their names; empty where there are none."""
    out = {}
    for group in fit.model.poses.groups:
        if (errors := group.common) is None:
            continue
        part = fit.model.unknowns.placed.common[errors.name]
        values = errors.values + errors.root @ fit.x[part]
        covariance = errors.root @ fit.covariance[part, part] @ errors.root.T
        out[errors.name] = CameraEstimate(errors, values, np.sqrt(np.diag(covariance)))
    return out


def doubts_of(fit: Fit) -> Iterator[str]:
    """Sentences on what the pictures contradict: the board's file, the robot, or themselves."""
    for name, camera in cameras_of(fit).items():
        yield from camera.errors.doubts
        far = [k for k, n in enumerate(camera.errors.names) if n in SCALES]
        far = [k for k in far if abs(camera.pull[k]) > PULL]
        if far:
            sizes = " and ".join(
                f"{camera.values[k]:+.2%} along {camera.errors.names[k][-1]}" for k in far
            )
            yield (
                f"the board that {name} saw differs from its file by {sizes}, as the robot's "
                "catalogue lengths have it: measure the board again, for the scale of the result "
                "is that of both"
            )
        yield from _of_another_size(fit, name)
    yield from _unexplained(fit)


def _of_another_size(fit: Fit, name: str) -> Iterator[str]:
    """The robot's lengths all off in one proportion: it is the board that has another size."""
    layout = fit.model.unknowns
    mean, off = layout.mean[layout.geometric], (fit.x - layout.mean)[layout.geometric]
    lengths = np.array([p.is_length for p in layout.parameters]) & (mean != 0.0)
    mean, off = mean[lengths], off[lengths]
    size = float(mean @ off / max(float(mean @ mean), np.finfo(float).tiny))
    shift = abs(size) * float(np.linalg.norm(mean))
    if shift > PULL * LENGTH_PRIOR and shift > IN_PROPORTION * float(np.linalg.norm(off)):
        yield (
            f"the robot's lengths are {size:+.2%} off the catalogue, all in one proportion, as if "
            f"the board that {name} saw had another size than its file states: measure the board "
            "again, for the scale of the result is that of the board"
        )


def _unexplained(fit: Fit) -> Iterator[str]:
    """Poses that scatter by more than the noise of corners."""
    points = fit.linear.evaluations[fit.still]
    seen = [p for p in points if p.still.common is not None]
    if not seen:
        return
    noise = float(np.sqrt(np.mean([(p.still.sigma[:, :3] ** 2).mean() for p in seen])))
    if fit.excess.position <= BEYOND * noise:
        return
    along, across = np.zeros(0), np.zeros(0)
    for point in seen:
        error, sight = point.closure.error[:3], point.target_closure.sight.point
        line = sight - point.target_closure.seat.origin[:, None]
        distance = np.linalg.norm(line, axis=0)
        part = (error * line).sum(axis=0) / distance
        along = np.append(along, part / distance)
        across = np.append(across, np.sqrt(((error**2).sum(axis=0) - part**2) / 2.0) / distance)
    ratio, share = (float(np.median(np.abs(v))) for v in (along, across))
    what = (
        f"the pictures leave {fit.excess.position * 1e3:.2f} mm along each axis unexplained, "
        f"{fit.excess.position / noise:.0f} times what the noise of their corners makes"
    )
    if ratio > ALONG * share:
        yield (
            f"{what}, and along the line of sight ({ratio:.2%} of the distance): the lens changed "
            "from picture to picture. Switch off autofocus, zoom and stabilisation"
        )
        return
    yield (
        f"{what}: the robot moved while pictures were taken, the board or the camera is loose, or "
        "the joints have errors that are not in the model"
    )
