"""Effects of the strength of their limit are found, of a third of it they are not."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

import discovery
from tests.discovery.driven_twins import Extra, driven, nothing

SEED = 5
FORCES: dict[tuple[str, str], Callable[[float], Extra]] = {
    ("cubic-stiffness", "k3"): lambda a: lambda x, _: a * x**3,
    ("even-stiffness", "k2"): lambda a: lambda x, _: a * x**2,
    ("quadratic-damping", "c2"): lambda a: lambda _, v: a * abs(v) * v,
}


def closed(folder: Path, extra: Extra = nothing) -> discovery.Closure:
    return discovery.close_loop(driven(folder, seed=SEED, extra=extra, seconds=4.0))


def named(folder: Path, extra: Extra) -> set[str]:
    closure = closed(folder, extra)
    return {one.effect.name for one in closure.effects} | {
        alike.name for one in closure.effects for alike in one.look_alikes
    }


@pytest.mark.slow
def test_driven_effects_are_found_at_their_limits_and_not_at_a_third_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = closed(tmp_path / "clean")
    assert clean.verdict == "no-effect"
    limits = {(one.name, one.parameter): one for one in clean.detection_limits if one.enters == "guide"}
    found = {1.0: 0, 0.3: 0}
    monkeypatch.setattr(import_module("discovery.loop.close_loop"), "_detection_limits", lambda *_: ())
    for place, ((name, parameter), force) in enumerate(FORCES.items()):
        value = limits[name, parameter].value
        assert value is not None
        for share in found:
            found[share] += name in named(tmp_path / f"{place}_{share}", force(share * value))
    assert found[1.0] >= 2  # of three, each with a probability of 0.8
    assert found[0.3] == 0
