"""The file of a result is written as it was fitted and read back before it takes its name.

Where the reader of results refuses it, it is kept whole under another name, so what was fitted is
not lost to a check of the program's own.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import methodcaller
from pathlib import Path

from cell.errors import InputError
from cell.files import write_yaml
from cell.schema import Strict


class RefusedResultError(RuntimeError):
    """A result that was fitted and written, and that the reader of results refuses.

    It is a fault of the program: one of fit, writer and reader is wrong.
    """


def write_result(path: Path, content: Strict, read: Callable[[Path], object]) -> None:
    """Write a result, whole or not at all.

    content : not checked yet (`model_construct`). read : the reader of such results.

    Raises RefusedResultError if it refuses the file. That then stands beside `path` with
    `.refused` in its name (ballbar.result.names.REFUSED), and an earlier result under `path` is
    deleted.
    """
    refused = path.with_suffix(f".refused{path.suffix}")
    plain = content.model_dump(
        mode="json",
        by_alias=True,
        exclude_none=True,
        warnings=False,  # of values that are not of the declared type: the reader says so
        fallback=methodcaller("tolist"),  # numbers of NumPy
    )
    write_yaml(refused, plain)
    try:
        read(refused)
    except InputError as error:
        path.unlink(missing_ok=True)
        raise RefusedResultError(
            f"the result stands whole in {refused}, and not in {path.name}, since the reader of "
            f"results refuses it: {error}"
        ) from error
    refused.replace(path)
