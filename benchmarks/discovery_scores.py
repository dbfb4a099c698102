"""A ranking of tension laws scored against the truth that the virtual rig wrote beside the campaign."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery_peers import laws_of_peers
from benchmarks.discovery_specimens import frozen_courses
from benchmarks.discovery_truth import Truth, curve_error, form, held_out_error, read_truth, same_motion
from discovery.courses.fit import refine
from discovery.courses.frozen_motion import FrozenMotion
from discovery.laws.candidate import BASELINE
from discovery.ranking.result import Ranking
from experiments.studies import rig
from rom.campaign.campaign import Campaign, read_campaign

SURE = 0.01  # chance below which a law is called better than the baseline


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


def measured(ranking: Ranking, campaign: Path) -> dict[str, Any]:
    """Return the score of a cell of an experiment as columns of its table; without times: these vary."""
    scores = asdict(score(ranking, read_truth(rig.truth_path(campaign))))
    return {name: value for name, value in scores.items() if name not in ("seconds", "peers")}


def measured_with_peers(ranking: Ranking, campaign: Path) -> dict[str, Any]:
    """Return the same with the scores of other programs, times among them."""
    path = rig.truth_path(campaign)
    seed = json.loads(path.read_text(encoding="utf-8"))["seed"]
    peers = score_peers(read_campaign(campaign), ranking, read_truth(path), seed)
    of_peers = {f"peers.{name}.{key}": v for name, one in peers.items() for key, v in asdict(one).items()}
    return {**measured(ranking, campaign), **of_peers}


def trial_of(cell: Mapping[str, Any]) -> Trial:
    """Return the score in a cell of ``experiment.json``; what is null there was no number."""
    names = [one.name for one in fields(Trial) if one.name not in ("seconds", "peers")]
    values = {name: np.nan if cell[name] is None else cell[name] for name in names}
    peers: dict[str, dict[str, Any]] = {}
    for key, value in cell.items():
        if key.startswith("peers."):
            name, what = key.removeprefix("peers.").rsplit(".", 1)
            peers.setdefault(name, {})[what] = np.inf if value is None else value
    return Trial(
        **values, seconds=cell["elapsed_s"], peers={name: Peer(**one) for name, one in peers.items()}
    )
