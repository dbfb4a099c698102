"""Whether small impacts leave the tension alone: what they seem to lose tells the noise of the gauge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import stats

from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.reduce import ReducedRecord

_ROUNDING: Numerical[float] = 1e-9  # of a tension without noise: changes below it are none


def losses_of_small_impacts(records: Sequence[ReducedRecord]) -> Iterator[str]:
    """Yield a line where coupled tests change the tension together, or one does unlike the others.

    In units of strain, in which a gauge drifts alike at every tension, changes d that are noise have a mean
    of zero: its t value tells whether they share a direction, and d over the root mean square of the others
    whether one stands out. Both are Student's t.
    """
    found = [(r.settings.file, r.tensions) for r in records if r.settings.test == "coupled" and r.tensions]
    if len(found) < RULES.quiet_cases:
        return
    files = [file for file, _ in found]
    lost = np.array([one.initial - one.final for _, one in found])
    change = lost / np.array([one.slope for _, one in found])
    count = len(change)
    least = _ROUNDING * np.max(np.abs([one.initial / one.slope for _, one in found]))
    others = np.maximum(np.sqrt(np.maximum(np.sum(change**2) - change**2, 0.0) / (count - 1)), least)
    chance = 2 * count * stats.t.sf(np.abs(change) / others, count - 1)
    alone = int(np.argmin(chance))
    if chance[alone] < RULES.lossy_chance:
        yield (
            f"{files[alone]}: loses {lost[alone]:.2g} N where other coupled tests stay within their noise: "
            'it may have loosened; declare it as test = "loosening", or leave it out: it counts as noise'
        )
    error = max(float(np.std(change, ddof=1)) / np.sqrt(count), least)
    if 2 * stats.t.sf(abs(np.mean(change)) / error, count - 1) < RULES.lossy_chance:
        way = "lose" if np.mean(change) > 0 else "gain"
        yield (
            f"coupled tests {way} tension alike, {np.median(np.abs(lost)):.2g} N in the median: their gauge "
            "drifts, or they loosen the bolt; all of it counts as noise of losses"
        )
