"""One BLAS thread per process.

The matrices have tens to hundreds of columns, for which a second thread only waits: the identifier
with all corrections takes 171 ms with two threads and 139 ms with one (`python -m
benchmarks.identifier_speed`). A second thread also sums in another order, which changes last
digits.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

# Read when the libraries load; Dask's nanny sets them.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Context in which new processes compute with one thread."""
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
