"""Sweeps on a Dask cluster: a real one, on this machine."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import pytest

from ballbar.sweep import workers as sweep_workers
from ballbar.sweep.chunk import Task
from ballbar.sweep.workers import dask_cluster
from cell.errors import InputError
from tests.helpers import sweep_work
from tests.helpers.sweeps import GRID, inline, loaded, swept, table_bytes

NOTHING = Task("", sweep_work.figures, (), Path())


@pytest.mark.long
@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(tmp_path: Path) -> None:
    from distributed import LocalCluster  # noqa: PLC0415  slow to import

    sweep = loaded(tmp_path, GRID.replace("count: 5", "count: 40"))
    alone = swept(sweep, tmp_path / "alone", inline, sweep_work.figures_with_failures)
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        there = swept(
            sweep,
            tmp_path / "there",
            partial(dask_cluster, address=cluster.scheduler_address),
            sweep_work.figures_with_failures,
        )
    assert there.finished
    assert table_bytes(there) == table_bytes(alone)


@pytest.mark.slow
def test_without_a_scheduler_the_address_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_workers, "CONNECT_TIMEOUT", 0.2)
    with (
        pytest.raises(
            InputError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers there"
        ),
        dask_cluster(NOTHING, address="tcp://127.0.0.1:9"),
    ):
        pass


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(
            InputError,
            match=r"needs Dask, which is not installed: pip install 'ballbar-bench\[dask\]'",
        ),
        dask_cluster(NOTHING, address="tcp://127.0.0.1:9"),
    ):
        pass
