"""Masses and springs that are a record's own: what the others share is identified over all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rom
from rom.campaign.campaign import Campaign
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import evaluate
from rom.model.model import Model
from tests.rom.lumped import LinkRow, campaign, noisy, pulse, random_force, respond
from tests.shared import Shared, once_per_run

RATE_HZ, SAMPLES, FINE = 2000.0, 6000, 4
ADDED_KG, STIFFER = 0.8, 26000.0
MASSES = {"a": 3.0, "b": 2.0, "c": 1.0}
CHAIN: list[LinkRow] = [
    ("ga", ("a", "ground"), "linear", 20000.0, 6.0),
    ("ab", ("a", "b"), "linear", 30000.0, 5.0),
    ("cb", ("c", "b"), "linear", 40000.0, 7.0),
]


def without_own(found: Campaign) -> Campaign:
    """The same campaign whose records give nothing of their own."""
    settings = found.settings.model_dump(exclude_none=True)
    for record in settings["record"]:
        record.pop("mass_kg", None)
        record.pop("stiffness_n_per_m", None)
    return replace(found, settings=type(found.settings).model_validate(settings))


def hold_out_error(model: Model, of: Campaign) -> float:
    """Motion error on held-out records."""
    judged = evaluate([model], of, of.select(hold_out=True))
    found = summarise(one.comparisons[0] for one in judged)["motion_nrmse"]
    assert found is not None
    return found


def chain(folder: Path, test: str, kind: str, known: Mapping[str, float | None]) -> Campaign:
    """Three bodies: every second record has a mass added to b, every third another spring at a."""
    rng, records = np.random.default_rng(7), []
    for i in range(8):
        body, own = "abc"[i % 3], dict[str, Any]()
        masses, links = dict(MASSES), list(CHAIN)
        if i % 2:
            masses["b"] += ADDED_KG
            own["mass_kg"] = {"b": masses["b"]}
        if i % 3 == 1:
            links[0] = (*links[0][:3], STIFFER, links[0][4])
            own["stiffness_n_per_m"] = {"ga": STIFFER}
        samples, rate = FINE * SAMPLES, FINE * RATE_HZ
        force = pulse(40.0, samples, rate, 0.3, 6e-3) if test == "coupled" else np.zeros(samples)
        if test == "driven":
            force = 10 * random_force(rng, samples, rate, 60.0)
        motion = respond(masses, links, {body: force}, rate)
        channels = {f"{kind}_{n}": noisy(rng, motion[f"{kind}_{n}"][::FINE], 0.003) for n in MASSES}
        channels[f"force_{body}"] = force[::FINE]
        records.append(({"file": f"{i}.h5", "test": test, "hold_out": i > 5, **own}, channels))
    return campaign(folder, known, CHAIN, records, RATE_HZ)


@pytest.mark.parametrize(
    ("test", "kind"), [("coupled", "acceleration"), ("driven", "displacement"), ("driven", "velocity")]
)
def test_a_chain_with_an_added_mass_and_another_spring_in_some_records(
    tmp_path: Path, test: str, kind: str
) -> None:
    found = chain(tmp_path / "c", test, kind, {"a": None, "b": MASSES["b"], "c": MASSES["c"]})
    model, blind = rom.identify(found), rom.identify(without_own(found))
    assert model.parameter("body.a.mass").value == pytest.approx(3.0, rel=0.01)
    for name, _, _, stiffness, damping in CHAIN:
        number = model.parameter(f"{name}.stiffness.k")
        assert number.low is not None
        assert number.high is not None
        assert abs(number.value - stiffness) < 1.5 * (number.high - number.low)
        assert number.value == pytest.approx(stiffness, rel=0.01)
        assert model.parameter(f"{name}.damping.c").value == pytest.approx(damping, rel=0.05)
    assert hold_out_error(model, found) < 0.03
    assert blind.identification is not None
    if blind.identification.set_aside:  # the balance of momentum of a hit knows that a mass is wrong
        assert test == "coupled"
        return
    truth = {f"{n}.stiffness.k": k for n, _, _, k, _ in CHAIN} | {f"{n}.damping.c": c for n, *_, c in CHAIN}
    off = [abs(blind.parameter(path).value / value - 1) for path, value in truth.items()]
    if kind != "velocity":  # there the fit follows the records that are as declared, and misses the others
        assert max(off) > 0.1
    assert hold_out_error(blind, without_own(found)) > 0.2


def test_an_added_mass_weighs_what_decays_freely(tmp_path: Path) -> None:
    """Free decay tells ratios alone; a mass that some records give fixes the factor of all numbers."""
    rng, records, link = np.random.default_rng(2), [], ("s", ("m", "ground"), "linear", 4000.0, 8.0)
    for i in range(4):
        mass = 2.0 + 0.7 * (i % 2)
        x = respond({"m": mass}, [link], {"m": np.zeros(2000)}, 500.0, rng.normal(0, [0.01, 0.3]))
        own = {"mass_kg": {"m": mass}} if i % 2 else {}
        shown = {"displacement_m": noisy(rng, x["displacement_m"], 0.003)}
        records.append(({"file": f"{i}.h5", "test": "free", "hold_out": i > 1, **own}, shown))
    found = campaign(tmp_path / "c", {"m": None}, [link], records, 500.0)
    model, blind = rom.identify(found), rom.identify(without_own(found))
    assert model.parameter("body.m.mass").value == pytest.approx(2.0, rel=0.01)
    assert model.parameter("s.stiffness.k").value == pytest.approx(4000.0, rel=0.005)
    assert model.parameter("s.stiffness.k").low is not None
    assert hold_out_error(model, found) < 0.01
    assert hold_out_error(blind, without_own(found)) > 0.3


@pytest.mark.parametrize("test", ["coupled", "driven", "free"])
def test_values_that_every_record_gives_need_none_of_the_campaign(tmp_path: Path, test: str) -> None:
    rng, records = np.random.default_rng(3), []
    for i in range(6):
        mass, k = 2.0 + 0.5 * (i % 2), 4000.0 + 800.0 * (i % 3)
        force = pulse(40.0, SAMPLES, RATE_HZ, 0.3, 6e-3) if test == "coupled" else np.zeros(SAMPLES)
        if test == "driven":
            force = 10 * random_force(rng, SAMPLES, RATE_HZ, 40.0)
        initial = np.array([0.01, 0.1]) if test == "free" else None
        link = ("s", ("m", "ground"), "linear", k, 8.0)
        x = respond({"m": mass}, [link], {"m": force}, RATE_HZ, initial)["displacement_m"]
        channels = {"displacement_m": noisy(rng, x, 0.002)} | ({} if test == "free" else {"force_m": force})
        own = {"mass_kg": {"m": mass}, "stiffness_n_per_m": {"s": k}}
        records.append(({"file": f"{i}.h5", "test": test, "hold_out": i > 3, **own}, channels))
    declared = ("s", ("m", "ground"), "linear", 0.0, 0.0)
    found = campaign(tmp_path / "c", {"m": None}, [declared], records, RATE_HZ)
    model = rom.identify(found)
    assert model.parameter("body.m.mass").value == 2.0
    assert model.parameter("s.stiffness.k").value == 4000.0
    assert model.parameter("s.damping.c").value == pytest.approx(8.0, rel=0.03)
    assert not any("stands in" in line for line in model.identification.warnings)  # type: ignore[union-attr]
    assert hold_out_error(model, found) < 0.02


def test_a_body_alone_on_another_spring_leaves_the_tie_to_its_mode(tmp_path: Path) -> None:
    """An uncoupled test with an added mass tells the stiffness through that mass, not the campaign's."""
    rng, links = np.random.default_rng(5), [("sa", ("a", "ground"), "linear", 2e4, 6.0)]
    bolted = [*links, ("sb", ("b", "ground"), "linear", 1.5e4, 4.0), ("j", ("a", "b"), "bolted", 3e5, 60.0)]
    force, records = pulse(40.0, SAMPLES, RATE_HZ, 0.3, 6e-3), []
    motion = respond({"a": 4.5}, links, {"a": force}, RATE_HZ)["acceleration_a"]
    channels = {"force_a": force, "acceleration_a": noisy(rng, motion, 0.003)}
    records.append(({"file": "u.h5", "test": "uncoupled", "bodies": ["a"], "mass_kg": {"a": 4.5}}, channels))
    for i in range(4):
        motion = respond({"a": 3.0, "b": 1.0}, bolted, {"a": force}, RATE_HZ)
        channels = {f"acceleration_{n}": noisy(rng, motion[f"acceleration_{n}"], 0.003) for n in "ab"}
        channels |= {"force_a": force, "tension": np.full(SAMPLES, 500.0)}
        records.append(({"file": f"{i}.h5", "test": "coupled", "hold_out": i == 3}, channels))
    found = campaign(tmp_path / "c", {"a": 3.0, "b": 1.0}, bolted, records, RATE_HZ, bolt={"link": "j"})
    model = rom.identify(found)
    identification = model.identification
    assert identification is not None
    assert identification.linear is not None
    tie = next(t for t in identification.linear.ties if t.leaning == ("sa.stiffness.uncoupled",))
    assert "body.a.mass" not in tie.factors
    assert np.exp(tie.target) == pytest.approx(2e4, rel=0.01)
    assert not identification.unsettled
    assert model.parameter("sa.stiffness.k").value == pytest.approx(2e4, rel=0.01)


def block(folder: Path, own: bool = True) -> tuple[Campaign, Model]:
    """One block on a spring and a bolted joint to ground; 1.2 kg more in half of its impact tests."""
    from rom.model.description import LinkLaws
    from rom.model.laws import (
        constant_damping,
        constant_stiffness,
        logistic_damping,
        logistic_stiffness,
        power_loosening,
    )
    from rom.model.structure import Body, Link, Structure

    rate, seconds, rng = 4096.0, 1.2, np.random.default_rng(5)
    structure = Structure(
        (Body("m", 2.0),), (Link("s", "m", "ground"), Link("joint", "m", "ground", "bolted"))
    )
    truth = Model(
        structure,
        {
            "s": LinkLaws(constant_stiffness(5e4), constant_damping(4.0)),
            "joint": LinkLaws(
                logistic_stiffness(8e5, -0.03, 10.0), logistic_damping(60.0, 50.0, -0.006),
                power_loosening(3000.0, 4.0),
            ),
        },
    )  # fmt: skip
    records = []
    samples = int(rate * seconds)
    for mass in (2.0, 3.2):  # without the bolt: told from it, which lies beside
        force = pulse(20.0, samples, rate, 0.3, 1.5e-3)
        motion = respond({"m": mass}, [("s", ("m", "ground"), "linear", 5e4, 4.0)], {"m": force}, rate)
        shown = {
            "force_m": force + rng.normal(0, 0.05, samples),
            "acceleration_m": motion["acceleration_m"] + rng.normal(0, 0.02, samples),
        }
        given = {"mass_kg": {"m": mass}} if own and mass > 2.0 else {}
        records.append(({"file": f"alone_{mass}.h5", "test": "uncoupled", "bodies": ["m"], **given}, shown))
    for i, tension in enumerate(np.geomspace(20.0, 1500.0, 6)):
        mass = 3.2 if i % 2 else 2.0
        model = truth.with_values({"body.m.mass": mass})
        for kind, peak in (("coupled", 20.0), ("loosening", 900.0), ("loosening", 600.0)):
            force = pulse(peak, samples, rate, 0.3, 1.5e-3)
            response = model.simulate({"m": force}, rate, float(tension))
            shown = {
                "force_m": force + rng.normal(0, 0.05, samples),
                "acceleration_m": response.acceleration["m"] + rng.normal(0, 0.02, samples),
                "tension": np.asarray(response.tension) + rng.normal(0, 0.2, samples),
            }
            given = {"mass_kg": {"m": mass}} if own and i % 2 else {}
            settings = {"file": f"{kind}_{i}_{peak:.0f}.h5", "test": kind, "preload_n": float(tension)}
            records.append(({**settings, "hold_out": i in (2, 3), **given}, shown))
    links: list[LinkRow] = [
        ("s", ("m", "ground"), "linear", 0.0, 0.0), ("joint", ("m", "ground"), "bolted", 0.0, 0.0)
    ]  # fmt: skip
    windows, sampling = {"initial_s": [0.0, 0.28], "final_s": [1.0, 1.2]}, {"pretrigger_s": 0.25}
    sampling |= {"motion_rate_hz": rate, "tension_rate_hz": rate}
    others: dict[str, Any] = {"bolt": {"link": "joint"}, "windows": windows, "sampling": sampling}
    return campaign(folder, {"m": 2.0}, links, records, rate, **others), truth


@once_per_run
def identified_block() -> tuple[Campaign, Model, Model]:
    """The campaign of the block, the truth, and what is identified."""
    found, truth = block(Shared.here.new_folder() / "c")
    return found, truth, rom.identify(found)


def test_a_bolted_block_with_an_added_mass_in_half_of_its_tests(tmp_path: Path) -> None:
    found, truth, model = identified_block()
    blind = rom.identify(block(tmp_path / "blind", own=False)[0])
    k = model.link_laws["joint"].stiffness(300.0) + model.parameter("s.stiffness.k").value
    assert k == pytest.approx(8.5e5, rel=0.01)
    assert model.identification is not None
    assert blind.identification is not None
    gammas = np.array([one.gamma for one in model.identification.gamma])
    errors = np.array([one.log_error for one in model.identification.gamma])
    assert np.median(np.abs(np.log(gammas / 3000.0))) < 0.03
    assert np.all(np.abs(np.log(gammas / 3000.0)) < 0.05 + 4 * errors)
    wrong = np.array([one.gamma for one in blind.identification.gamma])
    assert np.median(np.abs(np.log(np.abs(wrong) / 3000.0))) > 0.1
    judged = evaluate([model, truth], found, found.select(hold_out=True))
    ours, least = (summarise(one.comparisons[place] for one in judged) for place in (0, 1))
    assert ours["final_tension_error_percent_max"] is not None
    assert ours["final_tension_error_percent_max"] < 0.5
    assert ours["motion_nrmse"] is not None
    assert least["motion_nrmse"] is not None
    assert ours["motion_nrmse"] < 1.1 * least["motion_nrmse"]  # noise integrated twice
