"""Simulated tests of several bolts of one kind, whose rate differs from bolt to bolt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discovery.laws.candidate import Candidate
from rom.model.model import Model
from rom.parameters.he_2025 import paper_model
from rom.signals.tension_bins import TensionCourse
from tests.discovery.synthetic import measured

PRELOADS = (60.0, 300.0)


def bolts_of(
    law: Candidate,
    deviations: Sequence[float],
    *,
    preloads: Sequence[float] = PRELOADS,
    scatter: float = 0.3,
    noise: float = 1.0,
    seed: int = 0,
) -> list[tuple[Model, tuple[TensionCourse, ...]]]:
    """A model and tension histories for every bolt, by ln of its rate over the law's; two hits a preload."""
    found = []
    for place, deviation in enumerate(deviations):
        names = law.coefficient_names
        values = dict(zip(names, np.multiply(law.coefficients, np.exp(deviation)), strict=True))
        courses = measured(
            law.with_values(values), preloads=np.array(preloads), scatter=scatter, noise=noise,
            seed=1000 * seed + place, length_s=0.5,
        )  # fmt: skip
        found.append((paper_model(), courses))
    return found
