"""A number that decides: its value, unit, meaning, and where it was measured; groups of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, fields
from typing import Annotated, Any, TypeVar

T = TypeVar("T")
Numerical = Annotated[T, "decides nothing"]
"""Type of a constant outside the criteria: it stops an iteration, sets a step, a grid or a filter of a
computation, guards against zero, or shortens what is shown. No verdict rests on it."""


def number(value: float, unit: str, meaning: str, measured: str = "chosen, not measured") -> Any:
    """A field of a group of criteria.

    Parameters
    ----------
    value : float
        The default.
    unit : str
        ``"1"`` for a ratio; ``"2 ln L"`` for a gain in cost; SI otherwise.
    meaning : str
        What the number decides, in a short sentence.
    measured : str
        Where the value comes from: a command, a data set, a reference, or ``"convention"``.
    """
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "measured": measured})


class Group:
    """What all groups of criteria share."""

    def __post_init__(self) -> None:
        for one in fields(self):  # type: ignore[arg-type]
            value = getattr(self, one.name)
            if not isinstance(value, int | float) or isinstance(value, bool) or value != value:
                raise ValueError(f"{type(self).__name__}.{one.name}: expected a number, got {value!r}")

    def rows(self) -> Iterator[tuple[str, float, str, str, str]]:
        """Yield name, value, unit, meaning and origin of every number."""
        for one in fields(self):  # type: ignore[arg-type]
            about = one.metadata
            yield one.name, getattr(self, one.name), about["unit"], about["meaning"], about["measured"]
