"""Linear algebra in one thread: parallel work is of records and fits, whose matrices are small."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

P = ParamSpec("P")
R = TypeVar("R")


def one_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function with BLAS and OpenMP kept to one thread while it runs.

    On small matrices further threads only wait for each other, which costs a third of all CPU time; and the
    last digits of a product depend on how many there are.
    """
    limited: Callable[P, R] = threadpool_limits.wrap(limits=1)(function)
    return limited
