"""Which test executes which line: the tests under coverage, with a context for each of them.

A fixture of a session, package, module or class and a cached function are executed once, for the
first test that needs them. They get contexts of their own, and a test executes the lines of all
contexts that it needs, directly or through others.

The measurement is stored beside the private copy of the project that it was made in. It is repeated
for test files that have changed, and for all of them when a source or a helper of the tests has.
"""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coverage
import pytest

PACKAGES = ("acquisition", "ballbar", "cell", "ident", "planning", "sim")
CONTEXTS, TESTS = "coverage.sqlite", "tests.json"


@dataclass
class Context:
    """A test, a fixture or a call of a cached function."""

    seconds: float = 0.0  # processor time, without that of the contexts inside
    needs: list[str] = field(default_factory=list)
    long: bool = False
    passed: bool = True
    is_test: bool = False


class Recorder:
    """pytest plugin: switches the context of the coverage, and notes what needs what."""

    def __init__(self, measured: coverage.Coverage) -> None:
        self.measured = measured
        self.contexts: dict[str, Context] = {}
        self._inside: list[str] = []

    @contextmanager
    def within(self, name: str) -> Iterator[Context]:
        """Everything executed here belongs to the context `name`."""
        context = self.contexts.setdefault(name, Context())
        self.needed(name)
        self._inside.append(name)
        self.measured.switch_context(name)
        start = time.process_time()
        try:
            yield context
        finally:
            spent = time.process_time() - start
            context.seconds += spent
            self._inside.pop()
            if self._inside:
                self.contexts[self._inside[-1]].seconds -= spent
            self.measured.switch_context(self._inside[-1] if self._inside else "")

    def needed(self, name: str) -> None:
        """The present context needs another."""
        if self._inside and name not in self.contexts[self._inside[-1]].needs:
            self.contexts[self._inside[-1]].needs.append(name)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        with self.within(item.nodeid) as context:
            context.is_test = True
            context.long = item.get_closest_marker("long") is not None
            definitions = getattr(item, "_fixtureinfo").name2fixturedefs  # noqa: B009  not public
            for fixture in (last[-1] for last in definitions.values()):
                if fixture.scope != "function":
                    self.needed(_name(fixture))
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        with self.within(_name(fixturedef)):
            return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.contexts[report.nodeid].passed &= not report.failed

    def cache(self, function: Callable[..., Any], maxsize: int | None) -> Callable[..., Any]:
        """A `functools.lru_cache` with a context for each call that is not in the cache yet."""

        def key(args: tuple[Any, ...], kwargs: dict[str, Any]) -> str:
            call = hash((args, tuple(sorted(kwargs.items()))))
            return f"cache {function.__module__}.{function.__qualname__} {call}"

        def computed(*args: Any, **kwargs: Any) -> Any:
            with self.within(key(args, kwargs)):
                return function(*args, **kwargs)

        cached = _LRU_CACHE(maxsize=maxsize)(computed)

        @functools.wraps(function)
        def looked_up(*args: Any, **kwargs: Any) -> Any:
            self.needed(key(args, kwargs))
            return cached(*args, **kwargs)

        for name in ("cache_clear", "cache_info"):
            setattr(looked_up, name, getattr(cached, name))
        return looked_up


_LRU_CACHE = functools.lru_cache


def _name(fixture: Any) -> str:
    return f"fixture {fixture.baseid}::{fixture.argname}"


def measure(tree: Path, store: Path, files: list[str], marker: str) -> None:
    """Run the tests of `files` in this process and add what they execute to the store.

    tree : copy of the project, the present folder, not imported from before.
    """
    measured = coverage.Coverage(
        data_file=store / CONTEXTS,
        config_file=False,
        source=[str(tree / package) for package in PACKAGES],
    )
    measured.set_option("run:relative_files", True)
    measured.load()
    recorder = Recorder(measured)

    def lru_cache(maxsize: Any = 128, **_: Any) -> Any:
        if callable(maxsize):
            return recorder.cache(maxsize, 128)
        return lambda function: recorder.cache(function, maxsize)

    functools.lru_cache = lru_cache  # type: ignore[assignment]
    functools.cache = lambda function: recorder.cache(function, None)  # type: ignore[assignment]
    measured.start()
    pytest.main(["-p", "no:cacheprovider", "-p", "no:xdist", "-m", marker, *files], [recorder])
    measured.stop()
    measured.save()
    contexts = stored(store) | recorder.contexts
    text = {name: vars(context) for name, context in contexts.items()}
    (store / TESTS).write_text(json.dumps(text))


def stored(store: Path) -> dict[str, Context]:
    """Contexts of all measurements so far."""
    file = store / TESTS
    return (
        {n: Context(**c) for n, c in json.loads(file.read_text()).items()} if file.exists() else {}
    )


class ExecutedLines:
    """Tests that execute a line, and what each costs."""

    def __init__(self, store: Path) -> None:
        self.contexts = stored(store)
        data = coverage.CoverageData(store / CONTEXTS)
        data.read()  # all of it here: a forked process that reads erases the file
        self._lines = {file: data.contexts_by_lineno(file) for file in data.measured_files()}
        self._users: dict[str, set[str]] = {}
        for name, context in self.contexts.items():
            if context.is_test and context.passed:
                for needed in self.closure(name):
                    self._users.setdefault(needed, set()).add(name)

    def tests(self, file: str, lines: range) -> set[str]:
        """Passing tests that execute any of the lines of a file."""
        by_line = self._lines.get(file, {})
        contexts = {context for line in lines for context in by_line.get(line, ())}
        return set().union(*(self._users.get(context, set()) for context in contexts))

    def seconds(self, test: str) -> float:
        """[s] processor time of a test alone, with all that it needs, under coverage."""
        return sum(self.contexts[name].seconds for name in self.closure(test))

    def closure(self, name: str) -> set[str]:
        """The context and all that it needs, directly or through others."""
        reached, todo = set[str](), [name]
        while todo:
            context = todo.pop()
            if context not in reached and context in self.contexts:
                reached.add(context)
                todo += self.contexts[context].needs
        return reached
