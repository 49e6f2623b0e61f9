"""TwinCAT Scope exports in every form: held against the program that was recorded, and pytcs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytcs
import pytest

from acquisition.formats.scope import Channel, read_channels
from tests.helpers.scope_exports import (
    CYCLES,
    FORMS,
    START_NS,
    assert_counted,
    counting_program,
    export,
)

EXPORTS = Path(__file__).parents[3] / "shared" / "samples" / "twincat_scope"  # of pytcs, BSD-3


def channels(file: Path) -> list[Channel]:
    read, findings = read_channels(file, file.name)
    assert not findings
    return read


def assert_as_pytcs(file: Path) -> None:
    """Names, values and times are those that pytcs reads."""
    read, other = channels(file), pytcs.ScopeFile(str(file))
    other.load()
    assert [channel.name for channel in read if channel.name] == list(other)
    for channel in read:
        theirs = other[channel.name]
        assert np.array_equal(channel.values.astype(np.float64), theirs.values)
        assert np.array_equal(
            channel.time_ns - START_NS, np.rint(theirs.time * 1e6).astype(np.int64)
        )


@pytest.mark.parametrize("form", FORMS)
def test_an_export_of_every_form_holds_what_the_program_counted(form: str, tmp_path: Path) -> None:
    file = tmp_path / "scope.csv"
    file.write_bytes(export(counting_program(), **FORMS[form]))
    read = {channel.name: channel for channel in channels(file)}
    assert_counted(list(read.values()), CYCLES, scaling_applied=True)
    for series in counting_program():
        channel = read[series.name]
        assert (channel.data_type, channel.values.tolist()) == (
            series.data_type,
            series.values.tolist(),
        )
        rows = series.start_ms + series.step_ms * np.arange(len(series.values))  # [ms]
        assert np.array_equal(channel.time_ns, START_NS + np.rint(1e6 * rows).astype(np.int64))


@pytest.mark.parametrize("form", FORMS)
def test_pytcs_reads_our_exports_as_we_do(form: str, tmp_path: Path) -> None:
    file = tmp_path / "scope.csv"
    file.write_bytes(export(counting_program(), **FORMS[form]))
    assert_as_pytcs(file)


@pytest.mark.slow
def test_exports_of_the_scope_itself_are_read_as_pytcs_reads_them() -> None:
    files = sorted(EXPORTS.glob("tc3*"))
    if not files:
        pytest.skip("no exports of a real Scope beside the project (../shared/samples)")
    for file in files:
        assert_as_pytcs(file)
        scaling_applied = "default" not in file.name  # the option that this export left out
        assert_counted(channels(file), 1000, scaling_applied=scaling_applied)
