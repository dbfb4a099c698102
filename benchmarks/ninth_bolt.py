"""What three hits on a ninth bolt and eight others of its kind say of its loss, and the least error possible.

``python -m benchmarks.ninth_bolt --seeds 40 --noise 0.3 1 3 --out FOLDER`` simulates tension histories of
nine bolts of one hidden law. The typical loss of the ninth at three preloads without a hit is predicted in
four ways: a law of the same form fitted to its three hits alone; the law fitted to the other eight, at its
own rate or at their typical one; and the *oracle*, the hidden law with its form, numbers and standard
deviations known, its rate alone told by the three hits. What the oracle leaves no method lowers. Every repeat
is a file in the folder, so that a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from discovery.courses.fit import fit, predict, with_uncertainty
from discovery.courses.frozen_motion import FrozenMotion, freeze, freeze_bolts
from discovery.laws.candidate import Candidate, Term
from discovery.laws.factors import displacement_power, tension_power
from discovery.ranking.population import bolt_of_courses
from rom.campaign.record import replacing
from rom.parameters.he_2025 import paper_model
from tests.discovery.bolts import bolts_of
from tests.discovery.synthetic import free_power, measured, with_power

BETWEEN, WITHIN = float(np.log(1.6)), 0.3  # standard deviations of ln rate: between bolts, between tests
PRELOADS, FAR = (60.0, 150.0, 700.0), (30.0, 300.0, 1000.0)
LAWS = ("power 4", "power 3", "x^2, constant gamma")


@dataclass(frozen=True)
class Errors:
    """Median error of the typical loss at the preloads without a hit [%]."""

    borrowed: float
    alone: float
    typical: float
    oracle: float


@cache
def hidden(name: str) -> tuple[Candidate, Candidate]:
    """The hidden law, and the form that is fitted, exponents free."""
    if name.startswith("power"):
        return with_power(float(name.split()[1])), free_power()
    tension = tension_power()
    law = Candidate("hidden", (Term(displacement_power(2.0).held(q=2.0), tension),), (1.0,))
    for _ in range(6):  # until 6 N of 150 N are lost, as by the others
        (course,) = measured(law, preloads=(150.0,), strengths=(1.0,), noise=1e-3, length_s=0.5)
        law = rated(law, float(np.log(6.0 / max(-course.change[-1], 1e-6))))
    return law, Candidate("form", (Term(displacement_power(2.5), tension),), (1.0,))


def rated(law: Candidate, deviation: float) -> Candidate:
    """The law with a rate so much larger in logarithm."""
    names = law.coefficient_names
    return law.with_values(dict(zip(names, np.multiply(law.coefficients, np.exp(deviation)), strict=True)))


def run(name: str, noise: float, seed: int) -> Errors:
    """Make nine bolts and predict the ninth."""
    law, form = hidden(name)
    deviations = BETWEEN * np.random.default_rng([seed, 7]).standard_normal(9)
    others = bolts_of(law, deviations[:8], preloads=PRELOADS, scatter=WITHIN, noise=noise, seed=seed)
    courses = freeze_bolts(others)
    shared = with_uncertainty(fit(form, courses), courses)
    own = rated(law, deviations[8])
    hits = measured(
        own, preloads=PRELOADS, strengths=(1.0,), scatter=WITHIN, noise=noise, seed=seed + 900, length_s=0.5
    )
    unseen = freeze(paper_model(), measured(own, preloads=FAR, noise=1e-3, length_s=0.5, seed=3))
    known = replace(shared, candidate=law, scatter=(float(np.log(WITHIN)), 0.0, float(np.log(BETWEEN))))
    borrowed, least = (bolt_of_courses(found, "ninth", paper_model(), hits) for found in (shared, known))
    alone = fit(form, freeze(paper_model(), hits))
    return Errors(
        error_of(shared.candidate, borrowed.deviation.value, unseen),
        error_of(alone.candidate, 0.0, unseen),
        error_of(shared.candidate, 0.0, unseen),
        error_of(law, least.deviation.value, unseen),
    )


def error_of(candidate: Candidate, deviation: float, unseen: FrozenMotion) -> float:
    """Median error of the loss in the last bin [%]."""
    loss = predict(candidate, unseen, np.full(len(unseen), deviation))[:, -1]
    return float(np.median(100 * np.abs(loss / unseen.change[:, -1] - 1)))


def kept(name: str, noise: float, seed: int, folder: Path) -> Errors:
    """The errors of a repeat, from its file where there is one."""
    path = folder / f"{name.replace(' ', '-').replace('^', '')}-{noise:g}-{seed}.json"
    if path.is_file():
        return Errors(**json.loads(path.read_text(encoding="utf-8")))
    with np.errstate(all="ignore"):
        found = run(name, noise, seed)
    with replacing(path) as part:
        part.write_text(json.dumps(asdict(found)), encoding="utf-8")
    return found


def row(name: str, noise: float, found: Sequence[Errors]) -> str:
    """Return the line of a law and a level of noise: medians, and ratios of medians."""
    borrowed, alone, typical, oracle = np.median([list(asdict(one).values()) for one in found], axis=0)
    ratios = f"{borrowed / alone:.2f} | {oracle / alone:.2f} | {borrowed / oracle:.2f}"
    errors = " | ".join(f"{value:.1f}" for value in (borrowed, alone, typical, oracle))
    return f"| {name} | {noise:g} | {len(found)} | {errors} | {ratios} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.3, 1.0, 3.0])
    parser.add_argument("--out", type=Path, default=Path("ninth-bolt"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    columns = (
        "hidden law", "noise", "bolts", "with the other eight [%]", "three hits alone [%]",
        "the other eight alone [%]", "oracle [%]", "first over second", "oracle over second",
        "first over oracle",
    )  # fmt: skip
    print(f"| {' | '.join(columns)} |\n" + "|---" * len(columns) + "|")
    for name in LAWS:
        for noise in options.noise:
            found = [kept(name, noise, seed, options.out) for seed in range(options.seeds)]
            print(row(name, noise, found), flush=True)


if __name__ == "__main__":
    main()
