"""The plant of each seed of the virtual rig: identified once, for its own tests and for those of laws."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from benchmarks.discovery_specimens import PRELOADS
from benchmarks.identification import Trial, identified, score
from rom.identification.identify import Identification
from tests.shared import Shared


class Plant(NamedTuple):
    """How near an identification comes to the truth, and its model without the records behind it."""

    trial: Trial
    identified: Identification


def plants(shared: Shared, seeds: Iterable[int]) -> list[Plant]:
    """Of campaigns under the paper's law: 20 preloads, a full hit at each, nominal noise, records of 3 s."""
    return shared.all({f"plant, {seed}": partial(_plant, seed) for seed in seeds})


def _plant(seed: int) -> Plant:
    found, truth = identified(seed, PRELOADS, 1.0, jobs=1, duration_s=3.0)
    bare = Identification(replace(found.model, identification=None), None)
    return Plant(score(found, truth), replace(bare, course_noise=found.course_noise))
