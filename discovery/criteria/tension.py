"""Effects in the tension, in its gauge, and before the hits."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Tension(Group):
    """Effects in the tension, in its gauge, and before the hits."""

    quiet_s: float = number(0.2, "s", "time before a hit, below which it tells of no fault")
    quiet_records: float = number(4, "1", "training records that show a channel before the hit, at least")
    fault_at_rest: float = number(
        0.1, "1", "share of the smallest plausible strength: no amplifier has less of a fault"
    )
    fault_of_hit: float = number(
        1e-3, "1", "share of the weakest hit's peak, below which a fault of its hammer is none"
    )
    preload_scatter: float = number(
        0.02, "1", "scatter of declared preloads about the gauge, above which they are no reference",
        "VDI 2230-1 (2015), table A8: torque wrenches scatter by 0.1 to 0.3",
    )  # fmt: skip
    gauge_zero_n: float = number(
        0.5, "N", "error of a gauge's zero that is no finding: settings are no better known"
    )
    gauge_slope: float = number(
        0.05, "1", "share of the preload by which a gauge may be off without a finding"
    )
    preload_levels: float = number(8, "1", "different declared preloads that make a calibration, at least")
    same_preload: float = number(0.02, "1", "relative difference below which two preloads count as one")
    disturbance: float = number(
        2.0, "1", "gain before the hits over what noise gives, above which a force is fitted"
    )
    disturbance_band: float = number(
        2.0, "1", "upper end of the band before the hits where it is fitted, over its highest frequency"
    )
    line_reach_hz: float = number(
        0.15, "Hz", "distance from its nominal frequency at which a line in a channel is looked for"
    )
    beside_from_hz: float = number(
        5.0, "Hz", "distance from such a line from which the noise beside it is measured ..."
    )
    beside_to_hz: float = number(9.0, "Hz", "... and up to which")
    loosening_tests: float = number(
        3, "1", "training records that loosen, below which the tension tells of no effect"
    )
    drift_n_per_s: float = number(
        0.005,
        "N/s",
        "standard deviation of a drift that no gauge is free of",
        "half the smallest plausible one",
    )
    quiet_tests: float = number(
        6, "1", "tests that leave the tension alone from which its noise is estimated, at least"
    )
    agreeing_drifts: float = number(
        3.0, "1", "standard errors by which drifts before and after hits may differ"
    )
    noise_from_hz: float = number(4.0, "Hz", "lower end of the band in which the gauge's noise is estimated")
    noise_to_hz: float = number(300.0, "Hz", "upper end of the band in which the gauge's noise is estimated")
    misfit_chance: float = number(
        1e-3,
        "1",
        "probability of a larger misfit by noise, below which few rows are not explained",
    )
    misfit_floor: float = number(
        1.5, "1", "mean square that counts as noise: a motion known to a few per cent shifts as much",
        "eight clean campaigns of the rig: 0.94 to 1.18",
    )  # fmt: skip
    free_directions: float = number(
        2, "1", "directions of a history that may oscillate with the motion, taken off its numbers"
    )
    resimulated_effects: float = number(
        5, "1", "best effects along frozen motion that are corrected by full simulation"
    )
    fast_numbers: float = number(8, "1", "numbers that the fast part of a record counts as")
    fast_window_s: float = number(1.2, "s", "time after a hit whose fast part tells of the gauge")
    fault_lead_s: float = number(
        0.005, "s", "time before a hit from which a fault of the gauge is judged ..."
    )
    fault_window_s: float = number(0.06, "s", "... and time after it up to which")
    fault_directions: float = number(
        20,
        "1",
        "directions of such a fault's sizes in a record that are kept",
        "six late gauges of the rig: errors of 0.4 to 1.6 standard errors; with 5 of up to 4.5 of its own",
    )
    slowest_hz: float = number(
        6.0, "Hz", "frequency below which a wrong history and an effect in the fast part are alike"
    )
    fast_peak: float = number(
        0.3, "1", "share of a sample's noise: a reading with such peaks is in every record"
    )
    gauge_fault: float = number(
        0.3, "1", "share of the smallest plausible strength of a gauge's fault that is in every record"
    )
    free_terms: float = number(3, "1", "terms of a form outside the catalogue, at most")
    term_price: float = number(
        12.0, "2 ln L", "price of a term of such a form, and least gain on held-out records in the tension",
        "a clean campaign of the rig: a sum that gains 38 on training records gains 1.8 on held-out ones",
    )  # fmt: skip
    proposed_sums: float = number(5, "1", "sums of terms of a rate that are fitted by their likelihood")
    parallel_terms: float = number(
        0.98, "1", "cosine of two terms' histories, above which frozen motion cannot tell them apart"
    )
    turning_velocity: float = number(
        0.1, "1", "share of the largest velocity at which a term with a sign turns"
    )
    usual_sizes: float = number(
        100.0,
        "1",
        "factor by which force, displacement and velocity at a place may differ from those that "
        "the catalogue's ranges are meant for before the ranges of hammer tests go with them",
    )
    wider_range: float = number(
        10.0, "1", "factor by which ranges scaled to a motion are wider: its peaks are a rough measure"
    )
