"""Starting values of a fit: those declared, unless they are far from what the records show."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.output_error import OutputErrorFit, start_cost
from rom.identification.record_spectra import LinearNames
from rom.identification.spectral_model import STRUCTURAL, ComplexArray, SpectralRecord, Term

_FLOOR: Numerical[float] = 5.0
_ROUNDING: Numerical[float] = 1e-12  # share of the strongest line


def best_starts(
    records: Sequence[tuple[SpectralRecord, ...]], settings: CampaignSettings
) -> tuple[SpectralRecord, ...]:
    """Return all parts of all records with starting values.

    A fit that starts from a mode far off may never find that of the records: where a declared start is far
    from what equation errors tell, that of the two is taken which leaves less over.
    """
    declared = with_starts(records, settings)
    if not any(link.stiffness_n_per_m or link.damping_ns_per_m for link in settings.link):
        return declared
    own = with_starts(records, settings, declared=False)
    pairs = (
        (a.value, b.value)
        for x, y in zip(declared, own, strict=True)
        for a, b in zip(x.terms, y.terms, strict=True)
    )
    far = any(a > 0 and b > 0 and abs(np.log(a / b)) > np.log(RULES.far_start) for a, b in pairs)
    return own if far and start_cost(own) < start_cost(declared) else declared


def far_starts(settings: CampaignSettings, linear: OutputErrorFit | None) -> Iterator[str]:
    """Yield a line for every declared starting stiffness that is far from what was identified."""
    if linear is None:
        return
    for link in settings.link:
        name, start = LinearNames.stiffness(link.name), link.stiffness_n_per_m
        values = [linear.value(x) for x in linear.names if x == name or x.startswith(f"{name}@")]
        nearest = float(np.clip(start or 0.0, min(values, default=0.0), max(values, default=0.0)))
        if start and nearest and abs(np.log(start / nearest)) > np.log(RULES.far_start):
            factor = start / nearest
            yield (
                f"link {link.name}: stiffness_n_per_m = {start:.4g} is {factor:.3g} times what the records "
                "show: the mode that it gives is not theirs"
            )


def with_starts(
    records: Sequence[tuple[SpectralRecord, ...]], settings: CampaignSettings, *, declared: bool = True
) -> tuple[SpectralRecord, ...]:
    """Return all parts of all records with starting values.

    The campaign's own starting values come first, without `declared` none; a link whose stiffness was seen
    without the bolt starts from that; the rest are medians of equation-error fits. Then the joint of every
    record is estimated beside these.

    Parameters
    ----------
    records : sequence of tuple of SpectralRecord
        Parts of every record.
    settings : CampaignSettings
        Settings of the campaign.
    declared : bool
        Whether starting values that the campaign declares are taken.
    """
    links = settings.link if declared else ()
    given = {LinearNames.stiffness(link.name): link.stiffness_n_per_m for link in links}
    given |= {LinearNames.damping(link.name): link.damping_ns_per_m for link in links}
    shared = _shared_start(records)
    for link in settings.link:
        without = shared.get(LinearNames.stiffness(link.name, bolted_in=False))
        if without is not None:
            shared[LinearNames.stiffness(link.name)] = without
    shared |= {name: value for name, value in given.items() if value}
    started = []
    for parts in records:
        beside = [_with_values(part, shared) for part in parts]
        own = equation_error_fit(beside, only=parts[0].local)
        own |= {name: value for name, value in given.items() if value and name in own}
        started += [_with_values(part, own) for part in beside]
    return tuple(started)


def equation_error_fit(
    parts: Sequence[SpectralRecord], only: Collection[str] | None = None
) -> dict[str, float]:
    """Fit sum_terms value d d^T s^p X = F by least squares over the lines, a row for every moving body.

    Four polynomial columns a row and part (1/s^2, 1/s, 1, s) take up the record's ends. A value that comes
    out negative is replaced by one that the mass and the strongest line allow; the result only starts the
    output-error fit. `only` names the terms to fit, None for all free ones; the others are taken at their
    values.
    """
    structural = [term for term in parts[0].terms if term.matrix in STRUCTURAL]
    free = [term for term in structural if (term.free if only is None else term.name in only)]
    if not free:
        return {}
    blocks = [_equations(part, free, place, len(parts)) for place, part in enumerate(parts)]
    matrix = np.concatenate([block for block, _ in blocks])
    right = np.concatenate([target for _, target in blocks])
    scale = np.linalg.norm(matrix, axis=0) + np.finfo(float).tiny
    solution = np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale
    return {t.name: _plausible(t, float(value), parts[0]) for t, value in zip(free, solution, strict=False)}


def _equations(
    part: SpectralRecord, free: Sequence[Term], place: int, n_parts: int
) -> tuple[FloatArray, FloatArray]:
    """Return real rows (2 lines bodies, terms + nuisance) and their right-hand side."""
    s = 2j * np.pi * part.frequency
    n = len(part.orders)
    names = {term.name for term in free}
    displacement = np.stack([part.motion[:, i] / s**order for i, order in enumerate(part.orders)], axis=1)
    known = sum(
        (
            t.value * _action(t, s, displacement)
            for t in part.terms
            if t.matrix in STRUCTURAL and t.name not in names
        ),
        np.zeros_like(displacement),
    )
    nuisance = np.stack([s**-2, s**-1, np.ones_like(s), s], axis=1)
    block = np.zeros((len(s), n, len(free) + 4 * n * n_parts), dtype=np.complex128)
    for column, term in enumerate(free):
        block[:, :, column] = _action(term, s, displacement)
    for body in range(n):
        first = len(free) + 4 * (n * place + body)
        block[:, body, first : first + 4] = nuisance
    weight = _equation_weight(part)
    rows = (block * weight[:, :, None]).reshape(len(s) * n, -1)
    target = ((part.force - known) * weight).reshape(-1)
    return np.concatenate([rows.real, rows.imag]), np.concatenate([target.real, target.imag])


def _equation_weight(part: SpectralRecord) -> FloatArray:
    """Return weights (lines, bodies) of equations: small where differentiated noise would outdo motion.

    A record made of few lines shows nothing at all between them: rounding stands for noise there.
    """
    size = np.abs(part.motion)
    floor = np.maximum(_FLOOR * np.median(size, axis=0), _ROUNDING * size.max(axis=0) + 1e-150)
    omega = 2 * np.pi * part.frequency[:, None]
    strongest = omega[np.argmax(size, axis=0), 0]
    missing = 2 - np.array(part.orders)
    return np.asarray(size**2 / (size**2 + floor**2) / (omega**2 + strongest**2) ** (missing / 2))


def _action(term: Term, s: ComplexArray, displacement: ComplexArray) -> ComplexArray:
    return (s**term.power * (displacement @ term.direction))[:, None] * term.direction


def _plausible(term: Term, value: float, record: SpectralRecord) -> float:
    if value > 0:
        return value
    strength = np.sum(np.abs(record.motion) ** 2, axis=1)
    omega = 2 * np.pi * float(record.frequency[np.argmax(strength)])
    mass = float(np.mean([t.value for t in record.terms if t.matrix == "mass"]))
    return {"stiffness": mass * omega**2, "damping": 0.02 * mass * omega, "mass": mass}[term.matrix]


def _shared_start(records: Sequence[tuple[SpectralRecord, ...]]) -> dict[str, float]:
    """Return the median over records with a force, which alone tell more than ratios, and fewest unknowns."""
    found: dict[str, list[tuple[tuple[bool, int], float]]] = {}
    for parts in records:
        estimate, unforced = equation_error_fit(parts), not any(np.any(part.force) for part in parts)
        for name, value in estimate.items():
            if name not in parts[0].local:
                found.setdefault(name, []).append(((unforced, len(estimate)), value))
    return {
        name: float(np.median([value for rank, value in pairs if rank == min(pairs)[0]]))
        for name, pairs in found.items()
    }


def _with_values(record: SpectralRecord, values: Mapping[str, float]) -> SpectralRecord:
    """Return the record with new starting values of the named terms."""
    terms = (t if t.given else replace(t, value=values.get(t.name, t.value)) for t in record.terms)
    return replace(record, terms=tuple(terms))
