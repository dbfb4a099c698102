"""Laws over arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import invoke


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(address: int, table: Any, p: Any) -> Any:
    """A law at every column of ``table``, shape (arguments, points) -> (points,).

    Parameters
    ----------
    address : int
        Of the compiled law: of the tension alone, or of five arguments.
    table : ndarray, shape (1 or 5, points)
        The arguments.
    p : ndarray, shape (parameters,)
        The law's numbers.

    Returns
    -------
    ndarray, shape (points,)
        Its values.
    """
    result = np.empty(table.shape[1])
    for i in range(table.shape[1]):
        if table.shape[0] == 1:
            result[i] = invoke(address, (table[0, i], p))
        else:
            result[i] = invoke(address, (table[0, i], table[1, i], table[2, i], table[3, i], table[4, i], p))
    return result
