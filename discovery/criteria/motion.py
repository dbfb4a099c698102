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
    small_loss: float = number(
        0.1,
        "1",
        "share of the tension that a test loses, above which it falls by the model's law, not by one gamma",
        "clean campaigns of another structure, noise 0.3: tests from 250 N to 132 to 199 N leave 5 to 142 "
        "times the noise by one gamma, 1 to 12 by a factor on gamma(T)",
    )
    kept_stiffness: float = number(
        0.65,
        "1",
        "share of the joint's stiffness that a test leaves, below which its motion is not followed",
        "eight clean campaigns of another structure that loosens by the paper's rate: records that keep 0.73 "
        "leave 1.0 times the noise, those of 0.44 to 0.57 up to 3000 times",
    )
