"""A column of a log is asked for as the length, with the unit that is proposed for it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.dialect import Dialect
from ballbar.cell.load import load_instrument
from ballbar.recordings.answers import Answers
from ballbar.recordings.log_questions import _length, likely_unit
from ballbar.recordings.preview import LogPreview
from ballbar.recordings.questions import time_form

BAR = load_instrument("qc20w_300")  # 0.3 m, a few millimetres of stroke
DIALECT = cast("Dialect", SimpleNamespace(time=SimpleNamespace(column="t")))
SHOWN = np.linspace(-0.4, 0.4, 5) * (BAR.upper - BAR.lower)  # [m] about the middle of the stroke


def asked(
    columns: dict[str, Array], **answers: object
) -> tuple[dict[str, object], list[str | None]]:
    """The length as written, and each proposal, which is taken where there is one."""
    log = SimpleNamespace(columns=list(columns), values=columns.__getitem__)
    given = SimpleNamespace(**{"column": None, "unit": None, "zero": None} | answers)
    proposals: list[str | None] = []

    def ask(question: str, proposal: str | None) -> str:
        proposals.append(proposal)
        return proposal or ("mm" if "unit" in question else "length")

    out = _length(cast("LogPreview", log), BAR, DIALECT, cast("Answers", given), ask)
    return out, proposals


def test_the_column_that_lies_inside_the_stroke_is_proposed_with_its_unit() -> None:
    columns = {"t": SHOWN, "speed": 1e3 + SHOWN, "length": 1e3 * (BAR.nominal + SHOWN)}
    assert asked(columns) == ({"column": "length", "unit": "mm"}, ["length", "mm"])


def test_a_column_of_deviations_has_the_nominal_length_at_zero() -> None:
    middle = 0.5 * (BAR.lower + BAR.upper) - BAR.nominal
    out, proposals = asked({"t": SHOWN, "length": 1e3 * (middle + SHOWN)})
    assert out == {"column": "length", "unit": "mm", "zero_m": pytest.approx(BAR.nominal)}
    assert proposals == ["length", "mm", f"{BAR.nominal:g}"]
    stated, _ = asked({"t": SHOWN, "length": 1e3 * (middle + SHOWN)}, zero=0.2)
    assert stated["zero_m"] == 0.2


def test_the_only_column_is_proposed_whatever_it_holds_and_none_of_several() -> None:
    assert asked({"t": SHOWN, "length": 1e6 + SHOWN})[1] == ["length", None]
    assert asked({"t": SHOWN, "length": 1e6 + SHOWN, "v": 1e6 + SHOWN})[1] == [None, None]
    both = {"t": SHOWN, "length": BAR.nominal + SHOWN, "v": BAR.nominal + SHOWN}
    assert asked(both)[1] == [None, "m"]


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("mm", 1e-3), ("um", 1e-6)])
def test_the_unit_puts_all_values_inside_the_range(unit: str, metres: float) -> None:
    middle = 0.5 * (BAR.lower + BAR.upper)
    values = (middle + SHOWN) / metres
    assert likely_unit(BAR, values) == (unit, 0.0)
    half = 0.5 * (BAR.upper - BAR.lower) / metres
    assert likely_unit(BAR, np.array([middle / metres - 0.999 * half])) == (unit, 0.0)
    assert likely_unit(BAR, np.array([middle / metres, middle / metres + 1.01 * half])) != (
        unit,
        0.0,
    )
    assert likely_unit(BAR, np.array([middle / metres, middle / metres - 1.01 * half])) != (
        unit,
        0.0,
    )
    assert likely_unit(BAR, np.empty(0)) is None


@pytest.mark.parametrize(
    ("step", "proposal"), [(4.0, "ms"), (0.004, "s"), (4000.0, "us"), (40.0, None), (0.0, None)]
)
def test_the_unit_in_which_rows_have_a_usual_period_is_proposed(
    step: float, proposal: str | None
) -> None:
    asked: list[tuple[str, str | None]] = []

    def ask(question: str, proposed: str | None) -> str:
        asked.append((question, proposed))
        return proposed or "s"

    stamps = 7.0 + step * np.arange(5)
    form = time_form("a.csv", stamps, periods=(1e-3, 2e-2), given=None, ask=ask)
    assert form == (proposal or "s")
    assert asked[0][1] == proposal
    apart = f"; rows are {step:g} apart." if step else "They do not show it."
    assert apart in asked[0][0]
    assert time_form("a.csv", stamps, periods=(1e-3, 2e-2), given="us", ask=ask) == "us"
    assert len(asked) == 1
    time_form("a.csv", stamps[:1], periods=(1e-3, 2e-2), given=None, ask=ask)
    assert asked[1][1] is None
    time_form("a.csv", stamps, periods=(1e-3, 2e-2), given=None, ask=ask, proposed=["ns"])
    assert asked[2][1] is None
