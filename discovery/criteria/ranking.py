"""How laws are ranked, cross-validated and told apart."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class RankingRules(Group):
    """How laws are ranked, cross-validated and told apart."""
