"""When a closed loop ends, and its verdict."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Closing(Group):
    """When a closed loop ends, and its verdict."""

    far_less: float = number(0.7, "1", "ratio of two residual levels that is no matter of chance")
    special_case_share: float = number(
        0.5, "1", "share of what a wider form explains, from which its special case comes first"
    )
    closing_share: float = number(
        0.2, "1", "share of what was beyond noise: an effect that leaves no more closes the residual"
    )
    hit_limited_level: float = number(
        5.0, "1", "level that the samples of a hit may leave where sensors are quiet"
    )
    noisy_balance_level: float = number(
        2.0, "1", "level that balances of forces may leave where simulations leave noise alone",
        "a clean chain of three bodies: 1.44; a mode that no model has, above what simulations show: 40",
    )  # fmt: skip
    far_from_structure: float = number(
        10.0, "1", "level above which slopes along the measured motion screen too"
    )
    noise_ratio: float = number(2.0, "1", "ratio of noise powers that is worth another whitening")
