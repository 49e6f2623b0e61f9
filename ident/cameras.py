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
# Share of the squares beyond noise that another focal length in each picture explains: 0.78 to 0.93
# where it is so, up to 0.58 where joints or shutter are the cause (tests/ident/test_cameras.py)
BY_FOCUS = 0.7
LEAST_FOCUS = 5e-4  # of the focal length: autofocus changes it by more
DRIFTING = 0.7  # correlation of the focal lengths with the order of the pictures
CLEAR = 3.0  # standard deviations from which a sag is seen
BENT = 1.6  # deviations from flat, as the board's file states it, from which a sag is named


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
    yield from list(_refocused(fit)) or _unexplained(fit)


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


def remarks_of(fit: Fit) -> Iterator[str]:
    """Sentences on what was measured and taken into account, and should be known."""
    for name, camera in cameras_of(fit).items():
        sags = [k for k, n in enumerate(camera.errors.names) if n.startswith("sag_")]
        size = max(sags, key=lambda k: abs(float(camera.pull[k])))
        far = abs(camera.values[size]) > CLEAR * camera.sigma[size]
        if far and abs(camera.pull[size]) > BENT:
            yield (
                f"the board that {name} saw is bent by {abs(camera.values[size]) * 1e3:.1f} mm "
                f"over half of its size ({camera.errors.names[size]}), where its file states "
                f"{camera.errors.declared[size, 1] * 1e3:.1f} mm; the fit takes it into account. "
                "Glue it to glass or a plate"
            )


def _refocused(fit: Fit) -> Iterator[str]:
    """Pictures each of which has another focal length: it explains most of what they leave."""
    for k, point in enumerate(fit.linear.evaluations[fit.still]):
        group, counting = point.still, fit.linear.robust[fit.still][k] > 0.0
        if (errors := group.common) is None or group.by_common is None:
            continue
        lens = np.zeros(len(errors.names))
        lens[:2] = errors.values[:2]  # of a focal length longer by its own size
        change = group.by_common @ np.linalg.solve(errors.root, lens)
        column = point.target_closure.value_columns(change[..., None])[0].T[counting]
        noise = point.target_closure.sensor_columns(group.sigma, group.factor)[..., counting]
        rest = point.closure.error.T[counting]
        solved = np.linalg.solve(
            np.einsum("kcn,kdn->ncd", noise, noise), np.stack((column, rest), axis=2)
        )
        known, along = (np.einsum("nc,nc->n", v, solved[..., 0]) for v in (column, rest))
        focal = along / known  # (N,) each picture's, least squares
        of_focus = float((focal * along).sum()) - known.size
        beyond = float(np.einsum("nc,nc->", rest, solved[..., 1])) - rest.size
        size = np.sqrt(max(0.0, of_focus) / known.sum())
        if size < LEAST_FOCUS or of_focus < BY_FOCUS * beyond:
            continue
        order = np.corrcoef(np.flatnonzero(counting), focal)[0, 1]
        drift = ", steadily from the first to the last" if abs(order) > DRIFTING else ""
        yield (
            f"the focal length changes by {size:.2%} (1 sigma) between the pictures of "
            f"{errors.name}{drift}, which explains {of_focus / beyond:.0%} of what noise does not: "
            "switch off autofocus, zoom and stabilisation, and let the camera warm up"
        )


def _unexplained(fit: Fit) -> Iterator[str]:
    """Poses that scatter by more than the noise of corners."""
    points = fit.linear.evaluations[fit.still]
    seen = [p for p in points if p.still.common is not None]
    if not seen:
        return
    noise = float(np.sqrt(np.mean([(p.still.sigma[:, :3] ** 2).mean() for p in seen])))
    if fit.excess.position > BEYOND * noise:
        yield (
            f"the pictures leave {fit.excess.position * 1e3:.2f} mm along each axis unexplained, "
            f"{fit.excess.position / noise:.0f} times what the noise of their corners makes: the "
            "robot moved while pictures were taken, the board or the camera is loose, or the "
            "joints have errors that are not in the model"
        )
