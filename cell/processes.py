"""Processes beside this one, for work that Python does not do in threads.

They compute with one thread, leave Ctrl-C to the process that started them, and end with it, even
if it is killed.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from importlib.util import find_spec
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from ballbar.cell.threads import one_thread_each

# Begins work with its arguments; the function that it returns gives the result. `partial` is one
# that begins nothing beforehand.
Begin = Callable[..., Callable[[], Any]]


@contextmanager
def process_pool(
    count: int, initializer: Callable[..., None], *arguments: object
) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` processes, each of which calls `initializer` first.

    They are killed at the end, with whatever has not given its result: to end by itself an
    interpreter with many libraries takes half a second.
    """
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        count, mp_context=context, initializer=_begin, initargs=(initializer, arguments)
    )
    with one_thread_each():
        try:
            with stop_signals_blocked():  # also while the processes still import
                for _ in range(count):
                    pool.submit(os.getpid)
            yield pool
        finally:
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
            pool.shutdown(wait=True, cancel_futures=True)


def process_apart(
    command: list[str], output: int = subprocess.DEVNULL, env: dict[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """A process that does not write into this terminal, and that Ctrl-C here does not reach.

    output : of its standard output.
    """
    group = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)  # of Windows, which has no sessions
    none = subprocess.DEVNULL
    return subprocess.Popen(
        command, -1, None, None, output, none, env=env, start_new_session=True, creationflags=group
    )


@contextmanager
def stop_signals_blocked() -> Iterator[None]:
    """Processes started within receive neither Ctrl-C nor the SIGTERM of a batch system.

    Both signals go to all processes of a group at once; who started them receives them and decides.
    """
    if sys.platform == "win32":  # which has no masks: until they ignore it, Ctrl-C ends them
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def on_stop_signals(handle: Callable[..., None]) -> Iterator[None]:
    """Ctrl-C and SIGTERM (the end of a batch job) call `handle` instead of ending this process.

    So does SIGBREAK, with which one process of Windows stops another.
    """
    numbers = {signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGBREAK", signal.SIGTERM)}
    before = {number: signal.signal(number, lambda *_: handle()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def second_process(*modules: str) -> Iterator[Begin]:
    """A process that takes over work while this one has other work.

    It imports the modules at once. Before it has done so, of what it has not begun when the result
    is asked for, and where it died, the work is done in this process.

    Raises ModuleNotFoundError at once for a module of a package that is not installed.
    """
    for module in modules:
        if find_spec(module.partition(".")[0]) is None:
            raise ModuleNotFoundError(f"No module named {module!r}", name=module)
    with process_pool(1, _import, modules) as pool:
        ready = pool.submit(os.getpid)

        def begin(work: Callable[..., object], *arguments: object) -> Callable[[], object]:
            here = partial(work, *arguments)
            if not ready.done():
                return here
            try:
                future = pool.submit(work, *arguments)
            except BrokenProcessPool:
                return here

            def result() -> object:
                try:
                    return here() if future.cancel() else future.result()
                except BrokenProcessPool:
                    return here()

            return result

        yield begin


def begin_in_copy(work: Callable[..., object], *arguments: object) -> Callable[[], Any]:
    """Begins work in a copy of this process, made in milliseconds; only the result is sent.

    The work neither prints nor waits for a thread, which the copy would not have. With one
    processor, on another system than Linux, in a process that may have no others (a daemon), and
    where the work or its copy fails, it is done in this process when the result is asked for.
    """
    here = partial(work, *arguments)
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:
        return here
    if multiprocessing.current_process().daemon:
        return here
    receiving, sending = multiprocessing.Pipe(duplex=False)
    kind, arguments = multiprocessing.get_context("fork").Process, (_send, (sending, here))
    with stop_signals_blocked(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which the copy leaves
        with suppress(OSError):  # no memory: nothing will be received
            kind(target=_begin, args=arguments, daemon=True).start()
    sending.close()

    def result() -> object:
        try:
            return receiving.recv()
        except EOFError:
            return here()

    return result


def _send(sending: Connection, work: Callable[[], object]) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform != "win32":  # which has neither masks nor copies
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    with suppress(Exception):  # raised again where the work is repeated
        sending.send(work())


def _import(modules: tuple[str, ...]) -> None:
    for module in modules:
        importlib.import_module(module)


def _begin(initializer: Callable[..., None], arguments: tuple[object, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_with, args=(parent,), daemon=True).start()
    initializer(*arguments)


def _exit_with(parent: BaseProcess) -> None:
    """End this process when its parent is gone, even if that was killed."""
    parent.join()
    os._exit(1)
