"""Where the forces that a model leaves unbalanced live, and errors in the units of the channels."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy import stats

from discovery.localisation.force_history import Course
from discovery.localisation.force_map import ForceMap, force_map
from discovery.localisation.localise import Localisation, Profile, sides_of
from discovery.residual.force_balance import ForceBalanceResidual
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.evaluate import Evaluation
from rom.identification.equation_error import Balance, ForceRecord

_BANDS: Numerical[int] = 4
_CLASSES: Numerical[tuple[float, ...]] = (0.0, 0.25, 0.5, 0.75, 1.0)


def numbers_of(state: ForceBalanceResidual, judged: Sequence[Evaluation]) -> tuple[tuple[str, float], ...]:
    """Errors by name, mean over records of a kind and by held-out record.

    ``force_error_<kind>``: RMS of the unbalanced over that of the measured force, both filtered.
    ``simulation_rms_m_<kind>``: RMS of simulated minus measured displacement, in the channel's unit [m].
    """
    found: list[tuple[str, float]] = []
    force = {
        record.settings.file: _ratio(state, place) for place, record in enumerate(state.balances.records)
    }
    size = {record.settings.file: _rms_of_motion(record) for record in state.balances.records}
    motion = {
        one.settings.file: size[one.settings.file] * float(np.mean(list(c.motion_nrmse.values())))
        for one in judged for c in one.comparisons if c.motion_nrmse and one.settings.file in size
    }  # fmt: skip
    held = {r.settings.file: r.settings.hold_out for r in state.balances.records}
    for name, values in (("force_error", force), ("simulation_rms_m", motion)):
        for kind, wanted in (("training", False), ("hold_out", True)):
            mine = {file: value for file, value in values.items() if held[file] is wanted}
            if mine:
                found.append((f"{name}_{kind}", float(np.mean(list(mine.values())))))
            if wanted and len(mine) > 1:
                found += [(f"{name} in {file}", value) for file, value in mine.items()]
    return tuple(found)


def _ratio(state: ForceBalanceResidual, place: int) -> float:
    rows = state.balances.owner == place
    record, left = state.balances.records[place], (state.residual * state.balances.noise)[rows]
    measured = np.concatenate([balance.terms["force"] for balance in record.balances])
    size = float(np.linalg.norm(measured))
    return float(np.linalg.norm(left)) / size if size else 0.0


def _rms_of_motion(record: ForceRecord) -> float:
    bodies = [motion[0] for place, motion in record.motion.items() if place.startswith("body:")]
    return float(np.mean([np.sqrt(np.mean(x**2)) for x in bodies])) if bodies else 0.0


def localise_forces(state: ForceBalanceResidual, numbers: tuple[tuple[str, float], ...]) -> Localisation:
    """Return where the residual of the training records lives."""
    parts = list(_parts(state, state.residual))
    squares = np.concatenate([rows for _, _, rows in parts]) ** 2
    forces = tuple(_force_maps(state))
    return Localisation(
        by_channel=_means((balance.channel, rows) for _, balance, rows in parts),
        by_test=_means((record.settings.test, rows) for record, _, rows in parts),
        by_frequency=_by_frequency(parts),
        by_preload=(),
        by_amplitude=_by_amplitude(parts),
        by_place=tuple((one.place, one.level) for one in forces),
        by_sign=sides_of(forces[0]) if len(forces) == 1 else (),  # one link's, as with a bolt
        whiteness_p=whiteness([rows for _, _, rows in parts], int(state.criteria.localisation.lags)),
        total=float(squares.mean()),
        numbers=numbers,
        forces=forces,
    )


def _force_maps(state: ForceBalanceResidual) -> Iterator[ForceMap]:
    """Map of what is left unbalanced on every body, and in every link that is driven on its own."""
    found: dict[str, list[Course]] = {}
    noises = _parts(state, state.balances.noise)
    for (record, balance, rows), (_, _, noise) in zip(_parts(state, state.residual), noises, strict=True):
        x, v = (record.smoothing.rows(one, record.rate_hz) for one in record.motion[balance.place][:2])
        time = np.arange(len(rows)) / record.smoothing.rate_hz(record.rate_hz)
        name = balance.place.replace("body:", "body ")
        found.setdefault(name, []).append(Course(time, noise * rows, x, v, noise**2))
    yield from (force_map(name, courses, state.criteria) for name, courses in found.items())


def _parts(
    state: ForceBalanceResidual, values: FloatArray
) -> Iterator[tuple[ForceRecord, Balance, FloatArray]]:
    """Rows of every balance of the training records, of values that all rows have."""
    first = 0
    for record in state.balances.records:
        for balance in record.balances:
            count = len(balance.terms["force"])
            if not record.settings.hold_out:
                yield record, balance, values[first : first + count]
            first += count


def _means(parts: Iterable[tuple[str, FloatArray]]) -> Profile:
    found: dict[str, list[FloatArray]] = {}
    for label, rows in parts:
        found.setdefault(label, []).append(rows)
    return tuple((label, float(np.mean(np.concatenate(rows) ** 2))) for label, rows in found.items() if rows)


def _by_frequency(parts: Sequence[tuple[ForceRecord, Balance, FloatArray]]) -> Profile:
    """Power of the residual's lines over that of white noise, in bands of equal width."""
    rates = [record.smoothing.rate_hz(record.rate_hz) for record, _, _ in parts]
    edges = np.linspace(0.0, max(rates) / 2, _BANDS + 1)
    found = []
    for low, high in itertools.pairwise(edges):
        power: list[FloatArray] = []
        for (_, _, rows), rate in zip(parts, rates, strict=True):
            frequency = np.fft.rfftfreq(len(rows), 1 / rate)
            lines = np.abs(np.fft.rfft(rows)) ** 2 / len(rows)
            power.append(lines[(frequency >= low) & (frequency < high)])
        inside = np.concatenate(power)
        if len(inside):
            found.append((f"{low:.3g} to {high:.3g} Hz", float(inside.mean())))
    return tuple(found)


def _by_amplitude(parts: Sequence[tuple[ForceRecord, Balance, FloatArray]]) -> Profile:
    """Mean square by displacement of the place, in shares of its largest."""
    found = []
    largest = max((float(np.abs(m[0]).max()) for r, b, _ in parts if (m := r.motion[b.place]) is not None))
    for low, high in itertools.pairwise(_CLASSES):
        inside = []
        for record, balance, rows in parts:
            x = np.abs(record.smoothing.rows(record.motion[balance.place][0], record.rate_hz)) / largest
            inside.append(rows[(x >= low) & (x < high)])
        every = np.concatenate(inside)
        if len(every):
            found.append((f"{100 * low:g} to {100 * high:g} % of the largest", float(np.mean(every**2))))
    return tuple(found)


def whiteness(parts: Sequence[FloatArray], most: int) -> float:
    """Chance of so much correlation from row to row in noise (G. Ljung, G. Box, Biometrika 65, 297, 1978)."""
    square, count = 0.0, 0
    for rows in parts:
        n, lags = len(rows), min(most, len(rows) // 4)
        centred = rows - rows.mean()
        whole = float(centred @ centred)
        if whole <= 0 or lags < 1:
            continue
        for lag in range(1, lags + 1):
            square += n * (n + 2) / (n - lag) * (float(centred[lag:] @ centred[:-lag]) / whole) ** 2
        count += lags
    return float(stats.chi2.sf(square, count)) if count else float("nan")
