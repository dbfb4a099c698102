"""Campaigns of the virtual rig of which something is drawn: strengths of effects, rates of bolts; twins."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from experiments.studies import rig

ATTEMPTS = 5
"""Draws of strengths before effects that diverge together are given up."""
_TOLD = (
    "cases", "noise", "seed", "scatter", "strengths", "law", "rate", "tightening", "hold_out_every",
    "duration_s",
)  # fmt: skip
"""Options that a truth file tells."""


def run_drawn(
    new_dir: Path,
    hidden: Sequence[rig.Undeclared],
    percent: tuple[float, float],
    seed: int = 0,
    **options: Any,
) -> Path:
    """Measure a campaign whose undeclared effects have strengths that are drawn (`rig.draw`).

    Seed and names of the effects decide all that is drawn, of the campaign too. Where effects diverge
    together others are drawn.

    Parameters
    ----------
    new_dir : Path
        As for `experiments.studies.rig.run`.
    hidden : sequence of Undeclared
        Kinds and places.
    percent : tuple of float
        Smallest and largest influence of each [%].
    seed : int
        Same seed, same campaign.
    **options
        Others of it.

    Returns
    -------
    Path
        The campaign folder.

    Raises
    ------
    ValueError
        As it, or if the motion diverges whatever is drawn.
    """
    label = " + ".join(f"{one.name}@{one.enters}" for one in hidden) or "clean"
    rng = np.random.default_rng([seed, crc32(label.encode())])
    for attempt in range(ATTEMPTS):
        effects = tuple(rig.draw(rng, one.name, one.enters, percent) for one in hidden)
        try:
            return rig.run(new_dir, seed=int(rng.integers(2**31)), undeclared=effects, **options)
        except ValueError:
            if attempt + 1 == ATTEMPTS:
                raise
    raise AssertionError


def twin(campaign: Path, new_dir: Path) -> Path:
    """Measure a campaign again without what it does not declare: same tests, same noise; return its folder.

    Parameters
    ----------
    campaign : Path
        Its folder; the truth file is beside it.
    new_dir : Path
        Folder to create.
    """
    truth = json.loads(rig.truth_path(campaign).read_text(encoding="utf-8"))
    options = {name: truth[name] for name in _TOLD}
    return rig.run(new_dir, jobs=1, **options | {"strengths": tuple(truth["strengths"])})


def run_bolts(
    new_dir: Path,
    bolts: int,
    between_bolts: float,
    seed: int = 0,
    **options: Any,
) -> tuple[Path, ...]:
    """Measure a campaign of each of several bolts of one kind, ``bolt-1`` and so on in a new folder.

    Parameters
    ----------
    new_dir : Path
        The folder.
    bolts : int
        How many.
    between_bolts : float
        Standard deviation of the natural logarithm of the rate from bolt to bolt.
    seed : int
        Same seed, same campaigns.
    **options
        Others of `experiments.studies.rig.run`.

    Returns
    -------
    tuple of Path
        The campaign folders; each truth file has the bolt's ``rate`` over that of the law.
    """
    rng = np.random.default_rng([seed, crc32(b"bolts")])
    places = []
    for number in range(1, bolts + 1):
        rate, own_seed = float(np.exp(between_bolts * rng.standard_normal())), int(rng.integers(2**31))
        places.append(rig.run(new_dir / f"bolt-{number}", seed=own_seed, rate=rate, **options))
    return tuple(places)
