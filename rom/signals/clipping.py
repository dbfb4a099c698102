"""Flat tops: a channel that ran into the end of its range."""

from __future__ import annotations

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.criteria.records import Records

# enough of a record's begin to tell noise and quantisation of a channel
QUIET_SAMPLES: Numerical[int] = 20_000


def flat_top(
    samples: FloatArray, rules: Records, noise_and_step: tuple[float, float] | None = None
) -> tuple[int, float] | None:
    """Return samples and level of a flat top whose flanks point well above it, None where there is none.

    A parabola that stays within a band b of its top for n samples falls by 3 b over the next n / 2 on either
    side, which points to 1.5 b above the band; a clipped signal falls faster. The band is as wide as readings
    of one value scatter; but where noise is finely resolved, equal readings in a row are no chance. On a flat
    top readings change between two steps of quantisation at most: a crest of two modes goes over more.

    Parameters
    ----------
    samples : ndarray, shape (samples,)
        The channel.
    rules : Records
        The numbers that decide.
    noise_and_step : tuple of float, optional
        Its `resolution`, where it is known: that of either side is the same.
    """
    noise, step = noise_and_step or resolution(samples)
    peak = float(samples.max() - np.median(samples))
    scatter = max(rules.flat_noise * noise, rules.flat_steps * step)
    bands = [band for band in (0.0, scatter) if band or noise > rules.fine_steps * step or not scatter]
    for band in bands:
        start, stop = _flat_stretch(samples, peak, band, rules) if peak > rules.flat_height * band else (0, 0)
        if stop > start and samples[start:stop].std() <= rules.level_noise * noise + 0.5 * step:
            return stop - start, float(samples.max())
    return None


def resolution(samples: FloatArray) -> tuple[float, float]:
    """Return noise (root mean square) and quantisation step of a channel while it is quiet."""
    quiet = samples[:QUIET_SAMPLES]
    noise = 1.4826 * float(np.median(np.abs(np.diff(quiet)))) / np.sqrt(2)
    steps = np.diff(np.unique(quiet))
    step = float(steps.min()) if steps.size else 0.0
    above = quiet - quiet.min()
    if not step > np.finfo(float).eps * above.max(initial=0.0):  # rounding decides
        return float(noise), 0.0
    places = above / step
    on_grid = np.abs(places - np.round(places)).max() < 0.01
    return float(noise), step if on_grid else 0.0


def _flat_stretch(samples: FloatArray, peak: float, band: float, rules: Records) -> tuple[int, int]:
    """Return the longest [start, stop) within a band of the top, (0, 0) if the flanks do not point above."""
    top = float(samples.max())
    edges = np.flatnonzero(np.diff(samples >= top - max(band, 1e-9 * peak), prepend=False, append=False))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    start, stop = int(starts[longest]), int(stops[longest])
    count = stop - start
    reach = -(-count // 2)
    if count < rules.flat_samples or start < reach or stop + reach > len(samples):
        return 0, 0
    fall = top - max(samples[start - reach], samples[stop - 1 + reach])
    excess = fall / reach * count / 4
    return (start, stop) if excess > max(rules.flat_excess * band, rules.flat_share * peak) else (0, 0)
