"""Where a fit of modes starts: poles of many orders of a common denominator, and the best set among them.

    A(z) Y_s(f) = B_s(z) F(f) + T_s(z),    z = exp(-i pi f / f_max)

for the spectra of all sensors s of all records, real coefficients, by least squares; T takes up the states at
a record's ends, so that decays without a force count too. (Least-squares complex frequency: P. Guillaume et
al., IMAC 21, 2003; transients as polynomials: R. Pintelon, J. Schoukens, System Identification, 2nd ed.,
2012, Sec. 6.3.) Slow modes have few lines of a wide band, and are sought in its lower parts too. Of the poles
of all orders and parts those are chosen, one by one, that leave least of the records.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.modal_responses import ModalRecord

Pole = tuple[float, float]
"""Circular frequency [rad/s] and damping ratio."""
_MORE_ORDERS: Numerical[int] = 16  # than twice the modes
_DAMPED: Numerical[float] = 0.2  # no pole of a structure is damped more
_LEAST_DAMPED: Numerical[float] = 1e-5
_ALIKE: Numerical[tuple[float, float]] = (0.002, 0.5)  # poles that differ by less are one: in f, in ln zeta
_MOST: Numerical[int] = 40  # poles that are tried
_MOST_SLOW: Numerical[int] = 12  # of a lower part of the band
_PART: Numerical[float] = 4.0  # of which a lower part ends
_LINES: Numerical[float] = 1.5  # to one coefficient of a numerator or of transients, at least
_ABOVE: Numerical[float] = 1.1  # times the band's end: f_max


def starting_poles(records: Sequence[ModalRecord], count: int, band_hz: tuple[float, float]) -> list[Pole]:
    """Return the poles from which a fit of some modes starts, by frequency.

    Parameters
    ----------
    records : sequence of ModalRecord
        Training records.
    count : int
        Number of modes.
    band_hz : tuple of float
        Where modes are sought [Hz], from and to.

    Raises
    ------
    ValueError
        If the records tell fewer poles in the band.
    """
    pool = _pool(records, count, band_hz)
    if len(pool) < count:
        raise ValueError(
            f"modes.count: found {len(pool)} modes from {band_hz[0]:.4g} to {band_hz[1]:.4g} Hz, expected "
            f"{count}: declare fewer modes or another [band]"
        )
    shares = _Shares(records, pool)
    chosen: list[int] = []
    for _ in range(count):
        left = [k for k in range(len(pool)) if k not in chosen and _is_other(pool, k, chosen)]
        if not left:
            left = [k for k in range(len(pool)) if k not in chosen]
        chosen.append(min(left, key=lambda k: shares.misfit([*chosen, k])))
    return sorted(pool[k] for k in _exchanged(chosen, pool, shares))


def _exchanged(chosen: list[int], pool: Sequence[Pole], shares: _Shares) -> list[int]:
    """The set after single exchanges that leave less: the first choice was made without the others."""
    best, least = list(chosen), shares.misfit(chosen)
    for place in range(len(best)):
        others = [k for i, k in enumerate(best) if i != place]
        for k in range(len(pool)):
            if k in best or not _is_other(pool, k, others):
                continue
            trial = [*others, k]
            if (cost := shares.misfit(trial)) < least:
                best, least = [*best[:place], k, *best[place + 1 :]], cost
                others = [one for i, one in enumerate(best) if i != place]
    return best


def _is_other(pool: Sequence[Pole], k: int, chosen: Sequence[int]) -> bool:
    """Whether a pole is not another estimate of one that is chosen: further off than half its bandwidth."""
    omega, ratio = pool[k]
    return all(abs(pool[i][0] - omega) > 0.5 * max(ratio, pool[i][1]) * omega for i in chosen)


class _Shares:
    """What sets of poles leave of the records, residues of every sensor and record free."""

    def __init__(self, records: Sequence[ModalRecord], pool: Sequence[Pole]) -> None:
        self._records = records
        self._targets = [record.whitened for record in records]
        self._rows = [record.of_modes(*zip(*pool, strict=True)) for record in records]
        self._at_once = [record.at_once() for record in records]

    def misfit(self, chosen: Sequence[int]) -> float:
        """Sum of squares over the noise that a set leaves."""
        total = 0.0
        for record, target, rows, at_once in zip(
            self._records, self._targets, self._rows, self._at_once, strict=True
        ):
            for kind in dict.fromkeys(record.kinds):
                mine = [s for s, own in enumerate(record.kinds) if own == kind]
                table = np.concatenate([*rows[mine[0], list(chosen)], at_once[mine[0]]])
                table = table[np.any(table, axis=1)]
                q = np.linalg.qr((table / np.linalg.norm(table, axis=1)[:, None]).T)[0]
                total += float(np.sum(target[mine] ** 2) - np.sum((target[mine] @ q) ** 2))
        return total


def _pool(records: Sequence[ModalRecord], count: int, band_hz: tuple[float, float]) -> list[Pole]:
    """Poles of all orders in the band, and in its lower parts; of such as are alike one."""
    found = _without_twins(_in_part(records, 2 * count, 2 * count + _MORE_ORDERS, band_hz))[:_MOST]
    low_hz, high_hz = band_hz
    while (high_hz := high_hz / _PART) > _PART * low_hz:
        lines = min(_lines(record, (low_hz, high_hz)).sum() for record in records)
        most = min(2 * count + _MORE_ORDERS, int(lines / (_LINES * (1 + len(records[0].forces)))) - 1)
        slow = _without_twins(_in_part(records, min(2 * count, most), most, (low_hz, high_hz)))[:_MOST_SLOW]
        found += [pole for pole in slow if pole not in found]
    return found


def _in_part(
    records: Sequence[ModalRecord], least: int, most: int, band_hz: tuple[float, float]
) -> list[Pole]:
    """Poles of all orders within a part of the band, none of an order below two."""
    highest, found = _ABOVE * band_hz[1], list[Pole]()
    if most < 2:
        return found
    tables = [_denominators(record, most, highest, band_hz, sign) for record in records for sign in (1, -1)]
    grams = [np.sum(tables[k::2], axis=0) for k in (0, 1)]
    for order in range(max(least, 2), most + 1):
        for gram, sign in zip(grams, (1, -1), strict=True):
            poles = _poles(gram, order, highest, sign)
            found += [pole for pole in poles if band_hz[0] <= pole[0] / 2 / np.pi <= band_hz[1]]
    return found


def _lines(record: ModalRecord, band_hz: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Lines of a record's spectra within a part of the band."""
    frequency = np.fft.rfftfreq(record.ring.measured.shape[1], 1 / record.ring.row_rate_hz)
    return np.asarray((frequency >= band_hz[0]) & (frequency <= band_hz[1]))


def _without_twins(poles: Sequence[Pole]) -> list[Pole]:
    """Medians of groups of like poles, the largest groups first."""
    groups: list[list[Pole]] = []
    for pole in poles:
        for group in groups:
            omega, ratio = group[0]
            if (
                abs(pole[0] / omega - 1) < _ALIKE[0] + 0.25 * ratio
                and abs(np.log(pole[1] / ratio)) < _ALIKE[1]
            ):
                group.append(pole)
                break
        else:
            groups.append([pole])
    groups.sort(key=lambda group: -len(group))
    medians = (np.median(group, axis=0).tolist() for group in groups)
    return [(float(omega), float(ratio)) for omega, ratio in medians]


def _denominators(
    record: ModalRecord, order: int, highest_hz: float, band_hz: tuple[float, float], sign: int
) -> FloatArray:
    """Normal matrix of a denominator's coefficients, numerators and transients projected off."""
    ring = record.ring
    rate, rows = ring.row_rate_hz, record.whitened
    frequency = np.fft.rfftfreq(rows.shape[1], 1 / rate)
    inside = _lines(record, band_hz)
    powers = np.exp(-1j * sign * np.pi * np.outer(frequency[inside] / highest_hz, np.arange(order + 1)))
    forces = [np.fft.rfft(ring.compared(record.kinds[0], record.force(p)))[inside] for p in record.forces]
    columns = np.concatenate([powers, *(f[:, None] * powers for f in forces if np.any(f))], axis=1)
    q = np.linalg.qr(_real(columns / np.linalg.norm(columns, axis=0)))[0]
    gram = np.zeros((order + 1, order + 1))
    for y in rows:
        line = np.fft.rfft(y)[inside]
        block = _real(line[:, None] * powers / max(float(np.linalg.norm(line)), 1e-300))
        rest = block - q @ (q.T @ block)
        gram += rest.T @ rest
    return gram


def _real(columns: np.ndarray) -> FloatArray:
    return np.concatenate([columns.real, columns.imag])


def _poles(gram: FloatArray, order: int, highest_hz: float, sign: int) -> list[Pole]:
    """Poles of the denominator of an order, its last coefficient one."""
    lead = np.linalg.lstsq(gram[:order, :order], -gram[:order, order], rcond=None)[0]
    roots = np.roots([1.0, *lead[::-1]])
    roots = roots[np.abs(roots) > 0]
    continuous = -sign * np.log(roots.astype(np.complex128)) * 2 * highest_hz
    found = []
    for pole in continuous:
        omega = abs(pole)
        if pole.imag > 0 and _LEAST_DAMPED < -pole.real / omega < _DAMPED:
            found.append((float(omega), float(-pole.real / omega)))
    return found
