"""A campaign of modes: its records, the model of modal bodies that suits them, and what to know of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rom.campaign.campaign import Campaign, CampaignSettings
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.modal_complexity import phase_collinearities
from rom.identification.modal_fit import ModalFit, fit_modes
from rom.identification.modal_responses import ModalRecord
from rom.identification.ring_down import RingDown, ring_down
from rom.model.description import LinkLaws
from rom.model.laws import Z95, Law, Parameter, constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.shapes import ModeShapes, compliance_path, shape_path
from rom.model.structure import Body, Link, Structure
from rom.signals.measured_records import measured_record
from rom.signals.quality import Doubt

_REACH: Numerical[float] = 10.0  # of the largest: how far a shape or compliance may go
_OPEN: Numerical[float] = 20.0  # of a logarithm: nothing is told of the number


@dataclass(frozen=True)
class IdentifiedMode:
    """Natural frequency [Hz], damping ratio, and shape by sensor, with 95 % limits."""

    name: str
    frequency_hz: Parameter
    damping_ratio: Parameter
    shape: Mapping[str, Parameter]


@dataclass(frozen=True, eq=False)
class ModalIdentification:
    """The model of a campaign's modes.

    Attributes
    ----------
    model : Model
        With 95 % limits.
    free : tuple of str
        Paths of the numbers that the records tell.
    rings : tuple of RingDown
        All sound records as they are compared.
    doubts : tuple of Doubt
        Why others are not.
    lines : tuple of str
        What to know of the numbers.
    modes : tuple of IdentifiedMode
        As modal analysis reports them.
    """

    model: Model
    free: tuple[str, ...]
    rings: tuple[RingDown, ...]
    doubts: tuple[Doubt, ...]
    lines: tuple[str, ...]
    modes: tuple[IdentifiedMode, ...]


def identify_modes(campaign: Campaign) -> ModalIdentification:
    """Identify the modes of a campaign from its sound training records.

    Raises
    ------
    ValueError
        If there is none, or the records tell fewer modes than declared in the band.
    """
    rings, doubts = _sound(campaign)
    training = [ring for ring in rings if not ring.hold_out]
    if not training:
        raise ValueError(f"{campaign.path}: found no sound training record of a motion, expected one")
    settings = campaign.settings
    assert settings.modes is not None
    forces = tuple(sorted({p for r in training for p, f in r.measurement.force.items() if np.any(f)}))
    records = [ModalRecord(ring, forces) for ring in training]
    band_hz = _band(training, settings)
    fit = fit_modes(records, settings.modes.count, band_hz)
    model, free = _model(settings, fit)
    lines = (*_strays(fit, band_hz), *_lines(fit), *_complex_modes(records, fit))
    shown = tuple(ring_down(ring.measurement, model) for ring in rings)
    return ModalIdentification(model, free, shown, doubts, lines, tuple(_modes(fit, model)))


def _sound(campaign: Campaign) -> tuple[list[RingDown], tuple[Doubt, ...]]:
    rings, doubts = [], list[Doubt]()
    for record in campaign.settings.record:
        measured = measured_record(campaign, record)
        doubts += measured.doubts
        if not measured.doubts:
            rings.append(ring_down(measured.measurement, modal=True))
    return rings, tuple(doubts)


def _band(rings: Sequence[RingDown], settings: CampaignSettings) -> tuple[float, float]:
    """Where modes are sought [Hz]: in the declared band, or where the records have lines and no filter."""
    if settings.band_hz is not None:
        low, high = settings.band_hz
    else:
        low, high = 0.0, 0.4 * min(ring.row_rate_hz for ring in rings)
    longest = max(ring.measurement.samples / ring.measurement.rate_hz for ring in rings)
    return max(low, 1.0 / longest), high


def _model(settings: CampaignSettings, fit: ModalFit) -> tuple[Model, tuple[str, ...]]:
    """The model with limits, and the paths of its free numbers."""
    names, modes, columns = settings.body_names, fit.modes, fit.free
    bodies, laws, free = [], {}, []
    for i, name in enumerate(names):
        omega, ratio = float(modes.omega[i]), float(modes.ratio[i])
        by_omega, by_ratio = int(columns.omega[i]), int(columns.ratio[i])
        mass, by_mass = _mass(fit, i)
        of_mass = {} if by_mass < 0 else {by_mass: -mass}
        free += [f"body.{name}.mass"] if by_mass >= 0 else []
        free += [f"{name}.stiffness.k", f"{name}.damping.c"]
        bodies.append(Body(name, mass))
        k = _law(constant_stiffness(0.0), mass * omega**2, fit.error({by_omega: 2.0, **of_mass}))
        c = _law(constant_damping(0.0), 2 * ratio * mass * omega,
                 fit.error({by_omega: 1.0, by_ratio: 1.0, **of_mass}))  # fmt: skip
        laws[name] = LinkLaws(k, c)
    numbers, of_shapes = _numbers(names, fit)
    shapes = ModeShapes(fit.sensors, names, fit.forces, numbers)
    links = tuple(Link(x.name, *x.between, x.law) for x in settings.link)
    model = Model(
        Structure(tuple(bodies), links), laws, windows=dict(settings.windows),
        sampling=dict(settings.sampling), shapes=shapes,
    )  # fmt: skip
    return model, (*free, *of_shapes)


def _modes(fit: ModalFit, model: Model) -> Iterator[IdentifiedMode]:
    assert model.shapes is not None
    for i, name in enumerate(model.shapes.modes):
        shape = {sensor: model.shapes.numbers[shape_path(name, sensor)] for sensor in fit.sensors}
        frequency = _pole_number(fit, float(fit.modes.omega[i]) / (2 * np.pi), "Hz", int(fit.free.omega[i]))
        ratio = _pole_number(fit, float(fit.modes.ratio[i]), "1", int(fit.free.ratio[i]))
        yield IdentifiedMode(name, frequency, ratio, shape)


def _pole_number(fit: ModalFit, value: float, unit: str, column: int) -> Parameter:
    """A number whose logarithm was fitted, with limits; none where the records leave it open."""
    reach = Z95 * fit.error({column: 1.0})
    if not reach < _OPEN:
        return Parameter(value, unit, source="identified")
    factor = float(np.exp(reach))
    return Parameter(value, unit, value / factor, value * factor, source="identified")


def _mass(fit: ModalFit, i: int) -> tuple[float, int]:
    """Modal mass [kg] and its column; -1 where it is not told: its lower limit then, or 1 kg without a force.

    A mode that the force hardly moves must not be moved by it in a simulation either.
    """
    inverse, column = float(fit.modes.inverse_mass[i]), int(fit.free.inverse_mass[i])
    if column < 0:
        return 1.0, -1
    error = fit.error({column: 1.0})
    if inverse > RULES.beyond_chance * error:
        return 1.0 / inverse, column
    return 1.0 / (max(inverse, 0.0) + Z95 * error), -1


def _law(made: Law, value: float, relative_error: float) -> Law:
    (name, old), reach = next(iter(made.parameters.items())), Z95 * relative_error * value
    told = bool(np.isfinite(reach))
    low, high = (value - reach if told else None), (value + reach if told else None)
    number = replace(old, value=value, low=low, high=high, source="identified")
    return replace(made, parameters={name: number})


def _numbers(names: Sequence[str], fit: ModalFit) -> tuple[dict[str, Parameter], list[str]]:
    """Shapes and compliances with limits, by path, and the paths of those that are free."""
    found, free = {}, []
    modes, columns = fit.modes, fit.free
    of_shapes = [
        (shape_path(name, place), modes.shapes[p, i], columns.shapes[p, i])
        for i, name in enumerate(names) for p, place in enumerate(fit.places)
    ]  # fmt: skip
    of_forces = [
        (compliance_path(sensor, place), modes.at_once[s, d], columns.at_once[s, d])
        for s, sensor in enumerate(fit.sensors) for d, place in enumerate(fit.forces)
    ]  # fmt: skip
    for unit, rows in (("1", of_shapes), ("m/N", of_forces)):
        reach = _REACH * max((abs(float(value)) for _, value, _ in rows), default=1.0) or 1.0
        for path, value, column in rows:
            free += [path] if column >= 0 else []
            found[path] = _number(float(value), unit, fit.error({int(column): 1.0}), reach)
    return found, free


def _number(value: float, unit: str, error: float, reach: float) -> Parameter:
    told = bool(np.isfinite(error))
    low, high = (value - Z95 * error if told else None), (value + Z95 * error if told else None)
    return Parameter(value, unit, low, high, (-reach, reach), "identified" if told else "scale")


def _lines(fit: ModalFit) -> Iterator[str]:
    """What fixes the scale of the masses, and which modes are hard to tell apart."""
    modes, names = fit.modes, [f"mode_{i + 1}" for i in range(len(fit.modes.omega))]
    if not fit.forces:
        yield (
            "modes: no force was measured; free decay tells frequencies, damping ratios and shapes alone, "
            "1 kg stands in for every modal mass"
        )
    elif not set(fit.forces) & set(fit.sensors):
        yield (
            f"modes: no sensor stands at the drive point {fit.forces[0]}; shapes there are taken as 1, and "
            "modal masses go with that"
        )
    for i, name in enumerate(names):
        if fit.forces and _mass(fit, i)[1] < 0:
            yield _untold_mass(fit, i, name)
    for a, b in combinations(range(len(names)), 2):
        apart = abs(modes.omega[a] - modes.omega[b])
        widths = modes.ratio[a] * modes.omega[a] + modes.ratio[b] * modes.omega[b]
        if apart < RULES.close_modes * widths:
            yield (
                f"{names[a]} and {names[b]}: {apart / 2 / np.pi:.3g} Hz apart, within the sum of their "
                f"half-power half-widths, {widths / 2 / np.pi:.3g} Hz; their shapes may be mixed"
            )


def _untold_mass(fit: ModalFit, i: int, name: str) -> str:
    inverse, column = float(fit.modes.inverse_mass[i]), int(fit.free.inverse_mass[i])
    least = f"at least {_mass(fit, i)[0]:.3g} kg, which stands in"
    if inverse < -RULES.beyond_chance * fit.error({column: 1.0}):
        return (
            f"{name}: its modal mass comes out below zero; {least}: the sign of the force or of the sensor "
            f"at {', '.join(fit.forces)} seems flipped, or they do not stand at one place"
        )
    return f"{name}: the force hardly moves it, its modal mass is not told; it is {least}"


def _strays(fit: ModalFit, band_hz: tuple[float, float]) -> Iterator[str]:
    """Name modes that a fit has driven out of the band, or to a damping that no mode has."""
    for i, (omega, ratio) in enumerate(zip(fit.modes.omega, fit.modes.ratio, strict=True)):
        frequency = float(omega) / (2 * np.pi)
        if not band_hz[0] <= frequency <= band_hz[1] or ratio >= RULES.modal_damping:
            yield (
                f"mode_{i + 1}: found at {frequency:.4g} Hz with a damping ratio of {ratio:.2g}, expected a "
                f"mode from {band_hz[0]:.4g} to {band_hz[1]:.4g} Hz: the records may show fewer, or others "
                "just outside the band"
            )


def _complex_modes(records: Sequence[ModalRecord], fit: ModalFit) -> Iterator[str]:
    for i, value in enumerate(phase_collinearities(records, fit)):
        if value < RULES.real_mode:
            yield (
                f"mode_{i + 1}: its shape is complex (modal phase collinearity {value:.2f}, 1 for a real "
                "one): sensors do not move in phase, which a real mode shape cannot show"
            )
