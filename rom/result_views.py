"""Results that people look at: a summary, a table, a figure; what these show is registered elsewhere.

A result class derives from `HasViews` and imports neither prose nor figures. Its views are functions that are
registered for the class with `summary`, `frame` and `figure`, in modules below ``<package>.views``; the
package is the top-level one of the class, so ``rom.views`` or ``discovery.views``. The ``__init__.py`` there
imports these modules; `HasViews` imports ``<package>.views`` by name when a view is first asked for::

    # discovery/views/ranking.py
    from discovery.ranking.result import Ranking
    from rom import result_views

    @result_views.summary.register(Ranking)
    def _summary(result: Ranking) -> str: ...

    @result_views.frame.register(Ranking)
    def _frame(result: Ranking) -> DataFrame: ...

    # discovery/views/__init__.py
    from discovery.views import closure, ranking  # noqa: F401 - they register

`register` without a class would resolve all annotations, and so need pandas and matplotlib at import.
"""

from __future__ import annotations

import importlib
from functools import singledispatch
from html import escape
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

_ROWS = 60  # of a table in a notebook; the middle is left out
_COLUMNS = 14  # of it, the first ones


def _unregistered(view: str, result: object) -> NoReturn:
    raise TypeError(f"no {view} is registered for {type(result).__name__}; see rom.result_views")


@singledispatch
def summary(result: object) -> str:
    """Return a result in plain words."""
    _unregistered("summary", result)


@singledispatch
def frame(result: object) -> DataFrame:
    """Return a result as a table."""
    _unregistered("frame", result)


@singledispatch
def figure(result: object) -> Figure:
    """Draw a result."""
    _unregistered("figure", result)


class HasViews:
    """A result with a summary, a table and a figure; a notebook shows the first two."""

    def summary(self) -> str:
        """Return the result in plain words."""
        _load_views(type(self))
        return summary(self)

    def to_frame(self) -> DataFrame:
        """Return the result as a table."""
        _load_views(type(self))
        return frame(self)

    def plot(self) -> Figure:
        """Draw the result."""
        _load_views(type(self))
        return figure(self)

    def _repr_html_(self) -> str:
        table = (
            self.to_frame()
            .iloc[:, :_COLUMNS]
            .to_html(float_format=lambda x: f"{x:.4g}", na_rep="", max_rows=_ROWS)
        )
        return f"<pre>{escape(self.summary())}</pre>{table}"


def _load_views(kind: type) -> None:
    """Import the views of every package that a result class derives from."""
    for base in kind.__mro__:
        if issubclass(base, HasViews) and base is not HasViews:
            importlib.import_module(f"{base.__module__.partition('.')[0]}.views")
