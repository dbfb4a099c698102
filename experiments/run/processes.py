"""Processes of this machine for joblib: each is the only one at the other end of its pipes.

Nothing is shared, so that whatever becomes of a process, the pipe to it ends and with it all waiting.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

import cloudpickle
from joblib import ParallelBackendBase, cpu_count

_PATIENCE_S = 3.0  # with a process that is asked to end
_SCRIPT = Path(__file__).with_name("worker.py")
Task = Callable[[], Any]


class WorkerLostError(ChildProcessError):
    """A worker process ended in the midst of its work; the message says how and what to do."""


class RemoteTraceback(Exception):  # noqa: N818 - cause of an error, not one of its own
    """Where an exception was raised in another process, as text."""


class Worker:
    """One process and the pipes to and from it."""

    def __init__(self, environment: dict[str, str]) -> None:
        command = [sys.executable, "-P", str(_SCRIPT)]  # -P: no module beside it hides a standard one
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.busy = False
        self.process = subprocess.Popen(command, env={**os.environ, **environment}, **pipes)  # type: ignore[call-overload]
        self._send(sys.path)

    def _send(self, message: object) -> None:
        try:
            pickle.dump(message, self.process.stdin)
            self.process.stdin.flush()
        except OSError:
            raise self._lost() from None

    def run(self, task: Task) -> Any:
        """Return what the task returns in the process.

        Raises
        ------
        WorkerLostError
            If the process ends first. Every other exception is the task's own.
        """
        self.busy = True
        self._send(cloudpickle.dumps(task))  # functions of a script too, by value
        try:
            reply = pickle.load(self.process.stdout)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            raise self._lost() from None
        self.busy = False
        return pickle.loads(reply)

    def _lost(self) -> WorkerLostError:
        self.end()
        code = self.process.returncode
        how = (
            f"was killed by signal {-code}, often for want of memory"
            if code < 0
            else f"ended with code {code}"
        )
        return WorkerLostError(
            f"--jobs: a worker process {how}; expected its result: run again with fewer jobs"
        )

    def ask(self) -> None:
        """Let a process amid its work remove its scratch folders and end."""
        if self.busy:
            self.process.terminate()

    def end(self) -> None:
        """End the process, whatever it does; one amid its work has a moment to tidy up."""
        self.ask()
        if self.busy:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_PATIENCE_S)
        self.process.kill()
        self.process.wait()

    def hang_up(self) -> None:
        """Close the pipes of a process that ended, once nobody waits for it."""
        for pipe in (self.process.stdin, self.process.stdout):
            with suppress(OSError):  # what it never read
                pipe.close()


class Processes(ParallelBackendBase):  # type: ignore[misc]
    """Backend of joblib that keeps its worker processes from one call to the next, until `close`."""

    supports_retrieve_callback = True
    supports_sharedmem = True  # by its threads, which who requires it prefers

    def __init__(self) -> None:
        super().__init__(nesting_level=0)
        self._lock = Lock()
        self._all: list[Worker] = []
        self._idle: list[Worker] = []
        self._threads: ThreadPoolExecutor | None = None
        self._environment: dict[str, str] = {}
        self._closed = False
        self._sends = True

    def effective_n_jobs(self, n_jobs: int | None) -> int:
        """Return the number of processes; negative ones count from the number of processors."""
        return 1 if n_jobs is None else number_of_processes(n_jobs)

    def configure(
        self, n_jobs: int = 1, parallel: object = None, prefer: str | None = None, **_: object
    ) -> int:
        """Prepare for one call of joblib; a thread waits for each process; where preferred, it works.

        Parameters
        ----------
        n_jobs : int
            Processes; negative ones count from the number of processors.
        parallel : object
            joblib's own, kept for its callbacks.
        prefer : str, optional
            ``"threads"``: tasks run in threads of this process.
        **_ : object
            Other settings of joblib, of no use here.

        Returns
        -------
        int
            Number of processes.

        Raises
        ------
        ValueError
            If `n_jobs` is 0.
        """
        count = self.effective_n_jobs(n_jobs)
        self.parallel = parallel
        share = str(max(cpu_count() // count, 1))
        self._environment = {name: os.environ.get(name, share) for name in self.MAX_NUM_THREADS_VARS}
        self._closed, self._sends = False, prefer != "threads"  # such tasks share what is large
        self._threads = ThreadPoolExecutor(count) if count > 1 else None
        return count

    def submit(self, func: Task, callback: Callable[[Future[Any]], None] | None = None) -> Future[Any]:
        """Schedule a batch of tasks."""
        assert self._threads is not None
        future = self._threads.submit(self._run, func) if self._sends else self._threads.submit(func)
        if callback is not None:
            future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Future[Any]) -> Any:
        """Return the results of a batch, or raise what it raised."""
        return out.result()

    def _run(self, task: Task) -> Any:
        worker = self._taken()
        result, error, text = worker.run(task)
        with self._lock:
            self._idle.append(worker)
        if error is not None:
            raise error from RemoteTraceback(f"\n{text}")
        return result

    def _taken(self) -> Worker:
        with self._lock:
            if self._closed:
                raise WorkerLostError("found that the work was given up, expected it to go on")
            if self._idle:
                return self._idle.pop()
            worker = Worker(self._environment)
            self._all.append(worker)
            return worker

    def terminate(self) -> None:
        """End one call of joblib; the processes wait for the next."""
        if self._threads is not None:
            self._threads.shutdown(wait=False, cancel_futures=True)
            self._threads = None

    def abort_everything(self, ensure_ready: bool = True) -> None:
        """End all processes at once, after an error or an interrupt."""
        self.close()
        if ensure_ready:
            self.configure(self.parallel.n_jobs, self.parallel)  # type: ignore[attr-defined]

    def close(self) -> None:
        """End all processes, busy or not."""
        with self._lock:
            self._closed = True
            workers, self._all, self._idle = self._all, [], []
        for worker in workers:
            worker.ask()
        for worker in workers:
            worker.end()
        threads = self._threads
        self.terminate()
        if threads is not None:
            threads.shutdown(wait=True)
        for worker in workers:
            worker.hang_up()


def number_of_processes(jobs: int) -> int:
    """Return the number of processes; negative ones count from the number of processors.

    Raises
    ------
    ValueError
        If it is 0.
    """
    if jobs == 0:
        raise ValueError("n_jobs: found 0, expected at least 1, or -1 for all processors")
    return jobs if jobs > 0 else max(cpu_count() + 1 + jobs, 1)


def each_in_a_process(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[int, WorkerLostError | None]]:
    """Run every task in a process of its own, which gives all its memory back.

    Parameters
    ----------
    tasks : sequence of callable
        Importable functions of no argument.
    jobs : int
        Processes at the same time. None outlives the iteration, however that ends.

    Yields
    ------
    place : int
        Of a task that is done, in no order.
    error : WorkerLostError or None
        If its process was lost.

    Raises
    ------
    Exception
        Of the first task that raises one.
    """
    workers, jobs = list[Worker](), number_of_processes(jobs)
    share = str(max(cpu_count() // jobs, 1))
    environment = {name: os.environ.get(name, share) for name in ParallelBackendBase.MAX_NUM_THREADS_VARS}
    lock, ended = Lock(), False

    def run(place: int) -> tuple[int, WorkerLostError | None]:
        with lock:
            if ended:
                return place, None
            worker = Worker(environment)
            workers.append(worker)
        try:
            _, error, text = worker.run(tasks[place])
        except WorkerLostError as lost:
            return place, lost
        finally:
            worker.end()
            worker.hang_up()
        if error is not None:
            raise error from RemoteTraceback(f"\n{text}")
        return place, None

    with ThreadPoolExecutor(jobs) as threads:
        pending = [threads.submit(run, place) for place in range(len(tasks))]
        try:
            for one in as_completed(pending):
                yield one.result()
        finally:
            with lock:
                ended = True
            threads.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.ask()
            for worker in workers:
                worker.end()
