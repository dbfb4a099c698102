"""Work shared by the processes of a test run."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from tests.shared import Shared, once_per_run


def test_work_is_done_once(tmp_path: Path) -> None:
    done: list[int] = []
    for _ in range(2):
        assert Shared(tmp_path).once("one", lambda: done.append(1) or 7) == 7
    assert len(done) == 1


def test_work_that_fails_is_done_again(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        Shared(tmp_path).once("one", lambda: 1 / 0)
    assert Shared(tmp_path).once("one", lambda: 2.0) == 2.0


def test_what_another_one_is_at_comes_last(tmp_path: Path) -> None:
    begun, may_end, order = threading.Event(), threading.Event(), []

    def slow() -> str:
        begun.set()
        assert may_end.wait(20)
        return "slow"

    def quick() -> str:
        order.append("quick")
        may_end.set()
        return "quick"

    other = threading.Thread(target=Shared(tmp_path).once, args=("slow", slow))
    other.start()
    assert begun.wait(20)
    assert Shared(tmp_path).all({"slow": lambda: order.append("slow"), "quick": quick}) == ["slow", "quick"]
    other.join()
    assert order == ["quick"]


def test_a_function_runs_once_for_each_of_its_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Shared, "here", Shared(tmp_path))
    done: list[int] = []

    def work(number: int) -> int:
        done.append(number)
        return number + 1

    processes = [once_per_run(work) for _ in range(2)]
    assert [known(number) for number in (1, 2) for known in processes] == [2, 2, 3, 3]
    assert done == [1, 2]
