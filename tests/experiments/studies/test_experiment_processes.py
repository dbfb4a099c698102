"""Experiments as files on several processes and machines, and after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import experiments
from tests.experiments.conftest import Cluster
from tests.experiments.studies.experiment_files import SMALL, WITHOUT_FIGURES, cells_of, table_of


@pytest.mark.variant  # of a killed run, which goes on with two
def test_two_jobs_give_the_table_of_one(file: Path) -> None:
    one, two = (experiments.run_experiment(file, file.parent / str(jobs), jobs) for jobs in (1, 2))
    assert not one.failed
    assert len(set(one.to_frame()["error"])) == 2
    assert table_of(one.path.parent) == table_of(two.path.parent)


def started(file: Path, out: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """The program at work on an experiment, once its first cell is done."""
    code = "from experiments.cli import main; main()"
    command = [sys.executable, "-c", code, "run", str(file), "--out", str(out), "--quiet", *arguments]
    running = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])})
    deadline = time.monotonic() + 120
    while not cells_of(out):
        assert running.poll() is None, "it ended before a cell was done"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return running


def test_a_killed_run_goes_on_where_it_was(file: Path) -> None:
    """With two processes, and without figures of cells, whose numbers are those with figures."""
    out = file.parent / "killed"
    file.write_text(WITHOUT_FIGURES + SMALL)
    running = started(file, out, "--jobs", "1")
    running.send_signal(signal.SIGKILL)
    running.wait()
    done = cells_of(out)
    assert 1 <= len(done) < 4
    assert not (out / "experiment.csv").exists()
    table = experiments.run_experiment(file, out, jobs=2)
    assert not table.failed
    assert cells_of(out).items() >= done.items()
    file.write_text(SMALL)
    whole = experiments.run_experiment(file, file.parent / "whole").path.parent
    assert table_of(out) == table_of(whole)
    assert [len(list(folder.glob("cells/*/*.svg"))) > 0 for folder in (out, whole)] == [False, True]
    assert sorted(path.name for path in out.iterdir()) == [
        "cells", "experiment.csv", "experiment.json", "experiment.pdf", "experiment.svg",
    ]  # fmt: skip
    assert len(list((out / "cells").iterdir())) == 4


@pytest.mark.slow
@pytest.mark.variant  # test_execution has a cluster, test_experiment such processes and measures
def test_cells_spread_over_a_cluster_with_a_measure_beside_the_file(file: Path, cluster: Cluster) -> None:
    """Each cell in a process of its own on a worker, measured by a module that no worker has on its path."""
    address, _ = cluster
    (file.parent / "beside.py").write_text(
        "import os, sys\n\ndef seen(_, campaign):\n"
        "    if campaign.name == 'two':\n        os.kill(os.getpid(), 9)\n"
        "    return {'dask': 'distributed.worker' in sys.modules}\n"
    )
    text = WITHOUT_FIGURES + SMALL.replace("seeds", 'own_process = true\nmeasure = "beside:seen"\nseeds')
    file.write_text(text.replace("[0, 1]", "0"))
    table = experiments.run_experiment(file, file.parent / "apart", jobs=2, cluster=address)
    assert [row["status"] for row in table.rows] == ["ok", "failed"]
    assert not table.rows[0]["dask"]
    assert "killed by signal 9" in table.failed[0]["message"]
    file.write_text(text.replace("own_process = true\n", "").replace('["one", "two"]', '["one"]'))
    table = experiments.run_experiment(file, file.parent / "shared", jobs=2, cluster=address)
    assert [row["dask"] for row in table.rows] == [True, True]


@pytest.mark.slow
@pytest.mark.variant  # cells on a cluster are above, test_execution has the lost worker
def test_24_cells_are_the_same_on_a_cluster_that_loses_a_worker(file: Path, cluster: Cluster) -> None:
    """Of two workers one is killed."""
    address, workers = cluster
    file.write_text(WITHOUT_FIGURES + SMALL.replace("[0, 1]", str(list(range(12)))))
    whole = experiments.run_experiment(file, file.parent / "whole", jobs=1)
    assert (len(whole.rows), whole.failed) == (24, ())
    spread = file.parent / "cluster"
    running = started(file, spread, "--jobs", "2", "--cluster", address)
    assert len(cells_of(spread)) < 22
    workers[0].send_signal(signal.SIGKILL)
    assert running.wait(timeout=300) == 0
    assert table_of(whole.path.parent) == table_of(spread)
