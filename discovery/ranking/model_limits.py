"""Limits of a law's numbers that hold the uncertainty of the identified model too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from discovery.ranking import cross_validation as validation
from discovery.ranking.profile_likelihood import shifts_with_model
from discovery.ranking.result import RankedLaw
from rom.model.laws import Parameter


def widened(law: RankedLaw, frozen: FrozenMotion) -> dict[str, Parameter]:
    """Numbers with limits that hold what the uncertainty of the identified model adds, as a root of squares.

    A threshold of displacement of a hundredth's error is told to a thousandth along a motion taken as known.
    """
    if law.fit.of_losses or not law.fit.free:
        return dict(law.parameters)
    found, shifts = dict(law.parameters), shifts_with_model(law.fit, frozen)
    for name, value, shift in zip(law.fit.free, validation.estimate(law.fit), shifts, strict=True):
        p = found[name]
        if p.low is None or p.high is None or not np.isfinite(shift):
            continue
        logarithmic = name in law.fit.candidate.coefficient_names and p.value > 0
        ends = np.log([p.low, p.high]) if logarithmic else np.array([p.low, p.high])
        both = value + np.array([-1.0, 1.0]) * np.hypot(ends - value, shift)
        low, high = np.exp(np.clip(both, -690, 690)) if logarithmic else both
        found[name] = replace(p, low=float(low), high=float(high))
    return found
