"""Zero-phase filters of many signals at once: a recursion waits for itself, so signals go side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import ALLOCATES_NOTHING, INNER

LANES = 16  # signals that go side by side at most
_CHUNK = 256  # samples that stay near while they pass all sections


@njit(**INNER)  # type: ignore[untyped-decorator]
def _pass(section: Any, z: Any, y: Any, first: int, count: int, step: int) -> None:
    """One second-order section with its state z (2, lanes) over samples of y (samples, lanes) in place."""
    b0, b1, b2, a1, a2 = section[0], section[1], section[2], section[4], section[5]
    z0, z1 = z[0], z[1]
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


@njit(**INNER)  # type: ignore[untyped-decorator]
def _integrate(y: Any, z: Any, padding: int, step_s: float) -> None:
    """Cumulative trapezoid between the two ends, from zero, in place; z (2, lanes): last value and total."""
    for lane in range(y.shape[1]):
        z[0, lane], z[1, lane], y[padding, lane] = y[padding, lane], 0.0, 0.0
    for i in range(padding + 1, y.shape[0] - padding):
        row = y[i]
        for lane in range(row.size):
            now = row[lane]
            z[1, lane] += step_s * (now + z[0, lane]) / 2.0
            row[lane], z[0, lane] = z[1, lane], now


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def _filter(  # noqa: C901 - loops over arrays, in one place
    sections: Any, start: Any, padding: int, step_s: float, times: int, z: Any, y: Any
) -> None:
    """As `filter_and_integrate` for y (samples, lanes) with room at both ends, in place.

    A pass begins in the steady state of its first sample; z (sections, 2, lanes) is space.
    """
    samples, lanes = y.shape
    for turn in range(times + 1):
        if turn > 0:
            _integrate(y, z[0], padding, step_s)
        for i in range(padding):
            for lane in range(lanes):
                y[i, lane] = y[2 * padding - i, lane]
                y[samples - 1 - i, lane] = y[samples - 1 - 2 * padding + i, lane]
        for step in (1, -1):
            first = 0 if step > 0 else samples - 1
            for section in range(sections.shape[0]):
                for order in range(2):
                    for lane in range(lanes):
                        z[section, order, lane] = start[section, order] * y[first, lane]
            for done in range(0, samples, _CHUNK):
                count = min(_CHUNK, samples - done)
                for section in range(sections.shape[0]):
                    _pass(sections[section], z[section], y, first + step * done, count, step)


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
    out, samples = np.empty(signals.shape), signals.shape[1]
    for block in range(0, len(signals), LANES):
        lanes = signals[block : block + LANES]
        y = np.empty((samples + 2 * padding, len(lanes)))
        y[padding : padding + samples] = lanes.T
        z = np.empty((*start.shape, len(lanes)))
        _filter(sections, start, padding, step_s, times, z, y)
        out[block : block + LANES] = y[padding : padding + samples].T
    return out


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def first_order(rows: Any, now: float, before: float, own: float) -> None:
    """Filter rows (rows, samples) in place: y_n = now x_n + before x_(n-1) - own y_(n-1), from rest.

    Parameters
    ----------
    rows : ndarray, shape (rows, samples)
        The signals.
    now, before : float
        Weights of a sample and of the one before.
    own : float
        Weight of what came out before.
    """
    for row in range(rows.shape[0]):
        kept = 0.0
        for i in range(rows.shape[1]):
            sample = rows[row, i]
            shown = now * sample + kept
            kept = before * sample - own * shown
            rows[row, i] = shown
