"""What an identification takes for told, warns of, or leaves open."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Identifying(Group):
    """What an identification takes for told, warns of, or leaves open."""

    undetermined: float = number(1.0, "1", "standard error of a logarithm, from which a value has no limits")
    vanished_mass: float = number(
        1e-4, "1", "share of the heaviest body's mass, below which a mass is not told"
    )
    modal_damping: float = number(
        0.2, "1", "largest damping ratio of a mode at which the paper's Eq. 7 is to be trusted"
    )
    curve_levels: int = number(2, "1", "levels of tension that tell a curve")
    curve_span: float = number(
        3.0, "1", "factor of tensions below which the form of a curve is the simplest that they allow"
    )
    curve_chance: float = number(
        0.05,
        "1",
        "p-value below which a number more of a curve over such tensions is told",
        "drawn: of a gamma that falls sixfold, 6 tests with 30 % of scatter leave 0.21 of its logarithm open "
        "(0.32 at 0.01); a constant is met a tenth worse at most",
    )
    discretised_curve: float = number(
        1e-4, "1", "least scatter of ln k and ln c that limits of a curve rest on: samples, filters",
        "campaigns without noise: rig up to 1.5e-5 of k and 4e-5 of c, a chain of three 1.1e-4",
    )  # fmt: skip
    discretised_link: float = number(
        1e-4, "1", "least error of ln k and ln c of a linear link that limits rest on: samples, filters, "
        "tensions that fall within a hit",
        "rig campaigns without noise: up to 1.0e-4 of k, a chain of three 3e-5",
    )  # fmt: skip
    discretised_rate: float = number(
        2e-3, "1", "the same of ln gamma", "campaigns without noise: a chain of three 2.4e-3"
    )
    level_step: float = number(0.1, "1", "logarithm of tension by which two levels differ")
    left_open: float = number(
        0.3, "1", "relative error of a shared number, from which joints are put on their curve"
    )
    aligned: float = number(
        0.2, "1", "square of the cosine that a misfit may have with the slope by a number"
    )
    misfit_share: float = number(
        0.1, "1", "systematic share of what is left that a good model may have",
        "pulses of few samples, a bolt that loosens",
    )  # fmt: skip
    misfit_chance: float = number(4.0, "1", "the same by chance, in 1 / sqrt(lines)")
    much_misfit: float = number(
        0.3, "1", "systematic share of what coupled tests leave over that is warned of"
    )
    much_motion: float = number(
        5e-4, "1", "the same as a share of the motion, below which it is not warned of",
        "without noise: discretisation leaves 1e-4 of a block's, friction that is not declared 1e-3 and more",
    )  # fmt: skip
    prior_stiffness: float = number(
        0.02, "1", "least error of ln k from an uncoupled test", "amplitudes differ from coupled tests"
    )
    prior_damping: float = number(
        0.3, "1", "least error of ln c from an uncoupled test", "amplitudes differ from coupled tests"
    )
    strained: float = number(1.0, "1", "standard errors off, from which a prior is asked for")
    unlikely: float = number(3.0, "1", "standard errors off a prior, from which numbers are unlikely")
    useful_mode: float = number(
        0.5, "1", "standard error of a logarithm, above which an uncoupled mode is no prior"
    )
    stiffened_alike: float = number(
        0.15,
        "1",
        "error of the logarithm by which bolts stiffen links alike",
        "He et al. (2025), 3.2",
    )
    beyond_chance: float = number(
        3.0, "1", "standard errors from which an offset is in a driven model, or a damping's sign is wrong"
    )
    noise_bias: float = number(
        1e-3, "1", "share of noise in a term behind the filter, from which its number is too small"
    )
    broad_force: float = number(
        0.1, "1", "white part of a force over its size, above which it drives the top of the band itself",
        "0.001 for a multisine to 40 Hz beside 0.02 N of noise; 1 for white excitation",
    )  # fmt: skip
    quiet_cases: int = number(6, "1", "coupled tests that tell the error of a loss")
    lossy_chance: float = number(
        0.002, "1", "p-value of changes of tension in coupled tests below which they are not noise alone",
        "two tests of each campaign: about one warning in 250 campaigns whose gauge shows noise alone",
    )  # fmt: skip
    lost_tension: float = number(
        3.0, "1", "final tension in its errors, below which gamma is little more than a bound"
    )
    gamma_bound: float = number(1e10, "1", "size of gamma at which it is given up as unbounded")
    small_loss: float = number(
        0.01, "1", "share of the tension that a bolt may lose in a ringing taken for linear"
    )
    enough_linear: int = number(5, "1", "records besides loosening tests that tell the joint's curves")
    quiet_sensors: float = number(
        4.0, "1", "power of the noise over the least, up to which a group's ambient forces serve"
    )
    close_modes: float = number(
        1.0,
        "1",
        "sum of the half-power half-widths of two modes, within which shapes may be mixed",
        "convention",
    )
    real_mode: float = number(
        0.9, "1", "modal phase collinearity, below which a mode shape is called complex", "convention"
    )
    far_start: float = number(
        10.0, "1", "factor between a declared starting value and the records, from which theirs may do better"
    )
    unexplained_share: float = number(
        0.05, "1", "share of a channel's power in a resonance without a mode, from which it is told",
        "11 rig campaigns, three levels of noise: below 0.01 %, with friction, slip and gaps too",
    )  # fmt: skip
    unexplained_part: float = number(0.5, "1", "part of a resonance that the model does not explain")
    unexplained_peak: float = number(
        5.0, "1", "height of a resonance over its neighbours' level, below which it may be noise"
    )
    unmet_record: float = number(
        0.5, "1", "share of a ring-down's RMS that a fit to all leaves, from which the record is named",
        "as of all records together, at exit code 3",
    )  # fmt: skip
    calibration_slack: float = number(
        0.01, "1", "share of the calibrated range beyond which a tension is extrapolated"
    )


RULES = Identifying()
"""The values."""
