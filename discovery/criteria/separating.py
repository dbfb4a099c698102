"""Which tests are proposed to tell rivals apart."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Separating(Group):
    """Which tests are proposed to tell rivals apart."""

    odds: float = number(100.0, "1", "odds, to one, at which a list of proposed hits aims")
    least_odds: float = number(
        10.0, "1", "odds below which the most hits of one kind tell nothing of two laws"
    )
    tests: float = number(3, "1", "different hits in a list, at most")
    hits: float = number(60, "1", "hits in a list, at most")
    hardest: float = number(1.5, "1", "hardest hit between laws over the strongest measured")
    longest: float = number(2.0, "1", "longest pulse over the measured one")
    preload_range: float = number(1.5, "1", "preloads beyond the measured ones, as ratio")
    shape_error: float = number(0.01, "1", "error of the log rate of the identified model, from bin to bin")
    least_left: float = number(
        0.5, "1",
        "share of the tension that a proposed hit leaves: beyond, refits absorb more",
        "docs/discovery.md",
    )  # fmt: skip
    effect_hardest: float = number(4.0, "1", "hardest hit between effects over that of a record")
    effect_repeats: float = number(10, "1", "repeats of one hit between effects, at most")
    effect_preloads: float = number(3, "1", "preloads of the records that are tried")
    least_gain: float = number(1.0, "2 ln L", "gain below which the nearest hit is not named")
