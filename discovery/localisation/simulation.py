"""Where the residual of ring-downs lives."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from discovery.localisation.force import whiteness
from discovery.localisation.lines import Profile
from discovery.localisation.localise import Localisation
from discovery.residual.simulation import SimulationResidual
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.ring_down import RingDown

_BANDS: Numerical[int] = 4
_CLASSES: Numerical[tuple[float, ...]] = (0.0, 0.25, 0.5, 0.75, 1.0)


def localise_motion(residual: SimulationResidual) -> Localisation:
    """Return where the residual of the training records lives."""
    parts = list(_parts(residual))
    rows = np.concatenate([one for _, _, one in parts])
    return Localisation(
        by_channel=_means([(f"{r.measurement.motion[b].kind}_{b}", one) for r, b, one in parts]),
        by_test=_means([(r.measurement.test, one) for r, _, one in parts]),
        by_frequency=_by_frequency(parts),
        by_preload=(),
        by_amplitude=_by_amplitude(parts),
        whiteness_p=whiteness([one for _, _, one in parts], int(residual.criteria.localisation.lags)),
        total=float(np.mean(rows**2)),
    )


def _parts(residual: SimulationResidual) -> Iterator[tuple[RingDown, str, FloatArray]]:
    """Rows of every channel of the training records."""
    for place in residual.trained:
        ring = residual.rings[place]
        mine = residual.residual[residual.owner == place].reshape(len(ring.channels), -1)
        yield from ((ring, body, rows) for body, rows in zip(ring.channels, mine, strict=True))


def _means(parts: list[tuple[str, FloatArray]]) -> Profile:
    found: dict[str, list[FloatArray]] = {}
    for label, rows in parts:
        found.setdefault(label, []).append(rows)
    return tuple((label, float(np.mean(np.concatenate(rows) ** 2))) for label, rows in found.items())


def _by_frequency(parts: list[tuple[RingDown, str, FloatArray]]) -> Profile:
    """Power of the residual's lines over that of white noise, in bands of equal width."""
    edges = np.linspace(0.0, max(ring.row_rate_hz for ring, _, _ in parts) / 2, _BANDS + 1)
    found = []
    for low, high in itertools.pairwise(edges):
        power = []
        for ring, _, rows in parts:
            frequency = np.fft.rfftfreq(len(rows), 1 / ring.row_rate_hz)
            lines = np.abs(np.fft.rfft(rows)) ** 2 / len(rows)
            power.append(lines[(frequency >= low) & (frequency < high)])
        inside = np.concatenate(power)
        if len(inside):
            found.append((f"{low:.3g} to {high:.3g} Hz", float(inside.mean())))
    return tuple(found)


def _by_amplitude(parts: list[tuple[RingDown, str, FloatArray]]) -> Profile:
    """Mean square by what the channel shows at that time, in shares of the largest of all records."""
    shown = [ring.measured[ring.channels.index(body)] for ring, body, _ in parts]
    largest: dict[str, float] = {}
    for (_, body, _), rows in zip(parts, shown, strict=True):
        largest[body] = max(largest.get(body, 0.0), float(np.abs(rows).max()))
    found = []
    for low, high in itertools.pairwise(_CLASSES):
        inside = []
        for (_, body, left), rows in zip(parts, shown, strict=True):
            x = np.abs(rows) / (largest[body] or 1.0)
            inside.append(left[(x >= low) & (x < high)])
        every = np.concatenate(inside)
        if len(every):
            found.append((f"{100 * low:g} to {100 * high:g} % of the largest", float(np.mean(every**2))))
    return tuple(found)
