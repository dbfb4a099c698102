"""Where a residual is said to live."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Localising(Group):
    """Where a residual is said to live."""

    repeat_preload: float = number(
        0.1, "1", "relative difference of the tensions of two tests that repeat each other, at most"
    )
    repeat_hit: float = number(
        0.2, "1", "relative difference of the hits of two tests that repeat each other, at most"
    )
    chance: float = number(
        0.05, "1", "probability that white noise exceeds what is printed as chance", "convention"
    )
    harmonic_width: float = number(
        0.2, "1", "distance of a line from a harmonic in dominant frequencies, which move, at most"
    )
    loud_line: float = number(
        2.0, "1", "power of noise over its median, above which a line of a force is faded"
    )
    dominant_width: float = number(
        0.1, "1", "relative distance from the dominant frequency of lines whose noise counts too"
    )
    blocks: float = number(16, "1", "blocks of a record whose signs are drawn: longer than noise remembers")
    folds: float = number(5, "1", "parts of which each is predicted by a map of the others")
    class_numbers: float = number(5, "1", "free numbers of a class of tension histories, at least")
    regular: float = number(
        0.01, "1", "p-value below which what is left is said to be more regular than noise"
    )
    wrapped: float = number(
        0.1,
        "1",
        "share of a record at its end, where what smears to before the hit comes round, that is put aside",
    )
    lags: float = number(
        20, "1", "lags of the correlation from row to row that is compared with chance, at most"
    )
    stands_out: float = number(
        1.3, "1", "largest mean square of a view over its smallest, above which its place is named"
    )
    function_of_motion: float = number(
        0.1, "1", "share of a force that a map of the motion must predict to be put into words"
    )
