"""How often discovery finds the tension law that the virtual rig hid, and how well.

``python -m benchmarks.discovery --seeds 10 --laws eq13 power-2 --noise 1 --scatter 1`` makes a campaign per
law and seed (20 preloads, hits of 100, 80 and 60 % of full strength), discovers on the folder alone, and
scores the ranking against the truth beside it, read only then. A table per noise level, a row per law;
``--peers`` adds a table of other programs on the same records. ``--forms`` is quick: a race of given forms,
all started alike, in place of the search, and one identification for all laws of a seed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from benchmarks.discovery_peers import SYMBOLIC, laws_of_peers, missing
from benchmarks.discovery_specimens import (
    Setting,
    Specimen,
    frozen_courses,
    measure,
    specimen_of,
)
from benchmarks.discovery_truth import (
    LAWS,
    Truth,
    curve_error,
    form,
    held_out_error,
    read_truth,
    same_motion,
)
from discovery.courses.fit import refine
from discovery.courses.frozen_motion import FrozenMotion
from discovery.laws.candidate import BASELINE, Candidate, Term
from discovery.laws.factors import (
    displacement_power,
    dissipated_power,
    tension_logistic,
    tension_power,
    velocity_displacement,
    velocity_power,
    velocity_threshold,
)
from discovery.ranking.confidence_sets import exponent_profile
from discovery.ranking.discover import discover
from discovery.ranking.pairwise import compare_laws, not_told_apart
from discovery.ranking.race import race
from discovery.ranking.result import Ranking
from experiments.studies import rig
from rom.campaign.campaign import Campaign
from rom.identification.identify import Identification

SURE = 0.01


@dataclass(frozen=True)
class Peer:
    """Another program's law: held-out loss error over ours, if it is driven as the truth, time [s]."""

    ratio: float
    motion: bool
    seconds: float


@dataclass(frozen=True)
class Trial:
    """One ranking scored: exponents, forms, errors in percent, chance, time. nan: there is none."""

    winner: str
    exponent: float
    low: float
    high: float
    holds: float
    form: str  # "true", "listed" among those not told apart from the winner, or "other"
    motion: bool
    curve: float
    winner_error: float
    truth_error: float
    baseline_error: float
    smallest_p: float
    seconds: float
    peers: Mapping[str, Peer] = field(default_factory=dict)


def frozen_of(ranking: Ranking) -> tuple[FrozenMotion, FrozenMotion]:
    """Motion and courses of a ranking's training records and of those held out."""
    return frozen_courses(ranking.identified, ranking.courses)


def score(
    ranking: Ranking,
    truth: Truth,
    seconds: float = float("nan"),
    frozen: tuple[FrozenMotion, FrozenMotion] | None = None,
) -> Trial:
    """Score a ranking against the truth: the true law is refitted to the same records for comparison.

    ``frozen`` is what `frozen_of` returns for the ranking, where it is at hand.
    """
    training, hold_out = frozen or frozen_of(ranking)
    first, fitted = ranking.laws[0], refine(truth.candidate, training)
    power, profile = truth.velocity_power, ranking.profile
    told = power is not None and profile is not None
    better = [p for law in ranking.laws if (p := law.p_value_against_baseline) is not None]
    return Trial(
        winner=first.name,
        exponent=profile.best if told else float("nan"),
        low=profile.low if told else float("nan"),
        high=profile.high if told else float("nan"),
        holds=float(profile.holds(power)) if told else float("nan"),
        form=_found_form(ranking, truth),
        motion=same_motion(first.candidate.law(), truth, training),
        curve=curve_error(fitted.candidate, truth),
        winner_error=held_out_error(first.candidate, hold_out),
        truth_error=held_out_error(fitted.candidate, hold_out),
        baseline_error=held_out_error(ranking[BASELINE].candidate, hold_out),
        smallest_p=min(better, default=1.0),
        seconds=seconds,
    )


def _found_form(ranking: Ranking, truth: Truth) -> str:
    first, true = ranking.laws[0], form(truth.candidate)
    if form(first.candidate) == true:
        return "true"
    alike = [law for law in ranking.laws if law.name in ranking.indistinguishable]
    texts = [text for law in (first, *alike) for text in law.look_alikes]
    listed = any(form(law.candidate) == true for law in alike) or truth.candidate.equation in texts
    return "listed" if listed else "other"


def _forms() -> dict[str, tuple[Term, ...]]:
    gamma, n, q = tension_logistic(), velocity_power(3.5), displacement_power(3.0)
    both = Term(velocity_power(4.0).held(n=4.0), gamma), Term(displacement_power(2.0).held(q=2.0), gamma)
    return {
        "velocity": (Term(n, gamma),),
        "velocity-constant-gamma": (Term(n, tension_power()),),
        "displacement": (Term(q, gamma),),
        "displacement-constant-gamma": (Term(q, tension_power()),),
        "velocity-times-displacement": (Term(velocity_displacement(2.0, 1.0), gamma),),
        "velocity-threshold": (Term(velocity_threshold(0.01, 0.1, 3.0), gamma),),
        "dissipated-power": (Term(dissipated_power(1.5), gamma),),
        "velocity-and-displacement": both,
    }


FORMS = tuple(_forms())


def contenders(names: Sequence[str] = FORMS) -> list[Candidate]:
    """Forms that a race without search is between, beside those that are always in it."""
    forms = _forms()
    return [Candidate(name, forms[name], (1.0,) * len(forms[name]), "contender") for name in names]


def race_of_forms(
    found: Specimen, seed: int, names: Sequence[str] = FORMS, *, profiled: bool = True
) -> Ranking:
    """Rank the contenders, with the profile of the exponent in the first one where that is asked for."""
    laws = race(contenders(names), found.training, seed=seed)
    compared = laws[:6]
    fits = [replace(law.fit, candidate=law.candidate) for law in compared]
    pairs = compare_laws(fits, found.training, {law.name: law.scores for law in compared})
    return Ranking(
        laws=laws,
        considered=len(laws),
        identified=found.training.model,
        inclusion={},
        profile=exponent_profile(found.training, laws[0].candidate) if profiled else None,
        indistinguishable=not_told_apart(pairs, laws[0].name),
        courses=(*found.training.courses, *found.hold_out.courses),
    )


def run_seed(
    seed: int, laws: Sequence[str], setting: Setting, forms: Sequence[str] = (), peers: bool = False
) -> list[Trial]:
    """Make a campaign for every law and score what is found; with ``forms``, identify the plant once."""
    trials: list[Trial] = []
    known: Identification | None = None
    for law in laws:
        with tempfile.TemporaryDirectory() as scratch:
            campaign = measure(Path(scratch) / "campaign", law, seed, setting)
            started = time.perf_counter()
            if forms:
                found = specimen_of(campaign, known)
                known = found.identified
                ranking = race_of_forms(found, seed, forms)
            else:
                ranking = discover(campaign, seed=seed)
            truth, seconds = read_truth(rig.truth_path(campaign.path)), time.perf_counter() - started
            trial = score(ranking, truth, seconds)
            trials.append(
                replace(trial, peers=score_peers(campaign, ranking, truth, seed)) if peers else trial
            )
        print(f"noise {setting.noise:g}, {law}, seed {seed}: {trials[-1]}", file=sys.stderr, flush=True)
    return trials


def score_peers(campaign: Campaign, ranking: Ranking, truth: Truth, seed: int) -> dict[str, Peer]:
    """Score what other programs find in the training records of a ranking."""
    training, hold_out = frozen_of(ranking)
    ours = held_out_error(ranking.laws[0].candidate, hold_out)
    return {
        name: Peer(
            held_out_error(found.law, hold_out) / ours if found.law else float("inf"),
            found.law is not None and same_motion(found.law, truth, training),
            found.seconds,
        )
        for name, found in laws_of_peers(campaign, training, held_out_error, seed).items()
    }


COLUMNS = (
    "seeds",
    "exponent of v",
    "95 % set holds it",
    "its width",
    "form true / listed / other",
    "driven as the truth",
    "gamma(T) curve of the true form, largest error [%]",
    "held-out loss error [%]",
    "over true law's, refitted",
    "over baseline's",
    "called better than the baseline",
    "time [s]",
)


def row(law: str, trials: Sequence[Trial]) -> str:
    """Return the line of a law: medians, smallest to largest in brackets, counts."""
    count = len(trials)

    def spread(value: Callable[[Trial], float], digits: int = 2) -> str:
        values = np.array([value(trial) for trial in trials])
        values = values[~np.isnan(values)]
        if not values.size:
            return "-"
        return f"{np.median(values):.{digits}f} ({values.min():.{digits}f}-{values.max():.{digits}f})"

    held = [trial.holds for trial in trials if not np.isnan(trial.holds)]
    forms = [trial.form for trial in trials]
    cells = [
        spread(lambda t: t.exponent),
        f"{sum(held):.0f} of {len(held)}" if held else "-",
        spread(lambda t: t.high - t.low),
        " / ".join(str(forms.count(name)) for name in ("true", "listed", "other")),
        f"{sum(t.motion for t in trials)} of {count}",
        spread(lambda t: t.curve, 0),
        spread(lambda t: t.winner_error, 1),
        spread(lambda t: t.winner_error / t.truth_error),
        spread(lambda t: t.winner_error / t.baseline_error),
        f"{sum(t.smallest_p < SURE for t in trials)} of {count}",
        spread(lambda t: t.seconds, 0),
    ]
    return "| " + " | ".join([law, str(count), *cells]) + " |"


PEER_COLUMNS = ("held-out loss error over ours", "driven as the truth (ours)", "time [s] (ours)")


def peer_rows(law: str, trials: Sequence[Trial]) -> list[str]:
    """Return a line for every peer: medians, smallest to largest in brackets, counts."""
    lines = []
    ours = sum(t.motion for t in trials), float(np.median([t.seconds for t in trials]))
    for name in trials[0].peers:
        of = [trial.peers[name] for trial in trials]
        ratios = np.array([peer.ratio for peer in of])
        seconds = float(np.median([peer.seconds for peer in of]))
        cells = [
            f"{np.median(ratios):.3g} ({ratios.min():.3g}-{ratios.max():.3g})",
            f"{sum(peer.motion for peer in of)} of {len(of)} ({ours[0]})",
            f"{seconds:.0f} ({ours[1]:.0f})",
        ]
        lines.append(f"| {law}: {name} | {' | '.join(cells)} |")
    return [*lines, *(f"| {law}: {name} | not installed | - | - |" for name in missing())]


def header(columns: Sequence[str], first: str = "truth") -> str:
    """Return the two lines that open a table."""
    return "\n".join([f"| {' | '.join([first, *columns])} |", "|---" * (len(columns) + 1) + "|"])


def options_given() -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--laws", nargs="+", choices=list(LAWS), default=list(LAWS))
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0])
    parser.add_argument("--scatter", type=float, default=1.0)
    parser.add_argument("--duration", type=float, default=8.5, help="length of a record [s]")
    parser.add_argument("--strengths", default="1,0.8,0.6", help="hits per preload, shares of full strength")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--forms", nargs="*", choices=FORMS, help="race of these (none named: all) in place of the search"
    )
    parser.add_argument("--peers", action="store_true", help=f"pysindy alone, and {', '.join(SYMBOLIC)}")
    return parser.parse_args()


def main() -> None:
    """Print a table for every level of noise."""
    options = options_given()
    strengths = rig.strengths_from_text(options.strengths)
    for noise in options.noise:
        setting = Setting(noise, options.scatter, options.duration, strengths)
        print(
            f"\n### Noise x {noise:g}, scatter x {options.scatter:g}, hits {options.strengths}, records of "
            f"{options.duration:g} s, {options.seeds} seeds\n",
            flush=True,
        )
        seeds = range(options.first, options.first + options.seeds)
        forms = () if options.forms is None else options.forms or FORMS
        given = options.laws, setting, forms, options.peers
        by_seed = Parallel(n_jobs=options.jobs)(delayed(run_seed)(seed, *given) for seed in seeds)
        by_law = {law: [trials[k] for trials in by_seed] for k, law in enumerate(options.laws)}
        print("\n".join([header(COLUMNS), *(row(law, trials) for law, trials in by_law.items())]), flush=True)
        if options.peers:
            lines = [line for law, trials in by_law.items() for line in peer_rows(law, trials)]
            print("\n".join(["", header(PEER_COLUMNS, "truth: program"), *lines]), flush=True)


if __name__ == "__main__":
    main()
