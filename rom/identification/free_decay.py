"""The declared model of a campaign of ring-downs: stiffnesses and dampings by output error.

    M x'' + C x' + K x = 0,   x(0) = x_0,   x'(0) = v_0

with the state (x_0, v_0) of every record its own, taken out linearly at every step (variable projection).
Fits start on the first periods and go on to twice the length until they hold the whole record: a frequency
that is a little wrong loses the phase of a long one. Free decays tell M, C and K but for a common factor,
which is fixed by a given mass or stiffness.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize, signal

from rom.campaign.campaign import Campaign, CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.free_scale import Scale, mass_of, scale_of
from rom.identification.modal_starts import of_modes
from rom.identification.record_spectra import LinearNames
from rom.identification.record_spectra import spectral_records as spectra_of
from rom.identification.ring_down import RingDown, ring_down
from rom.identification.starting_values import with_starts
from rom.model.description import LinkLaws
from rom.model.laws import Z95, Law, Parameter, constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import GROUND, Body, Link, Structure
from rom.signals.measured_records import measured_record
from rom.signals.quality import Doubt

TESTS = ("free", "driven")
_PERIODS: Numerical[float] = 6.0  # of the strongest line: where a fit starts
_EVALUATIONS: Numerical[int] = 40
_MASSES: Numerical[tuple[float, float]] = (1e-3, 1e3)  # of its start, as far as a mass may go
_LEAST: Numerical[float] = 1e-9  # of a stiffness or damping's start
_STEP: Numerical[float] = 1e-6
_UNSEEN: Numerical[float] = 1e-9  # of what the state shows most
_AT_NOISE: Numerical[float] = 1.2  # mean square of what is left over the noise: no other start leaves less
_UNTOLD: Numerical[float] = 1e-150  # of the largest slope: a number that no row depends on


def is_followed(campaign: Campaign) -> bool:
    """Whether a campaign without a bolt trains on free and driven records alone: simulations can follow."""
    training = campaign.select(hold_out=False)
    bolted = any(link.law == "bolted" for link in campaign.settings.link)
    return bool(training) and not bolted and {record.test for record in training} <= set(TESTS)


def is_mixed(campaign: Campaign) -> bool:
    """Whether a campaign that simulations can follow trains on free and on driven records."""
    return is_followed(campaign) and len({record.test for record in campaign.select(hold_out=False)}) > 1


def is_free(campaign: Campaign) -> bool:
    """Whether a campaign without a bolt trains on ring-downs alone: free records, or driven without force."""
    return is_followed(campaign) and not any(
        np.any(force)
        for record in campaign.select(hold_out=False)
        for force in measured_record(campaign, record).measurement.force.values()
    )


def ring_downs(campaign: Campaign) -> tuple[tuple[RingDown, ...], tuple[Doubt, ...]]:
    """Return the sound records of a campaign as they are compared, and the doubts about the others."""
    found, doubts = list[RingDown](), list[Doubt]()
    for record in campaign.select(TESTS):
        measured = measured_record(campaign, record)
        doubts += measured.doubts
        if not measured.doubts and measured.measurement.motion:
            found.append(ring_down(measured.measurement))
    return tuple(found), tuple(doubts)


def matrices(
    settings: CampaignSettings, bodies: Sequence[str], values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mass, damping and stiffness matrices of the moving bodies.

    Parameters
    ----------
    settings : CampaignSettings
        For the links.
    bodies : sequence of str
        Bodies that move; others are ground.
    values : mapping of str to float
        Masses [kg], stiffnesses [N/m] and dampings [N s/m] by path.

    Returns
    -------
    tuple of ndarray
        Each of shape (bodies, bodies).
    """
    n = len(bodies)
    mass = np.diag([values[mass_of(b)] for b in bodies])
    damping, stiffness = np.zeros((n, n)), np.zeros((n, n))
    for link in settings.link:
        row = np.zeros(n)
        for sign, end in zip((1.0, -1.0), link.between, strict=True):
            if end in bodies:
                row[bodies.index(end)] = sign
        damping += values[f"{link.name}.damping.c"] * np.outer(row, row)
        stiffness += values[f"{link.name}.stiffness.k"] * np.outer(row, row)
    return mass, damping, stiffness


def _columns(ring: RingDown, settings: CampaignSettings, values: Mapping[str, float]) -> FloatArray:
    """What the channels show of motions from unit states, over the noise, (rows, 2 bodies)."""
    values = {**values, **ring.measurement.given}
    mass, damping, stiffness = matrices(settings, ring.bodies, values)
    n, seen = len(ring.bodies), ring.measurement
    inverse = np.linalg.inv(mass)
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    rows = _powers(linalg.expm(system / seen.rate_hz), seen.samples) * ring.scale
    second = np.einsum("ij,tjk->tik", system[n:], rows)
    parts = {"displacement": rows[:, :n], "velocity": rows[:, n:], "acceleration": second}
    motion = {
        kind: {b: np.ascontiguousarray(part[:, k].T) for k, b in enumerate(ring.bodies)}
        for kind, part in parts.items()
    }
    return np.asarray(ring.shown(motion).T)


def _powers(step: FloatArray, count: int) -> FloatArray:
    """Powers 0 to count - 1 of a matrix, (count, n, n)."""
    found, power = np.eye(len(step))[None], step
    while len(found) < count:
        found = np.concatenate([found, found @ power])
        power = power @ power
    return found[:count]


def _left_over(
    rings: Sequence[RingDown], settings: CampaignSettings, values: Mapping[str, float], periods: float
) -> FloatArray:
    """What the motions from the best states leave over of all records, cut to some periods."""
    found = []
    for ring in rings:
        rows = _cut(ring, periods)
        table = _columns(ring, settings, values).reshape(len(ring.bodies), -1, 2 * len(ring.bodies))
        target = ring.whitened.reshape(len(ring.bodies), -1)[:, :rows].ravel()
        part = table[:, :rows].reshape(len(target), -1)
        if not np.isfinite(part).all():
            found.append(1e3 * target)
            continue
        basis = _basis(part)
        found.append(target - basis @ (basis.T @ target))
    return np.concatenate(found)


def _basis(table: FloatArray) -> FloatArray:
    """Orthonormal columns that span a table's: a state that no channel shows, such as a place of a structure
    without ground behind a high-pass, adds none.
    """
    q, r = np.linalg.qr(table)
    left, size, _ = np.linalg.svd(r)
    return np.asarray(q @ left[:, size > _UNSEEN * size[0]])


def _cut(ring: RingDown, periods: float) -> int:
    whole = int(ring.measured.shape[1])
    strongest = ring.measurement.strongest_hz
    if strongest is None:
        return whole
    return min(max(int(periods * ring.row_rate_hz / strongest), 16 * len(ring.bodies)), whole)


def _starts(
    rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale
) -> Iterator[dict[str, float]]:
    """Yield starting values: by the records' modes, each body's own decay, the balance of forces."""
    simple = _own_decays(rings, settings, scale)
    yield of_modes(rings, settings, scale, simple)
    yield simple
    if len(settings.body) > 1:
        yield _of_spectra(rings, settings, scale, simple)


def _own_decays(rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale) -> dict[str, float]:
    """Values as if every link held its bodies alone; where a stiffness is held the masses follow it."""
    simple = {**scale.values, **_likely_masses(rings, settings, scale)}
    for link in settings.link:
        masses = [simple[mass_of(b)] for b in link.between if b != GROUND]
        omega, ratio = _frequency_and_damping(rings, link.between)
        reduced = 1 / sum(1 / m for m in masses)
        k, c = f"{link.name}.stiffness.k", f"{link.name}.damping.c"
        if k in scale.free:
            simple[k] = simple[k] or reduced * omega**2
        simple[c] = simple[c] or 2 * ratio * reduced * omega
    for link in settings.link:
        if f"{link.name}.stiffness.k" not in scale.free and link.law != "dashpot":
            omega, _ = _frequency_and_damping(rings, link.between)
            for body in link.between:
                if body != GROUND and mass_of(body) in scale.free:
                    simple[mass_of(body)] = simple[f"{link.name}.stiffness.k"] / omega**2
    return simple


def _likely_masses(rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale) -> dict[str, float]:
    """Masses that are sought: that of a record where one gives it, else the geometric mean of all given."""
    known = {mass_of(b.name): b.mass_kg for b in settings.body if b.mass_kg is not None}
    known |= {path: m for ring in rings for path, m in ring.measurement.given.items() if path in scale.values}
    known = {path: m for path, m in known.items() if path.endswith(".mass")}
    mean = float(np.exp(np.mean(np.log(list(known.values()))))) if known else 1.0
    return {path: known.get(path, mean) for path in scale.free if path.endswith(".mass")}


def _of_spectra(
    rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale, simple: Mapping[str, float]
) -> dict[str, float]:
    """Values by the balance of forces in the records' spectra."""
    parts = [part for ring in rings if (part := spectra_of(ring.measurement, settings))]
    terms = {term.name: term.value for part in with_starts(parts, settings) for term in part.terms}
    found = dict(simple)
    for link in settings.link:
        names = {"stiffness.k": LinearNames.stiffness(link.name), "damping.c": LinearNames.damping(link.name)}
        for path, name in names.items():
            if terms.get(name, 0.0) > 0 and f"{link.name}.{path}" in scale.free:
                found[f"{link.name}.{path}"] = terms[name]
    return found


def _frequency_and_damping(rings: Sequence[RingDown], ends: Sequence[str]) -> tuple[float, float]:
    """Circular frequency [rad/s] and damping ratio from the analytic signal of the bodies' motion.

    The frequency is the mean rate of the phase, the ratio the mean rate of the envelope's logarithm over it,
    both weighted by the envelope's square: where the motion is large.
    """
    rates, decays, weights = [], [], []
    for ring in rings:
        for body in set(ring.bodies) & set(ends):
            x = ring.measurement.displacement(body)
            if not np.ptp(x):
                continue
            analytic = signal.hilbert(x - x.mean())
            envelope = np.abs(analytic)
            edge = len(x) // 50
            inner = slice(edge, len(x) - edge)
            rate = np.gradient(np.unwrap(np.angle(analytic)))[inner] * ring.measurement.rate_hz
            weight = envelope[inner] ** 2
            time = np.arange(len(x))[inner] / ring.measurement.rate_hz
            slope = np.polyfit(time, np.log(np.maximum(envelope[inner], 1e-300)), 1, w=envelope[inner])[0]
            rates.append(abs(float(np.average(rate, weights=weight))))
            decays.append(max(-float(slope), 0.0))
            weights.append(float(weight.sum()))
    omega = float(np.average(rates, weights=weights)) if rates else 2 * np.pi
    ratio = float(np.average(decays, weights=weights)) / omega if rates else 0.01
    return omega, float(np.clip(ratio, 1e-4, 0.5))


@dataclass(frozen=True, eq=False)
class FreeDecayFit:
    """Numbers by path, their standard errors relative to them, and what is to be said of them.

    Where 1 kg stands in for a mass only ratios are known, and errors are none.
    """

    values: Mapping[str, float]
    errors: Mapping[str, float]
    free: tuple[str, ...]
    lines: tuple[str, ...]


def fit_free_decay(rings: Sequence[RingDown], campaign: Campaign) -> FreeDecayFit:
    """Fit the declared model to ring-downs that are not held out; a mass that they leave open is said.

    Raises
    ------
    ValueError
        If all are held out.
    """
    rings, settings = [ring for ring in rings if not ring.hold_out], campaign.settings
    if not rings:
        raise ValueError(f"{campaign.path}: found no sound training record of a motion, expected one")
    scale = scale_of(settings, [ring.measurement.given for ring in rings])
    values, errors = _best(rings, settings, scale)
    simple = _own_decays(rings, settings, scale)
    open_ = [n for n in scale.free if n.endswith(".mass") and not errors[n] < RULES.undetermined]
    open_ += [n for n in scale.free if n.endswith(".mass") and n not in open_
              and _at_end(values[n], simple[n])]  # fmt: skip
    lines = list(scale.lines)
    if open_:
        held = replace(
            scale,
            values={**scale.values, **{n: simple[n] for n in open_}},
            free=tuple(n for n in scale.free if n not in open_),
        )
        values, errors = _best(rings, settings, held)
        scale = held
        lines += [f"{n.removesuffix('.mass').removeprefix('body.')}: free decay leaves its mass open; "
                  f"{values[n]:.4g} kg stands in" for n in open_]  # fmt: skip
    lines += _unmet(rings, settings, values)
    return FreeDecayFit(values, errors if scale.known else {}, scale.free, tuple(lines))


def _unmet(
    rings: Sequence[RingDown], settings: CampaignSettings, values: Mapping[str, float]
) -> Iterator[str]:
    """Yield a line for every record that is left over: its own values may be others."""
    for ring in rings:
        rest = _left_over([ring], settings, values, _periods(ring) + 1)
        left, whole = float(np.sum(rest**2)), float(np.sum(ring.whitened**2))
        if left > max(RULES.unmet_record**2 * whole, 2 * _AT_NOISE * ring.measured.size):
            yield (
                f"{ring.file}: the fit to all records leaves {100 * np.sqrt(left / whole):.3g} % of its "
                "motion: masses or springs that campaign.toml gives may not be its own"
            )


def _best(
    rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale
) -> tuple[dict[str, float], dict[str, float]]:
    """Values and errors of the fit that leaves least; others are not tried once one leaves noise alone."""
    noise = 0.5 * sum(ring.measured.size for ring in rings)
    best: tuple[dict[str, float], dict[str, float], float] | None = None
    for start in _starts(rings, settings, scale):
        fit = _fitted(rings, settings, scale, start)
        best = fit if best is None or fit[2] < best[2] else best
        if best[2] < _AT_NOISE * noise:
            break
    assert best is not None
    return best[:2]


def _at_end(value: float, start: float) -> bool:
    low, high = _MASSES
    return not 2 * low < value / start < high / 2


def _fitted(
    rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale, start: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float], float]:
    """Values, relative standard errors and cost of the fit from one start, on longer and longer parts."""
    names = list(scale.free)
    size = np.array([start[name] or 1.0 for name in names])
    low = np.array([_MASSES[0] if n.endswith(".mass") else _LEAST for n in names])
    high = np.array([_MASSES[1] if n.endswith(".mass") else np.inf for n in names])
    at, longest = np.ones(len(names)), max(_periods(ring) for ring in rings)
    periods = min(_PERIODS, longest)
    while True:

        def residuals(x: FloatArray, periods: float = periods) -> FloatArray:
            values = {**start, **dict(zip(names, (x * size).tolist(), strict=True))}
            return _left_over(rings, settings, values, periods)

        found = optimize.least_squares(
            residuals, np.clip(at, low * 1.001, high), bounds=(low, high), x_scale="jac",
            diff_step=np.full(len(names), _STEP), max_nfev=_EVALUATIONS,
        )  # fmt: skip
        at = found.x
        if periods >= longest:
            break
        periods = min(2 * periods, longest)
    jacobian = np.asarray(found.jac) * at
    spread = max(2 * found.cost / len(found.fun), 1.0)
    length = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / np.maximum(length, 1e-300)
    values_, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    inverse = (vectors / np.maximum(values_, 1e-12)) @ vectors.T
    told = length > _UNTOLD * length.max(initial=0.0)
    errors = np.full(len(names), np.inf)
    errors[told] = np.sqrt(np.diag(inverse) * spread)[told] / length[told]
    values = {**start, **dict(zip(names, (at * size).tolist(), strict=True))}
    return values, dict(zip(names, errors.tolist(), strict=True)), float(found.cost)


def _periods(ring: RingDown) -> float:
    strongest = ring.measurement.strongest_hz
    return 1.0 if strongest is None else ring.measured.shape[1] / ring.row_rate_hz * strongest


def free_model(settings: CampaignSettings, fit: FreeDecayFit) -> Model:
    """Return the declared model with fitted numbers and their 95 % limits."""

    def law(made: Law, path: str) -> Law:
        (name, old), value = next(iter(made.parameters.items())), fit.values[path]
        error = fit.errors.get(path, np.inf)
        if path not in fit.free:
            return replace(made, parameters={name: replace(old, value=value, source="given")})
        reach = Z95 * error * value if error < RULES.undetermined else None
        limits = (None, None) if reach is None else (value - reach, value + reach)
        number: Parameter = replace(old, value=value, low=limits[0], high=limits[1], source="identified")
        return replace(made, parameters={name: number})

    laws = {
        link.name: LinkLaws(
            law(constant_stiffness(0.0), f"{link.name}.stiffness.k"),
            law(constant_damping(0.0), f"{link.name}.damping.c"),
        )
        for link in settings.link
    }
    bodies = tuple(Body(b.name, float(fit.values[mass_of(b.name)])) for b in settings.body)
    links = tuple(Link(x.name, *x.between, x.law) for x in settings.link)
    return Model(
        Structure(bodies, links), laws, windows=dict(settings.windows), sampling=dict(settings.sampling)
    )
