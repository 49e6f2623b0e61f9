"""Mutation testing: the share of single-line faults of the sources that the tests see.

    python -m benchmarks.mutants [--sample 400] [--seed 1] [--processes 1] [--long | --quick]
                                 [--again | --resume] [--tests PATH ...] [--only PATH ...]
                                 [--out docs/studies/mutants.csv]

Faults are drawn by benchmarks.mutant_places. Each stands in a private copy of the project, where
the tests of `make test` that execute its line run until the first failure, up to LIMIT_SECONDS of
them: those of its own package first, of these those of its module, then the quickest. `--tests`
takes only the tests below some paths, `--only` of the sample the faults there. `--again` repeats
only those that survived the last time, `--resume` goes on where a run was stopped. `--long` gives
survivors to all other tests that execute the line, the long ones too; `--quick` takes only the
tests of `make quick`, and of these only those of the fault's own package.
Tests of the project's text (tests/project) do not count.

Writes the table `--out`. Why a survivor survives is stated by the table
docs/studies/mutants_survivors.csv: `equivalent` if no valid input gives another result, `message`
if only the text of a report or an error differs, `speed` if only the time does, `choice` if it is a
limit, count or seed chosen by judgement whose neighbours serve as well, `open` otherwise.
"""

from __future__ import annotations

import argparse
import csv
import gc
import hashlib
import json
import multiprocessing
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest

from benchmarks.executed_lines import CONTEXTS, PACKAGES, TESTS, ExecutedLines, measure
from benchmarks.mutant_places import Mutant, drawn, in_function, lines_of_use, target_files

ROOT = Path(__file__).parent.parent
STORE = ROOT / "runs/mutants"  # outside git
RESULT = ROOT / "docs/studies/mutants.csv"
REASONS = ROOT / "docs/studies/mutants_survivors.csv"
MEMORY = 12 << 30  # [bytes] of a process with a mutant
LIBRARIES = (
    *("mujoco", "pandas", "pyarrow.csv", "pydantic", "rich", "typer", "yaml"),
    *("scipy.interpolate", "scipy.optimize", "scipy.signal", "scipy.sparse.linalg"),
    *("scipy.spatial", "scipy.stats"),
)
OPTIONS = ("-p", "no:cacheprovider", "-p", "no:xdist", "--tb=short")
OF_CLASSES = "test_frozen.py::"  # looks at every class of a package, and executes nothing of them
FAULT = "fault of this command"
QUICK, TEST, ALL = "not slow and not long", "not long", "long or not long"  # markers of tests
LIMIT_SECONDS = 15.0  # of tests, by their processor time under coverage
HEAD = ("file", "line", "operator", "before", "after", "outcome", "test", "kind", "reason")
Row = dict[str, str]


class FirstFailure:
    """pytest plugin: the tests in the given order, and which was the first to fail."""

    def __init__(self, tests: Iterable[str] = ()) -> None:
        self.order = {test: i for i, test in enumerate(tests)}
        self.failed = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self.order),
            key=lambda item: self.order[item.nodeid],
        )

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid


def warm_up() -> None:
    """Import what most tests need, once for all processes; nothing of the project."""
    for name in LIBRARIES:
        import_module(name)


def enter(tree: Path) -> None:
    """Make a copy of the project that of this process and of those that it starts."""
    os.chdir(tree)
    sys.path[:0] = [str(tree)]
    os.environ |= {"PYTHONPATH": str(tree), "PYTHONHASHSEED": "0"}
    sys.modules["__main__"] = ModuleType("__main__")  # what spawned processes would import


def in_child(work: Callable[[], object], *, seconds: float, log: Path) -> bool:
    """Do the work in a forked process; False if it was stopped or crashed.

    seconds : [s] limit of processor time.
    """
    child = os.fork()
    if not child:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        status = 1
        try:
            work()
            status = 0
        finally:
            sys.stdout.flush()
            os._exit(status)
    deadline = time.monotonic() + 60.0 + 8.0 * seconds  # the machine may be busy
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status == 0
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def synchronise(tree: Path) -> None:
    """Make the private copy equal to the project; unchanged files keep their compiled form."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=ROOT, capture_output=True, check=True, text=True,
    ).stdout  # fmt: skip
    for name in filter(None, listed.split("\0")):
        source, copy = ROOT / name, tree / name
        if source.is_symlink():
            copy.unlink(missing_ok=True)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(source.readlink())
            continue
        if not source.exists():
            copy.unlink(missing_ok=True)
            continue
        same = copy.exists() and copy.stat().st_mtime == source.stat().st_mtime
        if not same or copy.stat().st_size != source.stat().st_size:
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy)
    beside = tree.parent / "shared"  # data that some tests read from beside the project
    if not beside.exists() and (ROOT.parent / "shared").exists():
        beside.symlink_to(ROOT.parent / "shared")


def measured_lines(tree: Path, paths: list[str], chosen: str) -> ExecutedLines:
    """Which test below `paths` executes which line; changed test files are measured again."""
    tests = sorted(
        file
        for file in (ROOT / "tests").rglob("*.py")
        if "project" not in file.parts  # they compare texts
    )
    every = [file for file in tests if file.name.startswith("test_")]
    cases = [file for file in every if any(file.is_relative_to(ROOT / path) for path in paths)]
    rest = [file for file in tests if file not in every]
    rest += [file for package in PACKAGES for file in (ROOT / package).rglob("*")]
    common = _hash([file for file in rest if file.suffix in (".py", ".yaml")])
    known_file = STORE / "measured.json"
    known = json.loads(known_file.read_text()) if known_file.exists() else {}
    if known.get("common") != common:
        for name in (CONTEXTS, TESTS):
            (STORE / name).unlink(missing_ok=True)
        known = {"common": common}
    for marker in (TEST, "long") if chosen == ALL else (chosen,):
        done = known.setdefault(marker, {})
        for folder in sorted({file.parent for file in cases}):  # one import of everything for each
            hashes = {str(f.relative_to(ROOT)): _hash([f]) for f in cases if f.parent == folder}
            changed = [name for name, value in hashes.items() if done.get(name) != value]
            if changed:
                print(f"measuring {folder.relative_to(ROOT)} ({marker})", flush=True)
                _measured(tree, changed, marker)
                done |= hashes
                known_file.write_text(json.dumps(known))
    return ExecutedLines(STORE)


def _measured(tree: Path, files: list[str], marker: str) -> None:
    """Add what the tests of some files execute to the store; in a process of its own."""
    log = STORE / f"measured_{marker.replace(' ', '_')}.txt"

    def work() -> None:
        enter(tree)
        measure(tree, STORE, files, marker)

    if not in_child(work, seconds=7200.0, log=log):
        raise SystemExit(f"the tests did not come to an end: {log}")


def _hash(files: list[Path]) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(files))).hexdigest()


class Judge:
    """pytest plugin: in place of running the tests it collected, tries mutants with them.

    A mutant of a function is made in a forked process by exchanging the code of the function. One
    of a module or class stands in the private copy of the project, from which a forked process
    imports everything again.
    """

    def __init__(
        self, executed: ExecutedLines, tree: Path, mutants: Callable[[], Iterator[Mutant]],
        report: Callable[[Row], None], chosen: str,
    ) -> None:  # fmt: skip
        self.executed = executed
        self.tree = tree
        self.mutants = mutants
        self.report = report
        self.chosen = chosen
        self.items: dict[str, pytest.Item] = {}

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self.items = {item.nodeid: item for item in session.items}
        for mutant in self.mutants():
            tests = self._tests(mutant)
            test = self._first_failure(mutant, tests) if tests else ""
            outcome = "seen" if test else "survived" if tests else "not executed"
            outcome = FAULT if test.startswith(FAULT) else outcome
            values = (mutant.file, str(mutant.line), mutant.operator, mutant.before, mutant.after)
            self.report(dict(zip(HEAD, (*values, outcome, test, "", ""), strict=True)))
        return True

    def _tests(self, mutant: Mutant) -> list[str]:
        """The tests that a mutant is tried with: those of its module first, then the quickest."""
        position = (mutant.line, mutant.column)
        tests = set[str]()
        for file, lines in lines_of_use(mutant.file, position):
            tests |= self.executed.tests(file, lines)
        package = f"tests/{mutant.file.split('/')[0]}/"
        of_classes = package + OF_CLASSES
        if not in_function(mutant.file, position):
            tests |= {name for name in self.executed.contexts if name.startswith(of_classes)}
        tests &= self.items.keys()
        if self.chosen == QUICK:
            tests = {test for test in tests if test.startswith(package)}
        module = mutant.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        direct = {name for name in _test_files(tests) if module in (ROOT / name).read_text()}
        seconds = {test: self.executed.seconds(test) for test in tests}
        quick = sorted(
            (test for test in tests if not self.executed.contexts[test].long),
            key=lambda test: (
                not test.startswith(of_classes),
                not test.startswith(package),
                test.split("::")[0] not in direct,
                seconds[test],
            ),
        )
        if self.chosen == ALL:
            return quick + sorted(tests - set(quick), key=lambda test: seconds[test])
        spent = np.cumsum([seconds[test] for test in quick])
        return quick[: int(np.searchsorted(spent, LIMIT_SECONDS)) + 1]

    def _first_failure(self, mutant: Mutant, tests: list[str]) -> str:
        """The first of the tests that fails, or "" if none does."""
        outcome = self.tree.with_suffix(".txt")
        needed = set[str]().union(*(self.executed.closure(test) for test in tests))
        cost = sum(self.executed.contexts[name].seconds for name in needed)
        own = in_function(mutant.file, (mutant.line, mutant.column))

        def work() -> None:
            sys.dont_write_bytecode = True
            os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
            try:
                failed = (self._in_place if own else self._anew)(mutant, tests)
            except Exception:
                failed = f"{FAULT}: {traceback.format_exc()}"
            outcome.write_text(failed)

        copy = self.tree / mutant.file
        original = copy.stat()
        copy.write_text(mutant.source)  # also for what a test starts
        outcome.unlink(missing_ok=True)
        try:
            in_child(work, seconds=30.0 + 4.0 * cost, log=self.tree.with_suffix(".log"))
        finally:
            copy.write_bytes((ROOT / mutant.file).read_bytes())
            os.utime(copy, ns=(original.st_atime_ns, original.st_mtime_ns))
        if not outcome.exists():
            return "stopped: out of time or memory, or crashed"
        return outcome.read_text()

    def _in_place(self, mutant: Mutant, tests: list[str]) -> str:
        if not _exchanged_code(self.tree, mutant):
            return self._anew(mutant, tests)
        plugin, items = FirstFailure(), [self.items[test] for test in tests]
        config = items[0].config
        config.pluginmanager.register(plugin)
        for item, following in zip(items, [*items[1:], None], strict=True):
            config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if plugin.failed:
                break
        return plugin.failed

    def _anew(self, mutant: Mutant, tests: list[str]) -> str:
        for name in [n for n in sys.modules if n.split(".")[0] in ("ballbar", "tests")]:
            del sys.modules[name]
        plugin = FirstFailure(tests)
        code = pytest.main([*OPTIONS, "-x", *_test_files(tests)], [plugin])
        if code == pytest.ExitCode.NO_TESTS_COLLECTED:
            raise RuntimeError(f"{mutant.file}:{mutant.line}: no tests where there were some")
        return str(plugin.failed or "import of a conftest.py") if code else ""


def _exchanged_code(tree: Path, mutant: Mutant) -> bool:
    """Give the functions of a module in this process the code of a mutant; False if it cannot."""
    file = str(tree / mutant.file)
    names = (file, str(tree / "ballbar" / mutant.file))  # the second through a link
    places = {code: place for place, code in _codes(compile(_original(mutant), file, "exec"))}
    codes = dict(_codes(compile(mutant.source, file, "exec")))
    if codes.keys() != set(places.values()):
        return False
    for each in gc.get_objects():
        if isinstance(each, FunctionType) and each.__code__.co_filename in names:
            place = places.get(each.__code__, "")  # none of the body of a module
            each.__code__ = codes.get(place, each.__code__)
    return True


def _original(mutant: Mutant) -> str:
    return (ROOT / mutant.file).read_text()


def _codes(code: CodeType, name: str = "") -> Iterator[tuple[str, CodeType]]:
    """All code objects within one, by their place."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    for i, each in enumerate(inner):
        place = f"{name}/{i} {each.co_name}"
        yield place, each
        yield from _codes(each, place)


def _test_files(tests: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(test.split("::")[0] for test in tests))


def judged(
    mutants: list[Mutant], executed: ExecutedLines, args: argparse.Namespace
) -> Iterator[Row]:
    """Rows of the mutants as they come in, from so many processes."""
    context = multiprocessing.get_context("fork")
    following, rows = context.Value("i", 0), context.SimpleQueue()

    def some() -> Iterator[Mutant]:
        while True:
            with following.get_lock():
                index, following.value = following.value, following.value + 1
            if index >= len(mutants):
                return
            yield mutants[index]

    def work(tree: Path) -> None:
        enter(tree)
        judge = Judge(executed, tree, some, rows.put, args.chosen)
        tests = _test_files(n for n, c in executed.contexts.items() if c.is_test)
        tests = [test for test in tests if (ROOT / test).exists()]  # others were moved since
        with tree.with_suffix(".out").open("w") as output:
            os.dup2(output.fileno(), 1)
            pytest.main([*OPTIONS, "-m", args.chosen, *tests], [judge])

    for number in range(args.processes):
        tree = STORE / f"tree{number}" / "project"
        synchronise(tree)
        context.Process(target=work, args=(tree,)).start()
    for _ in mutants:
        yield rows.get()


def main(args: argparse.Namespace) -> None:
    """Measures, draws, runs, prints each mutant and the share seen, and writes the result."""
    STORE.mkdir(parents=True, exist_ok=True)
    warm_up()
    tree = STORE / "tree0" / "project"
    synchronise(tree)
    executed = measured_lines(tree, args.tests, args.chosen)
    rows = {}
    if (args.again or args.resume) and args.out.exists():
        with args.out.open(newline="") as file:
            last = [row for row in csv.DictReader(file) if args.resume or row["outcome"] == "seen"]
        rows = {_key(row): row for row in last}
    sample = [
        mutant
        for mutant in _sample(args.sample, args.seed)
        if _key(vars(mutant)) not in rows and mutant.file.startswith(tuple(args.only))
    ]
    for row in judged(sample, executed, args):
        rows[_key(row)] = row
        print(*(row[name] for name in HEAD[:7]), sep=" | ", flush=True)
        _write(args.out, rows.values())
    _write(args.out, rows.values())
    print(*_shares(rows.values()), sep="\n")


def _sample(count: int, seed: int) -> list[Mutant]:
    """The sample, which takes half a minute to draw; drawn again when a source has changed."""
    sources = _hash([ROOT / file for file in target_files()])
    stored = STORE / f"sample_{seed}_{count}_{sources[:16]}.pickle"
    if not stored.exists():
        stored.write_bytes(pickle.dumps(drawn(count, seed)))
    return list(pickle.loads(stored.read_bytes()))


def _key(row: dict[str, Any]) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in ("file", "line", "operator", "before", "after"))


def _write(out: Path, rows: Iterable[Row]) -> None:
    """The result with the reasons of the survivors."""
    with REASONS.open(newline="") as file:
        reasons = {(r["file"], r["before"], r["after"]): r for r in csv.DictReader(file)}
    for row in rows:
        reason = reasons.get((row["file"], row["before"], row["after"]))
        known = reason is not None and row["outcome"] != "seen"
        row["kind"], row["reason"] = (reason["kind"], reason["reason"]) if known else ("", "")
    with out.open("w", newline="") as file:
        writer = csv.DictWriter(file, HEAD, lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            sorted(rows, key=lambda row: (row["file"], int(row["line"]), row["after"]))
        )


def _shares(rows: Iterable[Row]) -> Iterator[str]:
    every = list(rows)
    seen = sum(row["outcome"] == "seen" for row in every)
    equivalent = sum(row["kind"] == "equivalent" for row in every)
    yield f"{seen} of {len(every)} seen: {100.0 * seen / len(every):.1f} %"
    own = sum(row["test"].startswith(f"tests/{row['file'].split('/')[0]}/") for row in every)
    yield f"{own} of them by a test of the same package: {100.0 * own / len(every):.1f} %"
    yield f"without {equivalent} equivalent ones: {100.0 * seen / (len(every) - equivalent):.1f} %"
    for kind, count in sorted(
        Counter(row["kind"] for row in every if row["outcome"] != "seen").items()
    ):
        yield f"  survived, {kind or 'no reason yet'}: {count}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("--sample", 400), ("--seed", 1), ("--processes", 1)):
        parser.add_argument(name, type=int, default=default)
    for name in ("--again", "--resume"):
        parser.add_argument(name, action="store_true")
    for name, marker in (("--long", ALL), ("--quick", QUICK)):
        parser.add_argument(name, dest="chosen", action="store_const", const=marker, default=TEST)
    parser.add_argument("--tests", nargs="+", default=["tests"])
    parser.add_argument("--only", nargs="+", default=[""])
    parser.add_argument("--out", type=Path, default=RESULT)
    main(parser.parse_args())
