"""Worker processes: a lost one is an error, an interrupt ends all, nothing waits for what cannot come."""

from __future__ import annotations

import faulthandler
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from joblib import Parallel, delayed

from experiments.run.execution import execution
from experiments.run.processes import RemoteTraceback, Worker, WorkerLostError

_LONG_S = 60.0
INTERRUPTED = f"""
import signal
from tests.experiments.run.test_processes import many, slept
from experiments.run.execution import execution
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for what runs behind it
with execution():
    print(*many(slept, 8), flush=True)
    list(many(slept, 8, {_LONG_S}))
"""


def slept(_: int, seconds: float = 0.05) -> int:
    with TemporaryDirectory():
        time.sleep(seconds)
    return os.getpid()


def killed(number: int, size: int = 1) -> bytes:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return bytes(size)


def left(_: int) -> None:
    os._exit(7)


def refused(number: int) -> None:
    raise LookupError(f"refused {number}")


def unsendable(number: int) -> Iterator[int]:
    return (i for i in range(number))


def printed(number: int) -> int:
    print("heard on standard error")
    return number


def many(work: Callable[..., Any], count: int, *arguments: object) -> Iterator[Any]:
    tasks = (delayed(work)(number, *arguments) for number in range(count))
    return iter(Parallel(n_jobs=2, return_as="generator")(tasks))


@pytest.fixture(autouse=True)
def never_wait_for_ever() -> Iterator[None]:
    faulthandler.dump_traceback_later(5 * _LONG_S, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.parametrize("size", [1, 3_000_000], ids=["small", "more than a pipe holds"])
def test_a_killed_worker_is_one_clear_error(size: int) -> None:
    with execution(), pytest.raises(WorkerLostError, match=r"killed by signal 9.*run again with fewer jobs"):
        list(many(killed, 20, size))


def test_a_worker_killed_before_its_task_is_one_clear_error() -> None:
    worker = Worker({})
    worker.process.kill()
    worker.process.wait()
    with pytest.raises(WorkerLostError, match="signal 9"):
        worker.run(megabyte)
    worker.hang_up()


def megabyte() -> bytes:
    return bytes(1_000_000)


def test_a_worker_that_leaves_is_one_clear_error_and_the_next_work_has_new_ones() -> None:
    with execution():
        with pytest.raises(WorkerLostError, match="ended with code 7"):
            list(many(left, 4))
        assert len(list(many(slept, 4))) == 4


@pytest.mark.parametrize(
    ("work", "error", "said"), [(refused, LookupError, "refused [01]"), (unsendable, TypeError, "pickle")]
)
def test_an_error_of_a_task_comes_with_its_traceback(
    work: Callable[[int], object], error: type[Exception], said: str
) -> None:
    with execution(), pytest.raises(error, match=said) as found:
        list(many(work, 2))
    assert isinstance(found.value.__cause__, RemoteTraceback)
    assert "worker.py" in str(found.value.__cause__)


def test_a_function_of_a_script_reaches_the_workers() -> None:
    """A study's own measure: no worker can import it."""
    script = (
        "from joblib import Parallel, delayed\nfrom experiments.run.execution import execution\n"
        "def own(x):\n    return x + 1\n"
        "with execution():\n    print(Parallel(n_jobs=2)(delayed(own)(k) for k in range(3)))\n"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (ran.stdout, ran.stderr) == ("[1, 2, 3]\n", "")


def test_workers_serve_every_call_of_a_block_and_end_with_it(capfd: pytest.CaptureFixture[str]) -> None:
    with execution():
        first, second = set(many(slept, 12)), set(many(slept, 12))
        assert list(many(printed, 4)) == [0, 1, 2, 3]
    assert len(first | second) == 2
    assert os.getpid() not in first
    assert all(gone(pid) for pid in first)
    assert capfd.readouterr().err.count("heard") == 4


def test_an_interrupt_ends_all_workers_and_leaves_no_scratch_folder_of_theirs(tmp_path: Path) -> None:
    there = Path(__file__).parents[3]
    main = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        cwd=there,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert main.stdout is not None
    workers = {int(pid) for pid in main.stdout.readline().split()}
    time.sleep(1.0)  # until the work is under way: between two calls an interrupt may meet a clean-up
    assert len(list(tmp_path.iterdir())) == 2
    main.send_signal(signal.SIGINT)
    try:
        _, err = main.communicate(timeout=_LONG_S / 2)  # an error here: somebody still waits
    finally:
        main.kill()
    assert err.rstrip().endswith("KeyboardInterrupt")
    assert workers
    assert all(gone(pid) for pid in workers)
    assert list(tmp_path.iterdir()) == []


def test_workers_end_where_the_main_process_is_killed() -> None:
    there = Path(__file__).parents[3]
    main = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED.replace(str(_LONG_S), "1.0")],
        cwd=there,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert main.stdout is not None
    workers = {int(pid) for pid in main.stdout.readline().split()}
    main.kill()
    main.communicate()
    deadline = time.monotonic() + _LONG_S
    while not all(gone(pid) for pid in workers):
        assert time.monotonic() < deadline, "workers outlived the process that they serve"
        time.sleep(0.05)


def test_work_that_prefers_threads_stays_with_what_it_shares() -> None:
    with execution():
        found = Parallel(n_jobs=2, prefer="threads")(delayed(slept)(number) for number in range(4))
    assert set(found) == {os.getpid()}
