"""Arrays that were asked for last, up to a size: what several steps of a loop ask for is worked out once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from threading import Lock
from typing import Any

import numpy.typing as npt

Arrays = Sequence[npt.NDArray[Any]]


class ArrayCache:
    """Sequences of arrays by key; the one that was asked for longest ago goes first.

    Parameters
    ----------
    most_bytes : int
        Size of all arrays together.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most, self._size, self._lock = most_bytes, 0, Lock()
        self._held: OrderedDict[Hashable, tuple[int, Arrays]] = OrderedDict()

    def get(self, key: Hashable) -> Arrays | None:
        """The arrays of a key, if they are still there."""
        with self._lock:
            if key not in self._held:
                return None
            self._held.move_to_end(key)
            return self._held[key][1]

    def keep(self, key: Hashable, arrays: Arrays) -> None:
        """Hold arrays, and let go of others where there is no room."""
        size = sum(one.nbytes for one in arrays)
        with self._lock:
            self._size += size - self._held.pop(key, (0, ()))[0]
            self._held[key] = size, arrays
            while self._size > self._most:
                self._size -= self._held.popitem(last=False)[1][0]
