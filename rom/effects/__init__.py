"""Catalogue of effects that a model may lack, a file per family; empty so far."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rom.effects.effect import Effect
from rom.laws import Parameter

CATALOGUE: Mapping[str, Callable[[str, Mapping[str, Parameter]], Effect]] = {}
"""Effects by name: a function of the place where one enters, and its parameters."""


def make(name: str, enters: str, parameters: Mapping[str, Parameter]) -> Effect:
    """Return a catalogue effect.

    Raises
    ------
    ValueError
        If the catalogue has none of that name.
    """
    if name not in CATALOGUE:
        raise ValueError(f"an effect must be one of {', '.join(CATALOGUE) or 'none'}, got {name!r}")
    return CATALOGUE[name](enters, parameters)
