"""10,000 tension laws over 58 cases along a frozen motion: ``python -m benchmarks.screening [all]``.

The laws are scored by the median error of the loss against the paper's own. The 400 best of the screening and
400 others at random (with ``all``: every law, some ten minutes) are simulated in full, and the table says how
far down the screening's order the best of those come from.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from rich.console import Console

from benchmarks.frozen_screening import freeze, screen
from benchmarks.peers import RATE_HZ, FloatArray
from benchmarks.simulation import NOISE_N, hit
from rom.model.laws import Law, logistic_loosening, power_loosening
from rom.parameters.he_2025 import paper_model

FULL, OTHERS = 400, 400


def candidates(count: int, rng: np.random.Generator) -> list[Law]:
    """Logistic laws round the paper's with exponents from 1 to 6, and a tenth with constant gamma."""
    laws = []
    for number in range(count):
        exponent = float(rng.uniform(1.0, 6.0))
        # as the rate at 50 mm/s goes with the power, gamma keeps its size there
        shift = (exponent - 4.0) * np.log10(1.0 / 0.05) + rng.normal(0.0, 0.3)
        if number % 10 == 0:
            laws.append(power_loosening(10 ** (rng.uniform(3.0, 8.0) + shift), exponent))
        else:
            depth, rho = rng.normal(7.974, 0.5), -0.00362 * rng.lognormal(0.0, 0.3)
            laws.append(logistic_loosening(11.79 + shift, depth, rho, exponent))
    return laws


def main(count: int = 10_000, cases: int = 58, full_count: int = FULL, others: int = OTHERS) -> None:
    """Print times and the agreement of both orders."""
    console, model, rng = Console(width=120), paper_model(), np.random.default_rng(4)
    forces = np.stack([hit(peak, NOISE_N, rng) for peak in rng.normal(1608.7, 81.65, cases)])
    tensions = np.geomspace(5.8, 3013.0, cases)
    exact = tensions - model.final_tension(forces, RATE_HZ, tensions)

    def score(final: FloatArray) -> float:
        return float(np.nan_to_num(np.median(abs(tensions - final - exact) / exact), nan=np.inf))

    start = time.perf_counter()
    motion = freeze(model, forces, RATE_HZ, tensions, 0.5)
    frozen = time.perf_counter()
    laws = candidates(count, rng)
    made = time.perf_counter()
    screened = screen(motion, laws, jobs=2)
    done = time.perf_counter()
    console.print(f"freeze {cases} motions: {frozen - start:.2f} s ({motion.nodes.shape[2]} nodes each)")
    console.print(f"screen {count} laws x {cases} cases on two threads: {done - made:.1f} s")
    own = screen(motion, [model.link_laws["joint"].tension_rate or power_loosening(0.0)])[0]
    console.print(
        f"the model's own law: largest error of the loss {np.max(abs(tensions - own - exact) / exact):.1e}"
    )
    order = np.argsort([score(final) for final in screened])
    rest = rng.permutation(np.arange(full_count, count))[:others]
    places = np.concatenate([np.arange(min(full_count, count)), rest])
    start = time.perf_counter()
    full = [
        score(model.with_tension_law(laws[i]).final_tension(forces, RATE_HZ, tensions)) for i in order[places]
    ]
    spent = time.perf_counter() - start
    console.print(
        f"simulate the {full_count} best and {len(rest)} others in full on one thread: {spent:.1f} s"
    )
    best = places[np.argsort(full)[:20]]
    console.print(f"the 20 best of these come from places {sorted((best + 1).tolist())} of the screening")


if __name__ == "__main__":
    main(full_count=10_000 if "all" in sys.argv[1:] else FULL)
