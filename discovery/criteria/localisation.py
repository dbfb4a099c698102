"""Where a residual is said to live."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group, number


@dataclass(frozen=True)
class Localising(Group):
    """Where a residual is said to live."""

    repeat_preload: float = number(
        0.1,
        "1",
        "relative difference of the tensions of two tests that repeat each other, at most",
        "chosen, not measured",
    )
    repeat_hit: float = number(
        0.2,
        "1",
        "relative difference of the hits of two tests that repeat each other, at most",
        "chosen, not measured",
    )
    chance: float = number(
        0.05, "1", "probability that white noise exceeds what is printed as chance", "convention"
    )
    normal_quantile: float = number(
        1.96,
        "1",
        "standard deviations that a normal number exceeds by that chance, to either side",
        "convention",
    )
    harmonic_width: float = number(
        0.2, "1", "distance of a line from a harmonic in dominant frequencies, which move, at most",
        "chosen, not measured",
    )  # fmt: skip
    loud_line: float = number(
        2.0,
        "1",
        "power of noise over its median, above which a line of a force is faded",
        "chosen, not measured",
    )
    dominant_width: float = number(
        0.1,
        "1",
        "relative distance from the dominant frequency of lines whose noise counts too",
        "chosen, not measured",
    )
    blocks: float = number(
        16,
        "1",
        "blocks of a record whose signs are drawn: longer than noise remembers",
        "chosen, not measured",
    )
    folds: float = number(
        5, "1", "parts of which each is predicted by a map of the others", "chosen, not measured"
    )
    class_numbers: float = number(
        5, "1", "free numbers of a class of tension histories, at least", "chosen, not measured"
    )
    regular: float = number(
        0.01,
        "1",
        "p-value below which what is left is said to be more regular than noise",
        "chosen, not measured",
    )
