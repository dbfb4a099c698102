"""What chance gives: a null distribution from a campaign's own residuals, and normal numbers."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, sqrt

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Chance(Group):
    """What chance gives: a null distribution from a campaign's own residuals, and normal numbers."""

    false_alarms: float = number(
        0.05, "1", "share of campaigns without an effect in which chance passes this condition",
        "convention",
    )  # fmt: skip
    fewest_pieces: int = number(
        8, "1", "fewest records, or blocks of driven records, whose signs are drawn",
        "the signs of fewer fall all alike too often: 2 / 2^8 is below 1 %",
    )  # fmt: skip
    draws: int = number(999, "1", "draws of the signs", "the smallest p-value is then 0.001")
    blocks: int = number(
        16, "1", "blocks of a driven or cycled record whose signs are drawn apart",
        "chosen; the first effects of EMPS, Silverbox and the tribometer have p = 0.001, 0.001 and 0.03",
    )  # fmt: skip
    same_direction: float = number(
        0.1, "1", "tangent of half the angle between directions of an effect's numbers that count once"
    )
    normal_quantile: float = number(
        1.96, "1", "standard errors of 95 % limits, and of a correlation that is printed as chance",
        "convention",
    )  # fmt: skip

    @property
    def level(self) -> float:
        """Share of normal numbers within `normal_quantile` standard errors."""
        return erf(self.normal_quantile / sqrt(2))
