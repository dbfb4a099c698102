"""Every effect in a small standard campaign: felt in some record, finite over its range, saved and read."""

import json
import pickle
from functools import cache
from itertools import product

import numpy as np
import pytest

import rom
from rom.effects import CATALOGUE, Motion, candidates, free_form
from rom.model.laws import Parameter
from rom.parameters.he_2025 import nominal_impact, paper_model

RATE = 19200.0
CASES = tuple(product((6.0, 60.0, 300.0, 1000.0), (40.0, 1600.0)))  # tension and hit [N]
CHANNELS = ("force_lo", "acceleration_lo", "acceleration_so", "tension")
MODEL = paper_model()
EVERY = candidates(MODEL, CHANNELS, core=False)
SIMULATED = [pair for pair in EVERY if pair[1].kind in ("force", "law change")]


def title(pair) -> str:
    return f"{pair[0].name} at {pair[1].enters}"


def added(effect) -> rom.Model:
    return effect.added_to(MODEL)


@cache
def plain(case: int, seconds: float = 0.9):
    return run(MODEL, *CASES[case], seconds)


def run(model, tension: float, hit: float, seconds: float):
    return model.simulate({"lo": nominal_impact(hit, RATE, seconds)}, RATE, tension)


def shift(response, base) -> float:
    """Largest change of a motion or the tension, relative to what it does."""

    def changes():
        for body in ("lo", "so"):
            for name in ("displacement", "acceleration"):
                before, after = getattr(base, name)[body], getattr(response, name)[body]
                yield np.sqrt(np.mean((after - before) ** 2) / np.mean(before**2))
        loss = base.tension[0] - base.tension[-1]
        yield abs(response.tension[-1] - base.tension[-1]) / loss if loss > 0.05 else 0.0

    return max(changes())


@pytest.mark.parametrize("pair", SIMULATED, ids=title)
def test_an_effect_is_felt_in_some_record_and_absent_without_strength(pair):
    member, effect = pair
    felt = max(shift(run(added(effect), *case, 0.9), plain(i)) for i, case in enumerate(CASES))
    assert felt > 0.003
    off = added(effect.with_values(**dict.fromkeys(member.strengths, 0.0)))
    assert max(shift(run(off, *CASES[i], 0.9), plain(i)) for i in (1, 5)) < 1e-4


@pytest.mark.parametrize("pair", [p for p in EVERY if p[1].kind == "reading"], ids=title)
def test_a_reading_is_seen_above_the_noise_of_the_gauge(pair):
    shown = []
    for i in range(len(CASES)):
        r = plain(i)
        x = r.displacement["lo"] - r.displacement["so"]
        force = MODEL.link_force("joint", x, RATE, float(r.tension[0]))
        motion = Motion(r.time, 0.5, x, force, {"lo": r.displacement["lo"]})
        shown.append(np.sqrt(np.mean(pair[1].added(motion)[9600:] ** 2)))
    assert max(shown) > 0.02  # the mean over a period of 0.3 microstrain of white noise


@pytest.mark.parametrize("pair", [p for p in EVERY if p[1].kind == "sensor fault"], ids=title)
def test_a_fault_is_seen_in_its_channel(pair):
    r = plain(5)
    quantity, _, body = pair[1].channel.partition("_")
    force = nominal_impact(CASES[5][1], RATE, 0.9)
    true = {"force": force, "tension": r.tension}.get(quantity, r.acceleration.get(body))
    assert np.sqrt(np.mean((pair[1].apply(true, RATE, r.acceleration["lo"]) - true) ** 2)) > 1e-3 * np.sqrt(
        np.mean((true - true[0]) ** 2)
    )


@pytest.mark.slow
@pytest.mark.parametrize("pair", [pair for pair in SIMULATED if pair[0].core], ids=title)
def test_an_effect_stays_finite_over_its_whole_range(pair):
    effect, rng = pair[1], np.random.default_rng(1)
    corners = list(product(*(p.bounds for p in effect.parameters.values())))
    corners = [corners[i] for i in rng.permutation(len(corners))[:4]]
    within = [[rng.uniform(*p.bounds) for p in effect.parameters.values()] for _ in range(1)]
    for values in (*corners, *within):
        model = added(effect.with_values(**dict(zip(effect.parameters, values, strict=True))))
        for tension in (6.0, 3000.0):
            response = run(model, tension, 1770.0, 1.0)
            assert response.status == "ok", (values, tension)
            assert max(abs(x).max() for x in response.displacement.values()) < 0.02, (values, tension)


@pytest.mark.parametrize("pair", EVERY, ids=title)
def test_an_effect_survives_pickling(pair):
    assert pickle.loads(pickle.dumps(pair[1])) == pair[1]


@pytest.mark.parametrize("pair", EVERY, ids=title)
def test_a_model_with_an_effect_is_saved_and_read(pair, tmp_path):
    model = added(pair[1])
    model.save(tmp_path / "model.json")
    read = rom.load_model(tmp_path / "model.json")
    assert read.effects == model.effects
    assert read.parameters == model.parameters
    assert read.link_laws == model.link_laws
    assert read.acting_laws["joint"].tension_rate.equation == model.acting_laws["joint"].tension_rate.equation
    assert pickle.loads(pickle.dumps(model)).parameters == model.parameters  # once it was simulated, too
    path, value = next((f"{pair[1].path}.{name}", p) for name, p in pair[1].parameters.items())
    changed = read.with_values({path: value.bounds[0]})
    assert changed.parameter(path).value == value.bounds[0]


def test_a_model_holds_effects_of_every_kind_at_once(tmp_path):
    model = free_form("c_x * abs(x) * v", "joint", {"c_x": Parameter(1e5, "N s/m2")}).added_to(MODEL)
    model = free_form("rate * w", "tension", {"w": Parameter(0.5, "1")}).added_to(model)
    for _, effect in {pair[0].kind: pair for pair in EVERY}.values():
        model = effect.added_to(model)
    model.save(tmp_path / "model.json")
    read = rom.load_model(tmp_path / "model.json")
    assert [e.name for e in read.effects] == [e.name for e in model.effects]
    assert len({type(effect) for effect in read.effects}) == 5  # forces from code and from text differ
    assert np.array_equal(run(read, 60.0, 1600.0, 0.1).tension, run(model, 60.0, 1600.0, 0.1).tension)


def test_a_file_from_before_effects_had_kinds_is_read(tmp_path):
    CATALOGUE["coulomb-friction"].at("joint").added_to(MODEL).save(tmp_path / "model.json")
    data = json.loads((tmp_path / "model.json").read_text())
    for effect in data["effects"]:
        del effect["equation"]
    (tmp_path / "old.json").write_text(json.dumps(data))
    assert [e.name for e in rom.load_model(tmp_path / "old.json").effects] == ["coulomb-friction"]


def test_the_core_of_the_catalogue_is_complete():
    core = {name for name, member in CATALOGUE.items() if member.core}
    assert core >= {
        *("coulomb-friction", "jenkins-slip", "bouc-wen", "microslip-softening", "cubic-stiffness"),
        *("even-stiffness", "quadratic-damping", "displacement-damping", "two-sided-gap", "one-sided-gap"),
        *("tension-dependent-stiffness", "contact-stiffness", "maxwell-viscoelastic"),
        *("oscillating-tension-stiffness", "extra-mode", "constant-force", "ground-motion"),
        *("loosening-displacement", "loosening-dissipation", "loosening-threshold", "loosening-power"),
        *("loosening-slip-gate", "tightening", "loosening-ratchet", "relaxation-log", "tension-drift"),
        *("tension-follows-displacement", "tension-follows-displacement-squared", "force-gain"),
        *("acceleration-gain", "tension-skew", "acceleration-skew", "ac-coupling", "hum"),
        *("calibration-error", "acceleration-bias"),
    }
