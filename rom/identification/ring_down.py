"""A record that is compared with a simulation in its own channels: a ring-down, the force zero or measured.

A displacement is compared as it is. Of a velocity or an acceleration both sides pass one zero-phase
high-pass, so that a sensor's offset does not count; its noise stays white above the cutoff.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np

from rom.campaign.channels import Channel, FloatArray
from rom.criteria.number import Numerical
from rom.effects import in_record
from rom.identification.equation_error import noise_of
from rom.identification.modal_motion import ModalMotion
from rom.identification.modal_sensors import as_sensors_show, forces_of, quiet_noise, slowest_mode
from rom.model.assembly import TOLERANCE, Response
from rom.model.model import Model
from rom.model.shapes import ModeShapes
from rom.model.structure import GROUND, Structure
from rom.signals.decimation import decimate
from rom.signals.frequency_band import in_band, kink_samples
from rom.signals.motion import Motion
from rom.signals.processing import Measurement

PERIODS: Numerical[float] = 6.0
"""Of the strongest line, in which a frequency that is a little wrong does not lose the phase."""
_SAMPLES: Numerical[float] = 24.0  # a period of the strongest line: finer records are brought to this rate
# of a channel's RMS: below, a simulation and a converter have errors of their own
_LEAST_NOISE: Numerical[float] = 1e-4
_TOLERANCE: Numerical[float] = 1e-7  # of a simulation: slopes are differences of two
_ESCAPED: Numerical[float] = 1e6  # times the motion: no simulation of it
_PER_BAND: Numerical[float] = 3.0  # times a band's upper end: rate of rows

Tension = Mapping[str, float] | None


class Whitener(Protocol):
    """What makes noise of rows white that is not."""

    def whitened(self, rows: FloatArray) -> FloatArray:
        """Rows over the sensors' noise, (..., channels, rows), over all noise that they have."""
        ...


@dataclass(frozen=True, eq=False)
class RingDown:
    """One record, its channels as they are compared.

    Attributes
    ----------
    measurement : Measurement
        The record as processed.
    channels : tuple of str
        Bodies or sensors whose motion is compared.
    measured : ndarray, shape (channels, rows)
        Samples as they are compared.
    noise : ndarray, shape (channels,)
        Standard deviation of the white noise of a row.
    row_rate_hz : float
        Rate of the rows [Hz].
    shapes : ModeShapes or None
        Of the modes whose motion the sensors show; None where each channel is a body's own.
    beside : Whitener or None
        Whitens rows by noise that is not white; None where all is.
    tolerance : float
        Of its simulations, as for `Model.simulate`.
    """

    measurement: Measurement
    channels: tuple[str, ...]
    measured: FloatArray
    noise: FloatArray
    row_rate_hz: float
    shapes: ModeShapes | None = None
    beside: Whitener | None = None
    tolerance: float = float(_TOLERANCE)

    @property
    def file(self) -> str:
        """Path inside the campaign folder."""
        return self.measurement.file

    @property
    def hold_out(self) -> bool:
        """Whether no number but the record's own is fitted to it."""
        return self.measurement.hold_out

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies that move: those of the channels, or modes."""
        return self.channels if self.shapes is None else self.shapes.modes

    @property
    def kinds(self) -> tuple[str, ...]:
        """Quantity of each channel."""
        return tuple(self.measurement.motion[channel].kind for channel in self.channels)

    @cached_property
    def whitened(self) -> FloatArray:
        """What was measured over its noise, (rows of all channels,)."""
        return self.white(self.measured / self.noise[:, None])

    def white(self, rows: FloatArray) -> FloatArray:
        """Rows over their sensors' noise, (..., channels, rows), over all noise, (..., rows of channels)."""
        return (rows if self.beside is None else self.beside.whitened(rows)).reshape(*rows.shape[:-2], -1)

    def shown(self, motion: Mapping[str, Mapping[str, FloatArray]]) -> FloatArray:
        """Motion by quantity and body as the channels show it, over their noise: (rows of all channels,).

        Samples may have leading axes, (..., samples).
        """
        rows: dict[str, FloatArray] = {}
        for kind in dict.fromkeys(self.kinds):
            same = [c for c, own in zip(self.channels, self.kinds, strict=True) if own == kind]
            rows |= zip(same, self.compared(kind, np.stack([motion[kind][c] for c in same])), strict=True)
        pairs = zip(self.channels, self.noise.tolist(), strict=True)
        return self.white(np.stack([rows[channel] / noise for channel, noise in pairs], axis=-2))

    def compared(self, kind: str, samples: FloatArray) -> FloatArray:
        """Samples of a quantity, (..., samples), as the channels are compared, (..., rows)."""
        return _compared(self.measurement, kind, samples, self.row_rate_hz)

    def simulated(self, model: Model, state: FloatArray, tension: Tension = None) -> FloatArray | None:
        """What a model shows from a state at the first sample, over the noise; None where it diverges.

        Parameters
        ----------
        model : Model
            Of the whole structure; bodies at rest are ground.
        state : ndarray, shape (2 bodies,)
            Displacements [m], then velocities [m/s].
        tension : mapping of str to float or None
            Of bolted links [N].
        """
        with np.errstate(over="ignore", invalid="ignore"):  # of a motion that escapes
            found = (
                self._of_bodies(model, state, tension)
                if model.shapes is None
                else self._of_modes(model, state)
            )
        if found is None:
            return None
        return found if np.all(np.abs(found) < _ESCAPED * np.abs(self.whitened).max()) else None

    def _of_bodies(self, model: Model, state: FloatArray, tension: Tension) -> FloatArray | None:
        response = self.response(model, state, tension, self.tolerance)
        shown = as_sensors_show(model, response, self.measurement)
        return self.shown(shown) if response.status == "ok" else None

    def _of_modes(self, model: Model, state: FloatArray) -> FloatArray | None:
        moved = self.modal.of_modes(model, state, self.tolerance)
        if moved is None or model.shapes is None:
            return None
        by_kind = self.modal.of_sensors(model.shapes, moved)
        places = {c: place for place, c in enumerate(self.measurement.motion)}
        rows = [by_kind[kind][places[c]] for c, kind in zip(self.channels, self.kinds, strict=True)]
        return self.white(np.stack(rows) / self.noise[:, None])

    @cached_property
    def modal(self) -> ModalMotion:
        """Motion of its modes."""
        return ModalMotion(self.measurement, self.compared)

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name not in ("modal", "whitened")}

    def response(
        self, model: Model, state: FloatArray, tension: Tension = None, tolerance: float = TOLERANCE
    ) -> Response:
        """Simulate the record from a state; the force is the measured one.

        Parameters
        ----------
        model : Model
            Of the whole structure; bodies at rest are ground.
        state : ndarray, shape (2 bodies,)
            Displacements [m], then velocities [m/s].
        tension : mapping of str to float or None
            Of bolted links [N].
        tolerance : float
            As for `Model.simulate`.

        Returns
        -------
        Response
            At the samples of the record.
        """
        seen, (x, v) = self.measurement, np.split(np.asarray(state, dtype=np.float64), 2)
        force = {body: f for body, f in forces_of(model, seen).items() if body in self.bodies}
        return of_moving(in_record(model, seen.given), self.bodies).simulate(
            force or {self.bodies[0]: np.zeros(seen.samples)},
            seen.rate_hz,
            tension,
            dict(zip(self.bodies, x.tolist(), strict=True)),
            dict(zip(self.bodies, v.tolist(), strict=True)),
            tolerance=tolerance,
        )

    def parts(self, periods: float, most: int | None = None) -> tuple[RingDown, ...]:
        """The first of the equal parts of some periods of its strongest line, two samples each or more."""
        seen, strongest = self.measurement, self.measurement.strongest_hz
        per_period = np.inf if strongest is None else max(seen.rate_hz / strongest, 2.0)
        count = max(int(seen.samples / (periods * per_period)), 1)
        edges = np.linspace(0, seen.samples, count + 1).astype(int)[: (most or count) + 1].tolist()
        return tuple(self._between(*ends) for ends in pairwise(edges)) if count > 1 else (self,)

    def _between(self, first: int, last: int) -> RingDown:
        seen, rows = self.measurement, slice(first, last)
        motion = {body: Motion(m.kind, m.samples[rows]) for body, m in seen.motion.items()}
        force = {body: samples[rows] for body, samples in seen.force.items()}
        part = replace(seen, samples=last - first, motion=motion, force=force)
        kinds = ((motion[body].kind, motion[body].samples) for body in self.channels)
        measured = [_compared(part, *one, self.row_rate_hz) for one in kinds]
        return replace(self, measurement=part, measured=np.stack(measured))

    @property
    def scale(self) -> FloatArray:
        """Sizes of the state: largest displacement [m] of every body, and that times its circular rate."""
        omega = 2 * np.pi * (self.measurement.strongest_hz or 1.0)
        shown = np.stack([self.measurement.displacement(b) for b in self.channels])
        if self.shapes is not None:
            shown = np.asarray(np.linalg.lstsq(self.shapes.at(self.channels), shown, rcond=None)[0])
        x = np.asarray(np.abs(shown).max(axis=1))
        x = np.maximum(x, 1e-6 * float(x.max(initial=0.0)) + np.finfo(float).tiny)
        return np.concatenate([x, omega * x])


def ring_down(
    measurement: Measurement, model: Model | None = None, *, modal: bool = False, rows_hz: float | None = None
) -> RingDown:
    """Return a processed record as it is compared.

    Parameters
    ----------
    measurement : Measurement
        The record as processed.
    model : Model or None
        A model of modes, where it is known.
    modal : bool
        Whether modes are to be told from it, of any frequency in its band.
    rows_hz : float or None
        Rate of the rows [Hz], about; None: some rows a period of the strongest line.
    """
    shapes = None if model is None else model.shapes
    if model is not None and shapes is not None:
        measurement = replace(measurement, strongest_hz=slowest_mode(model))
    bodies = tuple(b for b in measurement.motion)
    is_modal = modal or shapes is not None
    rate = _modal_rate(measurement) if is_modal else _row_rate(measurement, rows_hz)
    measured, noise = [], []
    for body in bodies:
        motion = measurement.motion[body]
        rows = _compared(measurement, motion.kind, motion.samples, rate)
        channel = Channel(body, motion.samples, measurement.rate_hz)
        white = quiet_noise(channel, measurement.chain.band_hz) if is_modal else noise_of(channel)
        white *= np.sqrt(rate / measurement.rate_hz)
        noise.append(max(white, _LEAST_NOISE * float(np.sqrt(np.mean(rows**2))), np.finfo(float).tiny))
        measured.append(rows)
    return RingDown(measurement, bodies, np.stack(measured), np.array(noise), rate, shapes)


def _modal_rate(measurement: Measurement) -> float:
    """Rate of rows that hold the whole band: the strongest mode need not be the highest."""
    if measurement.chain.band_hz is None:
        return measurement.rate_hz
    return measurement.rate_hz / max(1, int(measurement.rate_hz / (_PER_BAND * measurement.chain.band_hz[1])))


def _row_rate(measurement: Measurement, wanted_hz: float | None) -> float:
    strongest = measurement.strongest_hz
    if wanted_hz is None and strongest is None:
        return measurement.rate_hz
    wanted_hz = wanted_hz or _SAMPLES * (strongest or measurement.rate_hz)
    return measurement.rate_hz / max(1, int(measurement.rate_hz / wanted_hz))


def _compared(measurement: Measurement, kind: str, samples: FloatArray, rate_hz: float) -> FloatArray:
    rows = np.asarray(samples, dtype=np.float64)
    low_hz = 0.0 if measurement.chain.band_hz is None else measurement.chain.band_hz[0]
    if kind != "displacement" and not low_hz > 0:  # else the band's own high-pass takes an offset off
        rows = measurement.chain.highpass(rows, measurement.rate_hz)
    rows = in_band(rows, measurement.rate_hz, measurement.chain.band_hz)
    rows = decimate(rows, measurement.rate_hz, rate_hz) if rate_hz < measurement.rate_hz else rows
    spoilt = kink_samples(rows.shape[-1], rate_hz, measurement.chain.band_hz)
    return rows[..., spoilt : rows.shape[-1] - spoilt]


def of_moving(model: Model, bodies: Sequence[str]) -> Model:
    """Return the model of the moving bodies: one that rests in a record is ground to the others."""
    if model.shapes is not None or not bodies or set(model.structure.body_names) <= set(bodies):
        return model
    ends = {body: body if body in bodies else GROUND for body in (*model.structure.body_names, GROUND)}
    links = tuple(
        type(link)(link.name, ends[link.first], ends[link.second], link.law)
        for link in model.structure.links
        if ends[link.first] != ends[link.second]
    )
    left = tuple(body for body in model.structure.bodies if body.name in bodies)
    return model.on(Structure(left, links), {link.name: model.link_laws[link.name] for link in links})
