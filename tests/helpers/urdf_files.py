"""URDF texts written for tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tests.helpers.published_urdf import Joint

INERTIAL = (
    '<inertial><origin xyz="{com}" rpy="{rpy}"/><mass value="{mass}"/>'
    '<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial>'
)


@dataclass(frozen=True)
class Mass:
    """An inertial with principal axes along `rpy`."""

    mass: float
    com: tuple[float, float, float]
    moments: tuple[float, float, float]
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def text(self) -> str:
        ixx, iyy, izz = self.moments
        return INERTIAL.format(
            com=_words(self.com), rpy=_words(self.rpy), mass=self.mass, ixx=ixx, iyy=iyy, izz=izz
        )


def urdf_text(
    joints: Sequence[Joint],
    *,
    name: str = "arm",
    masses: Sequence[Mass | None] = (),
    extra: str = "",
    limits: bool = True,
) -> str:
    """A URDF whose links are `base`, `link1`, ... in a row; joints are `joint1`, ..."""
    count = len(joints)
    lines = [f'<?xml version="1.0"?>\n<robot name="{name}">']
    for i in range(count + 1):
        mass = masses[i] if i < len(masses) else None
        lines.append(f'<link name="{link_name(i)}">{mass.text if mass else ""}</link>')
    for i, joint in enumerate(joints):
        kind = "fixed" if joint.axis is None else "revolute" if limits else "continuous"
        axis = "" if joint.axis is None else f'<axis xyz="{_words(joint.axis)}"/>'
        limit = '<limit lower="-2" upper="2.5" velocity="3" effort="9"/>' if limits else ""
        lines.append(
            f'<joint name="joint{i + 1}" type="{kind}"><parent link="{link_name(i)}"/>'
            f'<child link="{link_name(i + 1)}"/>'
            f'<origin xyz="{_words(joint.xyz)}" rpy="{_words(joint.rpy)}"/>{axis}{limit}</joint>'
        )
    return "\n".join([*lines, extra, "</robot>\n"])


def link_name(number: int) -> str:
    """Name of a link, 0 for the base."""
    return f"link{number}" if number else "base"


def _words(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
