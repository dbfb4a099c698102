"""Bars of progress on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

Report = Callable[[int, int], None]


class _Done(MofNCompleteColumn):
    """How much of how much is done; nothing of a stage that does not say how much there is."""

    def render(self, task: Task) -> Text:
        return Text("") if task.total is None else super().render(task)


class _Time(TimeRemainingColumn):
    """The time left; of a stage that does not say how much there is the time that it has taken."""

    def render(self, task: Task) -> Text:
        return TimeElapsedColumn().render(task) if task.total is None else super().render(task)


class _Compiling(ProgressColumn):
    """Says of the stage that runs that kernels are compiled: the first command of all takes longer for it."""

    under_way = 0

    def render(self, task: Task) -> Text:
        return Text("compiling once" if self.under_way and task.stop_time is None else "")


@contextmanager
def _told_of_compiling(column: _Compiling) -> Iterator[None]:
    """Let the column know of each kernel that is compiled, not of those that are found on disk."""
    from numba.core.event import Listener, install_listener

    class Told(Listener):
        def on_start(self, _event: Any) -> None:
            column.under_way += 1

        def on_end(self, _event: Any) -> None:
            column.under_way -= 1

    with install_listener("numba:compile", Told()):
        yield


@contextmanager
def progress_bars(quiet: bool, console: Console | None = None) -> Iterator[Callable[[str], Report | None]]:
    """Yield what opens a bar under a name and returns its mover; silent unless on a terminal."""
    console = console or Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda _: None
        return
    compiling = _Compiling()
    columns = (TextColumn("{task.description:>18}"), BarColumn(), _Done(), _Time(), compiling)
    with Progress(*columns, console=console) as bars, _told_of_compiling(compiling):

        def open_bar(name: str) -> Report:
            for task in bars.tasks:
                if task.stop_time is None:
                    bars.stop_task(task.id)  # the next stage has begun
            new = bars.add_task(name, total=None)
            return lambda done, total: bars.update(new, completed=done, total=total)

        yield open_bar
