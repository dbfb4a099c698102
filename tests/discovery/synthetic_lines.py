"""Whitened lines of two bodies, a bolted link between them, that lack a known force: no rig, no fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from discovery.localisation.lines import Lines, Place
from rom.campaign.channels import FloatArray
from rom.identification.ambient_noise import whitener
from rom.identification.small_matrices import root_of
from rom.identification.spectral_model import (
    ComplexArray,
    SpectralRecord,
    Term,
    key,
    linearise,
    spectrum,
    transfer,
)

RATE_HZ, SAMPLES, IMPACT_S, DOMINANT_HZ = 2000.0, 4000, 0.1, 20.0  # the first mode
BODIES = ("lo", "so")
SENSOR, AMBIENT = 5e-5, 5e-4  # noise of a line's real part [m/s], [N s]
JOINT = Place("joint", BODIES, bolted=True)
PLACES = (JOINT, *(Place(f"body {body}", (body, "ground"), bolted=False) for body in BODIES))
_TERMS = (
    Term("flexure_lo.stiffness", "stiffness", np.array([1.0, 0.0]), 1.6e4),
    Term("flexure_so.stiffness", "stiffness", np.array([0.0, 1.0]), 3.1e4),
    Term("joint.stiffness", "stiffness", np.array([1.0, -1.0]), 2e5),
    Term("joint.damping", "damping", np.array([1.0, -1.0]), 60.0),
    Term("flexure_lo.damping", "damping", np.array([1.0, 0.0]), 8.0),
    Term("mass_lo", "mass", np.array([1.0, 0.0]), 2.0, free=False),
    Term("mass_so", "mass", np.array([0.0, 1.0]), 1.0, free=False),
)
Law = Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray]


def silence(x: FloatArray, _v: FloatArray, _rng: np.random.Generator) -> FloatArray:
    """Nothing is missing."""
    return np.zeros_like(x)


def motion(amplitude: float) -> tuple[FloatArray, FloatArray]:
    """Displacement [m] and velocity [m/s] of a place that rings after a hit."""
    time = np.arange(SAMPLES) / RATE_HZ - IMPACT_S
    omega = 2 * np.pi * DOMINANT_HZ
    swing = np.where(time >= 0, amplitude * np.exp(-np.maximum(time, 0.0) / 0.25), 0.0)
    x = swing * np.sin(omega * time)
    return x, swing * (omega * np.cos(omega * time) - np.sin(omega * time) / 0.25)


def record(
    law: Law,
    place: Place = JOINT,
    *,
    seed: int = 0,
    amplitude: float = 1e-4,
    preload_n: float = 100.0,
    delay_s: float = 0.0,
) -> Lines:
    """Lines of one record in which a force of the law acts at a place along `motion`, in noise."""
    rng = np.random.default_rng(seed)
    x, v = motion(amplitude)
    f, lines = spectrum(law(x, v, rng), RATE_HZ, (4.0, 400.0))
    hit = np.zeros((SAMPLES, 2))
    hit[int(IMPACT_S * RATE_HZ), 0] = 50.0
    struck = spectrum(hit, RATE_HZ, (4.0, 400.0))[1] * np.exp(-2j * np.pi * f * delay_s)[:, None]
    unsure = np.stack([1e-3 * struck, 2e-6j * np.pi * f[:, None] * struck], axis=2)
    part = SpectralRecord(f"{seed}", "coupled", f, struck, np.zeros_like(struck), (2, 2), _TERMS,
                          force_errors=unsure, samples=(0, SAMPLES))  # fmt: skip
    values = {key(part, term): term.value for term in _TERMS}
    trace: Any = SimpleNamespace(
        bodies=BODIES, group=("coupled", BODIES), stride=1, rate_hz=RATE_HZ, parts=(part,),
        settings=SimpleNamespace(hold_out=False, file=f"{seed}"),
        relative=lambda ends: (x, v) if ends == place.ends else (0 * x, 0 * v),
        measurement=SimpleNamespace(
            test="coupled", rate_hz=RATE_HZ, impact_s=IMPACT_S, strongest_hz=DOMINANT_HZ,
            force={"lo": hit[:, 0]}, tension=SimpleNamespace(initial=preload_n),
        ),
    )  # fmt: skip
    direction = place.direction(trace)
    assert direction is not None
    gain = transfer(part, values)
    late = np.exp(-2j * np.pi * f * delay_s)
    pushed = struck - lines[:, None] * direction * late[:, None]
    pushed = pushed + AMBIENT * _white(rng, struck.shape)
    seen = (gain @ pushed[:, :, None])[:, :, 0] + SENSOR * _white(rng, struck.shape)
    found = replace(part, motion=seen)
    trace.parts = (found,)
    ambient = np.tile(AMBIENT**2 * np.eye(2, dtype=np.complex128), (len(f), 1, 1))
    linear = linearise(found, values, whitener(gain, root_of(ambient), np.full(2, SENSOR**2)))
    rows = linear.residual[: 2 * seen.size].reshape(2, *seen.shape)
    return Lines(trace, found, linear.thin(), rows)


def _white(rng: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
    return np.asarray(rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


def campaign(law: Law, place: Place = JOINT, amplitudes: Sequence[float] = ()) -> list[Lines]:
    """Records of hits of several strengths."""
    sizes = amplitudes or [*np.geomspace(2e-5, 2e-4, 4)] * 3
    return [record(law, place, seed=seed, amplitude=size) for seed, size in enumerate(sizes)]
