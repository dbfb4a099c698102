"""What a bootstrap of closures tells."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Bootstrap(Group):
    """What a bootstrap of closures tells."""

    fewest: int = number(
        8,
        "1",
        "replicates that name an effect, from which its numbers get limits",
        "simulated: six distributions of errors, 8 to 40 replicates: limits hold 95 to 97 %",
    )
    level: float = number(0.95, "1", "probability of the limits from replicates", "convention")
