"""A second process: what it takes over, and what is done here."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time

import pytest

from ballbar.cell.processes import Begin, second_process

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
