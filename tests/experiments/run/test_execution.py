"""Serial, threads, processes and a real Dask cluster on loopback give the same numbers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pytest
from distributed import Client

from experiments.run.execution import ClusterError, execution
from rom.parameters import he_2025

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


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    address_file = tmp_path / "scheduler.json"
    command = [sys.executable, "-m"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    here: dict[str, Any] = {"env": environment, "stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [*command, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
         "--scheduler-file", str(address_file)], **here,
    )  # fmt: skip
    workers: list[subprocess.Popen[bytes]] = []
    try:
        deadline = time.monotonic() + 60
        while not address_file.exists() or not address_file.read_text():
            assert time.monotonic() < deadline, "the scheduler did not start"
            time.sleep(0.1)
        address = json.loads(address_file.read_text())["address"]
        worker = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path)]
        for _ in range(2):
            workers.append(
                subprocess.Popen([*command, "distributed.cli.dask_worker", address, *worker], **here)
            )
        with Client(address) as client:
            client.wait_for_workers(2, timeout=60)  # a single thread would be told to compute here
        yield address, workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


@pytest.mark.slow
def test_cluster_gives_the_same_numbers_and_survives_a_lost_worker(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], reference: list[float]
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
