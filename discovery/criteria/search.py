"""From libraries and sparse fits to a short list of laws."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Search(Group):
    """From libraries and sparse fits to a short list of laws."""

    degree: float = number(6, "1", "highest degree of the polynomials in |v| and |x|")
    model_error: float = number(
        0.01, "1",
        "share of the change by which frozen motion and full simulation differ",
        "docs/discovery.md",
    )  # fmt: skip
    largest_support: float = number(3, "1", "terms of a sparse law, at most")
    ridge: float = number(1e-4, "1", "weight of the ridge in sparse fits of columns of length 1")
    least_threshold: float = number(
        0.02, "1", "lowest threshold on the paths of sparse fits, as share of the target"
    )
    largest_share: float = number(0.8, "1", "highest threshold of SR3 and of non-negative fits")
    least_positive: float = number(
        0.01, "1", "lowest threshold of non-negative fits: their coefficients cannot cancel"
    )
    thresholds: float = number(12, "1", "thresholds on a path of STLSQ")
    sr3_thresholds: float = number(8, "1", "thresholds on a path of SR3")
    ensemble: float = number(10, "1", "fits of an ensemble, each to rows drawn again")
    shortlist: float = number(60, "1", "candidates that go on to the ranking, at most")
    beaten: float = number(
        8, "1", "sums of terms that go on although a simpler law has the better quick score"
    )
    whole_powers: float = number(4, "1", "sums of one form whose whole powers are held as well")
    guides: float = number(3, "1", "single terms of different motion that are fitted to find the guide")
    shared: float = number(6, "1", "tension factors whose libraries go through the sparse fits")
    pairs: float = number(40, "1", "pairs of columns of every library that are fitted")
    bootstraps: float = number(20, "1", "draws of the records for the share of resamples that include a form")
    first_terms: float = number(2, "1", "terms of FROLS that count as included")
