"""Tension laws that the rig can hide, and how near a law that was found comes to the hidden one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from discovery.laws.candidate import Candidate, Term
from discovery.laws.factors import (
    displacement_power,
    tension_logistic,
    tension_power,
    velocity_displacement,
    velocity_power,
    velocity_threshold,
)
from experiments.rig.plant import LooseningTerm
from experiments.rig.rivals import RIVALS
from rom.campaign.channels import FloatArray
from rom.model.laws import Law

PAPER = "eq13"  # the law of the rig where no other is named
LAWS: Mapping[str, tuple[LooseningTerm, ...]] = {
    PAPER: (LooseningTerm(),),
    **{
        name: RIVALS[name]
        for name in (
            "constant-quartic",
            "power-2",
            "power-3",
            "power-5",
            "constant-quadratic",
            "displacement-2",
            "threshold",
            "threshold-30",
            "velocity-and-displacement",
        )
    },
}
"""Laws to hide, each losing at 150 N what Eqs. 12-13 of He et al. (2025) lose there."""
CURVE_N = np.geomspace(20.0, 3000.0, 100)
ALIKE = 0.3  # of an exponent, or of the slope of the log rate
_STEP = 1e-3


@dataclass(frozen=True)
class Truth:
    """The law that the rig followed, exponents held, and its terms as the truth file tells them."""

    candidate: Candidate
    terms: tuple[LooseningTerm, ...]

    @property
    def velocity_power(self) -> float | None:
        """Exponent of the velocity, where the law is one power of it; else None."""
        only = self.terms[0]
        plain = len(self.terms) == 1 and not (only.displacement_power or only.velocity_threshold)
        return only.velocity_power if plain else None


def true_candidate(terms: Sequence[LooseningTerm]) -> Candidate:
    """Return the rig's law as a candidate whose exponents no fit moves; coefficients and g(T) are free."""
    found = []
    for term in terms:
        n, q = term.velocity_power, term.displacement_power
        if term.velocity_threshold:
            motion = velocity_threshold(term.velocity_threshold, 5 * term.velocity_threshold, n).held(n=n)
        elif n and q:
            motion = velocity_displacement(n, q).held(n=n, q=q)
        else:
            motion = velocity_power(n).held(n=n) if n else displacement_power(q).held(q=q)
        tension = tension_logistic(term.gamma_i, term.rho) if term.gamma_i else tension_power()
        found.append(Term(motion, tension))
    return Candidate("truth", tuple(found), tuple(10.0**term.gamma_d for term in terms), "truth")


def read_truth(path: Path) -> Truth:
    """Read the truth file of a campaign."""
    plant = json.loads(path.read_text(encoding="utf-8"))["plant"]
    return truth_of(tuple(LooseningTerm(**term) for term in plant["loosening"]))


def truth_of(terms: tuple[LooseningTerm, ...]) -> Truth:
    """Return the truth of a plant whose bolt follows the sum of these terms."""
    return Truth(true_candidate(terms), terms)


def held_out_error(law: Law | Candidate, hold_out: FrozenMotion) -> float:
    """Median over records of the error of the re-simulated loss [%]; infinite where a simulation fails."""
    rate = law.law() if isinstance(law, Candidate) else law
    model = hold_out.model.with_tension_law(rate, hold_out.link)
    errors = []
    for course, change in zip(hold_out.courses, hold_out.change, strict=True):
        initial = max(course.initial, 0.0)
        means = model.mean_tensions(
            course.force[None], course.rate_hz, np.array([initial]), course.edges_s[None], {}, course.body
        )
        errors.append(100 * abs(float(means[0, -1]) - initial - change[-1]) / abs(change[-1]))
    return float(np.median(np.nan_to_num(errors, nan=np.inf)))


def slopes(law: Law, weight: Law, frozen: FrozenMotion) -> tuple[float, float]:
    """Slopes of the log rate over ln abs(v) and ln abs(x), weighted along the motion by another law's loss.

    (4, 0) for the law of the paper: what drives the loosening, whatever form the rate is written in.
    """
    time, x, v, force, damping, tension = frozen.nodes
    shares = np.abs(weight.rate(tension, x, v, force, damping)) * np.gradient(time)
    shares = np.where(time > 0, shares, 0.0)
    for first, last in zip(frozen.starts[:-1], frozen.starts[1:], strict=True):
        shares[first:last] /= max(float(shares[first:last].sum()), 1e-300)

    def log_rate(of_x: float, of_v: float) -> FloatArray:
        bent = force - damping
        moved = law.rate(tension, x * of_x, v * of_v, bent * of_x + damping * of_v, damping * of_v)
        return np.asarray(np.log(np.maximum(-moved, 1e-300)))

    up, down = 1 + _STEP, 1 - _STEP
    pairs = ((log_rate(1, up), log_rate(1, down)), (log_rate(up, 1), log_rate(down, 1)))
    found = [float((shares * (a - b)).sum() / (shares.sum() * np.log(up / down))) for a, b in pairs]
    return found[0], found[1]


def same_motion(law: Law, truth: Truth, frozen: FrozenMotion) -> bool:
    """Whether a law is driven by velocity and displacement as the true law is."""
    true = truth.candidate.law()
    pairs = zip(slopes(law, true, frozen), slopes(true, true, frozen), strict=True)
    return all(abs(ours - theirs) <= ALIKE for ours, theirs in pairs)


def form(candidate: Candidate) -> tuple[tuple[str, str], ...]:
    """Motion and tension factors of all terms without their numbers."""
    return tuple(sorted((term.motion.text, term.tension.text) for term in candidate.terms))


def curve_error(candidate: Candidate, truth: Truth) -> float:
    """Largest error [%] of the coefficient times g(T)/T from 20 to 3000 N; nan for several terms."""
    if len(truth.terms) != 1 or len(candidate.terms) != 1:
        return float("nan")
    true, ours = (
        c.coefficients[0] * c.terms[0].tension.of_tension(CURVE_N) for c in (truth.candidate, candidate)
    )
    return 100.0 * float(np.max(np.abs(ours / true - 1)))
