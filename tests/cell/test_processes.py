"""A second process: what it takes over, and what is done here."""

from __future__ import annotations

import errno
import multiprocessing
import os
import signal
import threading
import time

import pytest

from ballbar.cell.processes import Begin, begin_in_copy, second_process

PATIENCE = 300.0  # [s] for a process to start


def until_ready(begin: Begin) -> int:
    """Its process number, as soon as it takes work."""
    end = time.monotonic() + PATIENCE
    while (number := begin(os.getpid)()) == os.getpid():
        assert time.monotonic() < end
        time.sleep(0.01)
    return int(number)


@pytest.mark.slow
def test_work_is_done_here_until_the_other_process_is_ready_and_where_it_has_not_begun() -> None:
    with second_process("json") as begin:
        assert begin(os.getpid)() == os.getpid()
        other = until_ready(begin)
        started = [begin(time.sleep, 0.5) for _ in range(4)]  # more than it fetches in advance
        assert begin(os.getpid)() == os.getpid()
        for ended in started:
            ended()
        assert until_ready(begin) == other
    with pytest.raises(ProcessLookupError):
        os.kill(other, 0)


@pytest.mark.slow
def test_an_error_ends_the_other_process() -> None:
    other = 0

    def fail() -> None:
        nonlocal other
        with second_process("json") as begin:
            other = until_ready(begin)
            begin(time.sleep, 2.0 * PATIENCE)
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    with pytest.raises(ProcessLookupError):
        os.kill(other, 0)


@pytest.mark.slow
def test_work_of_a_process_that_died_is_done_here() -> None:
    with second_process("json") as begin:
        other = until_ready(begin)
        asleep = begin(time.sleep, 1.0)
        os.kill(other, signal.SIGKILL)
        asleep()
        assert begin(os.getpid)() == os.getpid()


def test_an_error_of_the_work_is_raised_where_its_result_is_needed() -> None:
    with second_process("json") as begin:
        until_ready(begin)
        with pytest.raises(ZeroDivisionError):
            begin(divmod, 1, 0)()


@pytest.mark.slow
def test_ctrl_c_while_it_still_imports_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    """A process that was just starting printed a traceback of what it was importing."""
    with second_process("json"):
        (helper,) = multiprocessing.active_children()
        for _ in range(20):
            if helper.is_alive() and helper.pid is not None:
                os.kill(helper.pid, signal.SIGINT)
            time.sleep(0.02)
        assert helper.is_alive()
    assert capfd.readouterr().err == ""


TWO = len(getattr(os, "sched_getaffinity", lambda _: [0])(0)) > 1  # processors


@pytest.mark.skipif(not TWO, reason="copies are made on Linux with two processors")
def test_a_copy_takes_over_work_that_no_other_process_could_be_sent() -> None:
    known = object()
    number, same = begin_in_copy(lambda: (os.getpid(), id(known)))()
    assert number != os.getpid()
    assert same == id(known), "the copy has what this process has, where it has it"


def test_a_copy_is_made_beside_threads_without_a_warning() -> None:
    """From Python 3.12 on fork warns of them, and warnings are errors here."""
    wake = threading.Event()
    other = threading.Thread(target=wake.wait)
    other.start()
    try:
        assert begin_in_copy(divmod, 7, 2)() == (3, 1)
    finally:
        wake.set()
        other.join()


def test_work_of_a_copy_that_died_is_done_here() -> None:
    here = os.getpid()

    def work() -> int:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return 5

    assert begin_in_copy(work)() == 5


def test_an_error_in_a_copy_is_raised_where_its_result_is_needed() -> None:
    with pytest.raises(ZeroDivisionError):
        begin_in_copy(divmod, 1, 0)()


def test_where_no_copy_can_be_made_the_work_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "fork", refused)
    assert begin_in_copy(os.getpid)() == os.getpid()
    monkeypatch.undo()
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)  # type: ignore[attr-defined]
    assert begin_in_copy(os.getpid)() == os.getpid()


@pytest.mark.skipif(not TWO, reason="copies are made on Linux with two processors")
def test_ctrl_c_does_not_reach_a_copy_and_the_end_of_its_process_does() -> None:
    others = set(multiprocessing.active_children())
    asleep = begin_in_copy(time.sleep, PATIENCE)
    (copy,) = set(multiprocessing.active_children()) - others
    assert copy.pid is not None
    os.kill(copy.pid, signal.SIGINT)
    time.sleep(0.2)
    assert copy.is_alive()
    copy.terminate()
    copy.join(PATIENCE)
    assert copy.exitcode == -signal.SIGTERM
    assert callable(asleep)
