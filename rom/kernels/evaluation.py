"""Laws over arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.calling import invoke


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(address: int, table: Any, p: Any) -> Any:
    """A law at every column of ``table``, shape (arguments, points) -> (points,)."""
    result = np.empty(table.shape[1])
    for i in range(table.shape[1]):
        if table.shape[0] == 1:
            result[i] = invoke(address, (table[0, i], p))
        else:
            result[i] = invoke(address, (table[0, i], table[1, i], table[2, i], table[3, i], table[4, i], p))
    return result
