"""Dependencies among columns whose null space is known, in the notation of thesis Table 3.2."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.dependencies import (
    groups,
    influence,
    orthogonalised,
    select,
    significant,
    spectrum,
    zero_jacobian,
)
from ballbar.ident.estimator.thesis_names import shortened
from tests.helpers.six_axes import EXTRA_PARAMETERS, INDEX, PLATE, THESIS_PARAMETERS

ROUNDING = 1e-9  # of columns of size 1

MADE_UP = (
    "ralpha6",
    "bd1",
    "rd3",
    "rtheta1",
    "balpha2",
    "ra2",
    "rd1",
    "oz",
    "ox",
    "oy",
    "btheta1",
    "bd2",
    "rd2",
)


def made_up() -> Array:
    """Random columns for MADE_UP with four known dependencies and one column without effect."""
    rng = np.random.default_rng(5)
    c = dict(zip(MADE_UP, rng.standard_normal((len(MADE_UP), 60)), strict=True))
    c["ralpha6"] *= 0.0
    c["rd1"], c["bd1"], c["rd3"] = -c["oz"], c["oz"], c["rd2"]
    c["balpha2"] = 0.6 * c["bd2"]
    c["rtheta1"] = -c["btheta1"] + 0.2 * c["ox"] - 0.7 * c["oy"]
    return np.array([c[name] for name in MADE_UP])


def scaled_lengths(nominal: Geometry) -> tuple[tuple[str, ...], Array]:
    """Columns of some lengths and angles that a common scale of the lengths leaves alone."""
    names = ("ox", "oz", "ra2", "ra6", "rd4", "bd3", "rtheta2", "rtheta3")
    columns = np.random.default_rng(6).standard_normal((len(names), 50))
    lengths = np.array([nominal[name] for name in names[:5]])
    columns[5] = -(lengths @ columns[:5]) / nominal["bd3"]
    return names, columns


def test_known_null_vectors_are_found_and_written_as_in_table_3_2(nominal: Geometry) -> None:
    columns = made_up()
    assert zero_jacobian(columns, MADE_UP) == ("ralpha6",)
    written = [str(group) for group in groups(columns, MADE_UP, nominal)]
    assert written == ["rd1 | oz | bd1", "rd2 | rd3", "rtheta1 | ox,y + btheta1", "bd2 | balpha2"]
    vectors = {d.name: dict(d.partners) for d in select(columns, MADE_UP, nominal).dependent}
    assert vectors.keys() == {"rd1", "rd3", "rtheta1", "bd1", "balpha2"}
    assert vectors["rd1"] == pytest.approx({"oz": -1.0})
    assert vectors["balpha2"] == pytest.approx({"bd2": 0.6})
    assert vectors["rtheta1"] == pytest.approx({"ox": 0.2, "oy": -0.7, "btheta1": -1.0})


def test_what_is_kept_and_left_out_follows_the_order_of_sec_3_3(nominal: Geometry) -> None:
    selection = select(made_up(), MADE_UP, nominal)
    assert selection.selected == ("btheta1", "ox", "oy", "oz", "ra2", "rd2", "bd2")
    assert [d.name for d in selection.dependent] == ["rd1", "rd3", "rtheta1", "bd1", "balpha2"]
    assert selection.without_effect == ("ralpha6",)


@pytest.mark.parametrize("seed", range(5))
def test_units_of_a_parameter_do_not_change_what_depends_on_what(
    nominal: Geometry, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    columns, unit = made_up(), 10.0 ** rng.uniform(-2.0, 2.0, len(MADE_UP))
    rescaled = columns * unit[:, None]
    assert list(map(str, groups(rescaled, MADE_UP, nominal))) == list(
        map(str, groups(columns, MADE_UP, nominal))
    )
    assert select(rescaled, MADE_UP, nominal).selected == select(columns, MADE_UP, nominal).selected
    vector = next(d for d in select(rescaled, MADE_UP, nominal).dependent if d.name == "balpha2")
    of = dict(zip(MADE_UP, unit, strict=True))
    assert vector.partners["bd2"] == pytest.approx(0.6 * of["balpha2"] / of["bd2"], rel=ROUNDING)


@pytest.mark.parametrize("seed", range(5))
def test_order_of_parameters_and_samples_does_not_matter(nominal: Geometry, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = made_up()
    rows, samples = rng.permutation(len(MADE_UP)), rng.permutation(columns.shape[1])
    shuffled, names = columns[rows][:, samples], [MADE_UP[k] for k in rows]
    assert list(map(str, groups(shuffled, names, nominal))) == list(
        map(str, groups(columns, MADE_UP, nominal))
    )
    assert select(shuffled, names, nominal).selected == select(columns, MADE_UP, nominal).selected


def test_the_scale_is_told_from_any_other_combination_of_lengths(nominal: Geometry) -> None:
    names, columns = scaled_lengths(nominal)
    (group,) = groups(columns, names, nominal)
    assert str(group) == "ra6 | bd3"
    assert group.vectors[0].is_scale
    (left_out,) = select(columns, names, nominal).dependent
    assert (left_out.name, left_out.is_scale) == (PLATE, True)
    assert left_out.partners["ra2"] == pytest.approx(-nominal["ra2"] / nominal["ra6"])
    other = columns.copy()
    other[5] += 0.1 * other[2]  # ra2 out of proportion
    (group,) = groups(other, names, nominal)
    assert not group.vectors[0].is_scale
    assert str(group) == "bd3 | ra2 + ra6 + rd4 + ox,z"


def test_a_nearly_dependent_column_is_kept_and_shows_in_the_spectrum(nominal: Geometry) -> None:
    columns = made_up()
    rd1 = MADE_UP.index("rd1")
    columns[rd1] += 1e-4 * np.random.default_rng(8).standard_normal(columns.shape[1])
    assert "rd1" in select(columns, MADE_UP, nominal).selected
    seen = spectrum(columns, MADE_UP)
    assert seen.rank == 8
    assert 1e-5 < seen.smallest_counted < 1e-3
    assert seen.largest_ignored < 1e-14


def test_an_error_left_out_moves_the_kept_ones_by_the_null_vector(nominal: Geometry) -> None:
    columns = made_up()
    selection = select(columns, MADE_UP, nominal)
    moves = influence(columns, MADE_UP, selection.selected, ["rtheta1", "balpha2", "ralpha6"])
    assert list(moves["rtheta1"]) == ["btheta1", "oy", "ox"]
    assert moves["rtheta1"] == pytest.approx({"btheta1": -1.0, "oy": -0.7, "ox": 0.2})
    assert moves["balpha2"] == pytest.approx({"bd2": 0.6})
    assert moves["ralpha6"] == {}
    assert influence(columns, MADE_UP, selection.selected, ["rtheta1"], threshold=0.5)[
        "rtheta1"
    ].keys() == {"btheta1", "oy"}


def test_wrong_names_and_shapes_are_refused(nominal: Geometry) -> None:
    with pytest.raises(ValueError, match="'rd7' is no parameter of robot, ball-bar or origin"):
        select(np.eye(2), ["rd1", "rd7"], nominal)
    with pytest.raises(ValueError, match=r"columns \(2, 2\) do not fit 3 names"):
        zero_jacobian(np.eye(2), ["rd1", "rd2", "rd3"])


@pytest.mark.parametrize(
    ("names", "together"),
    [
        (["ba1", "ba2", "ba3", "ba4", "ba5"], ["ba1-5"]),
        (["bd1", "bd2", "bd4", "bd5"], ["bd1,2,4,5"]),
        (["ox", "oy", "ra1", "otx", "oty"], ["ox,y", "ra1", "otx,y"]),
        (["rd1", "rd2", "oz"], ["rd1,2", "oz"]),
    ],
)
def test_names_of_one_kind_are_written_together(names: list[str], together: list[str]) -> None:
    assert shortened(names) == together


def test_the_thesis_s_list_has_its_47_parameters() -> None:
    assert len(set(THESIS_PARAMETERS)) == 24 + 20 + 3
    assert set(THESIS_PARAMETERS) | set(EXTRA_PARAMETERS) == set(INDEX)


def test_columns_are_taken_in_the_order_given_unless_they_depend_on_those_before() -> None:
    """Against numpy's QR: remainders are the diagonal of R at unit length."""
    rng = np.random.default_rng(9)
    columns = rng.standard_normal((5, 30)) * np.array([1.0, 1e-6, 1e4, 1.0, 1.0])[:, None]
    columns[3] = 2.0 * columns[0] - 1e6 * columns[1]
    order = [4, 0, 1, 3, 2]
    walk = orthogonalised(columns, order, lambda _, remainder: remainder > 1e-9)
    assert walk.selected == [4, 0, 1, 2]
    assert walk.before(3) == [4, 0, 1]
    assert walk.before(4) == []
    assert walk.remainders[3] < 1e-12
    unit = columns / np.linalg.norm(columns, axis=1, keepdims=True)
    diagonal = np.abs(np.diag(np.linalg.qr(unit[walk.selected].T)[1]))
    assert [walk.remainders[k] for k in walk.selected] == pytest.approx(diagonal)
    assert walk.basis @ walk.basis.T == pytest.approx(np.eye(4), abs=1e-12)


def test_the_caller_decides_what_is_kept() -> None:
    walk = orthogonalised(np.eye(3), [0, 1, 2], lambda k, _: k != 1)
    assert walk.selected == [0, 2]


def test_significant_moves_come_largest_first_whatever_their_sign() -> None:
    moves = {"ox": 0.04, "oy": -0.7, "oz": 0.2}
    assert list(significant(moves).items()) == [("oy", -0.7), ("oz", 0.2)]
    assert list(significant(moves, threshold=0.01)) == ["oy", "oz", "ox"]
