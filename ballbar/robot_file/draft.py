"""A robot's description before it is written: what its source states, and what it does not.

A source is a URDF, which is read here, or a table of DH rows (`dh_table`). Base and tip are links
of the source; `T_base_tip = T_base_dh @ (DH rows) @ T_flange_tip`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array, read_only
from ballbar.cell.chain import Chain
from ballbar.cell.description_files import MAX_DH_LENGTH_M, SMALLEST_TWIST_DEG
from ballbar.cell.descriptions import Link
from ballbar.cell.dh_from_axes import AxesError, DHForm, dh_from_axes
from ballbar.cell.errors import InputError
from ballbar.cell.foreign_files import read_regular
from ballbar.cell.foreign_text import one_line
from ballbar.cell.schema import TITLE_LENGTH
from ballbar.robot_file.urdf import Urdf, parse_urdf, with_round_angles
from ballbar.robot_file.urdf_chain import UrdfChain, bodies, chain_between

FEWEST_AXES, MOST_AXES = 5, 8  # of ballbar.cell.description_files.RobotFile
ASSUMED_RANGE_DEG = 180.0  # written to either side where the source states no limits
MAX_BYTES = 10_000_000  # of a URDF with every link of a cell; its meshes are other files
LENGTH_DIGITS, DEGREE_DIGITS, LIMIT_DIGITS = 12, 10, 3  # decimals of what is written
_POSES, _SEED = 100, 1


@dataclass(frozen=True, eq=False)
class RobotDraft:
    """A robot of J axes as its source states it."""

    name: str
    title: str
    source: str  # file and what was taken from it, in the head of the description
    form: DHForm
    lower: Array  # (J,) [rad] nan where not stated
    upper: Array  # (J,) [rad]
    speed: Array  # (J,) [rad/s] nan where not stated
    bodies: tuple[Link, ...] | str  # base, link 1..J in the source's base; or why there are none
    tip_poses: Callable[[Array], Array]  # (N, J) [rad] -> (N, 4, 4) [m], by the rules of the source

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "speed"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def joints(self) -> int:
        return self.form.chain.rows

    @property
    def unlimited(self) -> list[int]:
        """Axes, from 1, whose limits are not stated."""
        return [i + 1 for i in range(self.joints) if not np.isfinite(self.upper[i] - self.lower[i])]


def read_description(path: Path) -> str:
    """The text of a URDF or table.

    Raises InputError if it is no regular file, larger than MAX_BYTES, or not UTF-8.
    """
    try:
        raw = read_regular(path, MAX_BYTES)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file. Correct the name.") from None
    except OSError as error:
        what = f"cannot be read: {error.strerror}."
        raise InputError.at(path, what, "Name the URDF or table itself, without meshes.") from None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        what = f"byte 0x{raw[error.start]:02x} is not UTF-8."
        raise InputError.at(f"{path}:{line}", what, "Save the file as UTF-8.") from None


def rounded(form: DHForm) -> DHForm:
    """The form with the decimals that are written; -0 becomes 0."""
    chain = form.chain
    return replace(
        form,
        chain=Chain(
            a=_round(chain.a, LENGTH_DIGITS),
            d=_round(chain.d, LENGTH_DIGITS),
            alpha=np.deg2rad(_round(np.rad2deg(chain.alpha), DEGREE_DIGITS)),
            theta=np.deg2rad(_round(np.rad2deg(chain.theta), DEGREE_DIGITS)),
            beta=chain.beta,
        ),
        T_base_dh=_round(form.T_base_dh, LENGTH_DIGITS),
        T_flange_tip=_round(form.T_flange_tip, LENGTH_DIGITS),
    )


def check_rows(source: str, chain: Chain) -> None:
    """Refuse rows that a robot's description cannot hold, before it is written.

    source : named in messages.
    """
    if not FEWEST_AXES <= chain.rows <= MOST_AXES:
        what = f"{chain.rows} turning joints; a robot has {FEWEST_AXES} to {MOST_AXES}."
        raise InputError.at(source, what, "Choose the ends of the chain with --base and --tip.")
    for i in range(chain.rows):
        for name, length in (("a", chain.a[i]), ("d", chain.d[i])):
            if abs(length) > MAX_DH_LENGTH_M:
                raise InputError(
                    f"{source}: {name} of row {i + 1} is {length:.4g} m, beyond "
                    f"{MAX_DH_LENGTH_M:g} m. Lengths are metres; if they are, an axis is nearly "
                    "parallel to the next and should be exactly so."
                )
        for name, radians in (("alpha", chain.alpha[i]), ("theta", chain.theta[i])):
            if 0.0 < abs(angle := np.rad2deg(radians)) < SMALLEST_TWIST_DEG:
                raise InputError(
                    f"{source}: {name} of row {i + 1} is {angle:.6g} deg. Nominal angles below "
                    f"{SMALLEST_TWIST_DEG:g} deg are refused: they are radians taken for degrees, "
                    "or the calibrated values of a single robot. Give the nominal ones."
                )


def _round(values: Array, digits: int) -> Array:
    return np.asarray(np.round(values, digits) + 0.0)  # + 0.0: -0 becomes 0


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
