"""From libraries and sparse fits to a short list of laws."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Search(Group):
    """From libraries and sparse fits to a short list of laws."""
