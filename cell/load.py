"""Descriptions of a cell read from YAML files: those shipped in cell/, or files of one's own.

The schema of the files is ballbar.cell.description_files; here their units become SI.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.ballbar_files import AxialStiffnessFile, BallBarFile, JointBacklashFile, PlateFile
from ballbar.cell.description_files import (
    DHRowFile,
    ExpansionFile,
    GearsFile,
    LinkFile,
    RobotFile,
    ServoFile,
)
from ballbar.cell.descriptions import BallBar, Cell, Gears, Link, Plate, Robot, ServoGains
from ballbar.cell.errors import DescriptionError
from ballbar.cell.foreign_files import read_regular
from ballbar.cell.instrument import InstrumentFile, instrument_of, telescoping_bar
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.schema_errors import nearest
from ballbar.cell.strict_yaml import MAX_BYTES, M, load_model

F = TypeVar("F")
D = TypeVar("D")

_FOLDER = Path(__file__).parent
# Complete files, from which an error quotes what a file lacks.
_EXAMPLES = {
    RobotFile: _FOLDER / "robots/irb2400.yaml",
    BallBarFile: _FOLDER / "instruments/lund_600.yaml",
    PlateFile: _FOLDER / "plates/plate_250.yaml",
    InstrumentFile: _FOLDER / "instruments/drawwire_2m.yaml",
}
_SCHEMA = re.compile(r"^schema: ballbar-(\w+)/\d", re.MULTILINE)
# What the files of cell/instruments describe, by the word of their schema.
_INSTRUMENTS = {
    "bar": "a ball-bar with encoders (ballbar-bar/1)",
    "instrument": "another instrument (ballbar-instrument/1)",
}


def load_cell(robot: str, ballbar: str, plate: str, *, relative_to: Path | None = None) -> Cell:
    """The cell of three descriptions, each a shipped name or a path as in `load_robot`."""
    return Cell(
        load_robot(robot, relative_to=relative_to),
        load_ballbar(ballbar, relative_to=relative_to),
        load_plate(plate, relative_to=relative_to),
    )


def load_measured_cell(
    robot: str, instrument: str, plate: str, *, relative_to: Path | None = None
) -> Cell:
    """The cell of `load_cell`, held by a ball-bar or by an instrument that measures a length.

    instrument : a shipped ball-bar or instrument, or a path; a file shows by its schema which one
    it describes. An instrument stands in the cell as a massless ball-bar whose rod is sensed.
    """
    if describes_instrument(instrument, relative_to):
        bar = load_telescoping_bar(instrument, relative_to=relative_to)
    else:
        bar = load_ballbar(instrument, relative_to=relative_to)
    plate_of_cell = load_plate(plate, relative_to=relative_to)
    return Cell(load_robot(robot, relative_to=relative_to), bar, plate_of_cell)


def describes_instrument(name_or_path: str, relative_to: Path | None = None) -> bool:
    """Whether a name or path is that of an instrument, and not of a ball-bar with encoders.

    Raises DescriptionError for an unknown name.
    """
    path = _find(name_or_path, "instruments", relative_to)
    return path.is_file() and _kind(path) == "instrument"


def load_telescoping_bar(name_or_path: str, *, relative_to: Path | None = None) -> BallBar:
    """An instrument that measures a length, as a massless ball-bar whose rod is sensed."""
    instrument = load_instrument(name_or_path, relative_to=relative_to)
    try:
        return telescoping_bar(instrument)
    except ValueError as error:
        raise DescriptionError(
            f"{error}, not a length over time. Its measurements are still poses, or name another "
            "instrument."
        ) from None


def load_robot(name_or_path: str, *, relative_to: Path | None = None) -> Robot:
    """A robot by its shipped name, or from a file.

    name_or_path : `irb2400`, or a path that ends in `.yaml`, taken from the folder `relative_to`.

    Raises DescriptionError if there is no such robot or its file is wrong.
    """
    path = _find(name_or_path, "robots", relative_to)
    file = _load(path, RobotFile)
    joints = len(file.dh)
    transmission = _matrix(file.motor_to_joint, joints)
    lower, upper = file.accuracy_box_deg
    rotor, speed = file.rotor_inertia_kg_m2, file.axis_speed_max_deg_per_s
    return Robot(
        name=path.stem,
        title=file.title,
        **_dh_columns(file.dh),
        transmission=transmission,
        controller_to_joint=_matrix(file.controller_to_joint, joints),
        controller_offset=np.deg2rad(file.controller_offset_deg or np.zeros(joints)),
        axis_lower=np.deg2rad(file.axis_lower_deg),
        axis_upper=np.deg2rad(file.axis_upper_deg),
        axis_speed_max=np.deg2rad(speed or np.full(joints, np.inf)),
        accuracy_lower=np.deg2rad(lower),
        accuracy_upper=np.deg2rad(upper),
        gravity=np.array(file.gravity_m_per_s2),
        links=_optional(file.links, lambda f: tuple(_link(f[name]) for name in file.link_names)),
        servo=_optional(file.servo, _servo),
        gears=_optional(file.gears, lambda f: _gears(f, 1.0 / np.abs(np.diag(transmission)))),
        log_dialect=file.log_dialect,
        program_language=file.program_language,
        armature=_optional(rotor, lambda f: np.array(f) / np.diag(transmission) ** 2),
        expansion=_optional(file.expansion, ExpansionFile.described),
    )


def load_ballbar(name_or_path: str, *, relative_to: Path | None = None) -> BallBar:
    """A ball-bar by its shipped name (`lund_600`), or from a file, as in `load_robot`.

    Raises DescriptionError also for an instrument of another kind.
    """
    path = _find_instrument(name_or_path, "bar", relative_to)
    file = _load(path, BallBarFile)
    return BallBar(
        name=path.stem,
        title=file.title,
        **_dh_columns(file.dh),
        length_tolerance=file.length_tolerance_m,
        rod_stiffness=file.axial_stiffness_N_per_m.rod,
        joint_stiffness=_of_both_joints(file.axial_stiffness_N_per_m),
        axial_damping=file.axial_damping_N_s_per_m,
        joint_damping=np.array(file.joint_damping_N_m_s_per_rad),
        friction_torque=file.friction_torque_N_m,
        joint_backlash=_of_both_joints(file.backlash_m),
        encoder_lines=file.encoder.lines,
        encoder_bits=file.encoder.bits,
        encoder_noise_sigma=file.encoder.noise_sigma_rad,
        links=tuple(_link(body) for _, body in file.links),  # in the order of declaration
        expansion=_optional(file.expansion, ExpansionFile.described),
    )


def _of_both_joints(file: AxialStiffnessFile | JointBacklashFile) -> tuple[float, float]:
    return file.gimbal, file.universal_joint


def load_plate(name_or_path: str, *, relative_to: Path | None = None) -> Plate:
    """An offset plate by its shipped name (`plate_250`), or from a file, as in `load_robot`."""
    path = _find(name_or_path, "plates", relative_to)
    file = _load(path, PlateFile)
    return Plate(
        name=path.stem,
        title=file.title,
        length=file.length_m,
        length_sigma=file.length_sigma_m,
        tool_offset=file.tool_offset_m,
        tip_stiffness=file.tip_stiffness_N_per_m,
        body=_link(file.body),
        expansion=_optional(file.expansion, ExpansionFile.described),
    )


def load_instrument(name_or_path: str, *, relative_to: Path | None = None) -> Instrument:
    """An instrument by its shipped name (`tracker_point`), or from a file, as in `load_robot`.

    Raises DescriptionError also for a sensed ball-bar, which `load_ballbar` reads.
    """
    path = _find_instrument(name_or_path, "instrument", relative_to)
    return instrument_of(path.stem, _load(path, InstrumentFile))


def robot_names() -> list[str]:
    """Names of the shipped robots."""
    return _names("robots")


def ballbar_names() -> list[str]:
    """Names of the shipped ball-bars."""
    return _instrument_names("bar")


def plate_names() -> list[str]:
    """Names of the shipped offset plates."""
    return _names("plates")


def instrument_names() -> list[str]:
    """Names of the shipped instruments other than sensed ball-bars."""
    return _instrument_names("instrument")


def length_names() -> list[str]:
    """Names of the shipped instruments that measure a length."""
    return [name for name in instrument_names() if load_instrument(name).measured == "length"]


def _names(kind: str) -> list[str]:
    return sorted(path.stem for path in (_FOLDER / kind).glob("*.yaml"))


def _instrument_names(schema: str) -> list[str]:
    """Names of the shipped files of cell/instruments with one of the schemas of `_INSTRUMENTS`."""
    return [n for n in _names("instruments") if _kind(_FOLDER / f"instruments/{n}.yaml") == schema]


def _kind(path: Path) -> str | None:
    """The word of a file's schema: `bar` of `ballbar-bar/1`; None where it states none."""
    stated = _SCHEMA.search(read_regular(path, MAX_BYTES).decode("utf-8", "replace"))
    return stated[1] if stated else None


def _load(path: Path, model: type[M]) -> M:
    """The content of a description. Raises DescriptionError."""
    return load_model(path, model, example=_EXAMPLES[model])


def _find_instrument(name_or_path: str, schema: str, relative_to: Path | None) -> Path:
    """The file of an instrument of one of the schemas of `_INSTRUMENTS`."""
    path = _find(name_or_path, "instruments", relative_to, _instrument_names(schema))
    stated = _kind(path) if path.is_file() else None
    if stated != schema and stated in _INSTRUMENTS:
        raise DescriptionError(
            f"{name_or_path} is {_INSTRUMENTS[stated]}; expected {_INSTRUMENTS[schema]}: "
            f"{', '.join(_instrument_names(schema))}, or a file of your own."
        )
    return path


def _find(
    name_or_path: str, kind: str, relative_to: Path | None, valid: list[str] | None = None
) -> Path:
    """A file by its path, or a shipped one by its name; valid : names that an error lists."""
    if name_or_path.endswith(".yaml"):
        return (relative_to or Path()) / name_or_path
    names = _names(kind)
    if name_or_path in names:
        return _FOLDER / kind / f"{name_or_path}.yaml"
    names = names if valid is None else valid
    raise DescriptionError(
        f"unknown {kind.removesuffix('s')} {name_or_path!r}."
        f"{nearest(name_or_path, names, noun='name')} A file of your own ends in .yaml."
    )


def _dh_columns(rows: Iterable[DHRowFile]) -> dict[str, Any]:
    a, d, alpha, theta = np.array([(r.a_m, r.d_m, r.alpha_deg, r.theta_deg) for r in rows]).T
    return {"a": a, "d": d, "alpha": np.deg2rad(alpha), "theta": np.deg2rad(theta)}


def _optional(file: F | None, description: Callable[[F], D]) -> D | None:
    return None if file is None else description(file)


def _servo(file: dict[str, ServoFile]) -> dict[str, ServoGains]:
    return {
        name: ServoGains(np.array(gains.kp_N_m_per_rad), np.array(gains.kv_N_m_s_per_rad))
        for name, gains in file.items()
    }


def _matrix(rows: tuple[tuple[float, ...], ...] | None, joints: int) -> Array:
    return np.eye(joints) if rows is None else np.array(rows)


def _gears(file: GearsFile, ratio: Array) -> Gears:
    """Gears of a file; ratio : (J,) turns of the motor per turn of the output."""
    harmonics: list[tuple[tuple[float, float], ...]] = [()] * len(ratio)
    for group in file.transmission_error:
        amplitudes = (*group.amplitude_rad, group.input_amplitude_rad)
        for axis in group.axes:
            cycles = (*group.cycles_per_turn, float(ratio[axis - 1]))
            harmonics[axis - 1] += tuple(zip(cycles, amplitudes, strict=True))
    friction = file.friction
    return Gears(
        stiffness=np.array(file.stiffness_N_m_per_rad),
        damping=np.array(file.damping_N_m_s_per_rad),
        lost_motion=np.array(file.lost_motion_rad),
        static=np.array(friction.static_N_m),
        coulomb=np.array(friction.coulomb_N_m),
        viscous=np.array(friction.viscous_N_m_s_per_rad),
        stribeck=np.array(friction.stribeck_rad_per_s),
        harmonics=tuple(harmonics),
    )


def _link(file: LinkFile) -> Link:
    xx, yy, zz, xy, xz, yz = file.inertia_kg_m2
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Link(file.mass_kg, np.array(file.com_m), inertia)
