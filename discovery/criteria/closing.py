"""When a closed loop ends, and its verdict."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group, number


@dataclass(frozen=True)
class Closing(Group):
    """When a closed loop ends, and its verdict."""

    far_less: float = number(
        0.7,
        "1",
        "ratio of two residual levels that is no matter of chance",
        "rig: refits of one model differ by less",
    )
    closing_share: float = number(
        0.2, "1", "share of what was beyond noise: an effect that leaves no more closes the residual",
        "rig campaigns of two and four effects, docs/closed-loop.md",
    )  # fmt: skip
    hit_limited_level: float = number(
        5.0, "1", "level that the samples of a hit may leave where sensors are quiet",
        "rig at a tenth of the noise",
    )  # fmt: skip
    far_from_structure: float = number(
        10.0, "1", "level above which slopes along the measured motion screen too",
        "integrating and filtering change the measured motion by less",
    )  # fmt: skip
    noise_ratio: float = number(
        2.0, "1", "ratio of noise powers that is worth another whitening", "rig: one body struck alone"
    )
