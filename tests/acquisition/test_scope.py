"""TwinCAT Scope exports in every form: held against the program that was recorded, and pytcs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytcs
import pytest

from tests.helpers.scope_exports import (
    CYCLES,
    FORMS,
    assert_counted,
    channel,
    counting_program,
    export,
)

EXPORTS = Path(__file__).parents[3] / "shared" / "samples" / "twincat_scope"  # of pytcs, BSD-3


def assert_as_pytcs(file: Path) -> None:
    """Values and times are those that pytcs reads."""
    other = pytcs.ScopeFile(str(file))
    other.load()
    for name in other:
        times, values, _ = channel(file, name)
        assert np.array_equal(values, other[name].values)
        assert np.array_equal(times, np.rint(other[name].time * 1e6).astype(np.int64))


@pytest.mark.parametrize("form", FORMS)
def test_an_export_of_every_form_holds_what_the_program_counted(form: str, tmp_path: Path) -> None:
    file = tmp_path / "scope.csv"
    file.write_bytes(export(counting_program(), **FORMS[form]))
    assert_counted(file, CYCLES, scaling_applied=True)
    assert_as_pytcs(file)
    for series in counting_program():
        times, values, findings = channel(file, series.name)
        assert values.tolist() == series.values.tolist()
        rows = series.start_ms + series.step_ms * np.arange(len(series.values))  # [ms]
        assert np.array_equal(times, np.rint(1e6 * rows).astype(np.int64))
        assert {entry.kind for entry in findings} <= {"scaled channel", "end of export"}


@pytest.mark.long
def test_exports_of_the_scope_itself_are_read_as_pytcs_reads_them() -> None:
    files = sorted(EXPORTS.glob("tc3*"))
    if not files:
        pytest.skip("no exports of a real Scope beside the project (../shared/samples)")
    for file in files:
        assert_as_pytcs(file)
        # The option that the default export left out.
        assert_counted(file, 1000, scaling_applied="default" not in file.name)
