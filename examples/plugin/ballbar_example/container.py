"""Logs as a structured array of NumPy, whose fields are the columns."""

from pathlib import Path

import numpy as np

from ballbar.acquisition.formats.columns import one_file, wanted_columns
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table
from ballbar.cell.errors import LogError


def read(path: Path, file: str, time: str, layout: Layout) -> tuple[Table, Form]:
    """The wanted fields; `time` is whole nanoseconds."""
    try:
        rows = np.load(path, allow_pickle=False)
        names = [time, *wanted_columns(layout, time, rows.dtype.names, file)]
        table = one_file({n: rows[n] for n in names}, file, np.arange(1, len(rows) + 1))
    except (ValueError, TypeError) as error:
        raise LogError(f"{file}: {error} Save it again with numpy.save.") from None
    if bad := [name for name in names if not np.isfinite(rows[name]).all()]:
        raise LogError(f"{file}: {bad[0]} has values that are not finite. Leave such rows out.")
    return table, Form("npy", "none", "none", len(rows))


NPY = (read, "integer", "ns")  # with the type and unit of its times
