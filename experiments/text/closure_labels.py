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
OF_FORCE = (
    ("level", "Mean square over that of noise [1]", 1.0),
    ("explained", "A function of displacement and velocity [%]", 100.0),
    ("explained_p", "Chance of so much from noise [1]", 1.0),
    ("elastic", "Even in velocity, of that function [%]", 100.0),
    ("rest", "Memory, or differs from record to record [%]", 100.0),
    ("work_per_cycle_j", "Work in a cycle, first three [mJ]", 1e3),
    ("cosine_displacement", "Cosine of the angle to displacement [1]", 1.0),
    ("cosine_velocity", "Cosine of the angle to velocity [1]", 1.0),
    ("cosine_chance", "What noise exceeds in one case of {rare} [1]", 1.0),
)
"""Key, words with the unit shown, and factor to it of every number of a lacking force."""
