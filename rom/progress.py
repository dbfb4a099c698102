"""How far long work is: a function of what is done and what there is in all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Progress = Callable[[int, int], None]
_Item = TypeVar("_Item")


def counted(items: Iterable[_Item], total: int, progress: Progress | None) -> Iterator[_Item]:
    """Yield items and report each when the next is asked for, the total before the first one.

    A bar that knows its total from the start can say how long the rest takes.

    Parameters
    ----------
    items : iterable
        Work, or its results as they come.
    total : int
        How many there are.
    progress : callable, optional
        Called with (done, in all).
    """
    if progress is not None:
        progress(0, total)
    for done, item in enumerate(items, 1):
        yield item
        if progress is not None:
            progress(done, total)
