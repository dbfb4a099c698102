"""Where a residual is said to live."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Localising(Group):
    """Where a residual is said to live."""
