"""Robot calibration with a sensed double ball-bar: what a user of Python needs, under one name.

    import ballbar

    result = ballbar.identify("logs")

Each name is imported from its module when it is first used, so `import ballbar` takes milliseconds.
The names stand in `__init__.pyi`, a line each: `from MODULE import NAME as NAME`.
"""

from importlib import import_module
from pathlib import Path

# Folders of the source tree; all but the last are installed within it, as `ballbar.cell` and so on
PACKAGES = ("cell", "sim", "acquisition", "ident", "planning", "ballbar")

_LINES = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines()
_HOME = {words[3]: words[1] for words in map(str.split, _LINES) if words[:1] == ["from"]}
__all__ = sorted(_HOME)  # noqa: PLE0605  the stub is the list


def __getattr__(name: str) -> object:
    """The public object of this name, imported now and kept (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'ballbar' has no {name!r}; public: {', '.join(__all__)}")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """All names, those not imported yet included."""
    return sorted({*globals(), *__all__})
