"""Which parameters a Jacobian cannot tell apart, in the notation of thesis Tables 3.2, 3.3 and 3.4.

Everything here works on columns (P, M), one row a parameter, and the parameters' names; where the
columns come from (cost, robot, path, encoders) is the caller's affair. Columns are compared at unit
length, so units and weights of a parameter do not matter. A parameter whose column vanishes has no
effect (Table 3.3). The others form a null space as large as the number of directions that are
missing; its readable basis is: walk through the parameters in the order of thesis sec. 3.3 and
leave out each one whose column is a combination `c_k = sum_i x_i c_i` of those selected before.
(The thesis reads the diagonal of "Q"; it is that of R.)

- One partner, as in `c_rd1 = -c_oz`: either can be selected. All that share a partner make one
  group, `rd1 | oz | bd1` (Table 3.2).
- Several partners, as in `c_rtheta1 = -c_btheta1 + oy c_ox - ox c_oy`: they move together, `rtheta1
  | ox,y + btheta1`.
- All lengths in proportion to themselves: the scale, which one known length fixes. It joins the
  plate's group, `ra6 | bd3`.

The same x are the influence of Table 3.4: an error of 1 mm|mrad in a parameter left out moves each
selected one by x_i mm|mrad.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, ParameterTable, parameter_named
from ballbar.ident.estimator.thesis_names import (
    extra_parameters,
    joined_names,
    order_of_the_thesis,
    thesis_parameters,
)

# relative; thesis sec. 3.2. Structural zeros leave 1e-15, the weakest real direction 3e-4
# (docs/identifiability.md)
STRUCTURAL = 1e-6
# a combination of fewer lengths has a simpler name than "all lengths in proportion"
SCALE_PARTNERS = 3
SIGNIFICANT = 0.05  # mm|mrad for an error of 1 mm|mrad, thesis sec. 3.3


@dataclass(frozen=True)
class Dependency:
    """A parameter left out, and the combination of selected ones that does the same."""

    name: str
    # selected parameter: x, in units of the partner per unit of `name` (m, rad)
    partners: Mapping[str, float]
    is_scale: bool  # every length in proportion to itself


@dataclass(frozen=True)
class Selection:
    """Parameters that can be identified together, and the rest; names in order of priority."""

    selected: tuple[str, ...]
    without_effect: tuple[str, ...]  # zero Jacobian
    dependent: tuple[Dependency, ...]


@dataclass(frozen=True)
class Group:
    """Parameters of which only some can be identified, one entry of Table 3.2."""

    # alternatives; several names in one alternative move together
    members: tuple[tuple[str, ...], ...]
    vectors: tuple[Dependency, ...]  # the null vectors behind it

    def __str__(self) -> str:
        return " | ".join(joined_names(names) for names in self.members)


@dataclass(frozen=True)
class Spectrum:
    """Singular values on both sides of the cut, of the columns at unit length."""

    rank: int
    condition: float  # largest by smallest counted
    smallest_counted: float  # relative to the largest
    largest_ignored: float  # relative to the largest; 0 where nothing is ignored


def zero_jacobian(columns: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters that move nothing (thesis Table 3.3).

    Their columns, of columns (P, M), are shorter than STRUCTURAL of the longest one.
    """
    lengths = _lengths_of(columns, names)
    return tuple(
        name
        for name, length in zip(names, lengths, strict=True)
        if length <= STRUCTURAL * lengths.max()
    )


def spectrum(columns: Array, names: Sequence[str]) -> Spectrum:
    """Number of directions that columns (P, M) span; columns without effect do not count."""
    lengths = _lengths_of(columns, names)
    unit = columns[lengths > STRUCTURAL * lengths.max()]
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    relative = np.linalg.svd(unit, compute_uv=False)
    relative = relative / relative[0]
    rank = int((relative > STRUCTURAL).sum())
    return Spectrum(
        rank,
        float(1.0 / relative[rank - 1]),
        float(relative[rank - 1]),
        float(relative[rank:].max(initial=0.0)),
    )


def select(
    columns: Array, names: Sequence[str], nominal: Geometry, *, known: Sequence[str] | None = None
) -> Selection:
    """The parameters to identify, by the priority of thesis sec. 3.3.

    columns : (P, M) per [m] or [rad], one row for each of `names`, in any order.
    nominal : its lengths say what the scale direction is.
    known : asked last, so that they are left out where anything depends on them; by default the
    plate, whose length is known.

    Raises ValueError for a name that is no parameter, and when `columns` has not one row for each
    name.
    """
    table = nominal.table
    known = (table.plate,) if known is None else known
    priorities = [_priority(table, name) for name in names]
    order = sorted(range(len(names)), key=lambda k: (names[k] in known, priorities[k]))
    none = set(zero_jacobian(columns, names))
    lengths = _lengths_of(columns, names)
    moving = [k for k in order if names[k] not in none]
    walk = orthogonalised(columns, moving, lambda _, remainder: remainder >= STRUCTURAL)
    dependent: list[Dependency] = []
    for k in (k for k in moving if k not in walk.selected):
        before = walk.before(k)
        terms = _combination(columns, lengths, names, before, k, walk.basis[: len(before)])
        partners = {name: terms[name] for name in sorted(terms, key=order_of_the_thesis(table))}
        scale = _scale_without(names[k], [names[i] for i in before], dependent, nominal)
        dependent.append(Dependency(names[k], partners, _in_proportion(partners, scale)))
    return Selection(
        tuple(names[k] for k in walk.selected),
        tuple(names[k] for k in order if names[k] in none),
        tuple(dependent),
    )


@dataclass(frozen=True, eq=False)
class Orthogonalised:
    """Columns taken in one order, each selected unless it depends on those selected before."""

    order: list[int]
    selected: list[int]  # in that order
    remainders: dict[int, float]  # relative length of each column beyond those selected before it
    basis: Array  # (S, M) orthonormal rows of the selected columns

    def before(self, k: int) -> list[int]:
        """The columns selected before column k."""
        passed = set(self.order[: self.order.index(k)])
        return [i for i in self.selected if i in passed]


def orthogonalised(
    columns: Array, order: Sequence[int], keep: Callable[[int, float], bool]
) -> Orthogonalised:
    """Gram-Schmidt over columns (P, M) in the given order (thesis sec. 3.3).

    keep : whether a column is selected, from its index and the relative length of its remainder.
    """
    selected: list[int] = []
    remainders: dict[int, float] = {}
    basis = np.zeros((0, columns.shape[1]))
    for k in order:
        rest = columns[k] / np.linalg.norm(columns[k])
        for _ in range(2):  # twice is enough (Kahan, in Parlett 1980, sec. 6.9)
            rest = rest - basis.T @ (basis @ rest)
        remainders[k] = float(np.linalg.norm(rest))
        if keep(k, remainders[k]):
            basis = np.vstack((basis, rest / remainders[k]))
            selected.append(k)
    return Orthogonalised(list(order), selected, remainders, basis)


def groups(columns: Array, names: Sequence[str], nominal: Geometry) -> tuple[Group, ...]:
    """The dependencies as thesis Table 3.2 prints them; arguments as in `select`.

    Here the plate is a parameter like the others, so the scale shows up where another length is
    left out; it is written against the plate, the length that is known.
    """
    vectors = select(columns, names, nominal, known=()).dependent
    plate, written = nominal.table.plate, order_of_the_thesis(nominal.table)
    shared: dict[str, list[Dependency]] = {}
    entries = []
    for vector in vectors:
        partners = (
            [plate] if vector.is_scale and plate in vector.partners else list(vector.partners)
        )
        if len(partners) == 1:
            shared.setdefault(partners[0], []).append(vector)
        else:
            entries.append(Group(((vector.name,), tuple(sorted(partners, key=written))), (vector,)))
    for partner, alternatives in shared.items():
        members = sorted((partner, *(vector.name for vector in alternatives)), key=written)
        entries.append(Group(tuple((name,) for name in members), tuple(alternatives)))
    return tuple(sorted(entries, key=lambda group: written(group.members[0][0])))


def influence(
    columns: Array,
    names: Sequence[str],
    selected: Sequence[str],
    left_out: Sequence[str],
    *,
    threshold: float = SIGNIFICANT,
) -> dict[str, dict[str, float]]:
    """Influence of an error in a parameter left out on those selected, to first order (Table 3.4).

    columns : (P, M), one row for each of `names`. The selected ones are fitted by least squares.

    Returns for each of `left_out` the selected ones that move by more than `threshold` [mm|mrad per
    mm|mrad], largest first.
    """
    row = {name: k for k, name in enumerate(names)}
    scale = np.linalg.norm(columns[[row[name] for name in selected]], axis=1)
    unit = columns[[row[name] for name in selected]] / scale[:, None]
    wanted = columns[[row[name] for name in left_out]]
    moves = (np.linalg.lstsq(unit.T, wanted.T, rcond=None)[0] / scale[:, None]).T
    return {
        name: significant(dict(zip(selected, move, strict=True)), threshold)
        for name, move in zip(left_out, moves, strict=True)
    }


def significant(moves: Mapping[str, float], threshold: float = SIGNIFICANT) -> dict[str, float]:
    """Moves that exceed the threshold, largest first."""
    return {
        name: float(x)
        for name, x in sorted(moves.items(), key=lambda item: -abs(item[1]))
        if abs(x) > threshold
    }


def _lengths_of(columns: Array, names: Sequence[str]) -> Array:
    if columns.ndim != 2 or len(columns) != len(names):
        raise ValueError(
            f"columns {columns.shape} do not fit {len(names)} names; one row a parameter is needed"
        )
    return np.asarray(np.linalg.norm(columns, axis=1))


def _priority(table: ParameterTable, name: str) -> int:
    order = thesis_parameters(table) + extra_parameters(table)
    if name not in order:
        raise ValueError(f"{name!r} is no parameter of robot, ball-bar or origin")
    return order.index(name)


def _combination(
    columns: Array, lengths: Array, names: Sequence[str], selected: list[int], k: int, basis: Array
) -> dict[str, float]:
    """x of `c_k = sum_i x_i c_i`, shares of rounding size left out.

    columns : (P, M). basis : (K, M) orthonormal, of the K selected.
    """
    if not selected:
        return {}
    triangle = basis @ (columns[selected] / lengths[selected, None]).T
    shares = np.linalg.solve(triangle, basis @ columns[k] / lengths[k])
    return {
        names[i]: float(share * lengths[k] / lengths[i])
        for i, share in zip(selected, shares, strict=True)
        if abs(share) > STRUCTURAL
    }


def _scale_without(
    name: str, selected: Sequence[str], dependent: Sequence[Dependency], nominal: Geometry
) -> dict[str, float]:
    """Change of each selected length when all lengths but that of `name` grow in proportion.

    A length left out earlier does it through its partners: with rd1 at its nominal value the
    origin's oz grows by oz - rd1.
    """
    grows = {i: nominal[i] for i in selected if _is_length(i)}
    for other in dependent:
        if _is_length(other.name) and other.name != name:
            for partner, x in other.partners.items():
                grows[partner] = grows.get(partner, 0.0) + nominal[other.name] * x
    return grows


def _in_proportion(partners: Mapping[str, float], scale: Mapping[str, float]) -> bool:
    every = [*partners, *(i for i in scale if i not in partners)]
    x, grows = (np.array([vector.get(i, 0.0) for i in every]) for vector in (partners, scale))
    if len(partners) < SCALE_PARTNERS or not grows.any():
        return False
    aside = x - grows * (x @ grows) / (grows @ grows)
    return bool(np.linalg.norm(aside) < np.sqrt(STRUCTURAL) * np.linalg.norm(x))


def _is_length(name: str) -> bool:
    return parameter_named(name).is_length
