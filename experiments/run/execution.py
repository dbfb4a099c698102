"""Where parallel work runs: this machine's processes or threads, or an existing Dask cluster; the numbers are
the same.

The packages hand independent tasks to joblib in a fixed order. What is chosen here is only who carries them
out.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import joblib

from experiments.run.processes import Processes

Local = Literal["processes", "threading", "sequential"]
_CONNECT_S = 10
_WORKERS_S = 60
_LOST_WORKERS = 10  # how often a task may lose its worker before the run is given up


class ClusterError(ValueError):
    """A cluster that cannot be used; the message says what was asked for and what to do."""


@contextmanager
def execution(cluster: str | None = None, local: Local = "processes") -> Iterator[None]:
    """Run the parallel work of the block locally, or on the Dask cluster at `cluster`.

    Parameters
    ----------
    cluster : str or None
        Address of a running scheduler, such as ``tcp://host:8786``. It and its workers must have boltlaw
        installed and see the campaign under the same path. A worker lost midway costs its tasks again, not
        the run.
    local : {"processes", "threading", "sequential"}
        Processes, threads or neither, where no cluster is named. Processes end with the block.

    Raises
    ------
    ClusterError
        If Dask distributed is not installed or the scheduler does not answer.
    WorkerLostError
        From the work of the block, if a process of this machine is killed: nothing waits for it.
    """
    if cluster is None:
        with _local(local):
            yield
        return
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise ClusterError(
            f"--cluster {cluster}: found no Dask distributed, expected it: pip install '.[cluster]'"
        ) from error
    try:
        client = Client(cluster, timeout=_CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"--cluster {cluster}: no scheduler answers there within {_CONNECT_S} s, expected a running one"
        ) from error
    patience = dask.config.set({"distributed.scheduler.allowed-failures": _LOST_WORKERS})
    with client, patience, joblib.parallel_config(backend="dask", wait_for_workers_timeout=_WORKERS_S):
        yield


def on_this_machine() -> bool:
    """Return whether parallel work runs here, not on a cluster."""
    backend, _ = joblib.parallel.get_active_backend()
    return not type(backend).__module__.endswith("_dask")


@contextmanager
def _local(local: Local) -> Iterator[None]:
    if local != "processes":
        with joblib.parallel_config(backend=local):
            yield
        return
    processes = Processes()
    try:
        with joblib.parallel_config(backend=processes):
            yield
    finally:
        processes.close()
