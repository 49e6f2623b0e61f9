"""A draft from a URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ballbar.robot_file.draft import RobotDraft, check_rows, read_description, rounded
from ballbar.robot_file.urdf import Urdf, parse_urdf, with_round_angles
from ballbar.robot_file.urdf_chain import UrdfChain, bodies, chain_between
from cell.dh_from_axes import AxesError, dh_from_axes
from cell.errors import InputError
from cell.foreign_text import one_line
from cell.schema import TITLE_LENGTH

_POSES, _SEED = 100, 1


def draft_from_urdf(name: str, path: Path, base: str | None, tip: str | None) -> RobotDraft:
    """The draft of a robot from a URDF, between links `base` and `tip`.

    Raises InputError if the file or its chain cannot be used.
    """
    written = parse_urdf(read_description(path), str(path))
    urdf = with_round_angles(written)
    chain = chain_between(urdf, base, tip)
    try:
        form = dh_from_axes(chain.axes())
    except AxesError as error:
        raise InputError(f"{path}: {error}") from None
    form = rounded(form)
    check_rows(str(path), form.chain)
    return RobotDraft(
        name=name,
        title=one_line(urdf.name)[:TITLE_LENGTH],
        source=_source(path, chain, _influence(written, chain)),
        form=form,
        lower=_stated([joint.lower for joint in chain.joints]),
        upper=_stated([joint.upper for joint in chain.joints]),
        speed=_stated([joint.speed or None for joint in chain.joints]),  # 0 stands for unknown
        bodies=bodies(urdf, chain),
        tip_poses=chain.tip_poses,
    )


def _stated(values: list[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values])


def _influence(written: Urdf, chain: UrdfChain) -> float:
    """[m] largest shift of the tip by the rounding of the origins' angles."""
    exact = chain_between(written, chain.base, chain.tip)
    q = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (_POSES, len(chain.joints)))
    shift = exact.tip_poses(q)[:, :3, 3] - chain.tip_poses(q)[:, :3, 3]
    return float(np.linalg.norm(shift, axis=1).max())


def _source(path: Path, chain: UrdfChain, influence: float) -> str:
    joints = ", ".join(joint.name for joint in chain.joints)
    text = f"{path.name}, {chain.base} to {chain.tip}; axes: {joints}."
    if influence > 0.0:
        text += (
            " Angles of origins within 1e-5 rad of a multiple of 15 deg are taken as it; this "
            f"moves the tip by up to {influence * 1e3:.2g} mm."
        )
    return text
