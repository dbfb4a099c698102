"""The hysteretic benchmark of Noël and Schoukens, regenerated from its published equation and numbers.

J.P. Noël, M. Schoukens, "Hysteretic benchmark with a dynamic nonlinearity", Workshop on Nonlinear System
Identification Benchmarks, Brussels, 2016; data: doi 10.4121/12967592. A mass on a spring, a dashpot and a
Bouc-Wen element:

    m y'' + c y' + k y + z = u,   z' = alpha y' - beta (gamma |y'| |z|^(nu - 1) z + delta y' |z|^nu)

There are two official test records, without noise, and no official record for estimation: whoever takes part
makes it by the published recipe, a multisine of random phases, and noise is added to the displacement. So is
done here, and where the test records are not at hand they are made as published too. Integrated at 20 times
the rate, by the classical Runge-Kutta method where the original takes Newmark's, and sampled: above half the
rate is 0.01 µm, a thousandth of the noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

import numba
import numpy as np

from benchmarks import one_body
from benchmarks.matlab_rows import rows
from experiments.datasets.collected import Collected, file_of
from experiments.datasets.vectors import same_length
from rom.campaign.channels import Channel, FloatArray

RATE_HZ, FINER, PERIOD = 750.0, 20, 8192
BAND_HZ, FORCE_RMS_N, NOISE_RMS_M = (5.0, 150.0), 50.0, 8e-6
SWEEP_HZ, SWEEP_HZ_PER_S, SWEEP_N = (20.0, 50.0), 10 / 60, 40.0
TRAINING, PERIODS = 4, 2  # multisines for estimation; periods of each, from rest
TESTS = {"multisine": "records/test_multisine.h5", "sinesweep": "records/test_sweep.h5"}
REGENERATED = "Bouc-Wen, REGENERATED from the published equation (Noël, Schoukens 2016)"
OFFICIAL = "Bouc-Wen: official test records (Noël, Schoukens 2016), training records regenerated"


@dataclass(frozen=True)
class Oscillator:
    """The published numbers: mass [kg], damping [N s/m], stiffnesses [N/m], beta [1/m]; nu is 1."""

    mass: float = 2.0
    damping: float = 10.0
    stiffness: float = 5e4
    alpha: float = 5e4
    beta: float = 1e3
    gamma: float = 0.8
    delta: float = -1.1


OSCILLATOR = Oscillator()


def response(force: FloatArray, step_s: float, numbers: Oscillator = OSCILLATOR) -> FloatArray:
    """Return displacement [m], velocity [m/s] and hysteretic force z [N] from rest, (samples, 3).

    Parameters
    ----------
    force : ndarray, shape (2 * samples,)
        Of every half step [N].
    step_s : float
        Of the integration [s].
    numbers : Oscillator
        Of the equation.
    """
    return np.asarray(_integrated(np.ascontiguousarray(force), step_s, *astuple(numbers)))


@numba.njit(cache=True)
def _integrated(
    force: FloatArray, h: float, m: float, c: float, k: float, a: float, b: float, g: float, d: float
) -> FloatArray:
    found = np.zeros((len(force) // 2, 3))
    x = v = z = 0.0
    for i in range(len(found) - 1):
        dx = dv = dz = sx = sv = sz = 0.0
        for j in range(4):  # slopes at the start, twice in the middle, at the end
            share = 0.0 if j == 0 else h if j == 3 else 0.5 * h
            at_x, at_v, at_z = x + share * dx, v + share * dv, z + share * dz
            u = force[2 * i + (j + 1) // 2]
            dx, dv = at_v, (u - k * at_x - c * at_v - at_z) / m
            dz = a * at_v - b * (g * abs(at_v) * at_z + d * at_v * abs(at_z))
            weight = h / 3 if j in (1, 2) else h / 6
            sx, sv, sz = sx + weight * dx, sv + weight * dv, sz + weight * dz
        x, v, z = x + sx, v + sv, z + sz
        found[i + 1, 0], found[i + 1, 1], found[i + 1, 2] = x, v, z
    return found


def multisine(random: np.random.Generator) -> FloatArray:
    """Return one period of a multisine of random phases and equal lines [N], at every half step."""
    count = PERIOD * FINER * 2
    lines = np.fft.rfftfreq(count, 1 / (RATE_HZ * FINER * 2))
    inside = (lines >= BAND_HZ[0]) & (lines <= BAND_HZ[1])
    phases = random.uniform(0, 2 * np.pi, np.count_nonzero(inside))
    spectrum = np.zeros(len(lines), complex)
    spectrum[inside] = np.exp(1j * phases)
    shape = np.fft.irfft(spectrum, count)
    return np.asarray(shape * FORCE_RMS_N / np.sqrt(np.mean(shape**2)))


def sweep() -> FloatArray:
    """Return the sine sweep [N], at every half step."""
    seconds = (SWEEP_HZ[1] - SWEEP_HZ[0]) / SWEEP_HZ_PER_S
    rate_hz = RATE_HZ * FINER * 2
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    return SWEEP_N * np.sin(2 * np.pi * (SWEEP_HZ[0] * time + SWEEP_HZ_PER_S / 2 * time**2))


def record(force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return force [N] and displacement [m] at the rate of the records, from a force at every half step."""
    moved = response(force, 1 / (RATE_HZ * FINER))
    return force[:: 2 * FINER], moved[::FINER, 0]


def collect(source: Path | None, seed: int = 0) -> Collected:
    """Return the campaign: regenerated records for training, and both test records held out.

    Parameters
    ----------
    source : Path or None
        Folder of the official test records; they are regenerated too if not given.
    seed : int
        Of phases and noise.

    Raises
    ------
    SourceError
        If a test record is not what it should be.
    """
    official = None if source is None else {name: _official(source, name) for name in TESTS}
    training = [f"records/multisine_{number}.h5" for number in range(1, TRAINING + 1)]
    name = REGENERATED if official is None else OFFICIAL
    files = (*training, *TESTS.values())
    made_of = one_body.settings(name, "mass", "spring", RATE_HZ, files, tuple(TESTS.values()))

    def records() -> Iterator[tuple[str, Mapping[str, Channel]]]:
        random = np.random.default_rng(seed)
        for file in training:
            force, moved = record(np.tile(multisine(random), PERIODS))
            noise = NOISE_RMS_M * random.standard_normal(len(moved))
            yield file, one_body.channels("mass", force, moved + noise, RATE_HZ)
        made = {"multisine": np.tile(multisine(random), PERIODS), "sinesweep": sweep()}
        for name, file in TESTS.items():
            shown = record(made[name]) if official is None else official[name]
            yield file, one_body.channels("mass", *shown, RATE_HZ)

    return Collected(made_of, records())


def _official(folder: Path, name: str) -> tuple[FloatArray, FloatArray]:
    """Force and displacement of a test record; the multisine, a period in its steady state, twice."""
    found = {}
    for kind in ("uval", "yval"):
        variable = f"{kind}_{name}"
        found[variable] = rows(file_of(folder, f"{variable}.mat"), variable, 1)[0]
    same_length(folder, found)
    force, moved = found.values()
    times = PERIODS if name == "multisine" else 1
    return np.tile(force, times), np.tile(moved, times)
