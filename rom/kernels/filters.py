"""Zero-phase filters of many signals at once: a recursion waits for itself, so signals go side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

LANES = 16  # signals that go side by side at most
_CHUNK = 256  # samples that stay near while they pass all sections


@njit(cache=True, nogil=True, error_model="numpy")
def _pass(section: Any, z0: Any, z1: Any, y: Any, first: int, count: int, step: int) -> None:
    """One second-order section over ``count`` samples of y (samples, lanes) in place."""
    b0, b1, b2, a1, a2 = section[0], section[1], section[2], section[4], section[5]
    i = first
    for _ in range(count):
        row = y[np.uint64(i)]
        for lane in range(row.size):
            x = row[lane]
            new = b0 * x + z0[lane]
            z0[lane] = b1 * x - a1 * new + z1[lane]
            z1[lane] = b2 * x - a2 * new
            row[lane] = new
        i += step


@njit(cache=True, nogil=True, error_model="numpy")
def _run(sections: Any, start: Any, y: Any, step: int) -> None:
    """All sections over y (samples, lanes) in place, from its end where ``step`` is -1.

    Begins in the steady state of the first sample, ``start`` (sections, 2) times that sample.
    """
    samples, lanes = y.shape
    first = 0 if step > 0 else samples - 1
    z = np.empty((sections.shape[0], 2, lanes))
    for section in range(sections.shape[0]):
        for lane in range(lanes):
            z[section, 0, lane] = start[section, 0] * y[first, lane]
            z[section, 1, lane] = start[section, 1] * y[first, lane]
    for done in range(0, samples, _CHUNK):
        count = min(_CHUNK, samples - done)
        for section in range(sections.shape[0]):
            _pass(sections[section], z[section, 0], z[section, 1], y, first + step * done, count, step)


@njit(cache=True, nogil=True, error_model="numpy")
def _extend(y: Any, padding: int) -> None:
    """Fill both ends by even reflection about the first and the last sample between them."""
    last = y.shape[0] - 1
    for i in range(padding):
        for lane in range(y.shape[1]):
            y[i, lane] = y[2 * padding - i, lane]
            y[last - i, lane] = y[last - 2 * padding + i, lane]


@njit(cache=True, nogil=True, error_model="numpy")
def _integrate(y: Any, padding: int, step_s: float) -> None:
    """Cumulative trapezoid between the two ends, from zero, in place."""
    before = y[padding].copy()
    total = np.zeros(y.shape[1])
    y[padding] = 0.0
    for i in range(padding + 1, y.shape[0] - padding):
        for lane in range(y.shape[1]):
            now = y[i, lane]
            total[lane] += step_s * (now + before[lane]) / 2.0
            y[i, lane], before[lane] = total[lane], now


@njit(cache=True, nogil=True, error_model="numpy")
def filter_and_integrate(
    signals: Any, sections: Any, start: Any, padding: int, step_s: float, times: int
) -> Any:
    """Filter signals (rows, samples) to and fro, then integrate and filter again, ``times`` times.

    Each pass extends the signals by even reflection over ``padding`` samples at both ends.

    Parameters
    ----------
    signals : ndarray, shape (rows, samples)
        The signals.
    sections : ndarray, shape (sections, 6)
        Second-order sections, as SciPy has them.
    start : ndarray, shape (sections, 2)
        Their steady state for a signal of 1.
    padding : int
        Samples, fewer than those of a signal.
    step_s : float
        Time from sample to sample [s].
    times : int
        Integrations.

    Returns
    -------
    ndarray, shape (rows, samples)
        New arrays; the signals stay.
    """
    rows, samples = signals.shape
    out = np.empty((rows, samples))
    for block in range(0, rows, LANES):
        count = min(LANES, rows - block)
        y = np.empty((samples + 2 * padding, count))
        for i in range(samples):
            for lane in range(count):
                y[padding + i, lane] = signals[block + lane, i]
        for turn in range(times + 1):
            if turn > 0:
                _integrate(y, padding, step_s)
            _extend(y, padding)
            for step in (1, -1):  # a number written in the call would be a type of its own
                _run(sections, start, y, step)
        for i in range(samples):
            for lane in range(count):
                out[block + lane, i] = y[padding + i, lane]
    return out
