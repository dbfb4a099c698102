"""Whether probabilities of laws are what they say, and whether predictions averaged by them are better.

``python -m benchmarks.law_probabilities --races 300 --out FOLDER`` runs races between given forms on
simulated tension histories, each of one of ten hidden laws, between-test variability and noise drawn for each
race. Every race is a file in the folder, so that a run that was stopped goes on. The probability of a law is
right if the law is the hidden form (`place_of`). That of the first law's set is the sum over it and
those not told apart from it, and is right if the hidden form is one of them. Calibration error: the mean of
abs(mean probability - share that was right) over bins of a tenth, weighted by how many are in a bin (expected
calibration error).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy import stats

from benchmarks.discovery import contenders
from benchmarks.discovery_truth import LAWS, form, truth_of
from discovery.courses.fit import log_predictive
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.laws.candidate import Candidate
from discovery.ranking.averaging import Weighted, averaged_log_density, log_densities
from discovery.ranking.pairwise import compare_laws, not_told_apart
from discovery.ranking.race import race
from discovery.ranking.result import RankedLaw
from rom.campaign.channels import FloatArray
from rom.campaign.record import replacing
from rom.parameters.he_2025 import paper_model
from tests.discovery.synthetic import measured

PRELOADS = (8.0, 20.0, 60.0, 150.0, 300.0, 700.0, 1500.0, 3000.0)
UNSEEN = (14.0, 100.0, 500.0, 2000.0)
VARIABILITY = 0.1, 0.5  # standard deviation of ln rate between tests
NOISE = 1.0, 10.0  # times that of the rig
_COMPARED = 6


@dataclass(frozen=True)
class Race:
    """What a race said, and whether it was right.

    Attributes
    ----------
    probabilities : tuple of float
        Of the laws listed, the first one first.
    hidden : int
        Place of the hidden form among them; -1 if it is not listed.
    of_set, set_holds : float, bool
        Probability of the first law with those not told apart from it, and whether the hidden form is one.
    single, single_integrated, averaged : float
        Log density of eight tests that no fit saw: the first law with its numbers as fitted, with its numbers
        integrated out, and the average of all laws, their numbers integrated out.
    """

    law: str
    seed: int
    probabilities: tuple[float, ...]
    hidden: int
    of_set: float
    set_holds: bool
    single: float
    single_integrated: float
    averaged: float


def run(number: int) -> Race:
    """Run one race; its number decides the hidden law and all that is drawn."""
    name, seed = list(LAWS)[number % len(LAWS)], number // len(LAWS)
    rng = np.random.default_rng([seed, 5])
    scatter, noise = rng.uniform(*VARIABILITY), float(np.exp(rng.uniform(*np.log(NOISE))))
    law = truth_of(LAWS[name]).candidate
    seen, unseen = (
        freeze(
            paper_model(),
            measured(
                law, preloads=preloads, strengths=strengths, scatter=scatter, noise=noise, seed=own,
                length_s=0.5,
            ),
        )
        for preloads, strengths, own in ((PRELOADS, (1.0, 0.7), seed), (UNSEEN, (1.0, 0.6), seed + 50000))
    )  # fmt: skip
    with np.errstate(all="ignore"):
        laws = race(contenders(), seen, seed=seed)
        return _scored(name, seed, law, laws, seen, unseen)


def _scored(
    name: str, seed: int, true: Candidate, laws: Sequence[RankedLaw], seen: FrozenMotion, unseen: FrozenMotion
) -> Race:
    first, compared = laws[0], laws[:_COMPARED]
    fits = [replace(law.fit, candidate=law.candidate) for law in compared]
    pairs = compare_laws(fits, seen, {law.name: law.scores for law in compared})
    alike = {first.name, *not_told_apart(pairs, first.name)}
    hidden = place_of(true, laws)
    weighted = [Weighted(law.name, law.fit, law.probability) for law in laws]
    return Race(
        name,
        seed,
        tuple(law.probability for law in laws),
        hidden,
        sum(law.probability for law in laws if law.name in alike),
        hidden >= 0 and laws[hidden].name in alike,
        float(log_predictive(first.fit, unseen).sum()),
        float(log_densities(first.fit, unseen).sum()),
        float(averaged_log_density(weighted, unseen).sum()),
    )


def place_of(true: Candidate, laws: Sequence[RankedLaw]) -> int:
    """Place of the hidden form: the same law, else with its exponents free, else as a look-alike; or -1."""
    same = [k for k, law in enumerate(laws) if law.candidate.key == true.key]
    freer = [k for k, law in enumerate(laws) if form(law.candidate) == form(true)]
    freer.sort(key=lambda k: -laws[k].free_numbers)
    alike = [k for k, law in enumerate(laws) if true.equation in law.look_alikes]
    return next(iter((*same, *freer, *alike)), -1)


def bins_of(probability: FloatArray, right: FloatArray) -> list[tuple[int, float, float]]:
    """How many probabilities are in each tenth, their mean, and the share that was right."""
    places = np.minimum((10 * probability).astype(int), 9)
    return [
        (int((places == b).sum()), float(probability[places == b].mean()), float(right[places == b].mean()))
        for b in range(10)
        if (places == b).any()
    ]


def calibration_error(probability: FloatArray, right: FloatArray) -> float:
    """Expected calibration error over tenths."""
    rows = bins_of(probability, right)
    return sum(count * abs(mean - share) for count, mean, share in rows) / len(probability)


def all_pairs(races: Sequence[Race]) -> tuple[FloatArray, FloatArray]:
    """Probability of every law of every race, and whether it is the hidden form."""
    pairs = [(p, float(k == r.hidden)) for r in races for k, p in enumerate(r.probabilities)]
    probability, right = np.array(pairs).T
    return probability, right


def first_sets(races: Sequence[Race]) -> tuple[FloatArray, FloatArray]:
    """Probability of the first law with those not told apart from it, and whether the hidden form is one."""
    return np.array([r.of_set for r in races]), np.array([float(r.set_holds) for r in races])


def first_laws(races: Sequence[Race]) -> tuple[FloatArray, FloatArray]:
    """Probability of the first law, and whether it is the hidden form."""
    return np.array([r.probabilities[0] for r in races]), np.array([float(r.hidden == 0) for r in races])


def report(races: Sequence[Race]) -> str:
    """The tables."""
    lines = [
        f"{len(races)} races; the hidden form is not listed in {sum(r.hidden < 0 for r in races)}",
        "",
        "| what is likely | calibration error | mean probability | share right |",
        "|---|---|---|---|",
    ]
    kinds = {"every law": all_pairs, "the first law": first_laws, "the first law's set": first_sets}
    for name, chosen in kinds.items():
        probability, right = chosen(races)
        error = calibration_error(probability, right)
        lines.append(f"| {name} | {error:.3f} | {probability.mean():.2f} | {right.mean():.2f} |")
    lines += ["", "| tenth | laws | mean probability | share right |", "|---|---|---|---|"]
    for count, mean, share in bins_of(*all_pairs(races)):
        lines.append(f"| {int(min(10 * mean, 9)) / 10:.1f} | {count} | {mean:.3f} | {share:.3f} |")
    lines += ["", "| the average against | better in | log score, mean gain |", "|---|---|---|"]
    averaged = np.array([r.averaged for r in races])
    others = {
        "the first law as fitted": "single",
        "the first law, its numbers integrated out": "single_integrated",
    }
    for name, key in others.items():
        gain = averaged - np.array([getattr(r, key) for r in races])
        lines.append(f"| {name} | {100 * np.mean(gain > 0):.0f} % | {gain.mean():+.2f} |")
    return "\n".join(lines)


def diagram(races: Sequence[Race], path: Path) -> None:
    """Draw how often laws of a probability are the hidden form; bars: calibrated ones, 95 of 100."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.4, 3.2), layout="constrained")
    axes = figure.subplots()
    count, mean, share = np.array(bins_of(*all_pairs(races))).T
    low, high = (np.array(ends) / count for ends in stats.binom.interval(0.95, count, mean))
    axes.vlines(mean, low, high, color="0.75", lw=3)
    axes.plot(mean, share, "o", ms=4, color="#0072B2")
    for x, y, n in zip(mean, share, count, strict=True):
        axes.annotate(f"{n:.0f}", (x, y), xytext=(5, -9), textcoords="offset points", fontsize=7, color="0.4")
    axes.set(xlabel="Probability of a law [1]", ylabel="Share that is the hidden form [1]", aspect="equal")
    figure.savefig(path)


def raced(number: int, folder: Path) -> Race:
    """The race of a number, from its file where there is one."""
    path = folder / f"race-{number:04d}.json"
    if path.is_file():
        found = json.loads(path.read_text(encoding="utf-8"))
        return Race(**(found | {"probabilities": tuple(found["probabilities"])}))
    made = run(number)
    with replacing(path) as part:
        part.write_text(json.dumps(asdict(made)), encoding="utf-8")
    print(f"race {number}: {made}", flush=True)
    return made


def main() -> None:
    """Run the races that are not there, and print the tables of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--races", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("law-probabilities"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--diagram", type=Path, help="file for the reliability diagram")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    races = Parallel(n_jobs=options.jobs)(delayed(raced)(k, options.out) for k in range(options.races))
    print(report(races))
    if options.diagram:
        diagram(races, options.diagram)


if __name__ == "__main__":
    main()
