"""Slips of units, channels, masses and clocks, told by the balance of momentum of the hits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median_high, median_low

import numpy as np
from scipy import optimize
from scipy.constants import g

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.signals.momentum import HitBalance
from rom.signals.suspicion_evidence import Evidence, Suspicion

_LENGTHS = {"acceleration": "mm/s2", "velocity": "mm/s", "displacement": "mm"}


def late(records: Sequence[Evidence]) -> Iterator[Suspicion]:
    """Motions that begin after the force, or before it."""
    for record in records:
        balance = record.balance
        if balance is None or not delay_of(balance):
            continue
        word, size = ("late" if balance.late_s > 0 else "early"), f"{1e3 * abs(balance.late_s):.2g} ms"
        for channel in balance.channels:
            finding = f"{channel} begins {size} {'after' if balance.late_s > 0 else 'before'} the force"
            confidence = 1 - balance.late_misfit
            yield Suspicion(record.file, channel, finding, None, f"{word} by {size}", confidence)


def delay_of(balance: HitBalance | None) -> float:
    """Return the delay [s] of all motions behind the force, 0 where there is none."""
    if (
        balance is None
        or abs(balance.late_s) < balance.rules.late_s
        or balance.late_misfit > balance.rules.slip_share
    ):
        return 0.0
    return balance.late_s


@dataclass(frozen=True)
class _Slip:
    """One thing that may have gone wrong: what the masses seem to be multiplied by, or channels exchanged."""

    places: tuple[int, ...]
    apparent: float = 1.0
    exchanged: bool = False

    def misfit(self, balance: HitBalance, masses: FloatArray, scale: float = 1.0) -> float:
        count = len(masses)
        factors = np.where(np.isin(np.arange(count), self.places), self.apparent * scale, 1.0)
        order = np.arange(count)
        if self.exchanged:
            order[list(self.places)] = self.places[::-1]
        return balance.misfit(factors * masses, order.tolist())

    def measured(self, balance: HitBalance, masses: FloatArray) -> float:
        """The factor that fits best near its own."""
        found = optimize.minimize_scalar(
            lambda log: self.misfit(balance, masses, np.exp(log)), bounds=(-0.25, 0.25), method="bounded"
        )
        return self.apparent * float(np.exp(found.x))


def slips(records: Sequence[Evidence], settings: CampaignSettings, fewest: int) -> Iterator[Suspicion]:
    """What the balances of momentum tell: units, exchanged channels, masses.

    Parameters
    ----------
    records : sequence of Evidence
        Of all records of the campaign.
    settings : CampaignSettings
        The campaign's.
    fewest : int
        Records that tell a mass which nobody declares.
    """
    judged = [r for r in records if r.balance is not None and (not r.doubts or delay_of(r.balance))]
    masses = _masses(judged, settings, fewest)
    found: dict[str, tuple[_Slip | None, float, float]] = {}
    known = [r for r in judged if r.balance is not None and {*r.balance.bodies} <= {*masses, *_own(r)}]
    for record in known:
        assert record.balance is not None
        own = np.array([{**masses, **_own(record)}[body] for body in record.balance.bodies])
        told = _slip_of(record.balance, own)
        if told is not None:
            found[record.file] = told
    shared = len(found) == len(known)
    for record in known:
        if record.file in found:
            yield from _described(record, *found[record.file], shared)


def _own(record: Evidence) -> dict[str, float]:
    """Masses [kg] that a record gives, by body."""
    parts = ((path.split(".")[1], value) for path, value in record.given.items() if path.endswith(".mass"))
    return dict(parts)


def _masses(records: Sequence[Evidence], settings: CampaignSettings, fewest: int) -> dict[str, float]:
    """Masses [kg] as declared, or else as bodies alone show them, or as most records do."""
    masses = {}
    for body in settings.body:
        of_body = [r.balance for r in records if r.balance is not None and body.name not in _own(r)]
        shown = [(b, float(b.masses[b.bodies.index(body.name)])) for b in of_body if body.name in b.bodies]
        alone = [mass for balance, mass in shown if len(balance.bodies) == 1]
        if body.mass_kg is not None:
            masses[body.name] = body.mass_kg
        elif alone or len(shown) >= fewest:
            masses[body.name] = _usual(alone or [mass for _, mass in shown])
    return {body: mass for body, mass in masses.items() if mass > 0}


def _usual(masses: Sequence[float]) -> float:
    """Return what most records show; of two halves the smaller, since sensors in g show g times the mass,
    or the larger, where a thousand are between them: a force in kN, an acceleration in mm/s2.
    """
    low, high = median_low(masses), median_high(masses)
    return low if high < np.sqrt(1e3 * g) * low else high


def _slip_of(balance: HitBalance, masses: FloatArray) -> tuple[_Slip | None, float, float] | None:
    """Return the slip that a balance shows, its factor, and its confidence; a slip of None has no name."""
    left, rules = balance.misfit(masses), balance.rules
    if left < rules.slip_left:
        return None
    best = min(_candidates(len(masses)), key=lambda slip: slip.misfit(balance, masses))
    share = best.misfit(balance, masses) / left
    measured = best.measured(balance, masses)
    if share < rules.slip_share and abs(np.log(measured / best.apparent)) < np.log(rules.slip_near):
        return best, measured, 1 - share
    if left < rules.scale_left:
        return None
    whole = _Slip(tuple(range(len(masses))))
    found = optimize.minimize_scalar(
        lambda log: whole.misfit(balance, masses, np.exp(log)), bounds=(-12.0, 12.0), method="bounded"
    )
    share = float(found.fun) / left
    if share < rules.slip_share and abs(found.x) > np.log(rules.scale_factor):
        return None, float(np.exp(found.x)), 1 - share
    return None


def _candidates(count: int) -> Iterator[_Slip]:
    every = tuple(range(count))
    for apparent in (g, 1 / g, 1e-3, 1e3, 1 / 4.44822):
        yield _Slip(every, apparent)
    if count > 1:
        for place in every:
            for apparent in (g, 1e-3, 1e3):
                yield _Slip((place,), apparent)
        for pair in combinations(every, 2):
            yield _Slip(pair, exchanged=True)


def _described(
    record: Evidence, slip: _Slip | None, apparent: float, confidence: float, shared: bool
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
    likely, of_force, of_mass = _unit(slip, balance, shared)
    factor = apparent if not of_force else 1 / apparent
    named = [balance.force] if of_force else channels
    if of_mass:
        named = [f"body:{balance.bodies[place]}" for place in slip.places]
    for name in named:
        finding = f"force and motion balance with {name} multiplied by {factor:.4g}"
        yield Suspicion(record.file, name, finding, factor, likely, confidence)


def _unit(slip: _Slip, balance: HitBalance, shared: bool) -> tuple[str, bool, bool]:
    """Return the likeliest wrong unit, and whether it is the force's, or that of declared masses."""
    whole = len(slip.places) == len(balance.bodies)
    kind = balance.channels[slip.places[0]].partition("_")[0]
    if slip.apparent == g:
        return f"{kind} in g", False, False
    if slip.apparent == 1 / g:
        return "force in kgf", True, False
    if slip.apparent == 1 / 4.44822:
        return "force in lbf", True, False
    if slip.apparent == 1e3:
        return ("mass in t", False, True) if shared else (f"{kind} in km/s2", False, False)
    if whole and balance.peak_n < balance.rules.weak_hit_n:
        return "force in kN", True, False
    return ("mass in g", False, True) if shared else (f"{kind} in {_LENGTHS[kind]}", False, False)
