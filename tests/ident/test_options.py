"""Options of an identification."""

from __future__ import annotations

import pytest

from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.options import DEFAULT_SAMPLES, DEFAULTS, FitOptions


def test_by_default_the_data_decide() -> None:
    assert FitOptions() == DEFAULTS
    assert (DEFAULTS.model, DEFAULTS.force) == ("auto", "auto")
    assert DEFAULTS.corrections is None
    assert DEFAULTS.rod_sigma is None
    assert DEFAULTS.samples == DEFAULT_SAMPLES


def test_an_unknown_correction_is_refused_with_the_ones_there_are() -> None:
    with pytest.raises(ValueError, match="unknown correction 'gear_compliance'; there are") as e:
        FitOptions(corrections=("rod_strain", "gear_compliance"))
    for name in CORRECTIONS:
        assert name in str(e.value)


@pytest.mark.parametrize("names", [(), ("rod_strain",), tuple(CORRECTIONS)])
def test_known_corrections_are_taken_in_any_number(names: tuple[str, ...]) -> None:
    assert FitOptions(corrections=names).corrections == names
