"""Which tests are proposed to tell rivals apart."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group, number


@dataclass(frozen=True)
class Separating(Group):
    """Which tests are proposed to tell rivals apart."""

    odds: float = number(
        100.0, "1",
        "odds, to one, at which a list of proposed hits aims",
        "chosen, not measured",
    )  # fmt: skip
    least_odds: float = number(
        10.0, "1",
        "odds below which the most hits of one kind tell nothing of two laws",
        "chosen, not measured",
    )  # fmt: skip
    tests: float = number(
        3, "1",
        "different hits in a list, at most",
        "chosen, not measured",
    )  # fmt: skip
    hits: float = number(
        60, "1",
        "hits in a list, at most",
        "chosen, not measured",
    )  # fmt: skip
    hardest: float = number(
        1.5, "1",
        "hardest hit between laws over the strongest measured",
        "chosen, not measured",
    )  # fmt: skip
    longest: float = number(
        2.0, "1",
        "longest pulse over the measured one",
        "chosen, not measured",
    )  # fmt: skip
    preload_range: float = number(
        1.5, "1",
        "preloads beyond the measured ones, as ratio",
        "chosen, not measured",
    )  # fmt: skip
    shape_error: float = number(
        0.01, "1",
        "error of the log rate of the identified model, from bin to bin",
        "chosen, not measured",
    )  # fmt: skip
    least_left: float = number(
        0.5, "1",
        "share of the tension that a proposed hit leaves: beyond, refits absorb more",
        "docs/discovery.md",
    )  # fmt: skip
    effect_hardest: float = number(
        4.0, "1",
        "hardest hit between effects over that of a record",
        "chosen, not measured",
    )  # fmt: skip
    effect_repeats: float = number(
        10, "1",
        "repeats of one hit between effects, at most",
        "chosen, not measured",
    )  # fmt: skip
    effect_preloads: float = number(
        3, "1",
        "preloads of the records that are tried",
        "chosen, not measured",
    )  # fmt: skip
    least_gain: float = number(
        1.0, "2 ln L",
        "gain below which the nearest hit is not named",
        "chosen, not measured",
    )  # fmt: skip
