"""Decides between models: candidate tension laws, ranked by re-simulation.

``discover(campaign)`` gives a `Ranking`: ``ranking.laws``, ``ranking.summary()``, ``ranking.plot()``,
``ranking.to_frame()`` and, with the first law in it, ``ranking.model``.
"""

from discovery.discover import discover
from discovery.ranked import RankedLaw, Ranking

__all__ = ["RankedLaw", "Ranking", "discover"]
