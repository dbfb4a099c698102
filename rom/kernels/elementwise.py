"""A scalar function over whole records, as one compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from inspect import signature
from typing import Any

import numpy as np
import numpy.typing as npt


def elementwise(function: Callable[..., float]) -> Callable[..., npt.NDArray[np.float64]]:
    """Return the function over arrays and numbers that broadcast, in double precision.

    Compiled on the first call and kept on disk; it may call the functions of ``math``.

    Parameters
    ----------
    function : callable
        Plain function of scalars that lives in a file.
    """

    @cache
    def loop() -> Callable[..., Any]:
        from numba import float64, vectorize  # what only looks at the catalogue compiles nothing

        kind = float64(*[float64] * len(signature(function).parameters))
        compiled: Any = vectorize([kind], nopython=True, cache=True)  # type: ignore[no-untyped-call]
        return compiled(function)  # type: ignore[no-any-return]

    @wraps(function)
    def over(*arguments: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return np.asarray(loop()(*arguments))

    return over
