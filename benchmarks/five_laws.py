"""How often `boltlaw compare` finds the law of a campaign among five from the literature, and its numbers.

``python -m benchmarks.five_laws --out FOLDER`` runs ``five_laws.toml``, beside this file, and prints a row
for each law: twenty campaigns of the virtual rig whose bolt follows it. A law is found if it is the first
one, or not told apart from the first. Its numbers are compared with those that the rig had.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from discovery.ranking.result import Ranking
from experiments import run_experiment
from experiments.rig.rivals import RIVALS
from experiments.run.progress import progress_bars
from experiments.studies import rig

FILE = Path(__file__).with_suffix(".toml")
TRUTHS: Mapping[str, tuple[str, str]] = {
    "constant-quadratic": ("power 2", "c2"),
    "constant-quartic": ("power 4", "c4"),
    "slip-work": ("slip work", "a"),
    "displacement-threshold": ("displacement threshold", "b"),
    "path": ("path of slip", "r"),
}
"""For the rig's law its name in the file, and its coefficient."""


def measured(ranking: Ranking, campaign: Path) -> dict[str, Any]:
    """Return what the truth file says of a cell's ranking, as columns of the experiment's table."""
    hidden = json.loads(rig.truth_path(campaign).read_text(encoding="utf-8"))["law"]
    name, coefficient = TRUTHS[hidden]
    law, (term,) = ranking[name], RIVALS[hidden]
    true = {coefficient: 10.0**term.gamma_d}
    if term.displacement_threshold:
        true["x_0"] = term.displacement_threshold
    found = {"place": law.rank, "first_is_true": law.rank == 1, "true_probability": law.probability}
    found["true_is_listed"] = name in (ranking.laws[0].name, *ranking.indistinguishable)
    for key, value in true.items():
        p = law.parameters[key]
        low, high = (value if end is None else end for end in (p.low, p.high))
        found |= {f"{key}.value": p.value / value, f"{key}.low": low / value, f"{key}.high": high / value}
    return found


def row(law: str, cells: Sequence[Mapping[str, Any]]) -> str:
    """Return the line of a law."""
    numbers = [key.removesuffix(".value") for key in cells[0] if key.endswith(".value")]
    held, texts = _held(cells), []
    for number in numbers:
        values = np.array([cell[f"{number}.value"] for cell in cells])
        texts.append(f"{number} {np.median(values):.2f} ({values.min():.2f}-{values.max():.2f})")
    first, listed = (sum(cell[key] for cell in cells) for key in ("first_is_true", "true_is_listed"))
    share = np.median([cell["true_probability"] for cell in cells])
    cells_of = [
        TRUTHS[law][0], len(cells), first, listed, f"{share:.2f}",
        ", ".join(texts), f"{sum(held)} of {len(held)}",
    ]  # fmt: skip
    return f"| {' | '.join(map(str, cells_of))} |"


def _held(cells: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Whether the limits of every number hold the truth, all over which they are divided."""
    return [
        cell[key.replace(".value", ".low")] <= 1.0 <= cell[key.replace(".value", ".high")]
        for cell in cells
        for key in cell
        if key.endswith(".value") and cell[key] is not None
    ]


def report(cells: Sequence[Mapping[str, Any]]) -> str:
    """Return the table."""
    lines = [
        "| true law | campaigns | first | first or not told apart | its probability | numbers over true ones "
        "| limits hold |",
        "|---|---|---|---|---|---|---|",
    ]
    by_law = {law: [c for c in cells if c["settings"]["rig.law"] == law] for law in TRUTHS}
    lines += [row(law, found) for law, found in by_law.items() if found]
    held = [one for found in by_law.values() for one in _held(found)]
    low, high = stats.binom.interval(0.95, len(held), 0.95)
    lines.append(
        f"\nLimits hold {sum(held)} of {len(held)} numbers; of 95 % limits {low:g} to {high:g} would."
    )
    return "\n".join(lines)


def main() -> None:
    """Run the cells that are missing, and print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("five-laws"))
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    with progress_bars(quiet=False) as progress:
        table = run_experiment(FILE, options.out, options.jobs, progress=progress, measure=measured)
    cells = json.loads(table.path.read_text(encoding="utf-8"))["cells"]
    print(report([cell for cell in cells if cell["status"] == "ok"]))


if __name__ == "__main__":
    main()
