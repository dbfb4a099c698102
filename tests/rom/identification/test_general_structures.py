"""Structures other than the paper's: identified from raw records, saved, loaded, judged on held-out ones."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import rom
from rom.campaign.campaign import Campaign
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import evaluate
from rom.model.model import Model
from tests.rom.lumped import LinkRow, campaign, noisy, pulse, random_force, respond

RATE_HZ, SAMPLES = 2000.0, 6000
FINE = 4  # the truth runs this much finer than its samples


def errors(model: Model, of: Campaign) -> Mapping[str, float | None]:
    """Return the errors on the campaign's held-out records."""
    judged = evaluate([model], of, of.select(hold_out=True))
    return summarise(j.comparisons[0] for j in judged)  # type: ignore[return-value]


def one_body(
    folder: Path,
    link: LinkRow,
    kind: str,
    test: str,
    mass: float = 2.0,
    known: bool = True,
    highest_hz: float = 60.0,
    share: float = 0.01,
) -> Campaign:
    """Return a campaign of two training records and one held out, driven by noise or decaying freely."""
    rng = np.random.default_rng(11)
    records = []
    for i in range(3):
        force = 10 * random_force(rng, FINE * SAMPLES, FINE * RATE_HZ, highest_hz) * (test == "driven")
        initial = rng.normal(0, [0.01, 0.3]) if test == "free" else None
        motion = respond({"m": mass}, [link], {"m": force}, FINE * RATE_HZ, initial)[f"{kind}_m"][::FINE]
        channels = {f"{kind}_m": noisy(rng, motion, share)}
        channels |= {} if test == "free" else {"force_m": force[::FINE]}
        records.append(({"file": f"{i}.h5", "test": test, "hold_out": i == 2}, channels))
    return campaign(folder, {"m": mass if known else None}, [link], records, RATE_HZ)


@pytest.mark.parametrize("kind", ["displacement", "velocity", "acceleration"])
@pytest.mark.parametrize("frequency_hz", [1.2, 9.0, 160.0])
def test_a_driven_body_of_unknown_mass(tmp_path: Path, kind: str, frequency_hz: float) -> None:
    stiffness = 2.0 * (2 * np.pi * frequency_hz) ** 2
    link = ("s", ("m", "ground"), "linear", stiffness, 0.04 * stiffness / (2 * np.pi * frequency_hz))
    found = one_body(tmp_path / "c", link, kind, "driven", known=False, highest_hz=4 * frequency_hz + 10)
    model = rom.identify(found)
    assert model.parameter("body.m.mass").value == pytest.approx(2.0, rel=0.01)
    assert model.parameter("s.stiffness.k").value == pytest.approx(stiffness, rel=0.01)
    assert model.parameter("s.damping.c").value == pytest.approx(link[4], rel=0.02)
    held = errors(model, found)
    assert held["failed"] == 0
    assert held["relative_motion_nrmse"] is None
    assert held["motion_nrmse"] is not None
    assert held["motion_nrmse"] < (0.08 if kind == "acceleration" else 0.015)  # noise integrated twice


@pytest.mark.parametrize(
    ("kind", "mass"), [("displacement", 2.0), ("acceleration", 2.0), ("displacement", 80.0)]
)
def test_a_free_decay_whose_state_belongs_to_its_record(tmp_path: Path, kind: str, mass: float) -> None:
    link = ("s", ("ground", "m"), "linear", 4000.0, 8.0)
    found = one_body(tmp_path / "c", link, kind, "free", mass=mass)
    model = rom.identify(found)
    assert model.parameter("s.stiffness.k").value == pytest.approx(4000.0, rel=5e-3)
    assert model.parameter("s.damping.c").value == pytest.approx(8.0, rel=0.03)
    held = errors(model, found)
    assert held["motion_nrmse"] is not None
    assert held["motion_nrmse"] < 0.02


def test_a_free_decay_cannot_weigh(tmp_path: Path) -> None:
    link = ("s", ("m", "ground"), "linear", 4000.0, 8.0)
    model = rom.identify(one_body(tmp_path / "c", link, "displacement", "free", known=False))
    warnings = " ".join(model.identification.warnings)  # type: ignore[union-attr]
    assert "free decay tells only the ratios of all numbers to the mass of m, for which 1 kg" in warnings
    assert model.parameter("s.stiffness.k").low is None
    ratio = model.parameter("s.stiffness.k").value / model.parameter("body.m.mass").value
    assert ratio == pytest.approx(2000.0, rel=5e-3)


def test_a_floating_mass_on_a_dashpot(tmp_path: Path) -> None:
    link = ("d", ("m", "ground"), "dashpot", 0.0, 12.0)
    found = one_body(tmp_path / "c", link, "displacement", "driven", known=False)
    model = rom.identify(found)
    assert model.parameter("d.damping.c").value == pytest.approx(12.0, rel=0.02)
    assert model.parameter("d.stiffness.k").value == 0.0
    assert model.parameter("body.m.mass").value == pytest.approx(2.0, rel=0.01)
    assert errors(model, found)["motion_nrmse"] < 0.02  # type: ignore[operator]


CHAIN = [
    ("ga", ("a", "ground"), "linear", 20000.0, 6.0),
    ("ab", ("a", "b"), "linear", 30000.0, 5.0),
    ("bolt", ("c", "b"), "bolted", 3e5, 60.0),
    ("cg", ("ground", "c"), "linear", 15000.0, 2.0),
]
MASSES = {"a": 3.0, "b": 2.0, "c": 1.0}


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Three bodies in a chain, one bolted link at one tension, one test of body b without the bolt."""
    rng = np.random.default_rng(5)
    records = []
    for i, body in enumerate(("a", "b", "c", "a")):
        force = pulse(40.0, SAMPLES, RATE_HZ, 0.3, 6e-3)
        motion = respond(MASSES, CHAIN, {body: force}, RATE_HZ)
        channels = {f"acceleration_{n}": noisy(rng, motion[f"acceleration_{n}"], 0.003) for n in MASSES}
        channels |= {f"force_{body}": force, "tension": np.full(SAMPLES, 500.0)}
        records.append(({"file": f"c{i}.h5", "test": "coupled", "hold_out": i == 3}, channels))
    alone = [("ga", ("b", "ground"), "linear", 30000.0, 5.0)]  # body a rests: ground to body b
    force = pulse(40.0, SAMPLES, RATE_HZ, 0.3, 6e-3)
    motion = respond({"b": 2.0}, alone, {"b": force}, RATE_HZ)
    channels = {"force_b": force, "acceleration_b": noisy(rng, motion["acceleration_b"], 0.003)}
    records.append(({"file": "u.h5", "test": "uncoupled", "bodies": ["b"], "hold_out": True}, channels))
    records.insert(0, ({"file": "u0.h5", "test": "uncoupled", "bodies": ["b"]}, channels))
    rest = {"tension": 500.0 - 2 * np.log1p(np.arange(SAMPLES) / RATE_HZ)}
    records.append(({"file": "rest.h5", "test": "hold"}, rest))
    folder = tmp_path_factory.mktemp("chain") / "c"
    return campaign(folder, MASSES, CHAIN, records, RATE_HZ, bolt={"link": "bolt"})


def test_a_chain_with_one_bolted_link(chain: Campaign, tmp_path: Path) -> None:
    model = rom.identify(chain)
    for name, _, law, stiffness, damping in CHAIN:
        share = 0.02 if law == "bolted" else 0.01
        assert model.parameter(f"{name}.stiffness.k").value == pytest.approx(stiffness, rel=share)
        assert model.parameter(f"{name}.damping.c").value == pytest.approx(damping, rel=0.03)
    held = errors(model, chain)
    assert held["records"] == 2
    assert held["motion_nrmse"] is not None
    assert held["motion_nrmse"] < 0.01  # the test of body b alone included: the others rest
    model.save(tmp_path / "model.json")
    loaded = rom.load_model(tmp_path / "model.json")
    force = {"b": pulse(40.0, 500, RATE_HZ, 0.05)}
    ours, theirs = (m.simulate(force, RATE_HZ, 500.0).displacement["c"] for m in (model, loaded))
    assert np.array_equal(ours, theirs)
    assert errors(loaded, chain) == held


@pytest.mark.parametrize("law", ["linear", "dashpot", "bolted"])
def test_a_link_driven_on_its_own(tmp_path: Path, law: str) -> None:
    rng = np.random.default_rng(8)
    time = np.arange(SAMPLES) / RATE_HZ
    stiffness = 0.0 if law == "dashpot" else 5e4
    records = []
    for i, frequency_hz in enumerate((2.0, 5.0, 11.0)):
        omega = 2 * np.pi * frequency_hz
        displacement = 1e-3 * np.sin(omega * time)
        force = stiffness * displacement + 120.0 * 1e-3 * omega * np.cos(omega * time)
        channels = {
            "link_displacement_el": noisy(rng, displacement, 0.01),
            "link_force_el": noisy(rng, force, 0.01),
        } | ({"tension": np.full(SAMPLES, 300.0)} if law == "bolted" else {})
        records.append(({"file": f"{i}.h5", "test": "cycled", "hold_out": i == 2}, channels))
    bolt = {"bolt": {"link": "el"}} if law == "bolted" else {}
    link = ("el", ("p", "ground"), law, stiffness, 120.0)
    found = campaign(tmp_path / "c", {"p": None}, [link], records, RATE_HZ, **bolt)
    model = rom.identify(found)
    assert model.parameter("el.stiffness.k").value == pytest.approx(stiffness, rel=0.01)
    assert model.parameter("el.damping.c").value == pytest.approx(120.0, rel=0.02)
    held = errors(model, found)
    assert held["link_force_nrmse"] is not None
    assert held["link_force_nrmse"] < 0.02
    assert held["motion_nrmse"] is None
    assert "body p: no training record tells its mass" in " ".join(model.identification.warnings)  # type: ignore[union-attr]


@pytest.mark.parametrize("still", [(1,), (0, 1, 2)])
def test_driven_records_without_force(tmp_path: Path, still: tuple[int, ...]) -> None:
    rng, link = np.random.default_rng(11), ("s", ("m", "ground"), "linear", 4000.0, 8.0)
    records = []
    for i in range(4):
        force = 10 * random_force(rng, FINE * SAMPLES, FINE * RATE_HZ, 60.0) * (i not in still)
        initial = np.array([2e-3, 0.1]) if i in still else None
        motion = respond({"m": 2.0}, [link], {"m": force}, FINE * RATE_HZ, initial)["displacement_m"][::FINE]
        channels = {"displacement_m": noisy(rng, motion, 0.003), "force_m": force[::FINE]}
        records.append(({"file": f"{i}.h5", "test": "driven", "hold_out": i == 3}, channels))
    found = campaign(tmp_path / "c", {"m": 2.0}, [link], records, RATE_HZ)
    model = rom.identify(found)
    assert model.parameter("s.stiffness.k").value == pytest.approx(4000.0, rel=0.01)
    assert model.parameter("s.damping.c").value == pytest.approx(8.0, rel=0.05)
    assert errors(model, found)["motion_nrmse"] < 0.05  # type: ignore[operator]


def test_nothing_to_identify_is_one_clear_line(tmp_path: Path) -> None:
    link = ("joint", ("m", "ground"), "bolted", 0.0, 0.0)
    swing = np.cos(2 * np.pi * 20.0 * np.arange(SAMPLES) / RATE_HZ)
    records = [
        ({"file": "rest.h5", "test": "hold"}, {"tension": np.full(SAMPLES, 100.0)}),
        ({"file": "free.h5", "test": "free", "hold_out": True}, {"displacement_m": 1e-3 * swing}),
    ]
    found = campaign(tmp_path / "c", {"m": 1.0}, [link], records, RATE_HZ, bolt={"link": "joint"})
    with pytest.raises(ValueError, match="found no training record of a moving body or a cycled link"):
        rom.identify(found)
