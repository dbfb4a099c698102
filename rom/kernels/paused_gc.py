"""No garbage collection while kernels are compiled."""

from __future__ import annotations

import gc
from typing import Any

from numba.core.event import Listener, register


class _Uncollected(Listener):
    """No garbage collection while kernels are compiled: it goes through all that the compiler holds, again
    and again.
    """

    def __init__(self) -> None:
        self.under_way, self.was_on = 0, False

    def on_start(self, _event: Any) -> None:
        if not self.under_way:
            self.was_on = gc.isenabled()
            gc.disable()
        self.under_way += 1

    def on_end(self, _event: Any) -> None:
        self.under_way -= 1
        if not self.under_way and self.was_on:
            gc.enable()


register("numba:compile", _Uncollected())  # type: ignore[no-untyped-call]
