"""Noise of a measured force: a simulation takes it for force, and its answer rings in all that is shown.

    S(f) = I + G(f) Q G(f)^H

is the power of what the true model leaves over of a driven record, in units of the sensors' white noise: G
what the channels show of forces at their places, over their noise, by the linear part of a model, and Q the
power of the forces' own white noise. Rows times S^-1/2 are white (L. Ljung, System Identification, 1999).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rom.campaign.campaign import Campaign, CampaignSettings
from rom.campaign.channels import Channel, FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.equation_error import noise_of
from rom.identification.free_decay import matrices
from rom.identification.ring_down import RingDown
from rom.identification.spectral_model import ComplexArray
from rom.model.model import Model
from rom.signals.measured_records import measured_record

_NAMED: Numerical[int] = 3  # records
_DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, eq=False)
class ForceNoise:
    """Whitens rows of a record by what noise its forces have.

    Attributes
    ----------
    system : tuple of ndarray
        Mass, damping and stiffness matrices of the moving bodies.
    shows : ndarray, shape (channels, bodies)
        What a channel shows of each body's motion: one of it, or modes by their shapes.
    pushes : ndarray, shape (bodies, places)
        How a force at a place acts on each body.
    at_once : ndarray, shape (channels, places)
        Compliance of modes above the band [m/N].
    orders : ndarray, shape (channels,)
        Derivative of the displacement that each channel shows.
    sensor : ndarray, shape (channels,)
        Standard deviation of a row's white noise.
    force : ndarray, shape (places,)
        Standard deviation [N] of a force's noise in one row.
    row_rate_hz : float
        Rate of the rows [Hz].
    """

    system: tuple[FloatArray, FloatArray, FloatArray]
    shows: FloatArray
    pushes: FloatArray
    at_once: FloatArray
    orders: FloatArray
    sensor: FloatArray
    force: FloatArray
    row_rate_hz: float

    @cached_property
    def _known(self) -> dict[int, ComplexArray]:
        return {}

    def whitened(self, rows: FloatArray) -> FloatArray:
        """Return rows over all noise that they have.

        Records begin and end anywhere: rows are taken to go on as they began, which a difference from a
        model does within its noise.

        Parameters
        ----------
        rows : ndarray, shape (..., channels, rows)
            Over the sensors' noise.

        Returns
        -------
        ndarray
            The same shape.
        """
        count = rows.shape[-1]
        if count not in self._known:
            frequency = np.asarray(np.fft.rfftfreq(count, 1 / self.row_rate_hz), dtype=np.float64)
            self._known[count] = self._inverse_roots(frequency)
        lines = np.einsum("fij,...jf->...if", self._known[count], np.fft.rfft(rows, axis=-1))
        return np.asarray(np.fft.irfft(lines, count, axis=-1))

    def _inverse_roots(self, frequency: FloatArray) -> ComplexArray:
        """S^-1/2, (lines, channels, channels)."""
        mass, damping, stiffness = self.system
        rate = 2j * np.pi * frequency[:, None, None]
        compliance = np.linalg.pinv(mass * rate**2 + damping * rate + stiffness)
        moves = self.shows @ compliance @ self.pushes + self.at_once
        gain = rate ** self.orders[:, None] * moves * self.force / self.sensor[:, None]
        power = np.eye(len(self.sensor)) + gain @ np.conj(np.swapaxes(gain, 1, 2))
        values, vectors = np.linalg.eigh(power)
        return np.asarray((vectors / np.sqrt(values)[:, None, :]) @ np.conj(np.swapaxes(vectors, 1, 2)))


def with_force_noise(
    rings: Sequence[RingDown], model: Model, campaign: Campaign
) -> tuple[tuple[RingDown, ...], tuple[str, ...]]:
    """Return records whose rows are whitened by the noise of their forces too, and what is to be said of it.

    Records stay as they are where no force acts, where the ground moves (its noise is in force and motion
    alike), and where a force drives the top of its band, by which noise is told.

    Parameters
    ----------
    rings : sequence of RingDown
        The records.
    model : Model
        Its linear part passes the noise on; with an effect that moves a resonance far, noise is sought beside
        it.
    campaign : Campaign
        Of the records.

    Returns
    -------
    tuple
        Records in the same order, and lines.
    """
    records = {record.file: record for record in campaign.settings.record}
    found, broad = [], []
    for ring in rings:
        raw, noise = measured_record(campaign, records[ring.file]).raw, _noises(ring)
        sizes = [noise[body] / np.sqrt(np.mean(ring.measurement.force[body] ** 2)) for body in noise]
        if max(sizes, default=0.0) > RULES.broad_force:
            broad.append(ring.file)
        elif noise and not (raw is not None and raw.relative):
            ring = replace(ring, beside=_force_noise(ring, noise, model, campaign.settings))
        found.append(ring)
    if not broad:
        return tuple(found), ()
    names = ", ".join(broad[:_NAMED]) + (", ..." if len(broad) > _NAMED else "")
    line = "driven up to the top of the band, where noise of a force is told: none is allowed for"
    return tuple(found), (f"{names}: {line}",)


def _noises(ring: RingDown) -> dict[str, float]:
    """Standard deviation [N] of the white noise of each force that acts on what moves, by its place."""
    seen = ring.measurement
    places = seen.force if ring.shapes is not None else ring.bodies
    acting = {place: f for place, f in seen.force.items() if place in places and np.any(f)}
    return {place: noise_of(Channel(place, f, seen.rate_hz)) for place, f in acting.items()}


def _force_noise(
    ring: RingDown, noise: Mapping[str, float], model: Model, settings: CampaignSettings
) -> ForceNoise:
    seen = ring.measurement
    values = {path: number.value for path, number in model.parameters.items()}
    of_places = np.array([*noise.values()]) * np.sqrt(ring.row_rate_hz / seen.rate_hz)
    return ForceNoise(
        matrices(settings, ring.bodies, {**_without_links(settings), **values, **seen.given}),
        *_places(ring, tuple(noise)),
        np.array([_DERIVATIVES[kind] for kind in ring.kinds]),
        ring.noise,
        of_places,
        ring.row_rate_hz,
    )


def _places(ring: RingDown, forces: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What channels show of bodies or modes, how forces at places act on these, and what follows at once."""
    if ring.shapes is None:
        one = np.eye(len(ring.bodies))
        pushes = one[:, [ring.bodies.index(body) for body in forces]]
        return one, pushes, np.zeros((len(ring.channels), len(forces)))
    follows = [[ring.shapes.compliance(c, f) for f in forces] for c in ring.channels]
    return ring.shapes.at(ring.channels), ring.shapes.at(forces).T, np.array(follows)


def _without_links(settings: CampaignSettings) -> dict[str, float]:
    """Stiffness and damping of links that a model does not have: none."""
    return {f"{link.name}.{name}": 0.0 for link in settings.link for name in ("stiffness.k", "damping.c")}
