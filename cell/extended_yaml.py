"""YAML files that extend another file, and values set on the command line.

    extends: irb2400.yaml      # relative to this file, or the name of a shipped file: irb2400

Mappings are merged at every depth; lists and values replace those of the base, and null is a value
too. The base may extend another file. Names of files in a base stand relative to that base.
Afterwards each `KEY=VALUE` replaces the whole value at its dotted key; VALUE is YAML, and a name of
a file in it stands relative to the file that is read. Every value has its own
place, so an error names the file and line, or the option, that holds what is wrong.

A dotted key, `errors.joint_noise.sigma_rad`, names a value at any depth. A number picks an item of
a list, `cell.ballbar_position_m.0`. A key may itself hold dots where a file writes it so, as those
under `change` of a sweep. Nothing is evaluated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.files import copied_description, name_from
from ballbar.cell.schema_errors import Loc, nearest
from ballbar.cell.strict_yaml import Place, YamlDocument, load_yaml, parse_value

SHIPPED = Path(__file__).parents[1] / "scenarios"  # beside the packages, in the tree and installed
EXTENDS = "extends"  # the key
Value = Any  # plain data of YAML: mapping, list, text, number, truth value, null
MAX_BASES = 8  # files that one file extends, directly or through others


@dataclass(frozen=True)
class ExtendableKind:
    """A kind of file that may extend another of its kind."""

    what: str  # scenario, request, sweep
    shipped: Path  # folder of the shipped ones
    files: tuple[str, ...]  # dotted keys of files, relative to the file that names them
    # dotted keys of descriptions: a shipped one by its name, or a file that ends in .yaml
    descriptions: tuple[str, ...] = ()


def load_extended(
    path: Path, kind: ExtendableKind, *, overrides: Sequence[str] = ()
) -> YamlDocument:
    """The mapping of a file over those that it extends, with the values of `overrides`.

    overrides : texts `KEY=VALUE`, of different keys.

    Raises DescriptionError naming the place of what cannot be read or merged.
    """
    document, *bases = reversed(_chain(path, kind))
    for derived in bases:
        own = {key: value for key, value in derived.data.items() if key != EXTENDS}
        names = renamed(document.data, kind, document.path.parent, derived.path.parent)
        replaced: set[Loc] = set()
        data = _merged(names, own, (), replaced)
        places = dict(_above(document, replaced)) | derived.places
        document = YamlDocument(derived.path, data, places)
    keys: set[str] = set()
    for text in overrides:
        document = _with_override(document, text, keys)
    return document


def files_of(path: Path, kind: ExtendableKind) -> list[Path]:
    """The file, the one that it extends, and so on. Raises DescriptionError."""
    return [document.path for document in _chain(path, kind)]


def named_file(name: str, kind: ExtendableKind, *, relative_to: Path = Path()) -> Path:
    """The file of a name: the path itself, or the shipped file of a bare name.

    name : a path, taken from the folder `relative_to`, or a bare name such as `irb2400`.

    Raises DescriptionError when a bare name is neither a file there nor a shipped one.
    """
    path = relative_to / name
    if path.is_file() or path.suffix or Path(name).name != name:
        return path
    names = sorted(file.stem for file in kind.shipped.glob("*.yaml"))
    if name in names:
        return kind.shipped / f"{name}.yaml"
    hint = nearest(name, names, noun="name")
    raise DescriptionError(f"unknown {kind.what} {name!r}.{hint} A file of your own ends in .yaml.")


def renamed(data: dict[str, Any], kind: ExtendableKind, old: Path, new: Path) -> dict[str, Any]:
    """The data of a file with names of files relative to the folder `new` in place of `old`."""
    here, there = old.resolve(), new.resolve()
    if here == there:
        return data

    def moved(_: str, name: str) -> str:
        return name if Path(name).is_absolute() else name_from(there, here / name)

    return _with_names(data, kind, moved)


def portable(
    data: dict[str, Any], kind: ExtendableKind, old: Path, folder: Path, new: Path
) -> dict[str, Any]:
    """The data of a file whose files are copied into a folder, with names relative to `new`.

    old : folder that the names are relative to. What is a folder, as a recording, is not copied.
    """

    def copied(key: str, name: str) -> str:
        file, (first, *rest) = old / name, key.split(".")
        if file.is_file():
            file = folder / copied_description(folder, rest[-1] if first == "cell" else first, file)
        return name_from(new, file)

    return _with_names(data, kind, copied)


def _with_names(
    data: dict[str, Any], kind: ExtendableKind, change: Callable[[str, str], str]
) -> dict[str, Any]:
    """The data with other names of files; change : (dotted key, name) -> name."""

    def changed(key: str, name: Any) -> Any:
        if isinstance(name, list):
            return [changed(key, item) for item in name]
        own = isinstance(name, str) and name and (key in kind.files or name.endswith(".yaml"))
        return change(key, name) if own else name

    for key in (*kind.files, *kind.descriptions):
        value: Any = data
        for part in key.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if value is not None:
            data = with_changes(data, {key: changed(key, value)})
    return data


def _chain(path: Path, kind: ExtendableKind) -> list[YamlDocument]:
    """The file and its bases as they are written, each before the one that it extends."""
    chain = [load_yaml(path)]
    while EXTENDS in chain[-1].data:
        file, where = _base_of(chain[-1], kind)
        names = " extends ".join(document.path.name for document in chain)
        if any(file.resolve() == document.path.resolve() for document in chain):
            what = f"a circle, {names} extends {file.name}."
            raise DescriptionError.at(where, what, "Remove one of these lines.")
        if len(chain) > MAX_BASES:
            what = f"{names} extends more than {MAX_BASES} files one after the other."
            raise DescriptionError.at(where, what, "Merge some of them.")
        chain.append(load_yaml(file))
    return chain


def _base_of(document: YamlDocument, kind: ExtendableKind) -> tuple[Path, str]:
    """The file that a document extends, and the beginning of a message about it."""
    name = document.data[EXTENDS]
    where = f"{document.place_of((EXTENDS,))}: {EXTENDS} = {name!r}"
    if not isinstance(name, str):
        raise DescriptionError(f"{where}: expected the name of a file.")
    try:
        file = named_file(name, kind, relative_to=document.path.parent)
    except DescriptionError as error:
        raise DescriptionError(f"{where}: {error}") from None
    if not file.is_file():
        raise DescriptionError(f"{where}: no such file {file}. Name it relative to this file.")
    return file, where


def _merged(base: Any, own: Any, loc: Loc, replaced: set[Loc]) -> Any:
    """`own` over `base`; adds the locations whose value is replaced as a whole to `replaced`."""
    if isinstance(base, dict) and isinstance(own, dict):
        both = {k: _merged(base[k], own[k], (*loc, k), replaced) for k in own if k in base}
        return base | own | both
    replaced.add(loc)
    return own


def _above(document: YamlDocument, replaced: set[Loc]) -> Iterator[tuple[Loc, Place]]:
    """The places of a document that do not lie within one of the replaced values."""
    for loc, place in document.places.items():
        if not any(loc[:depth] in replaced for depth in range(1, len(loc))):
            yield loc, place


def _with_override(document: YamlDocument, text: str, keys: set[str]) -> YamlDocument:
    """The document with the value of `KEY=VALUE`; adds KEY to `keys`, which must not hold it."""
    option = f"--set {text}"
    key, equals, value = text.partition("=")
    if not equals or "" in key.split("."):
        raise DescriptionError(f"{option}: expected KEY=VALUE, such as seed=2.")
    if key in keys:
        raise DescriptionError(f"{option}: {key} is set twice. Remove one.")
    keys.add(key)
    changes = {key: parse_value(value, option)}
    try:
        loc = location_of(document.data, key)
        data = with_changes(document.data, changes)
    except InputError as error:
        raise DescriptionError(f"{option}: {error}.") from None
    place = Place(option, 0)
    new = {loc[:depth]: place for depth in range(1, len(loc) + 1)}
    return replace(document, data=data, places=new | dict(_above(document, {loc})) | {loc: place})


def with_changes(data: Mapping[str, Value], changes: Mapping[str, Value]) -> dict[str, Value]:
    """Plain data with the values at dotted keys replaced or added; `data` itself is unchanged.

    Raises InputError, beginning with the dotted key, when it leads through a value that holds
    nothing below it.
    """
    changed = dict(data)
    for key, value in changes.items():
        changed = _replaced(changed, location_of(changed, key), value)
    return changed


def location_of(data: Mapping[str, Value], key: str) -> Loc:
    """Keys and list indices that a dotted key stands for, whether its value exists or not.

    Raises InputError, beginning with the dotted key, as `with_changes`.
    """
    loc: Loc = ()
    node: Value = data
    below = key
    while below:
        step, node, below = _step(node, below, key)
        loc = (*loc, step)
    return loc


def overlap(key: str, other: str) -> bool:
    """Whether two dotted keys are equal or one lies below the other."""
    return f"{key}.".startswith(f"{other}.") or f"{other}.".startswith(f"{key}.")


def _step(node: Value, rest: str, key: str) -> tuple[str | int, Value, str]:
    """First key or index of the dotted key `rest` below `node`, its value, and the rest of the key.

    key : the whole dotted key, for the message.
    """
    head, _, below = rest.partition(".")
    if isinstance(node, list):
        if not head.isdecimal() or int(head) >= len(node):
            what = f"the list has no item {head}; its {len(node)} items count from 0."
            raise InputError.at(key, what, "Name one of these")
        return int(head), node[int(head)], below
    if node is not None and not isinstance(node, dict):
        what = f"the value {node!r} above {head} has no keys of its own."
        raise InputError.at(key, what, "Name a key that exists")
    held: dict[str, Value] = node or {}
    for written in sorted(held, key=len, reverse=True):
        if rest == written or rest.startswith(f"{written}."):
            return written, held[written], rest[len(written) + 1 :]
    return head, None, below


def _replaced(node: Value, loc: Loc, value: Value) -> Any:
    """`node` with `value` at a location below it."""
    if not loc:
        return value
    head, below = loc[0], loc[1:]
    if isinstance(head, int):
        return [*node[:head], _replaced(node[head], below, value), *node[head + 1 :]]
    held = node or {}
    return {**held, head: _replaced(held.get(head), below, value)}
