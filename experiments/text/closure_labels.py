"""What keys of closure.json are called on the page, and what letters of its equations stand for."""

from __future__ import annotations

LEGEND = {
    "z1": "z: internal states, zero at the start",
    "rate": "Ṫ₀: rate of the law of loosening before this change",
    "follow": "follow: dependence of that law on tension, 1 at 100 N",
    "y_true": "y: what the sensor shows",
}
TESTS = ("uncoupled", "coupled", "loosening")
SINGLE = {
    "whiteness_p": "Chance of so much dependence if only noise were left [1]",
    "total": "All",
    "repeatability": "Correlation of residuals of tests that repeat each other [1]",
    "repeatability_chance": "What noise exceeds there in one case of {rare} [1]",
    "repeatability_noise": "Noise as such tests tell it, over that before the hits [1]",
    "repeatability_pairs": "Pairs of such tests",
    **{
        f"line_correlation_{test}{end}": f"{words}, {test} tests [1]"
        for test in TESTS
        for end, words in (
            ("", "Correlation of lines side by side"),
            ("_chance", "What white noise exceeds there in one case of {white}"),
        )
    },
}
CORRELATED = {
    **{f"line_correlation_{test}": f"Lines side by side, {test}" for test in TESTS},
    "repeatability": "Tests that repeat each other",
}
