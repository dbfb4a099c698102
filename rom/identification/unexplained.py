"""Resonances of the records that no mode of the identified structure explains.

Of every body the squares of its channel, measured and left over, are summed over bands of frequency and over
records of a kind. A band that the model explains less than half of, that holds much of the motion and stands
out from its neighbours, is a resonance that is not declared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.spectral_model import Linearised, SpectralRecord

_BAND: Numerical[float] = 0.05  # logarithm of its edges
_EDGES: Numerical[FloatArray] = np.exp(np.arange(np.log(0.1), np.log(2e4), _BAND))
_WIDTH: Numerical[int] = 3  # bands of a resonance
_ABOUT: Numerical[int] = 2  # bands to either side in which a mode of the model explains it, if off
_BESIDE: Numerical[int] = 5  # bands from it to its neighbours


@dataclass(frozen=True)
class Unexplained:
    """A resonance near `frequency_hz` that holds a `share` of the squares of a body's channel."""

    test: str
    body: str
    frequency_hz: float
    share: float

    @property
    def line(self) -> str:
        """What people should know."""
        return (
            f"{self.body} in {self.test} tests: {100 * self.share:.0f} % of the power of its channel rings "
            f"near {self.frequency_hz:.3g} Hz, where the declared structure has no mode: a body or link is "
            "missing, or it is a disturbance such as hum"
        )


def unexplained_resonances(
    records: Sequence[SpectralRecord], parts: Sequence[Linearised]
) -> tuple[Unexplained, ...]:
    """Return the strongest unexplained resonance of every body in every kind of test, most have none.

    Parameters
    ----------
    records : sequence of SpectralRecord
        Spectra of the records.
    parts : sequence of Linearised
        What the model leaves over of each.
    """
    energies: dict[tuple[str, str], dict[str, FloatArray]] = {}
    for record, part in zip(records, parts, strict=True):
        test, _, others = record.group.partition(":")  # bodies and number of lines
        bodies = others.partition(":")[0].split(",") if others else ["a body"]
        for place, body in enumerate(bodies):
            of_files = energies.setdefault((test, body), {})
            of_files[record.file] = of_files.get(record.file, 0.0) + _energies(record, part, place)
    found = []
    for (test, body), of_files in energies.items():
        shares = np.mean([rows / max(rows[0].sum(), 1e-300) for rows in of_files.values()], axis=0)
        found += [Unexplained(test, body, *one) for one in _strongest(*shares)]
    return tuple(found)


def _energies(record: SpectralRecord, part: Linearised, place: int) -> FloatArray:
    """Return squares of a channel in every band: measured, left over, and of the model, (3, bands)."""
    frequency, measured, left = record.frequency, record.motion[:, place], part.unweighted[:, place]
    step = frequency[1] - frequency[0]  # parts of a record may be of other lengths
    rows = [step * np.abs(one) ** 2 for one in (measured, left, measured - left)]
    return np.stack([np.histogram(frequency, _EDGES, weights=row)[0] for row in rows])


def _strongest(measured: FloatArray, left: FloatArray, model: FloatArray) -> Iterator[tuple[float, float]]:
    """Yield frequency [Hz] and share of the strongest band that stands out unexplained, if there is one."""
    total, rest = (np.convolve(row, np.ones(_WIDTH), "same") for row in (measured, left))
    about = np.convolve(model, np.ones(2 * _ABOUT + 1), "same")
    known = np.where(total > 0, rest, np.inf)  # at the end of the band nothing stands out
    padded = np.pad(known, _BESIDE, constant_values=np.inf)
    beside = np.maximum(padded[: -2 * _BESIDE], padded[2 * _BESIDE :])
    strange = (
        (rest > RULES.unexplained_part * total)
        & (rest > RULES.unexplained_share)
        & (rest > RULES.unexplained_peak * beside)
        & (about < RULES.unexplained_part * rest)
    )
    if strange.any():
        place = int(np.argmax(np.where(strange, rest, 0.0)))
        yield float(np.sqrt(_EDGES[place] * _EDGES[place + 1])), float(rest[place])
