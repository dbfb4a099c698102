"""Sections of result files, made up: errors that differ from each other, names that would run as scripts."""

from __future__ import annotations

from typing import Any

HOSTILE = '<script>alert("x")</script>'


def errors(scale: float, records: int = 14) -> dict[str, Any]:
    return {
        "motion_nrmse": 0.0123 * scale,
        "relative_motion_nrmse": 0.0821 * scale,
        "final_tension_error_percent_mean": 3.66 * scale,
        "final_tension_error_percent_median": 1.15 * scale,
        "final_tension_error_percent_max": 62.8 * scale,
        "tension_loss_error_percent_median": 21.4 * scale,
        "link_force_nrmse": None,
        "tension_rmse_n": 0.31 * scale,
        "tension_course_within_band": 0.93,
        "records": records,
        "failed": 0,
    }


def identification(hold_out: float = 1.0) -> dict[str, Any]:
    return {
        "records": 40,
        "set_aside": [f"records/a.h5: clipped {HOSTILE}"],
        "warnings": ["records/b.h5: strain leaves the calibrated range"],
        "errors": {
            "training": errors(0.9),
            "hold_out": errors(hold_out, 7),
            "no_loosening": {"training": errors(4.0), "hold_out": errors(4.5, 7)},
        },
        "joint": [
            {"file": f"c{i}.h5", "tension_n": 10.0 * i, "modal_stiffness_n_per_m": None} for i in range(20)
        ],
        "convergence": {"split_n": 850.0, "cases": 20},
        "command": f"boltlaw identify {HOSTILE}",
        "campaign_digest": "0123abcd",
    }
