"""Suspicions: what the records of a campaign say against what it declares, its units, signs and channels.

Most slips are told by a ratio that all records share, or by the few records that differ from the others: so
all records of a campaign are looked at together. `evidence` keeps of each what that needs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import g, lbf

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import BOLT_CHANNELS, default_rate
from rom.criteria.criteria import RECORD_CRITERIA
from rom.criteria.suspicions import Suspicions
from rom.signals.damage import BEYOND
from rom.signals.quality import Doubt
from rom.signals.slips import delay_of, late, slips
from rom.signals.suspicion_evidence import OF_DOUBTS, Evidence, Suspicion, evidence

__all__ = ["Evidence", "Suspicion", "causes", "doubts_of", "evidence", "suspicions"]


_GAUGE_UNITS = {1e3: "kN", 1e-3: "mN", 1e6: "MN"}
_NEAR_UNITS = {lbf: "lbf", g: "kgf", -1.0: ""}
"""Of factors that a wrong zero may show too, where a preload is small; minus one is a sign."""


def suspicions(
    records: Sequence[Evidence],
    settings: CampaignSettings,
    rules: Suspicions = RECORD_CRITERIA.suspicions,
) -> tuple[Suspicion, ...]:
    """Name what does not fit what a campaign declares; nothing for a sound one.

    Parameters
    ----------
    records : sequence of Evidence
        Of all records of the campaign.
    settings : CampaignSettings
        The campaign's.
    rules : Suspicions
        The numbers that decide.
    """
    preloads = tuple(_preloads(records, settings, rules))
    in_other_units = {(one.record, one.channel) for one in preloads if one.likely}
    found = (
        *_of_doubts(records),
        *_without_force(records),
        *_damaged(records, in_other_units),
        *late(records),
        *slips(records, settings, rules.fewest),
        *preloads,
        *_rates(records, settings, rules),
    )
    places = {record.file: place for place, record in enumerate(records)}
    return tuple(sorted(found, key=lambda one: places[one.record]))


def doubts_of(found: Sequence[Suspicion], records: Sequence[Evidence]) -> dict[str, tuple[Doubt, ...]]:
    """Return by file why records are set aside beyond what they tell by themselves, a line for each cause.

    A delay of half a contact passes for a wrong sign in a single record.
    """
    trusted = {record.file for record in records if not record.doubts or delay_of(record.balance)}
    lines: dict[tuple[str, str], Doubt] = {}
    for one in found:
        if one.sets_aside and one.record in trusted:
            message = f"{one.finding}: {one.cause}"
            lines.setdefault((one.record, one.likely), Doubt(one.record, one.channel, "suspicion", message))
    files = dict.fromkeys(file for file, _ in lines)
    return {file: tuple(d for (of, _), d in lines.items() if of == file) for file in files}


def nameless(found: Sequence[Suspicion]) -> list[str]:
    """Return findings that have a channel and a factor, but no likely cause, the most frequent first."""
    counts = Counter((one.channel, one.finding) for one in found if not one.likely and one.factor is not None)
    return [f"{channel}: {finding}" for (channel, finding), _ in counts.most_common()]


def causes(found: Sequence[Suspicion]) -> list[str]:
    """Return the likely causes with where they are and in how many records, the most frequent first."""
    counts = Counter((one.likely, one.channel) for one in found if one.likely)
    lines = []
    for (likely, channel), count in counts.most_common():
        same = [one for one in found if (one.likely, one.channel) == (likely, channel)]
        factors = [one.factor for one in same if one.factor is not None]
        middle = None if not factors else float(np.median(factors))
        shown = replace(same[0], factor=middle).cause
        lines.append(f"{shown} in {count} record{'' if count == 1 else 's'}")
    return lines


def _of_doubts(records: Sequence[Evidence]) -> Iterator[Suspicion]:
    """Doubts of single records; where one body moves, the hammer's push tells whose sign is wrong."""
    records = [record for record in records if not delay_of(record.balance)]
    against = {d.channel for r in records for d in r.doubts if d.channel.startswith("force_")}
    for record in records:
        for doubt in record.doubts:
            turned = doubt.kind == "polarity"
            if any(one.at_hit for one in record.damages):  # what is wrong with the samples looks like more
                continue
            force = doubt.channel.startswith("force_")
            struck = next((name for name in record.rates if name.startswith("force_")), "")
            channel = doubt.channel
            if turned and not force and (struck in against or not record.pushed) and len(record.doubts) == 1:
                channel, force = struck, True
            sign = "force sign" if force else f"{channel.partition('_')[0]} sign"
            likely = {"polarity": sign, "clipped": "overload", "second-hit": "second hit"}.get(
                doubt.kind, "nothing moves"
            )
            yield Suspicion(record.file, channel, doubt.message, -1.0 if turned else None, likely, OF_DOUBTS)


def _without_force(records: Sequence[Evidence]) -> Iterator[Suspicion]:
    for record in records:
        if record.unhit:
            finding = f"{record.unhit} shows no hit"
            yield Suspicion(record.file, record.unhit, finding, None, "force not recorded", OF_DOUBTS)


def _damaged(records: Sequence[Evidence], in_other_units: Collection[tuple[str, str]]) -> Iterator[Suspicion]:
    """Damage of channels; one in another unit is beyond its calibration because of that."""
    for record in records:
        for one in record.damages:
            if one.likely == BEYOND and (record.file, one.channel) in in_other_units:
                continue
            yield Suspicion(record.file, one.channel, one.finding, None, one.likely, OF_DOUBTS)


def _preloads(
    records: Sequence[Evidence], settings: CampaignSettings, rules: Suspicions
) -> Iterator[Suspicion]:
    """Mean of the gauge before the hit against the nominal preload, where a bolt is in."""
    told = [(r, *r.gauge, r.preload_n) for r in records if r.gauge and r.preload_n and r.test != "uncoupled"]
    least = rules.preload_share * max((preload for *_, preload in told), default=0.0)
    rows = [_Gauge(r, channel, mean, preload, settings) for r, channel, mean, preload in told]
    off = [row for row in rows if not abs(np.log(row.ratio())) < np.log(rules.preload_factor)]
    usual = [row.ratio() for row in rows if row not in off and row.preload >= least]
    near = {row: row.mended(_NEAR_UNITS, rules.preload_like) for row in off}
    if usual:  # a few records are off: by as much as the unit, beside the others
        near = {row: row.mended(_NEAR_UNITS, rules.preload_near, float(np.median(usual))) for row in off}
    shared = None if usual else {near[row] for row in off if row.preload >= least}
    for row in off:
        unit = row.mended(_GAUGE_UNITS, rules.preload_like)
        if unit is None and (row.preload >= least or shared == {near[row]}):
            unit = near[row]
        before = f"{row.channel} before the hit"
        if unit is not None:
            finding = f"{before} fits the preload of {row.preload:.4g} N if multiplied by {unit:.4g}"
            likely = _wrong_unit(row.channel, unit)
            yield Suspicion(row.record.file, row.channel, finding, unit, likely, OF_DOUBTS)
        elif len(told) >= rules.fewest and row.preload >= least:
            shown = row.tension() / row.preload
            finding = f"{before} is {shown:.3g} times the preload of {row.preload:.4g} N"
            yield Suspicion(row.record.file, row.channel, finding, 1 / shown if shown > 0 else None, "", 0.5)


@dataclass(frozen=True, eq=False)
class _Gauge:
    """Mean of a gauge before the hit and the nominal preload [N] of a record."""

    record: Evidence
    channel: str
    mean: float
    preload: float
    settings: CampaignSettings

    def tension(self, factor: float = 1.0) -> float:
        """Tension [N] of the mean times a factor."""
        return _tension(self.channel, factor * self.mean, self.settings)

    def ratio(self, factor: float = 1.0) -> float:
        """The same over the preload, next to nothing where it is negative."""
        return max(self.tension(factor), 1e-12) / self.preload

    def mended(self, factors: Collection[float], within: float, usual: float = 1.0) -> float | None:
        """Return the factor with which the ratio is the usual one best, None where it is with none."""
        off = {factor: abs(np.log(self.ratio(factor) / usual)) for factor in factors}
        return min((one for one in off if off[one] < np.log(within)), key=off.__getitem__, default=None)


def _wrong_unit(channel: str, factor: float) -> str:
    if factor < 0:
        return f"{channel} sign"
    if factor == 1e-3 and channel == "tension":
        return "preload in kN, or tension in mN"
    unit = {**_GAUGE_UNITS, **_NEAR_UNITS}[factor]
    return f"tension in {unit}" if channel == "tension" else "strain in another unit"


def _tension(channel: str, mean: float, settings: CampaignSettings) -> float:
    terms = settings.bolt.calibration if settings.bolt is not None and channel == "strain" else (1.0,)
    return sum(c * mean ** (power + 1) for power, c in enumerate(terms or (1.0,)))


def _rates(records: Sequence[Evidence], settings: CampaignSettings, rules: Suspicions) -> Iterator[Suspicion]:
    sampling = settings.sampling
    for record in records:
        for channel, rate in record.rates.items():
            declared = default_rate(channel, sampling.motion_rate_hz, sampling.tension_rate_hz)
            off = abs(rate / declared - 1)
            hit = channel not in BOLT_CHANNELS and _hit_as_declared(record, rate, declared, settings, rules)
            if rules.rate_same < off < rules.rate_other or hit:
                at = f"; by that the hit is at the {sampling.pretrigger_s:g} s of pretrigger_s" if hit else ""
                finding = f"{channel} is sampled at {rate:.7g} Hz, {declared:.7g} Hz is declared{at}"
                yield Suspicion(record.file, channel, finding, rate / declared, "sampling rate", OF_DOUBTS)


def _hit_as_declared(
    record: Evidence, rate_hz: float, declared_hz: float, settings: CampaignSettings, rules: Suspicions
) -> bool:
    """Whether the hit is at the declared time by the declared rate, but not by that of force and channel."""
    expected, found = settings.sampling.pretrigger_s, record.hit_s
    forces = {rate for name, rate in record.rates.items() if name.startswith("force_")}
    if not expected or found is None or forces != {rate_hz}:
        return False
    by_file, by_declared = (abs(at / expected - 1) for at in (found, found * rate_hz / declared_hz))
    return by_declared < rules.rate_other / 2 and by_file > rules.rate_other
