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
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery_peers import Samples, rate_law, samples_of
from benchmarks.discovery_scores import frozen_of
from discovery.courses.frozen_motion import FrozenMotion
from discovery.ranking.discover import discover
from experiments.rig.rivals import RIVALS
from experiments.studies import rig
from rom.campaign.campaign import read_campaign
from rom.campaign.channels import FloatArray
from rom.campaign.record import replacing
from rom.model.laws import Law as RateLaw
from rom.model.laws import free_form_law

TRUTHS = {"slip-work": "abs(D * v) * T", "constant-quadratic": "abs(v)**2 * T"}
MOST = 2  # terms
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
    """A law that was found: its text, and whether it is the hidden term alone.

    Errors of its loss on hold-out records [%], medians: over the measured loss, most of which is the
    between-test variability, and over what the hidden law typically loses there.
    """

    text: str
    right: bool
    error: float
    of_typical: float


def library(inputs: str) -> Any:
    """The terms as a library of pysindy over inputs such as ``v, x, T``."""
    from pysindy import CustomLibrary

    functions, names = (
        [eval(f"lambda {inputs}: {body}") for body in bodies]
        for bodies in (TERMS, [repr(term) for term in TERMS])
    )
    return CustomLibrary(functions, names)


def of_pysindy(
    samples: Samples, damping: Sequence[FloatArray], smoothed: bool, most: int | None
) -> dict[str, float]:
    """Coefficients by term of `SINDy` alone: its own derivative, its own regression.

    Parameters
    ----------
    samples : Samples
        Measured tension and the model's v and x, a trajectory for each record.
    damping : sequence of ndarray, shape (samples,)
        Damping part of the joint's force [N] along each.
    smoothed : bool
        Whether its derivative smooths.
    most : int or None
        Terms at most; None: its own choice.
    """
    from pysindy import FROLS, FiniteDifference, SINDy, SmoothedFiniteDifference

    model = SINDy(
        optimizer=FROLS(normalize_columns=True, **({} if most is None else {"max_iter": most})),
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
            campaign, seed=seed, libraries=[library("v, x, T, F, D")], optimizers=[FROLS()], max_terms=MOST
        )
        training, hold_out = frozen_of(ranking)
        samples, true = samples_of(campaign, training), TRUTHS[hidden]
        first = ranking.laws[0]
        exact = free_form_law("truth", f"-{10 ** RIVALS[hidden][0].gamma_d!r} * {true}", "tension rate", {})
        measured, typical = -hold_out.change[:, -1], losses(exact, hold_out)

        def scored(text: str, right: bool, law: RateLaw | None) -> Law:
            lost = np.full(len(typical), np.inf) if law is None else losses(law, hold_out)
            errors = (float(np.median(100 * abs(lost / of - 1))) for of in (measured, typical))
            return Law(text, right, *errors)

        ours = scored(first.name, _is(first.candidate.law(), true), first.candidate.law())
        joint = ranking.identified.link_laws[training.link]
        damping = [joint.damping(t) * m[:, 0] for t, m in zip(samples.tension, samples.motion, strict=True)]
        found = {"boltlaw": ours}
        for most, smoothed in product((None, MOST), (False, True)):
            name = f"pysindy{', smoothed derivative' if smoothed else ''}{f', {MOST} terms' if most else ''}"
            terms = of_pysindy(samples, damping, smoothed, most)
            text = " ".join(f"{c:+.4g} * {term}" for term, c in terms.items())
            found[name] = scored(text, list(terms) == [true] and terms[true] < 0, rate_law("pysindy", text))
        return found | {"the true law": scored(exact.equation, True, exact)}


def _is(law: Any, text: str) -> bool:
    """Whether a law is a multiple of an expression, at random motions."""
    rng = np.random.default_rng(0)
    tension = rng.uniform(5, 3000, 50)
    x, v, damping = (rng.uniform(-size, size, 50) for size in (1e-4, 0.06, 40.0))
    other = free_form_law("one", f"-1 * {text}", "tension rate", {})
    ratio = law.rate(tension, x, v, damping, damping) / other.rate(tension, x, v, damping, damping)
    return bool(np.ptp(ratio) < 1e-6 * abs(ratio.mean()))


def losses(law: RateLaw, hold_out: FrozenMotion) -> FloatArray:
    """Loss of every hold-out record [N] by full simulation of the identified model with a law."""
    model, lost = hold_out.model.with_tension_law(law, hold_out.link), []
    for c in hold_out.courses:
        means = model.mean_tensions(
            c.force[None], c.rate_hz, np.array([c.initial]), c.edges_s[None], {}, c.body
        )
        lost.append(c.initial - float(means[0, -1]))
    return np.nan_to_num(np.array(lost), nan=np.inf)


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
    parser.add_argument("--laws", nargs="+", choices=list(TRUTHS), default=list(TRUTHS))
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0, 2.0])
    parser.add_argument("--out", type=Path, default=Path("pysindy-user"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print(
        "| hidden law | noise | who | hidden term alone | error of the loss, hold-out [%] "
        "| of the typical loss [%] |\n" + 6 * "|---" + "|"
    )
    for hidden, noise in product(options.laws, options.noise):
        found = [kept(hidden, noise, seed, options.out) for seed in range(options.seeds)]
        for name in found[0]:
            laws = [one[name] for one in found]
            right = f"{sum(law.right for law in laws)} of {len(laws)}"
            errors = np.array([[law.error, law.of_typical] for law in laws]).T
            spread = " | ".join(f"{np.median(e):.3g} ({e.min():.3g}-{e.max():.3g})" for e in errors)
            print(f"| `{TRUTHS[hidden]}` | {noise:g} | {name} | {right} | {spread} |", flush=True)


if __name__ == "__main__":
    main()
