"""Cost against the number of bolted links and of cases: ``python -m benchmarks.scaling``.

A chain of equal bodies bolted in a row, struck at its first body, for 8 s at 19200 Hz on one core: up to 60
bodies by blocks, larger ones link by link. And 58 to 5800 cases of the paper's model over 58 records, the
candidates' law differing from call to call.
"""

from __future__ import annotations

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.peers import RATE_HZ
from benchmarks.simulation import NOISE_N, hit, seconds
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.parameters.he_2025 import paper_model


def chain(links: int) -> Model:
    """Bodies in a row, the first held by a flexure, each bolted to the next with the paper's joint."""
    paper = paper_model().link_laws
    bolts = tuple(Link(f"j{i}", f"b{i}", f"b{i + 1}", "bolted") for i in range(links))
    bodies = tuple(Body(f"b{i}", 1.0) for i in range(links + 1))
    laws = {"flexure": paper["flexure_lo"]} | {bolt.name: paper["joint"] for bolt in bolts}
    return Model(Structure(bodies, (Link("flexure", "b0", "ground"), *bolts)), laws)


def links_table() -> Table:
    """Time against the number of links."""
    table = Table(title="8 s of a chain, one core")
    for name in ("bolted links", "s", "ms per link"):
        table.add_column(name, justify="right")
    force = hit(100.0, NOISE_N, np.random.default_rng(2))[None]
    for links in (1, 2, 5, 10, 20, 50, 100, 200):
        model, tensions = chain(links), np.full((1, links), 150.0)
        start = tensions if links > 1 else tensions[0]
        call = lambda m=model, s=start: m.final_tension(force, RATE_HZ, s)  # noqa: E731 - timed below
        call()
        spent = seconds(call, 1 if links > 20 else 3)
        table.add_row(f"{links}", f"{spent:.4f}", f"{1e3 * spent / links:.2f}")
    return table


def cases_table() -> Table:
    """Time against the number of cases."""
    rng, model = np.random.default_rng(3), paper_model()
    forces = np.stack([hit(peak, NOISE_N, rng) for peak in rng.normal(1608.7, 81.65, 58)])
    tensions = np.geomspace(5.8, 3013.0, 58)
    table = Table(title="Cases of 8 s, one core")
    for name in ("cases", "s", "ms a case"):
        table.add_column(name, justify="right")
    for candidates in (1, 10, 100):
        exponents = rng.uniform(3.5, 4.5, candidates)

        def campaign(exponents: np.ndarray = exponents) -> None:
            for exponent in exponents:
                vary = {"joint.tension_rate.exponent": np.full(58, exponent)}
                model.final_tension(forces, RATE_HZ, tensions, vary)

        spent = seconds(campaign, 1)
        cases = 58 * candidates
        table.add_row(f"{cases}", f"{spent:.3f}", f"{1e3 * spent / cases:.2f}")
    return table


def main() -> None:
    """Print both tables."""
    console = Console(width=100)
    console.print(links_table())
    console.print(cases_table())


if __name__ == "__main__":
    main()
