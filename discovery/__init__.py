"""Decides between models: candidate tension laws ranked by re-simulation, and effects that a model lacks.

``discover(campaign)`` gives a `Ranking`: ``ranking.laws``, ``ranking.summary()``, ``ranking.plot()``,
``ranking.to_frame()`` and, with the first law in it, ``ranking.model``. ``compare(campaign, laws)`` gives a
ranking of laws of one's own beside the standing ones. Both take the campaigns of several bolts of one kind,
too. ``close_loop(campaign)`` gives a `Closure`: ``closure.verdict``, ``closure.effects``, ``closure.model``,
``closure.summary()``, ``closure.plot()``. Rankings and closures say themselves in a notebook.

Examples
--------
>>> import discovery, rom
>>> campaign = rom.read_campaign("campaign")
>>> ranking = discovery.discover(campaign)  # doctest: +SKIP
>>> closure = discovery.close_loop(campaign)  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from discovery.criteria.criteria import Criteria
    from discovery.loop.close_loop import close_loop
    from discovery.loop.result import Closure
    from discovery.ranking.discover import compare, discover
    from discovery.ranking.result import RankedLaw, Ranking
    from discovery.search.libraries import LIBRARIES
    from discovery.search.optimizers import OPTIMIZERS

_HOME = {
    "Closure": "discovery.loop.result",
    "Criteria": "discovery.criteria.criteria",
    "LIBRARIES": "discovery.search.libraries",
    "OPTIMIZERS": "discovery.search.optimizers",
    "RankedLaw": "discovery.ranking.result",
    "Ranking": "discovery.ranking.result",
    "close_loop": "discovery.loop.close_loop",
    "compare": "discovery.ranking.discover",
    "discover": "discovery.ranking.discover",
}
__all__ = [
    "LIBRARIES",
    "OPTIMIZERS",
    "Closure",
    "Criteria",
    "RankedLaw",
    "Ranking",
    "close_loop",
    "compare",
    "discover",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module 'discovery' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """Name the public interface."""
    return list(__all__)
