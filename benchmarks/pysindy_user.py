"""What re-simulation and selection change for a user of pysindy: the same library and optimizer in both.

``python -m benchmarks.pysindy_user --seeds 5 --noise 1 2 --out FOLDER`` measures campaigns of the virtual rig
whose bolt loosens by slip work or by the square of the velocity, with constant gamma. Both get the same terms
and `FROLS`. pysindy alone: `SINDy.fit` on the measured tension and the motion of the identified model, the
derivative by its own methods; its law is then simulated in full. boltlaw: `discover` with that library and
optimizer. Every campaign is a file in the folder, so that a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery_peers import Samples, rate_law, samples_of
from benchmarks.discovery_scores import frozen_of
from benchmarks.discovery_truth import held_out_error
from discovery.ranking.discover import discover
from experiments.rig.rivals import RIVALS
from experiments.studies import rig
from rom.campaign.campaign import read_campaign
from rom.campaign.channels import FloatArray
from rom.campaign.record import replacing
from rom.model.laws import free_form_law

TRUTHS = {"constant-quadratic": "abs(v)**2 * T", "slip-work": "abs(D * v) * T"}
TERMS = (
    "abs(v) * T",
    "abs(v)**2 * T",
    "abs(v)**3 * T",
    "abs(v)**4 * T",
    "abs(x) * T",
    "abs(x)**2 * T",
    "abs(D * v) * T",
)


@dataclass(frozen=True)
class Law:
    """A law that was found: its text, whether it is the hidden term alone, hold-out error of the loss [%]."""

    text: str
    right: bool
    error: float


def library(inputs: str) -> Any:
    """The terms as a library of pysindy over inputs such as ``v, x, T``."""
    from pysindy import CustomLibrary

    functions, names = (
        [eval(f"lambda {inputs}: {body}") for body in bodies]
        for bodies in (TERMS, [repr(term) for term in TERMS])
    )
    return CustomLibrary(functions, names)


def of_pysindy(samples: Samples, damping: Sequence[FloatArray], smoothed: bool) -> dict[str, float]:
    """Coefficients by term of `SINDy` alone: its own derivative, its own regression.

    Parameters
    ----------
    samples : Samples
        Measured tension and the model's v and x, a trajectory for each record.
    damping : sequence of ndarray, shape (samples,)
        Damping part of the joint's force [N] along each.
    smoothed : bool
        Whether its derivative smooths.
    """
    from pysindy import FROLS, FiniteDifference, SINDy, SmoothedFiniteDifference

    model = SINDy(
        optimizer=FROLS(normalize_columns=True),
        feature_library=library("T, v, x, D"),
        differentiation_method=SmoothedFiniteDifference() if smoothed else FiniteDifference(),
    )
    inputs = [np.column_stack([m, d]) for m, d in zip(samples.motion, damping, strict=True)]
    states = [tension[:, None] for tension in samples.tension]
    model.fit(states, t=list(samples.time), u=inputs, feature_names=["T", "v", "x", "D"])
    return {text: float(c) for text, c in zip(TERMS, model.coefficients()[0], strict=True) if c}


def run(hidden: str, noise: float, seed: int) -> dict[str, Law]:
    """Measure a campaign and let all find its law."""
    from pysindy import FROLS

    with tempfile.TemporaryDirectory() as scratch:
        folder = rig.run(
            Path(scratch) / "campaign", 10, noise, seed, 1, duration_s=2.5, strengths=(1.0, 0.6), law=hidden
        )
        campaign = read_campaign(folder)
        ranking = discover(
            campaign, seed=seed, libraries=[library("v, x, T, F, D")], optimizers=[FROLS()], max_terms=2
        )
        training, hold_out = frozen_of(ranking)
        samples, true = samples_of(campaign, training), TRUTHS[hidden]
        first = ranking.laws[0]
        ours = Law(first.name, _is(first.candidate.law(), true), held_out_error(first.candidate, hold_out))
        joint = ranking.identified.link_laws[training.link]
        damping = [joint.damping(t) * m[:, 0] for t, m in zip(samples.tension, samples.motion, strict=True)]
        found = {"boltlaw": ours}
        for name, smoothed in (("pysindy", False), ("pysindy, smoothed derivative", True)):
            terms = of_pysindy(samples, damping, smoothed)
            text = " ".join(f"{c:+.4g} * {term}" for term, c in terms.items())
            law = rate_law("pysindy", text)
            error = held_out_error(law, hold_out) if law else float("inf")
            found[name] = Law(text, list(terms) == [true] and terms[true] < 0, error)
        reference = RIVALS[hidden][0].gamma_d
        exact = free_form_law("truth", f"-{10**reference!r} * {true}", "tension rate", {})
        return found | {"the true law": Law(exact.equation, True, held_out_error(exact, hold_out))}


def _is(law: Any, text: str) -> bool:
    """Whether a law is a multiple of an expression, at random motions."""
    rng = np.random.default_rng(0)
    tension = rng.uniform(5, 3000, 50)
    x, v, damping = (rng.uniform(-size, size, 50) for size in (1e-4, 0.06, 40.0))
    other = free_form_law("one", f"-1 * {text}", "tension rate", {})
    ratio = law.rate(tension, x, v, damping, damping) / other.rate(tension, x, v, damping, damping)
    return bool(np.ptp(ratio) < 1e-6 * abs(ratio.mean()))


def kept(hidden: str, noise: float, seed: int, folder: Path) -> dict[str, Law]:
    """The laws of a campaign, from its file where there is one."""
    path = folder / f"{hidden}-{noise:g}-{seed}.json"
    if path.is_file():
        return {name: Law(**law) for name, law in json.loads(path.read_text(encoding="utf-8")).items()}
    with np.errstate(all="ignore"):
        found = run(hidden, noise, seed)
    with replacing(path) as part:
        part.write_text(json.dumps({name: asdict(law) for name, law in found.items()}), encoding="utf-8")
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0, 2.0])
    parser.add_argument("--out", type=Path, default=Path("pysindy-user"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print(
        "| hidden law | noise | who | hidden term alone | error of the loss, hold-out [%] |\n"
        + 5 * "|---"
        + "|"
    )
    for hidden, term in TRUTHS.items():
        for noise in options.noise:
            found = [kept(hidden, noise, seed, options.out) for seed in range(options.seeds)]
            for name in found[0]:
                laws = [one[name] for one in found]
                errors = np.array([law.error for law in laws])
                spread = f"{np.median(errors):.3g} ({errors.min():.3g}-{errors.max():.3g})"
                right = f"{sum(law.right for law in laws)} of {len(laws)}"
                print(f"| `{term}` | {noise:g} | {name} | {right} | {spread} |", flush=True)


if __name__ == "__main__":
    main()
