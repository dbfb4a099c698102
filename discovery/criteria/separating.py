"""Which tests are proposed to tell rivals apart."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Separating(Group):
    """Which tests are proposed to tell rivals apart."""
