"""What a blind test hides: campaigns with none, one or two undeclared effects, as an experiment's file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal
from zlib import crc32

import numpy as np

from experiments.studies import rig
from experiments.studies.experiment.settings import FORMAT

Group = Literal["clean", "one", "outside", "two"]
Place = tuple[str, str]
"""Name of an effect and where it enters."""

PRELOADS = 20
DURATION_S = 2.5
HOLD_OUT_EVERY = 5
UNFELT = ("sensor:force_so",)
"""A hammer that strikes in one test alone, with one body, changes nothing of the others."""
INFLUENCE_PERCENT = (3.0, 60.0)
MEASURE = "experiments.studies.blind.measure:measured"


@dataclass(frozen=True)
class Trial:
    """One campaign to be measured and closed: what it hides, its seed, and the factor on noise."""

    group: Group
    seed: int
    hidden: tuple[Place, ...] = ()
    noise: float = 1.0

    @property
    def label(self) -> str:
        """What it hides, for people."""
        return " + ".join(f"{name}@{enters}" for name, enters in self.hidden) or "clean"


def planned(
    clean: int = 0,
    each: int = 0,
    outside: int = 0,
    two: int = 0,
    names: Sequence[str] = (),
    noise: Sequence[float] = (1.0,),
    first: int = 0,
) -> tuple[Trial, ...]:
    """Return the trials of a test, those of the first seed first.

    Parameters
    ----------
    clean, two : int
        Campaigns without effect, and with a random pair of effects of different classes.
    each, outside : int
        Seeds for every core effect of the catalogue, and for every effect outside it. Where no place is
        named the seeds go round the places where it can enter, the usual one first.
    names : sequence of str
        ``NAME[@PLACE]``: only these effects; empty for all.
    noise : sequence of float
        Factors on the noise of the rig, of which each campaign draws one.
    first : int
        The first seed.

    Raises
    ------
    ValueError
        If there is no such effect or place.
    """
    chosen = [rig.undeclared_from_text(name) for name in names]
    given = [(one.name, one.enters if "@" in text else "") for one, text in zip(chosen, names, strict=True)]
    every = given or [(name, "") for name in _core() + _outside()]
    trials = []
    for number in range(max(clean, each, outside, two)):
        seed = first + number
        trials += [Trial("clean", seed, ())] * (number < clean)
        for name, place in every:
            group: Group = "outside" if rig.KINDS[name].outside else "one"
            places = (place,) if place else _places(name)
            hidden = ((name, places[seed % len(places)]),)
            wanted = number < (outside if group == "outside" else each)
            trials += [Trial(group, seed, hidden)] * wanted
        trials += [Trial("two", seed, _pair(seed))] * (number < two)
    return tuple(replace(trial, noise=_drawn(noise, trial)) for trial in trials)


def _drawn(noise: Sequence[float], trial: Trial) -> float:
    rng = np.random.default_rng([trial.seed, crc32(trial.label.encode()), crc32(b"noise")])
    return float(noise[int(rng.integers(len(noise)))])


def _core() -> list[str]:
    from rom.effects import CATALOGUE

    return [name for name in rig.KINDS if name in CATALOGUE and CATALOGUE[name].core]


def _outside() -> list[str]:
    return [name for name, kind in rig.KINDS.items() if kind.outside]


def _pair(seed: int) -> tuple[Place, ...]:
    """Two core effects that share no class, each at a place where it can enter."""
    from rom.effects import CATALOGUE

    rng, core = np.random.default_rng([seed, crc32(b"two")]), _core()
    one = core[rng.integers(len(core))]
    apart = [name for name in core if not {*CATALOGUE[one].classes} & {*CATALOGUE[name].classes}]
    names = one, apart[rng.integers(len(apart))]
    return tuple((n, _places(n)[rng.integers(len(_places(n)))]) for n in names)


def _places(name: str) -> tuple[str, ...]:
    """Where an effect can enter and be felt."""
    return tuple(place for place in rig.KINDS[name].allowed if place not in UNFELT)


def experiment_of(trials: Iterable[Trial]) -> dict[str, Any]:
    """Return the content of the experiment's file in which every trial is a cell."""
    tables: dict[tuple[int, float], list[list[str]]] = {}
    for trial in trials:
        hidden = [f"{name}@{enters}" for name, enters in trial.hidden]
        tables.setdefault((trial.seed, trial.noise), []).append(hidden)
    rig_tables = [
        {
            "name": f"seed {seed}, noise {noise:g}",
            "cases": PRELOADS, "duration_s": DURATION_S, "hold_out_every": HOLD_OUT_EVERY, "noise": noise,
            "influence_percent": list(INFLUENCE_PERCENT), "seed": seed, "undeclared": hidden,
        }
        for (seed, noise), hidden in tables.items()
    ]  # fmt: skip
    head = {"format": FORMAT, "name": "blind test", "command": "close", "seeds": 0}
    return {**head, "own_process": True, "measure": MEASURE, "rig": rig_tables}
