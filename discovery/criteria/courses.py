"""Fits of laws to tension histories of many tests."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Courses(Group):
    """Fits of laws to tension histories of many tests."""

    least_variability: float = number(
        0.01, "1", "lowest standard deviation of the log rate from test to test"
    )
    largest_variability: float = number(
        5.0, "1", "highest standard deviation of the log rate from test to test"
    )
    usual_variability: float = number(
        0.5, "1", "standard deviation of the log rate that is assumed before it is fitted"
    )
    signed_variability: float = number(1.5, "1", "the same where some tests tighten")
    slope_prior: float = number(
        1.0, "1", "prior standard deviation of the slope of ln(variability) over ln(tension)"
    )
    least_final: float = number(
        0.01, "1", "share of the initial tension that a measured final tension counts for at least"
    )
    lost_times: float = number(
        1.5, "1", "a refit is lost above so many times the deviance that it started from ..."
    )
    lost_beyond: float = number(100.0, "2 ln L", "... and so much more")
