"""The paper's numbers: He, Wang, Alexander, Moore, "Reduced-Order Modeling of Bolt Loosening" (2025).

Each number with its unit and the place where it is printed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rom.campaign.channels import FloatArray
from rom.model.description import LinkLaws
from rom.model.laws import (
    Law,
    Parameter,
    constant_damping,
    constant_stiffness,
    logistic_damping,
    logistic_loosening,
    logistic_stiffness,
)
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure

MASS_LO = Parameter(8.625, "kg", source="section 2.2")
MASS_SO = Parameter(0.9888, "kg", source="section 2.2")
FREQUENCY_LO = Parameter(4.892, "Hz", source="section 3.1, uncoupled")
FREQUENCY_SO = Parameter(44.27, "Hz", source="section 3.1, uncoupled")
DAMPING_RATIO_LO = Parameter(0.0155, "1", source="section 3.1, uncoupled")
DAMPING_RATIO_SO = Parameter(0.004, "1", source="section 3.1, uncoupled; gives 2.20 N s/m, not 2.696")
STIFFNESS_LO_UNCOUPLED = Parameter(8148.7, "N/m", source="section 3.1")
STIFFNESS_SO_UNCOUPLED = Parameter(76500.0, "N/m", source="section 3.1")
STIFFNESS_LO = Parameter(8963.6, "N/m", source="section 3.2, with the bolt in (+10 %)")
STIFFNESS_SO = Parameter(91800.0, "N/m", source="section 3.2, with the bolt in (+20 %)")
DAMPING_LO = Parameter(8.200, "N s/m", source="section 3.1")
DAMPING_SO = Parameter(2.696, "N s/m", source="section 3.1")
K_I = Parameter(9.763e5, "N/m", source="section 3.2, Eq. 5")
ALPHA = Parameter(-0.0608, "1/N", source="section 3.2, Eq. 5")
BETA = Parameter(2.003, "N", source="section 3.2, Eq. 5")
C_D = Parameter(1853.0, "N s/m", source="section 3.2, Eq. 11")
C_I = Parameter(1717.4, "N s/m", source="section 3.2, Eq. 11")
ETA = Parameter(-0.00922, "1/N", source="section 3.2, Eq. 11")
GAMMA_D = Parameter(11.79, "1", source="section 3.5, Eq. 13")
GAMMA_I = Parameter(7.974, "1", source="section 3.5, Eq. 13")
RHO = Parameter(-0.00362, "1/N", source="section 3.5, Eq. 13")
EXPONENT = Parameter(4.0, "1", source="section 3.5, Eq. 12")

CALIBRATION = (2718.7, 2363.7, -575.63)  # T = c1 e + c2 e^2 + c3 e^3 [N]: section 2.4, Eq. 1
MOTION_RATE_HZ = 19200.0  # section 2.3
TENSION_RATE_HZ = 4800.0  # section 2.3
PRETRIGGER_S = 0.5  # section 2.3
CUTOFF_UNCOUPLED_HZ = 2.0  # section 2.3
CUTOFF_COUPLED_HZ = 5.0  # section 2.3
INITIAL_WINDOW_S = (0.0, 0.4)  # section 3.3
FINAL_WINDOW_S = (2.0, 8.0)  # section 3.3
IMPACT_N = Parameter(1608.7, "N", source="section 3.3, mean of the loosening tests; deviation 81.65 N")
FREQUENCY_BEFORE_STIFFENING = Parameter(14.93, "Hz", source="section 3.2, Eq. 4")
FREQUENCY_AFTER_STIFFENING = Parameter(16.29, "Hz", source="section 3.2, Eq. 4")
FREQUENCY_MEASURED = Parameter(15.78, "Hz", source="section 3.2, largest measured")


def paper_model() -> Model:
    """The reduced-order model of He et al. (2025), section 4: Eqs. 2, 5, 11, 12 and 13."""
    structure = Structure(
        bodies=(Body("lo", MASS_LO.value), Body("so", MASS_SO.value)),
        links=(
            Link("flexure_lo", "lo", "ground"),
            Link("flexure_so", "so", "ground"),
            Link("joint", "lo", "so", "bolted"),
        ),
    )
    joint = LinkLaws(
        _law(logistic_stiffness, K_I, ALPHA, BETA),
        _law(logistic_damping, C_D, C_I, ETA),
        _law(logistic_loosening, GAMMA_D, GAMMA_I, RHO, EXPONENT),
    )
    return Model(
        structure=structure,
        link_laws={
            "flexure_lo": _flexure(STIFFNESS_LO, DAMPING_LO),
            "flexure_so": _flexure(STIFFNESS_SO, DAMPING_SO),
            "joint": joint,
        },
        filter_cutoff_hz={
            "uncoupled": CUTOFF_UNCOUPLED_HZ,
            "coupled": CUTOFF_COUPLED_HZ,
            "loosening": CUTOFF_COUPLED_HZ,
        },
        calibration=CALIBRATION,
        windows={"initial_s": INITIAL_WINDOW_S, "final_s": FINAL_WINDOW_S},
        sampling={
            "motion_rate_hz": MOTION_RATE_HZ,
            "tension_rate_hz": TENSION_RATE_HZ,
            "pretrigger_s": PRETRIGGER_S,
        },
    )


def _flexure(stiffness: Parameter, damping: Parameter) -> LinkLaws:
    return LinkLaws(_law(constant_stiffness, stiffness), _law(constant_damping, damping))


def _law(law: Callable[..., Law], *numbers: Parameter) -> Law:
    """A law of printed numbers that keeps their sources."""
    return law(*(number.value for number in numbers)).sourced(*(number.source for number in numbers))


def nominal_impact(
    peak: float, rate_hz: float, duration_s: float, start_s: float = PRETRIGGER_S
) -> FloatArray:
    """Half-sine hammer pulse ``peak sin(pi (t - start) / tau)`` [N], tau = 1.05 ms (peak / 28 N)^-0.118.

    The paper prints no pulse shape. This one, with the paper's own equations, gives losses of the size
    that it prints for low and high impacts.

    Parameters
    ----------
    peak : float
        Peak of the force [N].
    rate_hz : float
        Sampling rate [Hz].
    duration_s : float
        Length of the record [s].
    start_s : float
        Start of the pulse [s].

    Returns
    -------
    ndarray
        Force [N], shape (samples,).
    """
    contact = 1.05e-3 * (peak / 28.0) ** -0.118
    phase = (np.arange(round(duration_s * rate_hz)) / rate_hz - start_s) / contact
    return np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0.0)
