"""The file of a result is written as it was fitted and read back before it takes its name.

Where the reader of results refuses it, it is kept whole under another name, so what was fitted is
not lost to a check of the program's own.
"""

from __future__ import annotations

from operator import methodcaller
from pathlib import Path

from ballbar.result.calibration import load_calibration
from ballbar.result.calibration_content import calibration_of
from ballbar.result.run_data import RunData
from cell.errors import InputError
from cell.files import copied_description, write_yaml
from cell.pose_file import pose_file_path


class RefusedResultError(RuntimeError):
    """A result that was fitted and written, and that the reader of results refuses.

    It is a fault of the program: one of fit, writer and reader is wrong.
    """


def write_calibration(path: Path, run: RunData) -> None:
    """Write calibration.yaml, whole or not at all, and the user's descriptions in it beside it.

    Raises RefusedResultError if its reader refuses the file. That then stands beside `path` with
    `.refused` in its name (ballbar.result.names.REFUSED), and an earlier result under `path` is
    deleted.
    """
    refused = path.with_suffix(f".refused{path.suffix}")
    file, described = calibration_of(run), ["robot"]
    if run.recordings:
        recorded, described = run.recordings[0].folder, ["robot", "instrument", "plate"]
    else:
        recorded = pose_file_path(run.tables[0][1]).parent
    copied = {
        key: copied_description(path.parent, key, recorded / name)
        for key in described
        if (name := getattr(file, key)).endswith(".yaml")
    }
    plain = file.model_copy(update=copied).model_dump(
        mode="json",
        by_alias=True,
        exclude_none=True,
        warnings=False,  # of values that are not of the declared type: the reader says so
        fallback=methodcaller("tolist"),  # numbers of NumPy
    )
    write_yaml(refused, plain)
    try:
        load_calibration(refused)
    except InputError as error:
        path.unlink(missing_ok=True)
        raise RefusedResultError(
            f"the result stands whole in {refused}, and not in {path.name}, since the reader of "
            f"results refuses it: {error}"
        ) from error
    refused.replace(path)
