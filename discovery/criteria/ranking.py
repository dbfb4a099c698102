"""How laws are ranked, cross-validated and told apart."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class RankingRules(Group):
    """How laws are ranked, cross-validated and told apart."""

    least_cases: float = number(4, "1", "loosening records that a comparison of laws needs")
    motion_off: float = number(
        0.04, "1", "error of the motion beyond noise from which a ranking says that laws rest on it",
        "clean campaigns of two structures: 0.005 and 0.018; with a hidden cubic spring 0.05 and 0.12",
    )  # fmt: skip
    tightened: float = number(
        3.0, "1", "standard errors by which a tension must rise for a record to be set aside"
    )
    refined_least: float = number(
        12, "1", "laws of lowest BIC fitted again with full re-simulation, at least"
    )
    refined_most: float = number(32, "1", "... and at most")
    refined_reach: float = number(200.0, "2 ln L", "BIC above the lowest up to which more are")
    validated_least: float = number(8, "1", "laws of lowest BIC that are cross-validated, at least")
    validated_most: float = number(18, "1", "... and at most")
    validated_reach: float = number(100.0, "2 ln L", "BIC above the lowest up to which more are")
    listed: float = number(10, "1", "laws that are listed with all error measures")
    compared: float = number(6, "1", "first laws that are compared pair by pair")
    compared_reach: float = number(
        10.0, "2 ln L",
        "BIC above the first up to which others are compared as well",
        "R. Kass and A. Raftery (1995): very strong",
    )  # fmt: skip
    misfit: float = number(4.0, "1", "dispersion beyond which a law is fitted to losses instead of courses")
    equal_noise: float = number(0.1, "1", "share of the noise within which two predicted courses are equal")
    equal_loss: float = number(0.005, "1", "share of the loss within which two predicted courses are equal")
    equal_fit: float = number(
        1.0, "2 ln L", "deviance within which a law with a number at its bound equals a simpler one"
    )
    folds: float = number(8, "1", "folds of the cross-validation over preloads, at most")
    same_preload: float = number(0.05, "1", "relative difference within which preloads are the same")
    record_bound: float = number(
        5.0, "ln L", "difference of log scores beyond which one record says no more: odds of 150 to 1"
    )
    log_odds: float = number(
        3.0, "ln L",
        "log likelihood ratio below which two laws are not told apart: odds of 20 to 1",
        "convention",
    )  # fmt: skip
    confidence: float = number(
        0.95, "1",
        "confidence of limits, sets and leads",
        "convention",
    )  # fmt: skip
    resamples: float = number(
        400, "1", "draws of the preloads for limits and for how often a law comes first"
    )
    better: float = number(0.01, "1", "p-value below which a law is better than the baseline")
    named: float = number(0.05, "1", "share of resamples from which a law that comes first is listed")
    misfit_chance: float = number(
        1e-4, "1", "p-value of the dispersion below which a law does not fit to within noise"
    )
    least_exponent: float = number(0.5, "1", "lowest exponent of the velocity that is profiled")
    largest_exponent: float = number(8.0, "1", "highest exponent of the velocity that is profiled")
    largest_mixed: float = number(4.0, "1", "highest exponent of the displacement that is profiled beside it")
    edge: float = number(
        0.1, "1",
        "share of a confidence set's width; one that ends nearer to 0 or to the end of its range leaves open "
        "what drives the loosening",
        "simulated courses of 11 laws, noise 0.5 to 4, damping 1 % off: that both act is said wrongly of 3 "
        "in 86 with 0, of 2 with 0.05, of none from 0.1 on; rightly of 60 in 70 with 0, of 58 with 0.1",
    )  # fmt: skip

    tests_per_number: float = number(
        2.0, "1",
        "tests for each free number of a product of powers of velocity and displacement, below which it is "
        "open what drives the loosening",
        "laws of velocity alone: that both act was said wrongly of one campaign of the rig with 5 tests for "
        "5 numbers, and of simulated courses of 1 in 12 with 8 tests, of none in 24 with 12 and 18",
    )  # fmt: skip

    def edge_of(self, low: float, high: float, largest: float) -> float | None:
        """Return the number that an end of a set lies next to, 0 or the largest searched; None for neither.

        Parameters
        ----------
        low, high : float
            Ends of the confidence set of an exponent; one that holds 0 does not end there.
        largest : float
            End of the range in which the set was sought.
        """
        near = self.edge * (high - low)
        if largest - high <= near:
            return largest
        return 0.0 if 0.0 < low <= near else None
