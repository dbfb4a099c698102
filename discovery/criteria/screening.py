"""Which effects of the catalogue are worth a fit."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Screening(Group):
    """Which effects of the catalogue are worth a fit."""

    record_share: float = number(
        0.2, "1", "records of a rough screen: those most is left of, and as many of all"
    )
    rough_share: float = number(
        0.1, "1", "share of the best gain of a rough screen, above which all records are screened"
    )
    rough_effects: float = number(12, "1", "effects that are screened on all records, at least")
    rough_probes: float = number(3, "1", "probes of each of these")
    starts: float = number(2, "1", "points of an effect's grid from which it is fitted")
    fitted_effects: float = number(
        5, "1", "effects of a screen that are fitted, but for those of the first one's class"
    )
    balance_starts: float = number(
        3, "1", "points of an effect's grid from which a fit to balances of forces starts"
    )
    balance_start_share: float = number(
        0.5, "1", "share of the best point's gain, below which no such fit starts"
    )
    finest_shape: float = number(
        0.01, "1", "least slip or gap over the largest motion that a slider is screened at",
        "a cycled damper and twins: 0.003 to 0.3 is met from there",
    )  # fmt: skip
    coarsest_shape: float = number(
        0.3, "1", "most slip or gap over the largest motion that a slider is screened at"
    )
    shape_steps: float = number(4, "1", "slips and gaps from the least to the most, in equal ratios")
    out_of_phase: float = number(
        0.25, "1", "share of a record that a simulation leaves, above which (shorter) parts of it are taken",
        "twins with a strong spring or stop, free and driven: at 0.42 a fit went astray, at 0.21 not",
    )  # fmt: skip
    least_share: float = number(
        0.3, "1", "share of a material gain that an effect must show in the screen to be fitted"
    )
    share_of_first: float = number(
        0.4, "1", "share of the first effect's gain, below which others are not fitted"
    )
