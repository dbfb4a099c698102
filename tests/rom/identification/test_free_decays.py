"""Ring-downs of which masses are not given: the fit ends where the structure is, from whatever start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rom
from rom.campaign.campaign import Campaign
from rom.identification.free_decay import ring_downs
from rom.identification.free_scale import scale_of
from rom.identification.modal_starts import of_modes
from tests.rom.lumped import LinkRow, campaign, noisy, respond

RATE_HZ, SAMPLES = 256.0, 800
TWO_FREE = {"a": 2.0, "b": 0.7}
BETWEEN: list[LinkRow] = [("ab", ("a", "b"), "linear", 2600.0, 1.2)]
THREE = {"a": 0.6, "b": 5.0, "c": 1.4}
CHAIN: list[LinkRow] = [
    ("ga", ("a", "ground"), "linear", 900.0, 0.4),
    ("ab", ("a", "b"), "linear", 15000.0, 3.0),
    ("bc", ("b", "c"), "linear", 5200.0, 2.0),
]
STIFF = {"a": 0.6, "b": 6.0}
LINK: list[LinkRow] = [
    ("ga", ("a", "ground"), "linear", 390.0, 0.5),
    ("ab", ("a", "b"), "linear", 18000.0, 9.0),
]
ONE = {"m": 2.6}
SPRING: list[LinkRow] = [("s", ("m", "ground"), "linear", 1900.0, 0.8)]


def decays(
    folder: Path,
    masses: Mapping[str, float],
    links: list[LinkRow],
    given: Mapping[str, float | None],
    kind: str,
    *,
    heavier: str = "",
    noise: float = 0.01,
) -> Campaign:
    """Four records whose momentum is zero where no link holds the ground; every second with an own mass."""
    rng, records, free = np.random.default_rng(11), [], not any("ground" in ends for _, ends, *_ in links)
    for i in range(4):
        own = {heavier: 1.2 * masses[heavier]} if heavier and i % 2 else {}
        state = rng.normal(0.0, 1.0, (2, len(masses))) * [[0.01], [0.1]]
        weights = np.array([(dict(masses) | own)[body] for body in masses])
        if free:
            state -= (state @ weights / weights.sum())[:, None]
        x = respond(dict(masses) | own, links, {"none": np.zeros(SAMPLES)}, RATE_HZ, state.ravel())
        shown = {f"{kind}_{body}": noisy(rng, x[f"{kind}_{body}"], noise) for body in masses}
        records.append(({"file": f"{i}.h5", "test": "free"} | ({"mass_kg": own} if own else {}), shown))
    return campaign(folder, given, links, records, RATE_HZ)


STRUCTURES = {
    "two without ground": (TWO_FREE, BETWEEN, {"a": None, "b": 0.7}, "velocity", ""),
    "one, in half of the records 20 % heavier": (ONE, SPRING, {"m": None}, "displacement", "m"),
    "two on a stiff link": (STIFF, LINK, dict.fromkeys("ab"), "acceleration", "a"),
    "three of which none is given": (THREE, CHAIN, dict.fromkeys("abc"), "acceleration", "b"),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_masses_that_are_not_given(tmp_path: Path, name: str) -> None:
    masses, links, given, kind, heavier = STRUCTURES[name]
    found = decays(tmp_path / "c", masses, links, given, kind, heavier=heavier)
    model = rom.identify(found)
    for body, mass in masses.items():
        assert model.parameter(f"body.{body}.mass").value == pytest.approx(mass, rel=0.03), body
    for link, _, _, k, _ in links:
        number = model.parameter(f"{link}.stiffness.k")
        assert number.value == pytest.approx(k, rel=0.03), link
        assert number.low is not None
        assert number.high is not None
        assert 1e-5 < (number.high - number.low) / k < 0.1, link


def test_a_record_whose_own_mass_is_not_stated_is_named(tmp_path: Path) -> None:
    stated = decays(tmp_path / "c", ONE, SPRING, ONE, "displacement", heavier="m")
    settings = stated.settings.model_dump(exclude_none=True)
    settings["record"][1].pop("mass_kg")
    blind = replace(stated, settings=type(stated.settings).model_validate(settings))
    lines = [rom.identify(each).identification.warnings for each in (stated, blind)]  # type: ignore[union-attr]
    assert [line.split(":")[0] for line in lines[1]] == ["1.h5"]
    assert not lines[0]


def test_modes_tell_a_start_near_the_structure(tmp_path: Path) -> None:
    found = decays(
        tmp_path / "c", THREE, CHAIN, dict.fromkeys("abc"), "acceleration", heavier="b", noise=1e-3
    )
    scale, (rings, doubts) = scale_of(found.settings, [{"body.b.mass": 6.0}]), ring_downs(found)
    assert not doubts
    start = of_modes(rings, found.settings, scale, dict.fromkeys(scale.values, 1.0))
    truth = {f"body.{b}.mass": m for b, m in THREE.items()} | {
        f"{n}.stiffness.k": k for n, _, _, k, _ in CHAIN
    }
    assert {path: start[path] for path in truth} == pytest.approx(truth, rel=0.1)
