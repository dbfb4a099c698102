"""The whitened residual of the motion: noise, priors, what is aligned with the model's numbers."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Motion(Group):
    """The whitened residual of the motion: noise, priors, what is aligned with the model's numbers."""

    final_share: float = number(
        0.01, "1", "share of the initial tension, below which a record's loss tells no rate"
    )
    quiet_samples: float = number(
        64, "1", "samples before a hit, below which their noise is not taken off the motion"
    )
