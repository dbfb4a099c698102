"""Slips of units, channels, masses and clocks, told by the balance of momentum of the hits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median_high, median_low

import numpy as np
from scipy import optimize
from scipy.constants import g, inch, lbf

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.signals.momentum import Balance
from rom.signals.suspicion_evidence import Evidence, Suspicion

_LEAST_KG: Numerical[float] = 1e-12  # of which a logarithm can be taken
_LENGTHS = {"acceleration": "mm/s2", "velocity": "mm/s", "displacement": "mm"}


def late(records: Sequence[Evidence]) -> Iterator[Suspicion]:
    """Motions that begin after the force, or before it; by what records show alike, where they do."""
    delays = [(record, record.balance, delay_of(record.balance)) for record in records]
    shown: dict[str, list[float]] = {}
    for _, balance, delay in delays:
        for channel in balance.late if balance is not None and delay else ():
            shown.setdefault(channel, []).append(delay)
    for record, balance, delay in delays:
        if balance is None or not delay:
            continue
        for channel in balance.late:
            usual = float(np.median(shown[channel]))
            own = usual if abs(delay / usual - 1) < balance.rules.late_alike else delay
            size = f"{1e3 * abs(own):.2g} ms"
            finding = f"{channel} begins {size} {'after' if own > 0 else 'before'} the force"
            likely = f"{'late' if own > 0 else 'early'} by {size}"
            yield Suspicion(record.file, channel, finding, None, likely, 1 - balance.late_misfit)


def delay_of(balance: Balance | None) -> float:
    """Return the delay [s] of motions behind the force, 0 where there is none."""
    if balance is None or abs(balance.late_s) < balance.rules.late_s:
        return 0.0
    return balance.late_s


@dataclass(frozen=True)
class _Slip:
    """One thing that may have gone wrong: what the masses seem to be multiplied by, or channels exchanged."""

    places: tuple[int, ...]
    apparent: float = 1.0
    exchanged: bool = False

    def fitted(self, balance: Balance, masses: FloatArray) -> tuple[float, float]:
        """Return what is left of the force's square beyond noise, and the factor with the sensors' gains."""
        count = len(masses)
        factors = np.where(np.isin(np.arange(count), self.places), self.apparent, 1.0)
        order = np.arange(count)
        if self.exchanged:
            order[list(self.places)] = self.places[::-1]
        left, gains = balance.with_gains(factors * masses, balance.rules.scale_factor, order.tolist())
        noise = balance.misfit_of_noise((factors * masses)[np.argsort(order)])
        return left - noise, self.apparent * float(np.exp(np.log(gains[list(self.places)]).mean()))


_Told = tuple[_Slip | None, float, float]
"""A slip, its factor, its confidence; None for a factor without a name."""


def slips(records: Sequence[Evidence], settings: CampaignSettings, fewest: int) -> Iterator[Suspicion]:
    """What the balances of momentum tell: units, signs, exchanged channels, masses.

    Parameters
    ----------
    records : sequence of Evidence
        Of all records of the campaign.
    settings : CampaignSettings
        The campaign's.
    fewest : int
        Hits, or parts of driven records, that tell a mass which nobody declares.
    """
    judged = [r for r in records if r.balance is not None and (not r.doubts or delay_of(r.balance))]
    guesses = [_told_by(judged, masses) for masses in _guesses(judged, settings, fewest)]
    known, found, _ = min(guesses, key=lambda told: (told[2], len(told[1])))
    shared = len(found) == len(known)
    wild = any(_is_wild(record.balance) for record in known if record.balance is not None)
    for record in known:
        if record.file in found:
            yield from _described(record, *found[record.file], shared, wild)


def _is_wild(balance: Balance) -> bool:
    """Whether the masses that balance would be shaken harder by their hit than any that are tested."""
    mass = float(balance.masses.sum())
    return mass > 0 and balance.peak_n > balance.rules.wild_m_per_s2 * mass


def _told_by(
    records: Sequence[Evidence], masses: Mapping[str, float]
) -> tuple[list[Evidence], dict[str, _Told], int]:
    """Return the records all of whose masses are known, the slip of each by file where it shows one, and how
    many records neither the masses nor a slip with a name explain.
    """
    known, found, open_ = [], {}, 0
    for record in records:
        balance, own = record.balance, {**masses, **_own(record)}
        if balance is None or not {*balance.bodies} <= own.keys():
            open_ += 1
            continue
        known.append(record)
        declared = np.array([own[body] for body in balance.bodies])
        told = _slip_of(balance, declared)
        if told is not None:
            found[record.file] = told
        named = told is not None and told[0] is not None
        open_ += not named and balance.misfit(declared) > balance.rules.scale_left
    found |= _of_most(known, found, masses)
    return known, found | _of_few(known, found, masses), open_


def _of_most(
    records: Sequence[Evidence], found: Mapping[str, _Told], masses: Mapping[str, float]
) -> dict[str, _Told]:
    """Return the slip of most records of the same bodies, by file, for those that it fits as well."""
    more: dict[str, _Told] = {}
    for bodies in {record.balance.bodies for record in records if record.balance is not None}:
        same = [r for r in records if r.balance is not None and r.balance.bodies == bodies]
        counts = Counter(found[record.file][0] for record in same if record.file in found)
        slip, count = next(iter(counts.most_common(1)), (None, 0))
        if slip is None or 2 * count <= len(same):
            continue
        for record in same:
            told = found.get(record.file)
            if record.balance is None or (told is not None and told[0] == slip):
                continue
            declared = np.array([{**masses, **_own(record)}[body] for body in bodies])
            left, measured = slip.fitted(record.balance, declared)
            most = _left(record.balance, declared) * (
                1.0 if told is None else record.balance.rules.slip_share
            )
            if left <= most:
                more[record.file] = (slip, measured, count / len(same))
    return more


def _of_few(
    records: Sequence[Evidence], found: Mapping[str, _Told], masses: Mapping[str, float]
) -> dict[str, _Told]:
    """Return the unit's factor by which few records differ from the others of the same bodies, by file.

    Gain, direction and delay of a sensor are the same in all records: masses that most of them show stand
    for all that sensors do, and a record needs no more allowance for it. A sign of the same body that
    balances too, as on a spring, is less likely.
    """
    more: dict[str, _Told] = {}
    for same in _of_same_bodies(records, masses):
        usual = [
            np.maximum(balance.masses, _LEAST_KG) / known
            for file, balance, known in same
            if file not in found and balance.shows(known)
        ]
        if 2 * len(usual) < len(same):
            continue
        for file, balance, known in same:
            told, unit = found.get(file), _unlike(balance, np.median(usual, axis=0) * known)
            if unit is not None and (told is None or told[0] == _Slip(unit[0].places, -1.0)):
                more[file] = unit
    return more


def _of_same_bodies(
    records: Sequence[Evidence], masses: Mapping[str, float]
) -> list[list[tuple[str, Balance, FloatArray]]]:
    """Return records of the same bodies together: file, balance, and masses as known [kg]."""
    groups: dict[tuple[str, ...], list[tuple[str, Balance, FloatArray]]] = {}
    for record in records:
        if record.balance is not None:
            known = {**masses, **_own(record)}
            row = np.array([known[body] for body in record.balance.bodies])
            groups.setdefault(record.balance.bodies, []).append((record.file, record.balance, row))
    return list(groups.values())


def _unlike(balance: Balance, usual: FloatArray) -> tuple[_Slip, float, float] | None:
    """Return the unit by which the masses that balance best differ from the usual ones, if one explains what
    is left as well as any masses would.
    """
    rules, shown = balance.rules, np.maximum(balance.masses, _LEAST_KG)
    left, least = balance.misfit(usual), balance.misfit(shown)
    needed = max(rules.slip_left, rules.slip_noise * balance.misfit_of_noise(usual))
    for slip in _candidates(balance):
        if slip.apparent < 0 or slip.exchanged:
            continue
        scaled = np.isin(np.arange(len(usual)), slip.places)
        masses = np.where(scaled, slip.apparent, 1.0) * usual
        off = np.abs(np.log(shown / masses))
        near = np.all(off < np.log(np.where(scaled, rules.slip_near, rules.scale_factor)))
        share = balance.misfit(masses)
        if near and left - share > needed and share - least < rules.slip_share * (left - least):
            measured = float(np.exp(np.log(shown / usual)[scaled].mean()))
            return slip, measured, 1 - (share - least) / (left - least)
    return None


def _left(balance: Balance, masses: FloatArray) -> float:
    """Share of the force's square that noise and faults of sensors leave."""
    left, _ = balance.with_gains(masses, balance.rules.slip_near, crossed=balance.rules.crossed)
    return left - balance.misfit_of_noise(masses)


def _own(record: Evidence) -> dict[str, float]:
    """Masses [kg] that a record gives, by body."""
    parts = ((path.split(".")[1], value) for path, value in record.given.items() if path.endswith(".mass"))
    return dict(parts)


def _guesses(
    records: Sequence[Evidence], settings: CampaignSettings, fewest: int
) -> Iterator[dict[str, float]]:
    """Masses [kg] as declared; where they are not, as bodies alone show them, or as most records do, or as
    these would with a sign turned.

    Those are right that leave the fewest records without an explanation.
    """
    names = settings.body_names
    yield _masses(records, settings, fewest)
    if all(body.mass_kg is not None for body in settings.body):
        return
    for turned in ((), names, *((name,) for name in names if len(names) > 1)):
        yield _masses(records, settings, fewest, turned)
    yield _masses(records, settings, fewest, (), likelier=False)


def _masses(
    records: Sequence[Evidence],
    settings: CampaignSettings,
    fewest: int,
    turned: Collection[str] | None = None,
    likelier: bool = True,
) -> dict[str, float]:
    """Masses [kg] as declared, or as bodies alone show them, or, with signs of some turned, as most do.

    A driven record of more than one body tells none: points of an elastic structure may add up to no sum.
    """
    masses = {}
    for body in settings.body:
        of_body = [
            balance
            for r in records
            if (balance := r.balance) is not None
            and body.name not in _own(r)
            and (balance.parts == 1 or len(balance.bodies) == 1)
        ]
        shown = [
            (b, float(b.masses_turned(turned or ())[b.bodies.index(body.name)]))
            for b in of_body
            if body.name in b.bodies
        ]
        alone = [] if turned is not None else [mass for b, mass in shown if len(b.bodies) == 1]
        if body.mass_kg is not None:
            masses[body.name] = body.mass_kg
        elif alone or sum(balance.parts for balance, _ in shown) >= fewest:
            masses[body.name] = _usual(alone or [mass for _, mass in shown], likelier)
    return {body: mass for body, mass in masses.items() if mass > 0}


def _usual(masses: Sequence[float], likelier: bool) -> float:
    """Return what most records show; of two halves likelier the smaller, since sensors in g show g times the
    mass, or the larger, where a thousand are between them: a force in kN, an acceleration in mm/s2.
    """
    low, high = median_low(masses), median_high(masses)
    return low if (high < np.sqrt(1e3 * g) * low) == likelier else high


def _slip_of(balance: Balance, masses: FloatArray) -> _Told | None:
    """Return the slip that a balance shows, its factor, and its confidence; a slip of None has no name."""
    rules = balance.rules
    noise, left = balance.misfit_of_noise(masses), _left(balance, masses)
    if left < max(rules.slip_left, rules.slip_noise * noise):
        return None
    fits = [(slip, *slip.fitted(balance, masses)) for slip in _candidates(balance)]
    best: dict[tuple[int, ...], float] = {}  # of all units of the same channels
    for slip, share, _ in fits:
        if slip.apparent > 0 and not slip.exchanged:
            best[slip.places] = min(share, best.get(slip.places, np.inf))
    met = [
        (slip, share, measured)
        for slip, share, measured in fits
        if share < (rules.exchanged_share if slip.exchanged else rules.slip_share) * left
        and abs(np.log(measured / slip.apparent)) < np.log(rules.slip_near)
        and (slip.apparent < 0 or slip.exchanged or share == best[slip.places])
    ]
    if not met:
        return _without_name(balance, masses)
    # a body on a spring may balance with a sign too, which its neighbours would have told
    near = min(share for _, share, _ in met)
    near += max(rules.slip_alike * left, rules.slip_noise * noise)
    likelier = [one for one in met if one[1] <= near and one[0].apparent > 0]
    slip, share, measured = min(likelier or met, key=lambda one: one[1])
    return slip, measured, min(1 - share / left, 1.0)


def _without_name(balance: Balance, masses: FloatArray) -> _Told | None:
    """Return the factor that all masses seem to have, where it is more than a gain."""
    rules, left = balance.rules, balance.misfit(masses)
    if left < rules.scale_left:
        return None
    found = optimize.minimize_scalar(
        lambda log: balance.misfit(np.exp(log) * masses), bounds=(-12.0, 12.0), method="bounded"
    )
    share = float(found.fun) / left
    if share < rules.slip_share and abs(found.x) > np.log(rules.scale_factor):
        return None, float(np.exp(found.x)), 1 - share
    return None


def _candidates(balance: Balance) -> Iterator[_Slip]:
    every = tuple(range(len(balance.channels)))
    small = (1e-3 * g,) if all(one.startswith("acceleration") for one in balance.channels) else ()
    for apparent in (g, *small, 1 / g, 1e-3, 1e3, 1 / lbf, inch, -1.0):
        yield _Slip(every, apparent)
    if len(every) > 1:
        for place in every:
            for apparent in (g, *small, 1e-3, 1e3, inch, -1.0):
                yield _Slip((place,), apparent)
        for pair in combinations(every, 2):
            yield _Slip(pair, exchanged=True)


def _described(
    record: Evidence, slip: _Slip | None, apparent: float, confidence: float, shared: bool, wild: bool
) -> Iterator[Suspicion]:
    balance = record.balance
    assert balance is not None
    if slip is None:
        finding = f"the momentum of the declared masses is {1 / apparent:.3g} times the impulse of the hit"
        yield Suspicion(record.file, balance.force, finding, 1 / apparent, "", confidence)
        return
    channels = [balance.channels[place] for place in slip.places]
    if slip.exchanged:
        for channel, other in (channels, channels[::-1]):
            finding = f"force and motion balance with {channel} in the place of {other}"
            yield Suspicion(record.file, channel, finding, None, "channels exchanged", confidence)
        return
    likely, of_force, of_mass = (
        _unit(slip, balance, shared, wild) if slip.apparent > 0 else _sign(slip, record)
    )
    named = [balance.force] if of_force else channels
    if of_mass:
        named = [f"body:{balance.bodies[place]}" for place in slip.places]
    shown, exact = (1 / apparent, 1 / slip.apparent) if of_force else (apparent, slip.apparent)
    for name in named:
        finding = f"force and motion balance with {name} multiplied by {shown:.4g}"
        yield Suspicion(record.file, name, finding, exact, likely, confidence)


def _sign(slip: _Slip, record: Evidence) -> tuple[str, bool, bool]:
    """The force's sign where all motions oppose it; of one body alone the hammer's push tells whose it is."""
    assert record.balance is not None
    count = len(record.balance.bodies)
    of_force = len(slip.places) == count and (count > 1 or not record.pushed)
    kind = record.balance.channels[slip.places[0]].partition("_")[0]
    return ("force sign" if of_force else f"{kind} sign"), of_force, False


def _unit(slip: _Slip, balance: Balance, shared: bool, wild: bool) -> tuple[str, bool, bool]:
    """Return the likeliest wrong unit, and whether it is the force's, or that of declared masses.

    What all motions of all records share may be the masses' as well: both are named, unless masses so small
    would be shaken wildly.
    """
    whole = len(slip.places) == len(balance.bodies)
    kind = balance.channels[slip.places[0]].partition("_")[0]
    of_force = {1 / g: "force in kgf", 1 / lbf: "force in lbf"}.get(slip.apparent)
    if of_force is None and slip.apparent == 1e-3 and whole and balance.peak_n < balance.rules.weak_hit_n:
        of_force = "force in kN"
    if of_force is not None:
        return of_force, True, False
    unit = {
        g: "g",
        1e-3 * g: "mg",
        inch: _LENGTHS[kind].replace("mm", "in"),
        1e3: "km/s2",
    }
    likely = f"{kind} in {unit.get(slip.apparent, _LENGTHS[kind])}"
    mass = {1e3: "mass in t", 1e-3: "mass in g"}.get(slip.apparent)
    of_mass = mass is not None and shared and not (wild and whole and slip.apparent < 1)
    return (f"{mass}, or {likely}", False, True) if of_mass else (likely, False, False)
