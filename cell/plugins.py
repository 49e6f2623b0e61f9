"""Tables of names that other installed packages extend by entry points (plug-ins).

A table holds what stands in the source tree and what entry points of its group add. The names come
from the metadata of the installed packages when they are first asked for; a plug-in is imported
when it is used, in worker processes as in the first one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from ballbar.cell.errors import InputError

T_co = TypeVar("T_co", covariant=True)
# Name and version of the distributions whose plug-ins this process has loaded.
LOADED: dict[str, str] = {}


class PluginTable(Mapping[str, T_co]):
    """Things of one kind by name, those of the tree first."""

    def __init__(
        self, group: str, own: Mapping[str, T_co], fits: Callable[[Any], bool] = callable
    ) -> None:
        """own : those of the tree. fits : whether an object is one of the kind."""
        self.group, self.own, self._fits = f"ballbar.{group}", own, fits

    @cached_property
    def added(self) -> dict[str, EntryPoint]:
        """Entry points of the plug-ins by name. Raises InputError for a name of two."""
        added: dict[str, EntryPoint] = {}
        for point in entry_points(group=self.group):
            other = added.get(point.name)
            if other or point.name in self.own:
                owner = _distribution(other)[0] if other else "ballbar itself"
                raise _refused(point, f"has a name that {owner} uses", "rename one of them")
            added[point.name] = point
        return added

    def __iter__(self) -> Iterator[str]:
        return iter((*self.own, *self.added))

    def __len__(self) -> int:
        return len(self.own) + len(self.added)

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in self.added

    def known(self, name: str, what: str = "") -> str:
        """The name. Raises InputError that lists all of them if it is none; what : it is of."""
        if name not in self:
            raise InputError(f"unknown{what}; there are {', '.join(self)}")
        return name

    def __getitem__(self, name: str) -> T_co:
        """Raises KeyError for an unknown name, InputError for a plug-in that cannot be loaded."""
        if name in self.own:
            return self.own[name]
        point = self.added[name]
        try:
            loaded: T_co = point.load()
            fits = self._fits(loaded) and getattr(loaded, "name", name) == name
        except Exception as error:
            reason = f"cannot be loaded ({type(error).__name__}: {error})"
            raise _refused(point, reason) from error
        if not fits:
            raise _refused(point, f"is no entry of that name and group, but {loaded!r}")
        LOADED.update([_distribution(point)])
        return loaded


def _distribution(point: EntryPoint) -> tuple[str, str]:
    """Name and version of the distribution of an entry point."""
    return (point.dist.name, point.dist.version) if point.dist else (point.value, "unknown")


def _refused(point: EntryPoint, reason: str, remedy: str = "repair it") -> InputError:
    name = _distribution(point)[0]
    return InputError(
        f"plug-in {point.name} of package {name} ({point.group} = {point.value}) {reason}; "
        f"{remedy}, or uninstall {name}."
    )
