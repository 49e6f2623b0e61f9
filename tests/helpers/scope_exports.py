"""Writer of TwinCAT Scope exports, and a program that counts into variables of every type.

The form is that of exports of TwinCAT 3 Scope 3.4.3145.3 (German Windows) among the test data of
pytcs; `FORMS` are the settings of its export dialog that change the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.formats.scope import read_scope
from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.header import Kind, Layout

FILETIME = 132_959_733_843_760_000  # start of every export: 2022-05-02, UTC [100 ns since 1601]
START_NS = (FILETIME - 116_444_736_000_000_000) * 100  # the same instant since 1970
CYCLES = 300  # of the counting program: more than UINT8 holds
FORMS: dict[str, dict[str, object]] = {
    "a time for each channel": {"decimal": ",", "own_times": True, "eof": True},
    "shared times, shorter rows": {"locale": ",", "padded": False, "eof": True},
    "decimal commas": {"decimal": ",", "padded": False},
    "colons": {"separator": ":", "locale": ",", "padded": False, "closing": True},
    "semicolons, CRLF": {"separator": ";", "own_times": True, "closing": True, "newline": "\r\n"},
}


@dataclass(frozen=True, eq=False)
class Series:
    """One channel as the Scope records it."""

    name: str
    data_type: str
    values: NDArray  # (N,)
    step_ms: float = 1.0
    start_ms: float = 0.0
    scaling: tuple[int, int] = (0, 1)  # offset and factor, applied to the values already
    unit: tuple[str, int, int] = ("(None)", 1, 0)  # with factor and offset


def export(
    channels: Sequence[Series],
    *,
    separator: str = "\t",
    decimal: str = ".",
    locale: str | None = None,
    own_times: bool = False,
    padded: bool = True,
    eof: bool = False,
    closing: bool = False,
    newline: str = "\n",
) -> bytes:
    """The file of an export.

    locale : decimal mark of Windows, in the metadata; None for that of the data. own_times : each
    channel has its time column; otherwise neighbours of one sample time share it. padded : blanks
    behind the end of a short channel; otherwise the rows get shorter. eof : a last line. closing :
    a separator behind the first two lines.
    """
    key = (lambda c: c.name) if own_times else (lambda c: (c.step_ms, c.start_ms))
    groups = [list(group) for _, group in groupby(channels, key)]
    end = FILETIME + round(max(1e4 * c.step_ms * (len(c.values) - 1) for c in channels))
    close = separator if closing else ""
    lines = [
        f"Name{separator}bench{close}",
        f"File{separator}bench.csv{close}",
        separator.join(
            ("Starttime of export", str(FILETIME), "Montag, 2. Mai 2022", "15:56:24.376")
        ),
        separator.join(("Endtime of export", str(end), "Montag, 2. Mai 2022", "15:56:25.375")),
        "",
        "",
    ]
    rows = {name: [[name, *map(of, group)] for group in groups] for name, of in METADATA.items()}
    rows["SampleTime[ms]"] = [
        [cell.replace(".", locale or decimal) for cell in group] for group in rows["SampleTime[ms]"]
    ]
    lines += [separator.join(chain.from_iterable(cells)) for cells in rows.values()]
    lines.append("")
    for row in range(max(len(c.values) for c in channels)):
        cells = [cell for group in groups for cell in _cells(group, row)]
        while not padded and cells[-1] == " ":
            cells.pop()
        lines.append(separator.join(cell.replace(".", decimal) for cell in cells))
    return newline.join([*lines, *["EOF"] * eof, ""]).encode()


METADATA = {
    "Name": lambda c: c.name,
    "SymbolComment": lambda _: "",
    "Data-Type": lambda c: c.data_type,
    "SampleTime[ms]": lambda c: f"{c.step_ms:g}",
    "VariableSize": lambda c: str(max(int("".join(filter(str.isdigit, c.data_type)) or 8) // 8, 1)),
    "SymbolBased": lambda _: "True",
    "IndexGroup": lambda _: "16448",
    "NetID": lambda _: "5.12.82.20.1.1",
    "Port": lambda _: "851",
    "Offset": lambda c: str(c.scaling[0]),
    "ScaleFactor": lambda c: str(c.scaling[1]),
    "BitMask": lambda _: "0xffffffffffffffff",
    "Unit": lambda c: c.unit[0],
    "Unit ScaleFactor": lambda c: str(c.unit[1]),
    "Unit Offset": lambda c: str(c.unit[2]),
}  # key of a row to the field of a channel


def _cells(group: Sequence[Series], row: int) -> list[str]:
    """Time and values of a group; blanks behind its end."""
    if row >= len(group[0].values):
        return [" "] * (1 + len(group))
    time = f"{group[0].start_ms + row * group[0].step_ms:g}"
    return [time, *(f"{c.values[row].item():.17g}" for c in group)]


def counting_program(cycles: int = CYCLES) -> list[Series]:
    """Channels of a PLC that counts its cycles of 1 ms from 0 into variables of every type.

    One channel is sampled five times a cycle, one every fifth; one integer is scaled as `1 - x`.
    """
    k = np.arange(cycles)
    late = np.arange(-3, cycles - 5, 5)
    return [
        Series("func_OS", "REAL32", np.arange(5 * cycles - 4) / 5, step_ms=0.2),
        Series("var_BIT", "BIT", np.minimum(k, 1)),
        *(Series(f"var_UINT{bits}", f"UINT{bits}", k % 2 ** min(bits, 62)) for bits in BITS),
        *(Series(f"var_INT{bits}", f"INT{bits}", _signed(k, bits)) for bits in BITS),
        Series("var_REAL64", "REAL64", k / 8),
        Series("func_scaled_int", "INT16", 1 - k, scaling=(1, -1)),
        Series("func_units_scaled", "REAL32", 10.0 - 10.0 * k, unit=("dV (Voltage)", -10, 10)),
        Series("test_special([{äöü!?ß$²}])", "REAL32", k / 2),
        Series("test space", "REAL32", 1.0 * k),
        Series("func_freesample", "REAL32", late % 1000.0, step_ms=5.0, start_ms=-3.0),
    ]


BITS = (8, 16, 32, 64)


def _signed(k: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """Value of a signed integer of so many bits after k increments."""
    return (k + 128) % 256 - 128 if bits == 8 else k


@cache
def channel(
    file: Path, name: str, kind: Kind = "float"
) -> tuple[NDArray[np.int64], NDArray, tuple[Finding, ...]]:
    """Times (N,) [ns] since START_NS and values (N,) of one channel of an export, and findings.

    Read once: a file is not written again.
    """
    table, _ = read_scope(file, file.name, "time", Layout((), {"time": "integer", name: kind}))
    return table.columns["time"] - START_NS, table.columns[name], table.findings


def assert_counted(file: Path, cycles: int, *, scaling_applied: bool) -> None:
    """The integer channels of a file hold what the program counted, at its times."""
    k = np.arange(cycles)
    for bits in BITS:
        times, whole, _ = channel(file, f"var_UINT{bits}", "integer")
        _, signed, _ = channel(file, f"var_INT{bits}", "integer")
        assert np.array_equal(times, 1_000_000 * k)
        assert np.array_equal(whole, k % 2**bits if bits < 16 else k)
        assert np.array_equal(signed, _signed(k, bits))
        assert whole.dtype == signed.dtype == np.int64
    assert np.array_equal(channel(file, "var_BIT", "integer")[1], np.minimum(k, 1))
    _, values, findings = channel(file, "func_scaled_int")
    assert np.array_equal(values, 1 - k if scaling_applied else k)
    assert [entry.kind for entry in findings] == ["scaled channel"]
    if b"func_OS" in file.read_bytes():
        oversampled = np.arange(5 * cycles - 4)
        times, values, _ = channel(file, "func_OS")
        assert np.array_equal(times, 200_000 * oversampled)
        assert np.array_equal(values, oversampled / 5)
