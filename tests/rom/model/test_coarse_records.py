"""Sliders in records with few samples a period, and of any size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Effect
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure

STIFFNESS, SHARE, PERIOD_S = 900.0, 0.15, 0.5


def slipping(limit_n: float) -> Model:
    """A body on a spring, a share of which slips at a force."""
    mass = STIFFNESS * (PERIOD_S / (2 * np.pi)) ** 2
    structure = Structure((Body("b", mass),), (Link("s", "b", "ground", "linear"),))
    model = Model(structure, {"s": LinkLaws(constant_stiffness(STIFFNESS), constant_damping(6.0))})
    slider = CATALOGUE["jenkins-slip"].at("s", ground=True)
    assert isinstance(slider, Effect)
    wide = {name: replace(number, bounds=(0.0, np.inf)) for name, number in slider.parameters.items()}
    return model.with_effect(replace(slider, parameters=wide).with_values(kappa=SHARE, F_s=limit_n, mu=0.0))


def moved(size_m: float, samples: int, finer: int) -> FloatArray:
    """Motion over its largest under one force that runs straight between samples, 24 a period."""
    time = np.arange(samples) * PERIOD_S / 24
    force = STIFFNESS * size_m * (np.sin(9.0 * time) + np.sin(12.5 * time))
    fine = np.interp(np.arange((samples - 1) * finer + 1) / finer, np.arange(samples), force)
    rate_hz = 24 * finer / PERIOD_S
    response = slipping(0.1 * SHARE * STIFFNESS * size_m).simulate({"b": fine}, rate_hz, None, {}, {})
    assert response.status == "ok"
    motion = response.displacement["b"][::finer]
    return np.asarray(motion / np.abs(motion).max())


def test_a_slider_moves_a_coarse_record_as_a_fine_one() -> None:
    assert moved(1e-3, 300, 1) == pytest.approx(moved(1e-3, 300, 64), abs=2e-4)


@pytest.mark.parametrize("size_m", [1e-1, 1e-8])
def test_a_slider_is_the_same_at_any_size(size_m: float) -> None:
    assert moved(size_m, 300, 1) == pytest.approx(moved(1e-3, 300, 1), abs=1e-4)
