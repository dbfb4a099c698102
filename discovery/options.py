"""How a search is run: what does not change its question."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from discovery.criteria.criteria import CRITERIA, Criteria
from rom.progress import Progress

Stages = Callable[[str], Progress | None]


def no_progress(_stage: str) -> None:
    """Report no stage to anybody."""


@dataclass(frozen=True)
class Options:
    """How a closed loop or a race is run.

    Attributes
    ----------
    jobs : int
        Processes and threads; numbers do not depend on it.
    stage : callable
        Called with the name of a stage; returns what is then called with (done, in all), or None.
    seed : int
        Of the ensembles of the sparse fits.
    criteria : Criteria
        The numbers that decide.
    """

    jobs: int = 1
    stage: Stages = no_progress
    seed: int = 0
    criteria: Criteria = CRITERIA
