"""Effects in the tension, in its gauge, and before the hits."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Tension(Group):
    """Effects in the tension, in its gauge, and before the hits."""
