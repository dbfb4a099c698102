"""Whitened rows of one record along its measured motion, and their slopes by the model's numbers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from discovery.residual.effect_forces import lines_beyond_linear
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.tension_error import beside_tension_error
from discovery.residual.trajectory import MeasuredTrajectory
from rom.campaign.channels import FloatArray
from rom.identification.noise_spectrum import NoiseDensity
from rom.identification.spectral_model import (
    STRUCTURAL,
    Linearised,
    SpectralRecord,
    Term,
    key,
    linearise,
    step_unit,
)

Slopes = dict[str, FloatArray]
"""Slopes of the rows of a part, (rows,), by number of the model."""
Part = tuple[SpectralRecord, Linearised, Slopes]
"""A part of a record with the forces along its motion, linearised."""


def linearised_parts(trace: MeasuredTrajectory, baseline: FreeParameters, floor: NoiseDensity) -> list[Part]:
    """Return the parts of a record, whitened.

    Parameters
    ----------
    trace : MeasuredTrajectory
        The record.
    baseline : FreeParameters
        The model.
    floor : NoiseDensity
        Of the record's kind of test and moving bodies.
    """
    found = []
    for part, on_bodies in zip(trace.parts, lines_beyond_linear(trace, baseline.model), strict=True):
        values = baseline.values(part, trace.level)
        driven = replace(part, force=part.force + on_bodies)
        first, last = part.samples
        seconds = (last - first) / trace.measurement.rate_hz
        linear = linearise(driven, values, floor.whitener(part, values, seconds))
        linear = beside_tension_error(linear, trace, baseline) if part is trace.parts[0] else linear
        terms = zip(linear.columns, linear.jacobian.T, strict=True)
        found.append((driven, linear.thin(), _by_number(terms, baseline, trace.level)))
    return found


def along_measured(
    trace: MeasuredTrajectory, place: int, linear: Linearised, baseline: FreeParameters
) -> Slopes:
    """Slopes along the motion that was measured, by the numbers of springs, dashpots and masses.

    Parameters
    ----------
    trace : MeasuredTrajectory
        The record.
    place : int
        Of its part.
    linear : Linearised
        That part, linearised.
    baseline : FreeParameters
        The model.
    """
    part = trace.parts[place]
    values = baseline.values(part, trace.level)
    moved = [
        trace.force_lines(np.stack([motion[body] for body in trace.bodies]), place).T
        for motion in (trace.displacement, trace.velocity)
    ]
    motions = [*moved, 2j * np.pi * part.frequency[:, None] * moved[1]]  # but for the ends, projected out

    def change(term: Term) -> FloatArray:
        along = (motions[term.power] @ term.direction)[:, None]
        return linear.projected(-(linear.gain @ term.direction) * along)

    terms = [term for term in part.terms if term.free and term.matrix in STRUCTURAL]
    names = [key(part, term) for term in terms]
    units = [step_unit(term.name, values[name]) for term, name in zip(terms, names, strict=True)]
    slopes = (change(term) * unit for term, unit in zip(terms, units, strict=True))
    return _by_number(zip(names, slopes, strict=True), baseline, trace.level)


def _by_number(
    terms: Iterable[tuple[str, FloatArray]], baseline: FreeParameters, level: float
) -> dict[str, FloatArray]:
    """Slopes by the model's numbers of slopes by a record's coefficients."""
    found: dict[str, FloatArray] = {}
    for term, along in terms:
        for number, slope in baseline.slopes(term, level).items():
            found[number] = found.get(number, 0.0) + slope * along
    return found
