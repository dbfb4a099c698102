"""Which effects outside the catalogue a member nearly does, once the paper's model is refitted."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from experiments.rig.plant import Plant
from experiments.rig.strength import HITS, PRELOADS, influence, scaled_to, trial
from experiments.rig.undeclared import KINDS, Undeclared
from tests.shared import Shared

NOMINAL = Plant()
BASELINE = (
    "damping_lo",
    "damping_so",
    "stiffness_lo",
    "stiffness_so",
    "k_i",
    "alpha",
    "beta",
    "c_d",
    "c_i",
    "eta",
)
LIKE = 0.88


def signals(plant: Plant) -> list[np.ndarray]:
    found = []
    for preload in PRELOADS:
        for hit in HITS:
            test = trial(plant, preload, hit)
            lo, _, relative = test.motion
            found += [np.diff(lo, 2)[::8], np.diff(relative, 2)[::8], relative[::8]]
            if hit == max(HITS):
                found.append(test.tension[::4])
    return found


@pytest.fixture(scope="module")
def plain(shared: Shared) -> list[np.ndarray]:
    return shared.once("signals of the declared plant", partial(signals, NOMINAL))


def signature(plant: Plant, plain: list[np.ndarray]) -> np.ndarray:
    """Change of all signals, each over its size."""
    changes = zip(signals(plant), plain, strict=True)
    return np.concatenate([(one - other) / np.std(other) / np.sqrt(other.size) for one, other in changes])


@pytest.fixture(scope="module")
def absorbed(plain: list[np.ndarray], shared: Shared) -> np.ndarray:
    """What a refit of the paper's model takes up."""
    return shared.once("what a refit takes up", partial(refitted, plain))


def refitted(plain: list[np.ndarray]) -> np.ndarray:
    """Orthonormal changes of all signals by the numbers of the paper's model."""
    law = NOMINAL.loosening[0]
    plants = [replace(NOMINAL, **{name: 1.003 * getattr(NOMINAL, name)}) for name in BASELINE]
    for name in ("gamma_d", "gamma_i", "rho"):
        term = replace(law, **{name: 1.001 * getattr(law, name)})
        plants.append(replace(NOMINAL, loosening=(term,)))
    return np.linalg.qr(np.stack([signature(plant, plain) for plant in plants], axis=1))[0]


def left(effect: Undeclared, plain: list[np.ndarray], absorbed: np.ndarray) -> np.ndarray:
    """Direction of an effect of 8 % beyond what a refit takes up."""
    felt = influence(effect).percent
    moderate, _ = scaled_to(effect.scaled(max(1.0, 16.0 / felt)), 8.0)
    change = signature(replace(NOMINAL, effects=(moderate,)), plain)
    change = change - absorbed @ (absorbed.T @ change)
    return np.asarray(change / np.linalg.norm(change))


@pytest.fixture(scope="module")
def catalogue(
    plain: list[np.ndarray], absorbed: np.ndarray, shared: Shared
) -> dict[tuple[str, str], np.ndarray]:
    members = [
        (name, place)
        for name, kind in KINDS.items()
        if not kind.outside and kind.acts in ("force", "rate")
        for place in kind.allowed
        if name not in ("constant-force", "ground-motion")  # no answer to a hit
    ]
    works = {
        f"{name} at {place}".replace(":", " "): partial(left, Undeclared(name, place), plain, absorbed)
        for name, place in members
    }
    return dict(zip(members, shared.all(works), strict=True))


@pytest.mark.variant
@pytest.mark.parametrize(
    "name", [name for name, kind in KINDS.items() if kind.outside and kind.acts in ("force", "rate")]
)
def test_only_those_that_say_so_have_a_member_that_nearly_does_the_same(
    name: str, plain: list[np.ndarray], absorbed: np.ndarray, catalogue: dict[tuple[str, str], np.ndarray]
) -> None:
    for place in KINDS[name].allowed:
        own = left(Undeclared(name, place), plain, absorbed)
        likeness = {key: float(own @ other) ** 2 for key, other in catalogue.items()}
        nearest = KINDS[name].nearest.get(place)
        if nearest is None:
            assert max(likeness.values()) < LIKE
        else:
            assert max(value for (member, _), value in likeness.items() if member == nearest) > LIKE
