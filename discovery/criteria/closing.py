"""When a closed loop ends, and its verdict."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Closing(Group):
    """When a closed loop ends, and its verdict."""
