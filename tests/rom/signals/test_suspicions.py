"""Slips of units, signs, channels and delays, told on several structures; sound campaigns are not accused."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

from rom.campaign.campaign import CampaignSettings, Record, RecordSettings
from rom.campaign.channels import FloatArray
from rom.campaign.record import Channel
from rom.signals.quality import assess
from rom.signals.suspicions import Evidence, Suspicion, causes, doubts_of, evidence, nameless, suspicions
from tests.rom.lumped import LinkRow, pulse, respond

RATE_HZ, SAMPLES, HIT_S, G = 19200.0, 16000, 0.3, 9.80665
Slip = Callable[[Record], Record]


@dataclass(frozen=True)
class Structure:
    """Masses and links; the bolted one is called "joint"."""

    masses: tuple[tuple[str, float], ...]
    links: tuple[LinkRow, ...]
    struck: str


PAPER = Structure(
    (("lo", 8.625), ("so", 0.9888)),
    (("fl", ("lo", "ground"), "linear", 8963.6, 8.2), ("fs", ("so", "ground"), "linear", 91800.0, 2.7),
     ("joint", ("lo", "so"), "bolted", 9.7e5, 700.0)),
    "lo",
)  # fmt: skip
BLOCK = Structure(
    (("block", 2.5),), (("joint", ("block", "ground"), "bolted", 1.2e6, 150.0),), "block"
)  # fmt: skip
CHAIN = Structure(
    (("a", 1.5), ("b", 2.2), ("c", 0.7)),
    (("wall", ("a", "ground"), "linear", 4e4, 5.0), ("joint", ("a", "b"), "bolted", 8e5, 300.0),
     ("end", ("b", "c"), "linear", 3e5, 20.0)),
    "b",
)  # fmt: skip
UNEQUAL = Structure(
    (("heavy", 2.0), ("light", 0.135)),
    (("wall", ("heavy", "ground"), "linear", 8e3, 2.0), ("leaf", ("light", "ground"), "linear", 8e3, 0.5),
     ("joint", ("heavy", "light"), "bolted", 1.5e5, 10.0)),
    "heavy",
)  # fmt: skip
STRUCTURES = {"paper": PAPER, "block": BLOCK, "chain": CHAIN}


@cache
def unit_response(of: Structure, length_s: float) -> tuple[FloatArray, dict[str, FloatArray]]:
    force = pulse(1.0, SAMPLES, RATE_HZ, HIT_S, length_s)
    return force, respond(dict(of.masses), of.links, {of.struck: force}, RATE_HZ)


def settings_of(of: Structure, masses: bool = True) -> CampaignSettings:
    data: dict[str, Any] = {
        "format": "boltlaw-campaign/1",
        "name": "hits",
        "body": [{"name": name} | ({"mass_kg": m} if masses else {}) for name, m in of.masses],
        "link": [{"name": name, "between": ends, "law": law} for name, ends, law, _, _ in of.links],
        "bolt": {"link": "joint"},
        "sampling": {"motion_rate_hz": RATE_HZ, "tension_rate_hz": 4800.0, "pretrigger_s": HIT_S},
        "windows": {"initial_s": [0.0, 0.25], "final_s": [0.5, 0.8]},
        "record": [{"file": "records/0.h5", "test": "coupled"}],
    }
    return CampaignSettings.model_validate(data)


@cache
def campaign(of: Structure, count: int = 6, noise: float = 1.0, motion: str = "acceleration") -> list[Record]:
    """Coupled and loosening records with preloads from 20 N, a small and a hard hit by turns."""
    random = np.random.default_rng(3)
    records = []
    for place in range(count):
        peak, preload = (30.0, 1500.0)[place % 2] * random.uniform(0.8, 1.2), 20.0 * 2**place
        force, moved = unit_response(of, (1.1e-3, 7e-4)[place % 2])
        level = noise * {"acceleration": 1.0, "velocity": 1e-4, "displacement": 1e-7}[motion]
        rows = {f"force_{of.struck}": peak * force + 0.05 * noise * random.standard_normal(SAMPLES)}
        for body, _ in of.masses:
            white = (0.003, 0.05)[place % 2] * level * random.standard_normal(SAMPLES)
            rows[f"{motion}_{body}"] = peak * moved[f"{motion}_{body}"] + white
        channels = {name: Channel(name, row, RATE_HZ) for name, row in rows.items()}
        tension = preload * 1.05 + noise * random.standard_normal(SAMPLES // 4)
        channels["tension"] = Channel("tension", tension, 4800.0)
        kind = {
            "file": f"records/{place}.h5",
            "test": ("coupled", "loosening")[place % 2],
            "preload_n": preload,
        }
        records.append(Record(RecordSettings.model_validate(kind), channels, tuple(b for b, _ in of.masses)))
    return records


def changed(record: Record, change: Callable[[str, FloatArray], FloatArray]) -> Record:
    channels = {
        name: Channel(name, change(name, c.samples), c.rate_hz) for name, c in record.channels.items()
    }
    return Record(record.settings, channels, record.bodies)


def only(
    channel: str, change: Callable[[FloatArray, FloatArray], FloatArray], rate_hz: float = RATE_HZ
) -> Slip:
    """A change of one channel, given its samples and their times."""
    return lambda record: changed(
        record, lambda name, y: change(y.copy(), np.arange(len(y)) / rate_hz) if name == channel else y
    )


def scaled(prefix: str, factor: float) -> Slip:
    return lambda record: changed(record, lambda name, y: y * factor if name.startswith(prefix) else y)


def late(delay_s: float) -> Slip:
    def shift(name: str, y: FloatArray) -> FloatArray:
        time = np.arange(len(y)) / RATE_HZ
        return np.interp(time - delay_s, time, y) if name.startswith("acceleration") else y

    return lambda record: changed(record, shift)


def exchanged(record: Record) -> Record:
    first, second = (f"acceleration_{body}" for body in record.bodies[:2])
    swap = {first: second, second: first}
    channels = {name: Channel(name, record.channels[swap.get(name, name)].samples, c.rate_hz)
                for name, c in record.channels.items()}  # fmt: skip
    return Record(record.settings, channels, record.bodies)


def told(
    records: Sequence[Record], settings: CampaignSettings, slip: Slip | None = None, few: Collection[int] = ()
) -> tuple[Suspicion, ...]:
    found = [
        seen.__wrapped__(slip(r), settings) if slip and (not few or i in few) else seen(r, settings)
        for i, r in enumerate(records)
    ]
    return suspicions(found, settings)


@cache
def seen(record: Record, settings: CampaignSettings) -> Evidence:
    """What is kept of a record; of one that is as measured, once."""
    return evidence(record, settings, assess(record, settings))


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("masses", [True, False])
def test_a_sound_campaign_is_not_accused(name: str, noise: float, masses: bool) -> None:
    assert told(campaign(STRUCTURES[name], noise=noise), settings_of(STRUCTURES[name], masses)) == ()


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("motion", ["velocity", "displacement"])
def test_nor_is_one_measured_by_velocity_or_displacement(name: str, motion: str) -> None:
    assert told(campaign(STRUCTURES[name], motion=motion), settings_of(STRUCTURES[name])) == ()


SLIPS: dict[str, tuple[Slip, str, float | None]] = {
    "acceleration in g": (scaled("acceleration", 1 / G), "acceleration in g", G),
    "acceleration in mm/s2": (scaled("acceleration", 1e3), "acceleration in mm/s2", 1e-3),
    "force in kgf": (scaled("force", 1 / G), "force in kgf", G),
    "force in kN": (scaled("force", 1e-3), "force in kN", 1e3),
    "force in lbf": (scaled("force", 1 / 4.44822), "force in lbf", 4.44822),
    "force sign": (scaled("force", -1.0), "force sign", -1.0),
    "no force": (scaled("force", 0.0), "force not recorded", None),
    "late": (late(1e-3), "late by 1 ms", None),
    "later": (late(12e-3), "late by 12 ms", None),
    "early": (late(-5e-4), "early by 0.5 ms", None),
    "tension in kN": (scaled("tension", 1e-3), "tension in kN", 1e3),
    "tension in lbf": (scaled("tension", 1 / 4.44822), "tension in lbf", 4.44822),
    "tension sign": (scaled("tension", -1.0), "tension sign", -1.0),
    "acceleration in mg": (scaled("acceleration", 1e3 / G), "acceleration in mg", G / 1e3),
    "acceleration in in/s2": (scaled("acceleration", 1 / 0.0254), "acceleration in in/s2", 0.0254),
    "exchanged": (exchanged, "channels exchanged", None),
}


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("few", [(), (1, 4)])
def test_a_slip_is_named_with_its_factor(name: str, slip: str, few: tuple[int, ...]) -> None:
    of, (spoil, likely, factor) = STRUCTURES[name], SLIPS[slip]
    if slip == "exchanged" and len(of.masses) == 1:
        pytest.skip("one body has one channel")
    found = told(campaign(of), settings_of(of), spoil, few)
    assert {one.likely for one in found} == {likely}
    assert {one.record for one in found} == {f"records/{place}.h5" for place in few or range(6)}
    assert all(one.sets_aside and one.confidence > 0.8 for one in found)
    if factor is not None:
        assert [one.factor for one in found] == pytest.approx([factor] * len(found), rel=0.03)


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("few", [(), (1, 4)])
def test_preloads_in_kilonewton_are_told(name: str, few: tuple[int, ...]) -> None:
    def in_kilonewton(record: Record) -> Record:
        preload = record.settings.preload_n or 0.0
        told = record.settings.model_copy(update={"preload_n": 1e-3 * preload})
        return Record(told, record.channels, record.bodies)

    found = told(campaign(STRUCTURES[name]), settings_of(STRUCTURES[name]), in_kilonewton, few)
    assert {one.likely for one in found} == {"preload in kN, or tension in mN"}
    assert {one.record for one in found} == {f"records/{place}.h5" for place in few or range(6)}


@pytest.mark.parametrize("body", ["a", "b", "c"])
def test_one_accelerometer_in_g_is_told_from_the_others(body: str) -> None:
    found = told(campaign(CHAIN), settings_of(CHAIN), scaled(f"acceleration_{body}", 1 / G))
    assert {(one.channel, one.likely) for one in found} == {(f"acceleration_{body}", "acceleration in g")}
    assert len(found) == 6


@pytest.mark.parametrize("few", [(), (1, 4)])
@pytest.mark.parametrize(("of", "body"), [(PAPER, "lo"), (PAPER, "so"), *((CHAIN, body) for body in "abc")])
def test_one_accelerometer_that_is_late_is_told_from_the_others(
    of: Structure, body: str, few: tuple[int, ...]
) -> None:
    late_by = only(f"acceleration_{body}", lambda y, time: np.interp(time - 1e-3, time, y))
    found = told(campaign(of), settings_of(of), late_by, few)
    assert {one.channel for one in found} == {f"acceleration_{body}"}
    assert {one.likely for one in found} <= {f"late by {size} ms" for size in ("0.99", "1", "1.1")}
    assert {one.record for one in found} == {f"records/{place}.h5" for place in few or range(6)}


@pytest.mark.parametrize(
    ("slip", "likely"), [("acceleration in g", "acceleration in g"), ("exchanged", "channels exchanged")]
)
def test_without_declared_masses_the_few_that_differ_are_told(slip: str, likely: str) -> None:
    found = told(campaign(CHAIN, 8), settings_of(CHAIN, masses=False), SLIPS[slip][0], few=(2, 5))
    assert {(one.record, one.likely) for one in found} == {(f"records/{i}.h5", likely) for i in (2, 5)}


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("slip", ["acceleration in g", "force in kN"])
@pytest.mark.parametrize("few", [(0, 2, 4), (1, 3, 5)])
def test_of_two_halves_that_with_the_likelier_slip_is_named(
    name: str, slip: str, few: tuple[int, ...]
) -> None:
    """All small hits, or all hard ones, without declared masses."""
    found = told(campaign(STRUCTURES[name]), settings_of(STRUCTURES[name], masses=False), SLIPS[slip][0], few)
    assert {(one.record, one.likely) for one in found} == {(f"records/{i}.h5", slip) for i in few}


def test_masses_a_thousand_times_too_large_are_told_from_a_force_in_kilonewton() -> None:
    heavy = Structure(tuple((name, 1e3 * m) for name, m in CHAIN.masses), CHAIN.links, CHAIN.struck)
    found = told(campaign(CHAIN), settings_of(heavy))
    assert {one.likely for one in found} == {"mass in g, or acceleration in mm/s2"}
    assert {one.channel for one in found} == {"body:a", "body:b", "body:c"}


def test_one_mass_off_by_a_factor_of_three_has_no_name_and_is_not_set_aside() -> None:
    wrong = Structure((("block", 7.5),), BLOCK.links, "block")
    found = told(campaign(BLOCK), settings_of(wrong))
    assert {one.likely for one in found} == {""}
    assert [one.factor for one in found] == pytest.approx([3.0] * 6, rel=0.03)
    assert not any(one.sets_aside for one in found)


def test_where_nothing_has_a_name_the_factor_is_the_likeliest_cause() -> None:
    wrong = Structure((("block", 7.5),), BLOCK.links, "block")
    found = told(campaign(BLOCK), settings_of(wrong))
    assert causes(found) == []
    assert nameless(found)[0].startswith("force_block: the momentum of the declared masses is 3")


@pytest.mark.parametrize(("of", "times"), [(BLOCK, 1.0005), (BLOCK, 4 / 3), (CHAIN, 0.8)])
def test_a_rate_other_than_that_declared_is_named_and_the_record_kept(of: Structure, times: float) -> None:
    def fast(record: Record) -> Record:
        channels = {n: Channel(n, c.samples, c.rate_hz * times) for n, c in record.channels.items()}
        return Record(record.settings, channels, record.bodies)

    rates = [one for one in told(campaign(of, 2), settings_of(of), fast) if one.likely == "sampling rate"]
    assert [one.factor for one in rates if one.channel.startswith("force")] == pytest.approx([times] * 2)
    assert not any(one.sets_aside for one in rates)
    sampling = settings_of(of).sampling.model_copy(update={"pretrigger_s": HIT_S / times})
    meant = settings_of(of).model_copy(update={"sampling": sampling})
    assert times == 1.0005 or "sampling rate" not in causes(told(campaign(of, 2), meant, fast))


def test_a_preload_of_another_record_is_a_finding() -> None:
    found = told(campaign(CHAIN), settings_of(CHAIN), scaled("tension", 0.25), few=(3,))
    ((one,)) = found
    assert (one.record, one.channel, one.likely) == ("records/3.h5", "tension", "")
    assert one.factor == pytest.approx(4.0 / 1.05, rel=0.02)


@pytest.mark.parametrize("of", [UNEQUAL, PAPER])
def test_a_light_body_on_a_spring_of_its_own_is_told(of: Structure) -> None:
    body = of.masses[1][0]
    found = told(campaign(of), settings_of(of), scaled(f"acceleration_{body}", 1 / G), few=(3, 5))
    assert {(one.record, one.channel, one.likely) for one in found} == {
        (f"records/{i}.h5", f"acceleration_{body}", "acceleration in g") for i in (3, 5)
    }


def late_struck(record: Record) -> Record:
    return only("acceleration_lo", lambda y, time: np.interp(time - 1.5e-4, time, y))(record)


def crossed_struck(record: Record) -> Record:
    light = record.channels["acceleration_so"].samples
    return only("acceleration_lo", lambda y, _: y - 0.09 * light)(record)


@pytest.mark.parametrize("fault", [late_struck, crossed_struck])
def test_a_light_body_in_g_is_told_from_the_other_records_whatever_a_sensor_does_in_all(fault: Slip) -> None:
    """At three times the usual noise, where allowances for sensors explain most of it in a single record."""
    records = [fault(record) for record in campaign(PAPER, 8, noise=3.0)]
    settings = settings_of(PAPER)
    assert told(records, settings) == ()
    for few in ((0, 1), (2, 5)):
        found = told(records, settings, scaled("acceleration_so", 1 / G), few)
        assert {(one.record, one.channel, one.likely) for one in found} == {
            (f"records/{i}.h5", "acceleration_so", "acceleration in g") for i in few
        }


def test_a_slip_is_told_beside_the_gain_of_another_sensor() -> None:
    records = [scaled("acceleration_b", 1.1)(record) for record in campaign(CHAIN)]
    settings = settings_of(CHAIN)
    assert told(records, settings) == ()
    found = told(records, settings, scaled("acceleration_a", 1 / G))
    assert {(one.channel, one.likely) for one in found} == {("acceleration_a", "acceleration in g")}
    assert len(found) == 6
    assert [one.factor for one in found] == pytest.approx([G] * 6, rel=1e-6)  # the unit's own


def test_another_body_s_motion_in_a_sensor_is_no_wrong_sign() -> None:
    """The light body's is 0.09 of what the heavy one's sensor shows, and seems to have minus its mass."""
    of = Structure((("heavy", 3.0), ("light", 0.135)), UNEQUAL.links, "heavy")

    def crossed(record: Record) -> Record:
        light = record.channels["acceleration_light"].samples
        return changed(record, lambda name, y: y + 0.09 * light if name == "acceleration_heavy" else y)

    assert told(campaign(of), settings_of(of), crossed) == ()


def test_masses_that_bodies_alone_show_are_wrong_where_one_slip_explains_the_others() -> None:
    """The test without bolt is in g, and one more."""
    alone = Structure((("heavy", 2.0),), UNEQUAL.links[:1], "heavy")
    (first, _) = campaign(alone, 2)
    kind = RecordSettings.model_validate(
        {"file": "records/alone.h5", "test": "uncoupled", "bodies": ["heavy"]}
    )
    channels = {name: c for name, c in first.channels.items() if name != "tension"}
    records = [*campaign(UNEQUAL), Record(kind, channels, ("heavy",))]
    settings = settings_of(UNEQUAL, masses=False)
    found = told(records, settings, scaled("acceleration", 1 / G), few=(3, 6))
    assert {one.likely for one in found} == {"acceleration in g"}
    assert {one.record for one in found} == {"records/3.h5", "records/alone.h5"}


@pytest.mark.parametrize("masses", [True, False])
def test_the_sign_of_a_body_beside_a_plain_link_is_told(masses: bool) -> None:
    found = told(campaign(CHAIN, 8), settings_of(CHAIN, masses), scaled("acceleration_c", -1.0), (2, 5))
    assert {(one.record, one.channel, one.likely, one.factor) for one in found} == {
        (f"records/{i}.h5", "acceleration_c", "acceleration sign", -1.0) for i in (2, 5)
    }


@pytest.mark.parametrize("masses", [True, False])
def test_the_force_s_sign_is_told_where_the_struck_body_bounces_during_the_contact(masses: bool) -> None:
    stiff = Structure(
        (("a", 3.0), ("b", 0.5), ("c", 2.0)),
        (("wall", ("a", "ground"), "linear", 4e4, 5.0), ("joint", ("a", "b"), "bolted", 8e5, 30.0),
         ("end", ("b", "c"), "linear", 8e5, 20.0)),
        "b",
    )  # fmt: skip
    found = told(campaign(stiff, motion="velocity"), settings_of(stiff, masses), scaled("force", -1.0))
    assert {(one.channel, one.likely, one.factor) for one in found} == {("force_b", "force sign", -1.0)}
    assert len({one.record for one in found}) == 6


def test_a_single_record_in_g_is_told() -> None:
    found = told(campaign(BLOCK, 1), settings_of(BLOCK), scaled("acceleration", 1 / G))
    assert [(one.likely, round(one.factor or 0, 1)) for one in found] == [("acceleration in g", 9.8)]


def test_causes_come_with_what_would_mend_them_and_doubts_with_a_line_for_each() -> None:
    settings = settings_of(CHAIN)
    spoilt = [scaled("acceleration", 1 / G)(r) if i in (0, 2) else r for i, r in enumerate(campaign(CHAIN))]
    kept = [evidence(r, settings, ()) for r in spoilt]
    found = suspicions(kept, settings)
    assert causes(found)[0].startswith("acceleration in g (acceleration_a, scale = 9.8")
    assert causes(found)[0].endswith("in 2 records")
    doubts = doubts_of(found, kept)
    assert list(doubts) == ["records/0.h5", "records/2.h5"]
    assert [doubt.kind for of in doubts.values() for doubt in of] == ["suspicion"] * 2
