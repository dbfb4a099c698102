"""Errors of a set of records in words."""

from __future__ import annotations

from experiments.text.error_lines import error_line

NONE = dict.fromkeys(
    (
        "motion_nrmse",
        "link_force_nrmse",
        "final_tension_error_percent_mean",
        "final_tension_error_percent_median",
        "tension_loss_error_percent_median",
        "tension_rmse_n",
    )
)


def test_a_loss_of_nothing_has_no_error() -> None:
    final = {"final_tension_error_percent_mean": 1.0, "final_tension_error_percent_median": 2.0}
    line = error_line({**NONE, **final}, {**NONE, **final}, {})
    assert line == (
        "final tension mean 1.00 %, median 2.00 % (no loosening: 1.00 %, 2.00 %); "
        "loss median undefined (no loosening: undefined)"
    )
    assert error_line(NONE, NONE, {}) == "nothing measured to compare with"
