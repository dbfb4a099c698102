"""What does not fit what a campaign declares: units, channels, masses, clocks, damaged channels."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number

_RIG = "python -m benchmarks.suspicions: sound records leave at most 1 % of the force's square"
_SEEN = "rig campaigns with something undeclared, and docs/measured.md"


@dataclass(frozen=True)
class Suspicions(Group):
    """What does not fit what a campaign declares: units, channels, masses, clocks, damaged channels."""

    balance_window_s: float = number(
        0.02, "s", "time after a contact over which momentum is balanced", "the joint passes momentum on"
    )
    balance_contacts: float = number(
        40.0,
        "1",
        "the same in durations of the contact, where that is shorter; so are the two below in proportion",
    )
    balance_guard_s: float = number(0.003, "s", "time before a contact that is balanced too")
    balance_parts: int = number(16, "1", "parts of a driven record, each with a trend of its own", "chosen")
    shortest_part: int = number(64, "1", "samples of such a part", "chosen: many more than its coefficients")
    unbalanced: float = number(
        0.02, "1", "share of the force's square left, below which no delay is looked for", _RIG
    )
    latest_s: float = number(
        3e-3, "s", "delay of motion behind the force, or behind where it begins, up to which is looked"
    )
    late_alike: float = number(
        0.2, "1", "relative difference below which two delays are one", "chosen: light bodies tell to a tenth"
    )
    late_alone: float = number(
        2.0, "1", "delay of one motion alone that is told, in delays that sensors sampled in turn may have",
        "sound rig: 1.1; a heavy body's gain looks like a light one's delay",
    )  # fmt: skip
    late_left: float = number(
        2e-5, "1", "share of the force's square beyond noise, above which one motion may be late", _RIG
    )
    late_share: float = number(
        0.02, "1", "share of the misfit that the delay of one motion may leave",
        "late by 1 ms: 95 of 100 records below; three sound ones of 2000 campaigns: 0.05 to 0.4",
    )  # fmt: skip
    slip_left: float = number(1e-4, "1", "share of the force's square that a slip is to explain", _RIG)
    slip_share: float = number(
        0.15, "1", "share of that which a slip may leave", "rig: slips leave at most 1.4 %"
    )
    exchanged_share: float = number(
        0.05, "1", "the same of exchanged channels",
        "99 of 100 exchanged ones leave 0.8 % at most; a sound record of 500 campaigns: 14 %",
    )  # fmt: skip
    slip_near: float = number(
        1.12, "1", "factor to which a unit's factor is met", "sensors are off by a tenth"
    )
    slip_noise: float = number(
        0.3, "1", "the same in what white noise leaves", "five deviations of the sum of 500 squares"
    )
    slip_alike: float = number(
        0.02, "1", "share of the misfit that two slips may leave, of which a unit is likelier than a sign",
        "of a body on a spring both may balance; its sign shows beside its neighbours too",
    )  # fmt: skip
    crossed: float = number(
        0.1, "1", "largest share of another body's motion in a sensor", "transverse sensitivity, mounting"
    )
    scale_left: float = number(
        0.05, "1", "share of the force's square left, for a factor without a name", _RIG
    )
    scale_factor: float = number(
        1.25, "1", "factor below which it is the gain of a sensor", "sensors are off by a tenth"
    )
    late_s: float = number(
        2.2e-4, "s", "delay that sensors sampled in turn may have", "data loggers: at most 0.2 ms"
    )
    weak_hit_n: float = number(5.0, "N", "peak force below which a hit is one in kN", "hammers hit harder")
    wild_m_per_s2: float = number(
        3e4, "m/s2", "peak force over mass above which motions in mm are likelier than masses in g",
        "a blow of 1500 N shakes the rig with 2e2, a structure of 2 kg with 7e2",
    )  # fmt: skip
    unlike_noise: float = number(
        1.1, "1", "rise of a motion's root mean square at a hit, below which only a line shows motion", _SEEN
    )
    force_noise: float = number(8.0, "1", "peak of a force in its noise, below which it shows nothing")
    fewest: int = number(3, "1", "records that tell a mass or a preload which nobody declares")
    preload_factor: float = number(
        2.0, "1", "factor between gauge and preload that is suspected", "gauges: 0.6 to 1.7"
    )
    preload_like: float = number(1.5, "1", "factor to which a preload is met once the unit is right")
    preload_near: float = number(
        1.1, "1", "the same beside other records, for pounds and kilograms", "preloads are set to a tenth"
    )
    preload_share: float = number(
        0.05, "1", "share of the largest preload, below which a wrong zero explains it"
    )
    rate_same: float = number(1e-4, "1", "relative difference below which two rates are one")
    rate_other: float = number(
        0.02, "1", "relative difference above which another rate was meant, unless by the declared one alone "
        "the hit is within half of it at the declared time",
    )  # fmt: skip
    lone_samples: int = number(2, "1", "samples in a row, above which an extreme is a signal", _SEEN)
    lone_share: float = number(
        0.2, "1", "share of the distance of lone samples from those beside them that others stay below", _SEEN
    )
    lone_height: float = number(0.25, "1", "least distance of a lone sample, in the range of the rest", _SEEN)
    hit_guard_s: float = number(
        5e-3, "s", "time about a hit in which a lone sample may be the blow itself", _SEEN
    )
    wrap_step: float = number(0.6, "1", "jump in ranges of a channel that may be a wrap-around", _SEEN)
    wrap_smooth: float = number(0.45, "1", "largest step in ranges that unwrapping may leave", _SEEN)
    wrap_beyond: float = number(0.02, "1", "least that unwrapping adds to the range, in ranges", _SEEN)
    wrap_noise: float = number(
        30.0, "1", "least range of a channel that may wrap around, in its noise", _SEEN
    )
    wrap_lasts: int = number(
        4, "1", "samples beyond half of what is unwrapped; fewer are a short blow", _SEEN
    )
    dropped: float = number(0.5, "1", "share of the level beside a dropout", _SEEN)
    dropped_to: float = number(0.1, "1", "share of the level that is left in a dropout", _SEEN)
    drop_noise: float = number(10.0, "1", "least level of a channel with dropouts, in its noise", _SEEN)
    drop_run: int = number(4, "1", "zeros in a row that are no chance at any level", _SEEN)
    drop_beside: int = number(
        5, "1", "samples beside a dropout that are looked at", "a loose bolt falls slowly"
    )
    held_run: float = number(
        8.0, "1", "length of one value in a frozen motion, in usual lengths", "chosen: noise repeats none"
    )
    held_digits: float = number(
        10.0,
        "1",
        "least motion beside it in half that time, in digits",
        "chosen: at rest it goes by single ones",
    )
    held_jump: float = number(
        1.5, "1", "least step at its end, in digits", "a smooth motion that rests goes on by single ones"
    )
    repeated: float = number(
        0.01, "1", "share of values that last longer than a sample, above which digits are coarse", "chosen"
    )
    beyond_calibration: float = number(
        0.01, "1", "share of a strain beyond where its calibration rises", "chosen: more than lone samples"
    )
    window_noise: float = number(
        0.4, "1", "noise at the end over that before the hit, below which a window is suspected", _SEEN
    )
    window_straight: float = number(
        0.97, "1", "correlation of its logarithm with time from which noise fades evenly", _SEEN
    )
    window_exact: float = number(
        0.999, "1", "the same of digits, where none changes before the hit", "digits behind a window: 0.9999"
    )
    one_digit: float = number(
        0.3, "1", "share of the largest step above which a step is a change of digit", "chosen: up to three"
    )
    digit_changes: int = number(8, "1", "changes of digit that tell its size", "chosen: a spike has fewer")
    no_digit: float = number(
        0.02, "1", "the same below which only a window changes a sample", "chosen: noise has steps between"
    )
    hann_like: float = number(0.15, "1", "scatter of the logarithm of noise about a window of Hann", _SEEN)
    settling_share: float = number(
        0.9, "1", "share of the variance before the hit that a settling sensor explains", _SEEN
    )
    settling_noise: float = number(20.0, "1", "least run of a settling sensor, in its noise", _SEEN)
    settling_size: float = number(0.1, "1", "least run of a settling sensor, in the motion", _SEEN)
    mean_speed: float = number(
        3.0, "1", "speed that a mean which moves stands for, in speeds that the hit gave", _SEEN
    )
    mean_errors: float = number(10.0, "1", "least change of a mean, in standard errors", _SEEN)
    mean_size: float = number(0.1, "1", "least change of a mean, in the motion after the hit", _SEEN)
    shortest: int = number(256, "1", "samples that tell a channel's noise")
