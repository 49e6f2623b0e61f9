"""One thread of BLAS a process.

Our matrices have tens to hundreds of columns. A second thread only waits for them (identifier, all corrections: 171 ms with two
threads, 139 ms with one, `python -m benchmarks.identifier_speed`), and it adds in another order: other last digits.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

ONE_THREAD = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
)  # read when the libraries load; Dask's nanny sets them


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes started within compute with one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
