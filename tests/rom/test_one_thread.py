"""Linear algebra in one thread while a function runs, and as before afterwards."""

from __future__ import annotations

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from rom.one_thread import one_threaded


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_a_function_has_one_thread_of_linear_algebra() -> None:
    with threadpool_limits(2):
        assert threads() == {2}
        assert one_threaded(threads)() == {1}
        assert threads() == {2}


def test_an_error_gives_the_threads_back() -> None:
    with threadpool_limits(2):
        with pytest.raises(ZeroDivisionError):
            one_threaded(lambda: 1 // 0)()
        assert threads() == {2}


def test_the_long_work_of_the_packages_runs_so() -> None:
    from discovery import discover
    from discovery.loop.close_loop import close_loop
    from rom.identification.identify import identify_campaign

    assert all(hasattr(one, "__wrapped__") for one in (discover, close_loop, identify_campaign))
