"""What a campaign would have shown."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Detection(Group):
    """What a campaign would have shown."""

    probability: float = number(
        0.8, "1", "probability with which an effect at its detection limit is found", "convention"
    )
