"""Courses of the tension simulated with the paper's model and a known law: no sensors, no identification."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

import rom
from discovery.courses.fit import Fit, fit, with_uncertainty
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.laws.candidate import Candidate, Term, baseline
from discovery.laws.factors import tension_logistic, velocity_power
from rom.model.model import Model
from rom.signals.tension_bins import CourseNoise, TensionBins, TensionCourse

NOISE = CourseNoise(white=9.4e-8, walk=1e-7, drift=1.7e-5, of_tension=True)  # as the virtual rig has
RATE_HZ, TENSION_RATE_HZ = 19200.0, 4800.0
_HIT_S, _BINS, _BEFORE_S = 0.1, 9, 0.09
_RATES = {2.0: 8.48, 3.0: 10.37, 4.0: 11.79, 5.0: 13.10}  # all lose 6 N of 150 N at the nominal hit


def with_power(n: float, unit: float = 1.0) -> Candidate:
    """The paper's law with another power of the velocity; for bolts whose tensions are in a unit [N]."""
    term = Term(velocity_power(n), tension_logistic(7.974, -0.00362 / unit, unit))
    return Candidate(f"power {n:g}", (term,), (10 ** _RATES[n],))


def free_power(unit: float = 1.0) -> Candidate:
    """The paper's law with the power of the velocity to be fitted."""
    term = Term(velocity_power(), tension_logistic(rho=-0.0036 / unit, unit=unit))
    return Candidate("free power", (term,), (6e11,))


def known_fit(law: Candidate, courses: FrozenMotion) -> Fit:
    """A fit along the frozen motion, with its uncertainty."""
    return with_uncertainty(fit(law, courses), courses)


@cache
def small(n: float = 4.0, noise: float = 1.0) -> FrozenMotion:
    """Few courses, for what is asked of many fits."""
    courses = measured(
        with_power(n), preloads=(20.0, 60.0, 300.0, 1000.0), scatter=0.3, noise=noise, length_s=0.5
    )
    return freeze(rom.paper_model(), courses)


@cache
def frozen(
    n: float = 4.0, scatter: float = 0.3, noise: float = 1.0, seed: int = 0, length_s: float = 0.5
) -> FrozenMotion:
    """Courses of a law with power n and their frozen motion; made once."""
    courses = measured(with_power(n), scatter=scatter, noise=noise, seed=seed, length_s=length_s)
    return freeze(rom.paper_model(), courses)


def model_with(law: Candidate, unit: float = 1.0) -> Model:
    """The paper's model with another law of the tension."""
    return paper_model_of(unit).with_tension_law(law.law())


def paper_model_of(unit: float) -> Model:
    """The paper's model of a bolt whose tensions are in a unit [N]."""
    model = rom.paper_model()
    powers = {"stiffness.alpha": -1, "stiffness.beta": 1, "damping.eta": -1}
    return model.with_values(
        {f"joint.{n}": model.parameter(f"joint.{n}").value * unit**power for n, power in powers.items()}
    )


def measured(
    law: Candidate | None = None,
    *,
    preloads: npt.ArrayLike = (8.0, 20.0, 60.0, 150.0, 300.0, 700.0, 1500.0, 3000.0),
    strengths: tuple[float, ...] = (1.0, 0.7),
    scatter: float = 0.0,
    noise: float = 1.0,
    seed: int = 0,
    length_s: float = 0.5,
    unit: float = 1.0,
) -> tuple[TensionCourse, ...]:
    """Simulated courses: half-sine hits of 1608.7 N times each strength at every preload, in a unit [N]."""
    generator = np.random.default_rng(seed)
    initial = unit * np.repeat(np.asarray(preloads, dtype=float), len(strengths))
    peaks = (
        1608.7
        * np.tile(strengths, len(initial) // len(strengths))
        * generator.uniform(0.95, 1.05, len(initial))
    )
    time = np.arange(round((_HIT_S + length_s) * RATE_HZ)) / RATE_HZ - _HIT_S
    pulse = np.where((time > 0) & (time < 6.5e-4), np.sin(np.pi * time / 6.5e-4), 0.0)
    places = round(_HIT_S * TENSION_RATE_HZ) + np.array(
        [0, *np.geomspace(15, 0.98 * length_s * TENSION_RATE_HZ, _BINS).round()], dtype=int
    )
    edges = (places - 0.5) / TENSION_RATE_HZ
    deviations = scatter * generator.standard_normal(len(initial))
    true = law or baseline()
    rated = true.rated(np.exp(deviations))
    vary = {f"joint.tension_rate.{name}": values for name, values in rated.items()}
    tension = (
        paper_model_of(unit)
        .with_tension_law(true.law())
        .mean_tensions(
            peaks[:, None] * pulse, RATE_HZ, initial, edges, vary, "lo", tension_rate_hz=TENSION_RATE_HZ
        )
    )
    found = []
    for case, start in enumerate(initial):
        slope = unit * np.sqrt(2718.7**2 + 4 * 2363.7 * start / unit)
        bins = TensionBins(
            edges, tension[case] - start, np.diff(places).astype(float), round(_BEFORE_S * TENSION_RATE_HZ),
            0.5 * (edges[1:] + edges[:-1]) - 0.5 * _BEFORE_S, float(slope), TENSION_RATE_HZ,
            float(start),
        )  # fmt: skip
        noises = replace(NOISE, walk=NOISE.walk * unit**2, drift=NOISE.drift * unit**2)
        covariance = noise**2 * noises.covariance(bins) + (1e-6 * unit) ** 2 * np.eye(len(bins.change))
        error = generator.multivariate_normal(np.zeros(len(bins.change)), covariance)
        found.append(
            TensionCourse(
                file=f"hit_{case:03d}.h5", hold_out=False, preload=float(start), body="lo",
                force=peaks[case] * pulse, rate_hz=RATE_HZ, impact_s=_HIT_S, initial=float(start),
                edges_s=edges, change=bins.change + error, covariance=covariance,
                tension_rate_hz=TENSION_RATE_HZ, final_window=(0.7 * length_s, length_s),
                final=float(start + bins.change[-1] + error[-1]),
                final_error=float(np.sqrt(covariance[-1, -1])),
            )
        )  # fmt: skip
    return tuple(found)
