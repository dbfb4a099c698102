"""Whether an effect explains more than chance, matters, and can be told from others."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Acceptance(Group):
    """Whether an effect explains more than chance, matters, and can be told from others."""
