"""Criteria under which few laws and exponents are tried, where a test does not look at which."""

from __future__ import annotations

from discovery.criteria.criteria import CRITERIA

FEWER = CRITERIA.changed(
    ranking={
        "refined_least": 4,
        "refined_most": 8,
        "validated_least": 4,
        "validated_most": 6,
        "folds": 4,
        "least_exponent": 2.0,
        "largest_exponent": 5.0,
        "largest_mixed": 2.0,
        "resamples": 100,
    },
    search={
        "thresholds": 4,
        "sr3_thresholds": 2,
        "ensemble": 3,
        "shared": 2,
        "pairs": 10,
        "bootstraps": 5,
    },
)
