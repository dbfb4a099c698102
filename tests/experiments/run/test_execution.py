"""Serial, threads, processes and a real Dask cluster on loopback give the same numbers."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import joblib
import numpy as np
import pytest

from experiments.run.execution import ClusterError, execution
from rom.parameters import he_2025
from tests.experiments.conftest import Cluster

PRELOADS = np.geomspace(6.0, 3000.0, 24)


def loss(preload: float) -> tuple[float, int]:
    """Loss of the paper's model after one high impact [N], and the process that computed it."""
    force = he_2025.nominal_impact(1608.7, 19200.0, 1.0)
    final = he_2025.paper_model().final_tension(force[None], 19200.0, np.array([preload]))
    return preload - float(final[0]), os.getpid()


def losses() -> Iterator[tuple[float, int]]:
    tasks = (joblib.delayed(loss)(float(preload)) for preload in PRELOADS)
    return iter(joblib.Parallel(n_jobs=2, return_as="generator")(tasks))


@pytest.fixture(scope="module")
def reference() -> list[float]:
    return [loss(float(preload))[0] for preload in PRELOADS]


@pytest.mark.parametrize("local", ["sequential", "threading", "processes"])
def test_local_numbers_do_not_depend_on_who_computes(local: str, reference: list[float]) -> None:
    with execution(local=local):  # type: ignore[arg-type]
        assert [value for value, _ in losses()] == reference


@pytest.mark.slow
def test_cluster_gives_the_same_numbers_and_survives_a_lost_worker(
    cluster: Cluster, reference: list[float]
) -> None:
    address, workers = cluster
    with execution(address):
        running = losses()
        found = [next(running)]
        workers[0].send_signal(signal.SIGKILL)
        found += running
    assert [value for value, _ in found] == reference
    assert {pid for _, pid in found} <= {worker.pid for worker in workers}
    assert workers[1].pid in {pid for _, pid in found}


def test_no_scheduler_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("experiments.run.execution._CONNECT_S", 0.5)
    with (
        pytest.raises(ClusterError, match=r"tcp://127.0.0.1:9: no scheduler answers"),
        execution("tcp://127.0.0.1:9"),
    ):
        pass
