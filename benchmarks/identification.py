"""How near identification comes to the truth of the virtual rig, and how often its limits hold it.

``python -m benchmarks.identification --seeds 10 --cases 20 --noise 1`` makes a campaign per seed (no scatter
of gamma from test to test, no record held out), identifies it, and prints medians and spread over the seeds.
The truth is read for scoring alone, from the file beside the campaign.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from experiments.studies import rig
from rom.campaign.campaign import read_campaign
from rom.criteria.identification import RULES
from rom.identification.curve_fits import gamma_curve, link_curve
from rom.identification.identify import Identification, identify_campaign
from rom.identification.joint import JointEstimate
from rom.model.laws import Law, logistic_damping, logistic_loosening, logistic_stiffness

SOFT_N = 150.0
GRID_N = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 3000.0)
FLEXURES = {
    "k_LO": "flexure_lo.stiffness.k",
    "k_SO": "flexure_so.stiffness.k",
    "c_LO": "flexure_lo.damping.c",
    "c_SO": "flexure_so.damping.c",
}
_Z95 = 1.959964
LARGEST_GAMMA = "gamma(T), largest from 20 to 3000 N"
TARGETS = {  # largest error [%] at the median over seeds
    "k_LO": 2.0,
    "k_SO": 2.0,
    f"k_C(T), largest below {SOFT_N:g} N": 5.0,
    f"c_C(T), largest where damping ratio < {RULES.modal_damping:g}": 10.0,
    LARGEST_GAMMA: 10.0,
    **{f"gamma(T) at {tension:g} N": 10.0 for tension in GRID_N},
}
COVERAGE_TARGET = (0.85, 0.99)


@dataclass(frozen=True)
class Truth:
    """What the rig hid: numbers of the plant, its laws, and the true tension of every record [N]."""

    numbers: Mapping[str, float]
    laws: Mapping[str, Law]
    tension: Mapping[str, float]


@dataclass(frozen=True)
class Trial:
    """Errors [%] of one identification and whether its 95 % limits hold the truth."""

    errors: Mapping[str, float]
    covered: Mapping[str, tuple[bool, ...]]


def read_truth(path: Path) -> Truth:
    """Read the truth file of a campaign."""
    data = json.loads(path.read_text(encoding="utf-8"))
    plant, loosening = data["plant"], data["plant"]["loosening"][0]
    return Truth(
        {
            "k_LO": plant["stiffness_lo"] * plant["stiffening_lo"],
            "k_SO": plant["stiffness_so"] * plant["stiffening_so"],
            "c_LO": plant["damping_lo"],
            "c_SO": plant["damping_so"],
        },
        {
            "stiffness": logistic_stiffness(*(plant[name] for name in ("k_i", "alpha", "beta"))),
            "damping": logistic_damping(*(plant[name] for name in ("c_d", "c_i", "eta"))),
            "tension_rate": logistic_loosening(*(loosening[name] for name in ("gamma_d", "gamma_i", "rho"))),
        },
        {record["file"]: record["tension"] for record in data["records"]},
    )


def identified(
    seed: int, cases: int, noise: float, jobs: int = 2, duration_s: float = 8.5
) -> tuple[Identification, Truth]:
    """Make a campaign in a temporary folder and identify it.

    Parameters
    ----------
    seed : int
        Of the campaign.
    cases : int
        Preloads.
    noise : float
        Over the nominal one.
    jobs : int
        Processes.
    duration_s : float
        Length of a record [s].

    Returns
    -------
    tuple of (Identification, Truth)
        What was identified, and the truth that lay beside the folder.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        rig.run(folder, cases, noise, seed, jobs, duration_s=duration_s, scatter=0.0, hold_out_every=0)
        return identify_campaign(read_campaign(folder, jobs), jobs), read_truth(rig.truth_path(folder))


def score(found: Identification, truth: Truth) -> Trial:
    """Return errors and coverage of an identification."""
    model = found.model
    errors = {
        name: _percent(model.parameter(path).value, truth.numbers[name]) for name, path in FLEXURES.items()
    }
    covered = {
        name: (_within(model.parameter(path), truth.numbers[name]),) for name, path in FLEXURES.items()
    }
    by_law = {place: getattr(model.link_laws["joint"], place) for place in truth.laws}
    for place, law in by_law.items():
        for name, true in truth.laws[place].parameters.items():
            if name != "exponent":
                known = law.parameters.get(name)
                covered[name] = (known is not None and _within(known, true.value),)
    joint_errors, joint_covered = _score_joint(found.joint, by_law, truth)
    gamma_errors, gamma_covered = _score_gamma(found, truth)
    return Trial(errors | joint_errors | gamma_errors, covered | joint_covered | gamma_covered)


def _score_joint(
    joint: Sequence[JointEstimate], laws: Mapping[str, Law], truth: Truth
) -> tuple[dict[str, float], dict[str, tuple[bool, ...]]]:
    """Score k_C and c_C at the true tension of every coupled record: the curves, and record by record."""
    tension = np.array([truth.tension[estimate.file] for estimate in joint])
    light = np.array([estimate.heaviest_damping_ratio < RULES.modal_damping for estimate in joint])
    everywhere = np.ones(len(joint), bool)
    errors: dict[str, float] = {}
    covered: dict[str, tuple[bool, ...]] = {}
    for i, (symbol, place, masks) in enumerate(
        (
            ("k_C", "stiffness", {f"below {SOFT_N:g} N": tension < SOFT_N, "everywhere": everywhere}),
            (
                "c_C",
                "damping",
                {f"where damping ratio < {RULES.modal_damping:g}": light, "everywhere": everywhere},
            ),
        )
    ):
        true = link_curve(truth.laws[place], tension)
        single = np.array([getattr(estimate, place) for estimate in joint])
        for where, mask in masks.items():
            errors[f"{symbol}(T), largest {where}"] = _largest(link_curve(laws[place], tension), true, mask)
            errors[f"{symbol} of one record, largest {where}"] = _largest(single, true, mask)
        width = _Z95 * np.array([estimate.log_errors[i] for estimate in joint])
        covered[f"{symbol} of every coupled record"] = tuple(np.abs(np.log(single / true)) <= width)
    return errors, covered


def _score_gamma(found: Identification, truth: Truth) -> tuple[dict[str, float], dict[str, tuple[bool, ...]]]:
    """Score gamma(T) on the grid, with limits from the covariance of its parameters."""
    law, fit = truth.laws["tension_rate"], found.gamma_fit
    if fit is None:
        return {name: float("inf") for name in TARGETS if name.startswith("gamma")}, {}
    grid, dense = np.array(GRID_N), np.geomspace(GRID_N[0], GRID_N[-1], 200)
    true, ours = gamma_curve(law, grid), gamma_curve(fit.law, grid)
    errors = {f"gamma(T) at {t:g} N": _percent(a, b) for t, a, b in zip(GRID_N, ours, true, strict=True)}
    errors[LARGEST_GAMMA] = _largest(
        gamma_curve(fit.law, dense), gamma_curve(law, dense), np.ones(len(dense), bool)
    )
    width = stats.t.ppf(0.975, max(len(fit.records) - len(fit.free), 1)) * fit.log_error(grid)
    return errors, {"gamma(T) on the grid": tuple(np.abs(np.log(ours / true)) <= width)}


def _within(parameter: object, true: float) -> bool:
    low, high = getattr(parameter, "low", None), getattr(parameter, "high", None)
    return low is not None and high is not None and bool(low <= true <= high)


def _percent(value: float, true: float) -> float:
    return 100.0 * float(value / true - 1.0)


def _largest(values: np.ndarray, true: np.ndarray, mask: np.ndarray) -> float:
    return 100.0 * float(np.max(np.abs(values / true - 1.0)[mask], initial=0.0))


def error_table(trials: Sequence[Trial]) -> list[str]:
    """Return lines of the table of errors: magnitudes over seeds, and the mean with its sign."""
    lines = [
        "| error [%] | median | 5-95 % | worst | mean with sign | target | |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in trials[0].errors:
        values = np.array([trial.errors[name] for trial in trials])
        size = np.abs(values)
        median = float(np.median(size))
        mean = "" if "largest" in name else f"{values.mean():+.2f}"
        target = TARGETS.get(name)
        verdict = "" if target is None else ("met" if median <= target else "MISSED")
        low, high = np.percentile(size, (5, 95))
        lines.append(
            f"| {name} | {median:.2f} | {low:.2f}-{high:.2f} | {size.max():.2f} | {mean} | "
            f"{'' if target is None else f'{target:g}'} | {verdict} |"
        )
    return lines


def coverage_table(trials: Sequence[Trial]) -> list[str]:
    """Return lines of the table of coverage.

    "open": outside the target, but so few trials that chance explains it (95 % Clopper-Pearson interval).
    """
    low, high = COVERAGE_TARGET
    lines = ["| 95 % limits of | held | trials | share [%] | target | |", "|---|---|---|---|---|---|"]
    every: list[bool] = []
    names = list(dict.fromkeys(name for trial in trials for name in trial.covered))
    pooled = {name: [hit for trial in trials for hit in trial.covered.get(name, ())] for name in names}
    for name in names:
        every += pooled[name]
    for name, hits in [*pooled.items(), ("all together", every)]:
        share = float(np.mean(hits))
        interval = stats.binomtest(int(np.sum(hits)), len(hits)).proportion_ci(0.95, "exact")
        overlap = interval.low <= high and interval.high >= low
        verdict = "met" if low <= share <= high else ("open" if overlap else "MISSED")
        lines.append(
            f"| {name} | {int(np.sum(hits))} | {len(hits)} | {100 * share:.1f} | "
            f"{100 * low:g}-{100 * high:g} | {verdict} |"
        )
    return lines


def main() -> None:
    """Print both tables for every level of noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0])
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    for noise in options.noise:
        trials = []
        for seed in range(options.seeds):
            trials.append(score(*identified(seed, options.cases, noise, options.jobs)))
            print(f"noise {noise:g}: seed {seed} done", file=sys.stderr)
        print(f"\n### Noise x {noise:g}, {options.cases} preloads, {options.seeds} seeds\n")
        print("\n".join([*error_table(trials), "", *coverage_table(trials)]), flush=True)


if __name__ == "__main__":
    main()
