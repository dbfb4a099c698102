"""A scalar function over whole records, as one compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from inspect import signature
from typing import Any

import numpy as np
import numpy.typing as npt


def elementwise(function: Callable[..., float]) -> Callable[..., npt.NDArray[np.float64]]:
    """Return the function over real arrays and numbers that broadcast; arrays in double precision come out.

    Compiled on the first call and kept on disk; it may call the functions of ``math``.

    Parameters
    ----------
    function : callable
        Plain function of scalars that lives in a file. What is made of it raises TypeError for another number
        of arguments.
    """
    count = len(signature(function).parameters)

    @cache
    def loop() -> Callable[..., Any]:
        from numba import float64, vectorize  # what only looks at the catalogue compiles nothing

        kind = float64(*[float64] * count)
        compiled: Any = vectorize([kind], nopython=True, cache=True)  # type: ignore[no-untyped-call]
        return compiled(function)  # type: ignore[no-any-return]

    @wraps(function)
    def over(*arguments: npt.ArrayLike) -> npt.NDArray[np.float64]:
        if len(arguments) != count:  # one more would be written into
            raise TypeError(f"{function.__name__} takes {count} arguments, got {len(arguments)}")
        return np.asarray(loop()(*arguments))

    return over


@elementwise
def times(factor: float, x: float) -> float:
    """Product."""
    return factor * x
