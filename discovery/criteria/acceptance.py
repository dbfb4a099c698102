"""Whether an effect explains more than chance, matters, and can be told from others."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number

_CLEAN = "python -m benchmarks.false_alarms, seven clean campaigns: at most "


@dataclass(frozen=True)
class Acceptance(Group):
    """Whether an effect explains more than chance, matters, and can be told from others."""

    training_gain_motion: float = number(
        150.0, "2 ln L", "least gain on training records of an effect in the motion", _CLEAN + "32"
    )
    hold_out_gain_motion: float = number(
        20.0, "2 ln L", "least gain on hold-out records of an effect in the motion", _CLEAN + "17"
    )
    training_gain_tension: float = number(
        20.0, "2 ln L", "least gain on training records of an effect in the tension", _CLEAN + "12"
    )
    hold_out_gain_tension: float = number(
        0.0, "2 ln L", "least gain on hold-out records of an effect in the tension"
    )
    material_share: float = number(
        0.01, "1", "least share of the cost that an effect takes away", _CLEAN + "0.0002"
    )
    noise_level: float = number(
        1.2, "1", "mean square of a whitened residual that still counts as noise",
        "clean campaigns of the rig, accelerometers: 0.94 to 1.14",
    )  # fmt: skip
    explained_remainder: float = number(
        0.03, "1", "share of what was beyond noise that still counts as explained"
    )
    indistinguishable_cost: float = number(
        12.0, "2 ln L", "difference in cost below which two effects are indistinguishable"
    )
    indistinguishable_share: float = number(
        0.05, "1", "share of the gain that a slightly wrong form of the right effect may lose"
    )
    material_error: float = number(
        0.02, "1", "least share by which an effect in the motion lowers an error on hold-out records"
    )
    material_error_explained: float = number(
        0.1, "1", "the same where next to nothing is left of the residual of impact tests"
    )
    error_rise_closing: float = number(
        0.2, "1", "share by which one error may rise where the effect closes the residual"
    )
    harm: float = number(
        1.5, "1", "factor by which a mean error may rise with an effect in the tension",
        "losses vary from test to test by about a factor of two",
    )  # fmt: skip
    exact_motion: float = number(
        0.005, "1", "motion error below which a record is simulated as exactly as its hit is known"
    )
    exact_relative_motion: float = number(0.02, "1", "the same of the relative motion")
