"""Files of pictures as files of poses: one bundle adjustment for each camera and its board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbar.acquisition.bundle import Bundle, Pictures, names_of, prior_of
from ballbar.acquisition.corners import Corners
from ballbar.acquisition.pose_rows import FilePoses
from ballbar.acquisition.report import Finding, finding
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import LogError
from ballbar.cell.poses import CommonErrors
from ballbar.cell.rigid_fit import nominal_frames

FEWEST_PICTURES = 3
_UNEVEN = 3.0  # times what chance gives by moving each corner on the board, that is named
_OTHER = 0.05  # of the size of the board in a picture: corners further off are others


def posed(robot: Robot, files: Sequence[FilePoses]) -> list[FilePoses]:
    """The files with the poses that their pictures show, pictures that show none left out.

    Raises LogError where too few do.
    """
    out = list(files)
    cameras = [
        None if f.corners is None else (f.corners.instrument.name, f.corners.board.name)
        for f in files
    ]
    for camera in dict.fromkeys(c for c in cameras if c is not None):
        own = [k for k, c in enumerate(cameras) if c == camera]
        several = len({c for c in cameras if c is not None and c[0] == camera[0]}) > 1
        name = " ".join(camera) if several else camera[0]
        for k, poses in zip(own, _posed(robot, name, [files[k] for k in own]), strict=True):
            out[k] = poses
    return out


def _posed(robot: Robot, name: str, files: Sequence[FilePoses]) -> list[FilePoses]:
    """The poses of the files of one camera and board."""
    from ballbar.acquisition.picture_start import bundle  # noqa: PLC0415  the extra camera

    corners = [f.corners for f in files if f.corners is not None]
    first, q = corners[0], np.concatenate([f.group.q for f in files])
    assert first.instrument.camera is not None  # checked with the declaration
    pixels = np.concatenate([c.pixels for c in corners])
    if len(pixels) < FEWEST_PICTURES:
        raise LogError.at(first.file, f"{len(pixels)} pictures show the board.", "Take more.")
    flange = nominal_frames(robot, q).rotation().transpose(2, 0, 1)
    fitted = bundle(Pictures(first.instrument.camera, first.board, pixels, flange))
    _refuse_other_board(fitted, first)
    _refuse_mirrored(fitted, first)
    common, out, begin = common_errors(name, fitted), [], 0
    for poses, own in zip(files, corners, strict=True):
        rows = np.arange(begin, begin + len(own.images))
        begin += len(own.images)
        used = fitted.used[rows]
        values, sigma, factor, by_common = pose_values(fitted, rows[used], carried=own.carried)
        group = replace(
            poses.group.part(used),
            values=values,
            sigma=sigma,
            factor=factor,
            common=common,
            by_common=by_common @ common.root,
        )
        part = poses.part(used, group)
        findings = _findings(fitted, rows, own)
        out.append(replace(part, findings=(*part.findings, *findings)))
    return out


def _refuse_other_board(fitted: Bundle, corners: Corners) -> None:
    """Raises LogError where the pictures do not show the corners of the board."""
    size = float(np.median(np.nanstd(fitted.pictures.pixels, axis=1)))
    if fitted.sigma > _OTHER * size or fitted.used.sum() < FEWEST_PICTURES:
        raise LogError(
            f"{corners.file}: the corners lie {fitted.sigma:.2g} px (root mean square) from where "
            f"board {corners.board.name} has them. Are they numbered from 0, row by row, and are "
            "squares_x and squares_y those of the board?"
        )


def _refuse_mirrored(fitted: Bundle, corners: Corners) -> None:
    """Raises LogError where the camera sees the back of the board."""
    behind = np.einsum("ni,ni->n", fitted.rotation[:, :, 2], fitted.origin) < 0.0
    if behind[fitted.used].mean() > 0.5:
        raise LogError(
            f"{corners.file}: the corners are those of a mirror image: the back of board "
            f"{corners.board.name} would be seen. Switch off the camera's mirroring, or "
            "number the corners from the left to the right, row by row from the top."
        )


def common_errors(name: str, fitted: Bundle) -> CommonErrors:
    """The errors of lens and board that a bundle leaves uncertain."""
    mean, information = prior_of(fitted.pictures)
    return CommonErrors(
        name=name,
        names=names_of(fitted.pictures),
        values=fitted.values,
        root=np.asarray(np.linalg.cholesky(fitted.covariance)),
        noise=fitted.sigma,
        declared=np.column_stack((mean, np.sqrt(np.diag(np.linalg.inv(information))))),
        doubts=_uneven(fitted),
    )


def _uneven(fitted: Bundle) -> tuple[str, ...]:
    """A sentence where the corners lie elsewhere on the board than its file and its sag say: in all
    pictures the same, which noise is not.
    """
    by_point = fitted.slopes[0][..., :3] @ fitted.rotation[:, None]
    own = np.einsum("ncki,nckj->cij", by_point, by_point)
    right = np.einsum("ncki,nck->ci", by_point, fitted.residual)
    own += 1e-9 * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-12 * np.eye(3)
    off = np.linalg.solve(own, right[..., None])[..., 0]
    gained = float((right * off).sum())  # [px^2]
    freed = 3.0 * float(fitted.counting.any(axis=0).sum())
    rest = (float(fitted.square.sum()) - gained) / max(1.0, fitted.freedom - freed)
    if gained <= _UNEVEN * freed * rest:
        return ()
    length = np.linalg.norm(off, axis=1) * 1e3
    return (
        f"the corners of board {fitted.pictures.board.name} lie {np.sqrt((length**2).mean()):.2g} "
        f"mm (largest {length.max():.2g} mm) from where its file has them, in all pictures the "
        "same: glue it to glass or a plate, or measure its corners (kind points)",
    )


def pose_values(
    fitted: Bundle, rows: NDArray[np.intp], *, carried: bool
) -> tuple[Array, Array, Array, Array]:
    """Values (N, 6) [m, rad] of some pictures, their deviations (N, 6), the factor (N, 6, 6) of
    their correlation, and their change (N, 6, U) by lens and board.

    The board in the frame of the camera; of a camera that the robot carries the reverse.
    """
    own, mixed, _, _ = (part[rows] if part.ndim > 1 else part for part in fitted.reduced)
    rotation, origin = fitted.rotation[rows], fitted.origin[rows]
    to_values = np.tile(np.eye(6), (len(rows), 1, 1))
    if carried:
        back = rotation.transpose(0, 2, 1)
        to_values[:, :3, :3] = to_values[:, 3:, 3:] = -back
        to_values[:, :3, 3:] = -back @ np.cross(origin[:, None], np.eye(3)).transpose(0, 2, 1)
        rotation, origin = back, -(back @ origin[..., None])[..., 0]
    noise = fitted.picture_noise[rows, None, None]
    covariance = noise**2 * to_values @ np.linalg.inv(own) @ to_values.transpose(0, 2, 1)
    sigma: Array = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    factor = np.asarray(np.linalg.cholesky(covariance / sigma[:, :, None] / sigma[:, None]))
    by_values = np.asarray(-to_values @ np.linalg.solve(own, mixed))
    return np.hstack((origin, Rotation.from_matrix(rotation).as_rotvec())), sigma, factor, by_values


def _findings(fitted: Bundle, rows: NDArray[np.intp], own: Corners) -> tuple[Finding, ...]:
    """Findings about the pictures `rows` (N,) of a bundle."""
    out, used = [], fitted.used[rows]
    for n in np.flatnonzero(~used):
        sentence = f"picture {own.images[n]}: its corners do not lie as on the board; left out."
        out.append(finding("picture left out", own.file, sentence, count=1))
    seen = fitted.pictures.seen[rows]
    lost = np.asarray(seen & ~fitted.counting[rows] & used[:, None])
    if lost.any():
        named = [own.images[n] for n in np.flatnonzero(lost.any(axis=1))]
        shown = ", ".join(named[:4]) + (", ..." if len(named) > 4 else "")
        sentence = f"{int(lost.sum())} corners are far from where the board has them, of {shown}."
        out.append(finding("corner left out", own.file, sentence, count=int(lost.sum())))
    return tuple(out)
