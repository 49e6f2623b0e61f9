"""The version of the code that `--version` prints and every row of a sweep has.

Two rows of one version were computed by the same code.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from ballbar import PACKAGES

DISTRIBUTION = "ballbar-bench"
_CONTENT = {".py", ".yaml", ".xml", ".html"}
_LIBRARIES = ("numpy", "scipy", "mujoco-core")  # their arithmetic is in every result


@cache
def code_version() -> str:
    """Release and digest of our files and of the numeric libraries' versions: `0.1.0+3fa9c1d2`.

    The release alone would not tell two states of the code between releases apart, nor two workers
    of a cluster.
    """
    digest = hashlib.sha256()
    for package in PACKAGES:
        inside = "ballbar" if package == "ballbar" else f"ballbar.{package}"
        spec = find_spec(inside)  # without an import: `--version` answers at once
        assert spec is not None
        folder = Path(spec.origin or "").parent
        for file in sorted(path for path in folder.rglob("*") if path.suffix in _CONTENT):
            name = file.relative_to(folder)
            if name.parts[0] not in (*PACKAGES, "scenarios"):  # in `ballbar` once it is installed
                text = f"{package}/{name.as_posix()}\0"
                digest.update(text.encode() + file.read_bytes() + b"\0")
    for library in _LIBRARIES:
        with suppress(PackageNotFoundError):  # what identifies alone needs no plant
            digest.update(f"{library} {version(library)}\0".encode())
    return f"{version(DISTRIBUTION)}+{digest.hexdigest()[:8]}"
