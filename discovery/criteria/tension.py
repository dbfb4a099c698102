"""Effects in the tension, in its gauge, and before the hits."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group, number


@dataclass(frozen=True)
class Tension(Group):
    """Effects in the tension, in its gauge, and before the hits."""

    quiet_s: float = number(0.2, "s", "time before a hit, below which it tells of no fault", "convention")
    quiet_records: float = number(
        4, "1", "training records that show a channel before the hit, at least", "convention"
    )
    fault_at_rest: float = number(
        0.1, "1", "share of the smallest plausible strength: no amplifier has less of a fault", "convention"
    )
    fault_of_hit: float = number(
        1e-3, "1", "share of the weakest hit's peak, below which a fault of its hammer is none", "convention"
    )
    preload_scatter: float = number(
        0.02, "1", "scatter of declared preloads about the gauge, above which they are no reference",
        "VDI 2230-1 (2015), table A8: torque wrenches scatter by 0.1 to 0.3",
    )  # fmt: skip
    gauge_zero_n: float = number(
        0.5, "N", "error of a gauge's zero that is no finding: settings are no better known", "convention"
    )
    gauge_slope: float = number(
        0.05, "1", "share of the preload by which a gauge may be off without a finding", "convention"
    )
    preload_levels: float = number(
        8, "1", "different declared preloads that make a calibration, at least", "convention"
    )
    same_preload: float = number(
        0.02, "1", "relative difference below which two preloads count as one", "convention"
    )
    disturbance: float = number(
        2.0, "1", "gain before the hits over what noise gives, above which a force is fitted", "convention"
    )
