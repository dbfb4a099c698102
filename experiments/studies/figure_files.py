"""Figures of a study as files; one that fails is told, and costs no result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_wanted = ContextVar("figures are wanted", default=True)


@contextmanager
def without_figures() -> Iterator[None]:
    """Draw no figures of studies within the block: of many small ones they are most of the work."""
    before = _wanted.set(False)
    try:
        yield
    finally:
        _wanted.reset(before)


def figures_into(folder: Path, *draw: Callable[[], Mapping[str, Figure]]) -> list[str]:
    """Draw figures into an existing folder; return a line for each fault: results are worth more than it."""
    faults: list[str] = []
    for one in draw if _wanted.get() else ():
        try:
            save_figures(one(), folder)
        except OSError:
            raise  # a full disk has no room for results either
        except Exception as fault:  # whatever it is, the results of hours are not lost for a picture
            faults.append(f"figures were not drawn: {type(fault).__name__}: {fault}")
    return faults


def save_figures(drawn: Mapping[str, Figure], folder: Path) -> None:
    """Write figures to an existing folder, for the page and for print; none where none are wanted."""
    from experiments.figures.style import save

    for name, figure in drawn.items() if _wanted.get() else ():
        save(figure, folder / f"{name}.svg")
        save(figure, folder / f"{name}.pdf")
