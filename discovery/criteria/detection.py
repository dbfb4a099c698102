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
    prediction_error: float = number(
        0.1,
        "1",
        "standard error of the logarithm of the square that an effect is predicted to add",
        "rig, two campaigns, eight effects at their limits: 5 % in the level, 10 % in errors that must fall",
    )
