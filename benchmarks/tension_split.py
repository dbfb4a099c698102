"""Bias of the split of tension on known input: ``python -m benchmarks.tension_split``.

A step of 10 N is approached with a time constant of 0.5 to 20 ms, under a decaying 15.8 Hz oscillation with
its second harmonic and a 170 Hz contact transient, and white noise, at 4800 Hz. Errors are those of the
non-oscillatory part, in percent of the step; beside them the two plain moving means it replaces.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table
from scipy import ndimage

from rom.signals.filters import split_tension

FloatArray = npt.NDArray[np.float64]
Split = Callable[[FloatArray], FloatArray]

RATE_HZ, IMPACT_S, DURATION_S, FREQUENCY_HZ, STEP_N = 4800.0, 0.5, 4.0, 15.8, -10.0
WINDOW_S = 2 / FREQUENCY_HZ
IMPACT = round(IMPACT_S * RATE_HZ)
TIME_CONSTANTS_MS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
NOISES_N = (0.02, 0.2, 1.0)
SEEDS = 10
EARLY, LATE = slice(IMPACT, IMPACT + 288), slice(IMPACT + 288, IMPACT + 4800)  # 0-60 ms and 60-1060 ms


def known_tension(time_constant_ms: float) -> FloatArray:
    """Non-oscillatory tension [N]: 150 N, then the step."""
    since = np.arange(round(DURATION_S * RATE_HZ)) / RATE_HZ - IMPACT_S
    return 150 + np.where(since >= 0, STEP_N * -np.expm1(-np.maximum(since, 0) * 1e3 / time_constant_ms), 0.0)


def oscillation(amplitude: float, phase: float) -> FloatArray:
    """First mode at 15.77 Hz (the window is set for 15.8), its second harmonic, a 170 Hz transient [N]."""
    since = np.arange(round(DURATION_S * RATE_HZ)) / RATE_HZ - IMPACT_S
    turn = 2 * np.pi * 15.77 * since
    wave = np.exp(-0.008 * turn) * np.sin(turn + phase) + 0.2 * np.exp(-0.016 * turn) * np.sin(2 * turn + 1)
    contact = 0.5 * np.exp(-0.2 * 2 * np.pi * 170 * since) * np.sin(2 * np.pi * 170 * since)
    return np.where(since >= 0, amplitude * (wave + contact), 0.0)


def through_impact(tension: FloatArray) -> FloatArray:
    """Plain moving mean straight through the impact."""
    return np.asarray(ndimage.uniform_filter1d(tension, round(WINDOW_S * RATE_HZ), mode="nearest"))


def cut_at_impact(tension: FloatArray) -> FloatArray:
    """Plain moving means before and after the impact, windows moved inwards."""
    before, after = (
        split_tension(part, RATE_HZ, WINDOW_S)[0] for part in (tension[:IMPACT], tension[IMPACT:])
    )
    return np.concatenate((before, after))


def ours(tension: FloatArray) -> FloatArray:
    """The project's split."""
    return split_tension(tension, RATE_HZ, WINDOW_S, IMPACT_S)[0]


METHODS: dict[str, Split] = {
    "moving mean": through_impact,
    "cut at impact": cut_at_impact,
    "split_tension": ours,
}


def errors(
    split: Split, time_constant_ms: float, amplitude: float, noise: float
) -> tuple[float, float, float]:
    """Mean error at 0-60 ms, RMS error at 0-60 ms and at 60-1060 ms [percent of the step], over the seeds."""
    truth = known_tension(time_constant_ms)
    found = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        shaken = oscillation(amplitude, rng.uniform(0, 2 * np.pi)) + noise * rng.standard_normal(truth.size)
        found.append(split(truth + shaken) - truth)
    error = 100 / abs(STEP_N) * np.array(found)
    rms = [float(np.sqrt(np.mean(error[:, part] ** 2))) for part in (EARLY, LATE)]
    return float(error[:, EARLY].mean()), rms[0], rms[1]


def main() -> None:
    """Print the table."""
    table = Table(title="Error of the split, % of a 10 N step: mean 0-60 ms | RMS 0-60 ms | RMS 60-1060 ms")
    for column in ("oscillation N", "noise N", "method", *(f"{tau:g} ms" for tau in TIME_CONSTANTS_MS)):
        table.add_column(column, justify="right")
    for amplitude in (1.0, 10.0):
        for noise in NOISES_N:
            for name, split in METHODS.items():
                cells = [errors(split, tau, amplitude, noise) for tau in TIME_CONSTANTS_MS]
                rows = [f"{mean:+.1f}|{early:.1f}|{late:.1f}" for mean, early, late in cells]
                table.add_row(f"{amplitude:g}", f"{noise:g}", name, *rows)
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
