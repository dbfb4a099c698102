"""The force of one link alone, and where a model rests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rom import Model
from rom.effects import CATALOGUE, Effect, free_form
from rom.model.laws import Parameter, constant_damping, constant_stiffness
from rom.model.link_force import force_along
from rom.model.model import LinkLaws
from rom.model.structure import Body, Link, Structure
from rom.parameters.he_2025 import nominal_impact, paper_model

RATE_HZ = 19200.0
MODEL = paper_model()
STIFFNESS = 1e5


def with_effects(*effects: tuple[str, str, dict[str, float]]) -> Model:
    model = MODEL
    for name, enters, values in effects:
        model = CATALOGUE[name].at(enters).with_values(**values).added_to(model)
    return model


def alone(name: str, **values: float) -> Model:
    """Return one mass on one spring, with an effect in it."""
    structure = Structure((Body("m", 1.0),), (Link("spring", "m", "ground"),))
    laws = {"spring": LinkLaws(constant_stiffness(STIFFNESS), constant_damping(0.0))}
    return CATALOGUE[name].at("spring").with_values(**values).added_to(Model(structure, laws))


@pytest.mark.parametrize(
    "name", ["jenkins-slip", "bouc-wen", "lugre", "iwan-slip", "coulomb-friction", "cubic-stiffness"]
)
def test_the_force_is_that_of_the_simulation(name: str) -> None:
    model = with_effects((name, "joint", {}), ("maxwell-viscoelastic", "joint", {}))
    response = model.simulate({"lo": nominal_impact(1600.0, RATE_HZ, 0.8)}, RATE_HZ, 100.0)
    x, v, a = (of["so"] for of in (response.displacement, response.velocity, response.acceleration))
    number = model.parameter
    flexure = number("flexure_so.stiffness.k").value * x + number("flexure_so.damping.c").value * v
    from_motion = number("body.so.mass").value * a + flexure  # nothing else acts on it
    found = model.link_force("joint", response.displacement["lo"] - x, RATE_HZ, response.tension)
    size = np.sqrt(np.mean(from_motion**2))
    inside = slice(int(0.505 * RATE_HZ), None)  # central differences miss the onset of the hit
    assert np.sqrt(np.mean((found - from_motion)[inside] ** 2)) < 1e-3 * size
    bare = MODEL.link_force("joint", response.displacement["lo"] - x, RATE_HZ, response.tension)
    assert np.sqrt(np.mean((bare - from_motion)[inside] ** 2)) > 0.02 * size


@pytest.mark.parametrize(("stiffness", "most"), [(5e6, 5e-3), (1e8, 0.06)])
def test_a_slider_turns_between_samples(stiffness: float, most: float) -> None:
    """At 256 samples a period; the stiffer one slips after an eighth of the path between two of them."""
    values = {"k_t": stiffness, "F_s": 4e3, "b": 2.6e-3}
    known = CATALOGUE["backlash-slip"].at("spring", ground=True)
    wide = {n: replace(p, value=values.get(n, 0.0), bounds=(0.0, 1e12)) for n, p in known.parameters.items()}
    slider = replace(known, parameters=wide)
    assert isinstance(slider, Effect)
    coarse, fine = at_both_rates(slider, 0.0128, 1.0, 0.0, rate_hz=256.0, length_s=2.0)
    assert np.abs(coarse - fine).max() < most * np.ptp(fine)


def test_a_slider_that_slips_between_two_samples_alone_is_followed() -> None:
    """At ten samples a period: a decaying motion passes the limit near its turns, not at any sample."""
    slider = CATALOGUE["jenkins-slip"].at("joint")
    assert isinstance(slider, Effect)
    coarse, fine = at_both_rates(slider, 1e-4, 100.0, 0.01, rate_hz=1000.0, length_s=1.0)
    assert np.sqrt(np.mean((coarse - fine) ** 2)) < 0.02 * np.sqrt(np.mean(fine**2))


def at_both_rates(
    slider: Effect, size_m: float, hz: float, damping: float, rate_hz: float, length_s: float
) -> list[np.ndarray]:
    """Force along a decaying sine at a rate, and at the same samples of one 64 times finer."""
    forces, pole = [], 2 * np.pi * hz * (1j - damping)
    for times in (1, 64):
        time = np.arange(int(length_s * rate_hz) * times) / (rate_hz * times)
        turned = size_m * np.exp(pole * time)
        level = np.multiply.outer([300.0, 8e5, 60.0], np.ones(len(time)))
        motion = np.vstack([turned.imag, (pole * turned).imag, level])
        table = np.array([[slider.address, 0, 0]])
        found = force_along(table, np.append(slider.values, 0.0), motion, time[1], (slider,), settled=False)
        forces.append(found[::times])
    return forces


def test_a_mass_on_a_body_starts_with_it() -> None:
    """Far above all other frequencies it is mass, and rings no more than its acceleration asks."""
    one, spring = Structure((Body("b", 2.0),), (Link("s", "b", "ground", "linear"),)), 2.0 * 60.0**2
    laws = {"s": LinkLaws(constant_stiffness(spring), constant_damping(3.0))}
    mode = CATALOGUE["extra-mode"].at("body:b").with_values(m3=0.2, f3=500.0, zeta3=0.02)
    assert isinstance(mode, Effect)
    rides, heavy = Model(one, laws).with_effect(mode), Model(replace(one, bodies=(Body("b", 2.2),)), laws)
    for x, v in ((1e-3, 0.0), (0.0, 0.06), (-1e-3, 0.06)):
        start: Any = {"b": np.zeros(4000)}, 4000.0, None, {"b": x}, {"b": v}
        found, mass = rides.simulate(*start), heavy.simulate(*start)
        apart = np.abs(found.displacement["b"] - mass.displacement["b"]).max()
        assert apart < 1e-3 * np.abs(mass.displacement["b"]).max()
        motion = np.zeros((5, 4000))
        motion[:2] = found.displacement["b"], found.velocity["b"]
        table = np.array([[mode.address, 0, 0]])
        force = force_along(table, np.append(mode.values, 0.0), motion, 1 / 4000.0, (mode,), settled=False)
        assert np.abs(force).max() < 2.5 * 0.2 * np.abs(mass.acceleration["b"]).max()
    pushed = CATALOGUE["constant-force"].at("body:b").with_values(F_0=-4.0)
    rest = rides.with_effect(pushed).equilibrium(None)
    assert rest is not None
    assert rest["b"] == pytest.approx(-4.0 / spring)


def test_a_slider_follows_the_normal_force() -> None:
    time = np.arange(4000) / 1000.0
    x, normal = 5e-3 * np.sin(2 * np.pi * time), 40.0 + 10.0 * time
    model = alone("jenkins-slip", kappa=0.5, F_s=0.0, mu=0.2)
    friction = model.link_force("spring", x, 1000.0, normal) - 0.5 * STIFFNESS * x
    slips = np.abs(np.cos(2 * np.pi * time)) > 0.7
    slips[:200] = False
    assert np.abs(friction[slips]) == pytest.approx(0.2 * normal[slips], rel=0.02)


def test_a_settled_slider_goes_in_the_loop_that_it_repeats() -> None:
    time = np.arange(2000) / 1000.0
    x = 1e-3 * np.cos(2 * np.pi * time)
    model = alone("jenkins-slip", kappa=0.5, F_s=5.0, mu=0.0)
    fresh, settled = (model.link_force("spring", x, 1000.0, settled=s) for s in (False, True))
    cycle = slice(0, 1000), slice(1000, 2000)
    assert settled[cycle[0]] == pytest.approx(settled[cycle[1]], abs=0.02)
    assert np.abs(fresh - settled)[:10].max() < 0.1  # both start at the end of the stroke
    assert np.trapezoid(settled[cycle[1]], x[cycle[1]]) == pytest.approx(4 * 5.0 * (1e-3 - 1e-4), rel=0.02)


def test_a_model_at_rest_is_at_rest() -> None:
    model = with_effects(
        ("constant-force", "body:lo", {"F_0": 5.0}),
        ("one-sided-gap", "flexure_lo", {"k_g": 5e4, "delta": 2e-5}),
        ("jenkins-slip", "joint", {}),
        ("ground-motion", "body:so", {"F_a": 0.0, "F_b": 0.0}),
    )
    still = model.simulate({"lo": np.zeros(4000)}, RATE_HZ, 300.0)
    assert still.displacement["lo"][0] > 1e-5
    assert np.ptp(still.displacement["lo"]) < 1e-9 * still.displacement["lo"][0]
    placed = model.simulate({"lo": np.zeros(4000)}, RATE_HZ, 300.0, initial_displacement={"lo": 0.0})
    assert np.ptp(placed.displacement["lo"]) > 1e-5


@pytest.mark.parametrize("friction", [False, True])
def test_the_fast_path_starts_at_rest_too(friction: bool) -> None:
    model = with_effects(("constant-force", "body:lo", {"F_0": 0.0}), ("one-sided-gap", "flexure_lo", {}))
    if friction:
        model = CATALOGUE["jenkins-slip"].at("joint").added_to(model)
    forces, tensions = np.tile(nominal_impact(1600.0, RATE_HZ, 0.7), (2, 1)), np.array([60.0, 300.0])
    pushes = {"body:lo.constant-force.F_0": [20.0, -10.0]}
    found = model.final_tension(forces, RATE_HZ, tensions, pushes)
    for case, push in enumerate(pushes["body:lo.constant-force.F_0"]):
        one = model.with_values({"body:lo.constant-force.F_0": push})
        response = one.simulate({"lo": forces[case]}, RATE_HZ, tensions[case])
        assert found[case] == pytest.approx(response.tension[-1], abs=2e-3)
        assert (
            found[case] == one.final_tension(forces[case : case + 1], RATE_HZ, tensions[case : case + 1])[0]
        )


def test_only_what_a_simulation_depends_on_is_varied() -> None:
    model = with_effects(("force-gain", "sensor:force_lo", {}))
    with pytest.raises(ValueError, match="vary must name what a simulation depends on"):
        model.final_tension(np.zeros((1, 10)), RATE_HZ, 1.0, {"sensor:force_lo.force-gain.g": [0.1]})


def test_rest_is_where_forces_balance_whatever_goes_with_time() -> None:
    pushed = with_effects(
        ("constant-force", "body:so", {"F_0": -3.0}), ("ground-motion", "body:lo", {"F_a": 1.0})
    )
    rest = pushed.equilibrium(300.0)
    assert rest is not None
    k = {n: MODEL.parameter(f"flexure_{n}.stiffness.k").value for n in ("lo", "so")}
    assert sum(k[n] * rest[n] for n in k) == pytest.approx(-3.0, rel=1e-9)
    in_time = free_form("w * cos_t", "body:lo", {"w": Parameter(1.0, "N"), "cos_t": Parameter(1.0, "1")})
    assert in_time.added_to(MODEL).equilibrium(300.0) is not None
    assert (
        free_form("w * t", "body:lo", {"w": Parameter(1.0, "N/s")}).added_to(MODEL).equilibrium(1.0) is None
    )


def test_what_is_not_pushed_or_floats_starts_at_zero() -> None:
    assert MODEL.equilibrium(300.0) is None
    assert with_effects(("coulomb-friction", "joint", {})).equilibrium(300.0) is None
    structure = Structure((Body("m", 1.0),), (Link("guide", "m", "ground", "dashpot"),))
    laws = {"guide": LinkLaws(constant_stiffness(0.0), constant_damping(5.0))}
    floating = CATALOGUE["constant-force"].at("body:m").added_to(Model(structure, laws))
    assert floating.equilibrium() is None
    assert floating.simulate({"m": np.zeros(100)}, 1000.0).displacement["m"][0] == 0.0


def test_a_force_that_is_no_number_at_zero_leaves_the_start_at_zero() -> None:
    broken = free_form("w / x", "flexure_lo", {"w": Parameter(1.0, "N m")}).added_to(MODEL)
    assert broken.equilibrium(300.0) is None
    assert broken.simulate({"lo": np.zeros(50)}, RATE_HZ, 300.0).status == "diverged"


def test_an_unknown_link_is_named() -> None:
    with pytest.raises(ValueError, match=r"link must be one of .*, got 'bolt'"):
        MODEL.link_force("bolt", np.zeros(10), 1000.0)
