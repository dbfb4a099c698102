"""Every effect: equation and machine code agree, units are consistent, no strength is no effect."""

import itertools

import numpy as np
import pytest

from rom.effects import LawChange, Motion
from rom.effects.member import OF_CHANNEL
from rom.model.laws import logistic_loosening
from tests.contracts.effect_cases import compiled, drawn, evaluated, members, name_of, rescaled, scale_of

FORCES, RATES = members("force"), members("tension rate")
READINGS, SENSORS = members("measured tension"), members("sensor")
POINTWISE = [member for member in SENSORS if member.equation.startswith("y = ")]
LAW = logistic_loosening(11.79, 7.974, -0.00362)


def arguments(rng) -> dict[str, float]:
    return {
        "t": rng.uniform(0, 8),
        "x": 2e-4 * rng.uniform(-1, 1),
        "v": 0.1 * rng.uniform(-1, 1),
        "T": 10 ** rng.uniform(0.5, 3.5),
        "k": 10 ** rng.uniform(4, 6),
        "c": 10 ** rng.uniform(0, 3),
    }


def states(member, rng) -> tuple[float, ...]:
    size = {"m": 1e-4, "m/s": 0.1}
    return tuple(size[unit] * rng.uniform(-1, 1) for unit in member.state_units)


@pytest.mark.parametrize("ground", [False, True])
@pytest.mark.parametrize("member", FORCES, ids=name_of)
def test_equation_and_machine_code_of_a_force_agree(member, ground):
    rng = np.random.default_rng(1)
    for _ in range(100):
        p, given, s = drawn(member, rng, ground=ground), arguments(rng), states(member, rng)
        effect = member.at("joint", ground=ground).with_values(**p)
        force, rates, tension_rate = compiled(effect, *given.values(), s)
        zs = {f"z{i + 1}": value for i, value in enumerate(s)}
        read = evaluated(member.equation, {**given, **p, **zs})
        assert force == pytest.approx(read["F"], rel=1e-9, abs=1e-12 * abs(given["k"] * given["x"]))
        for i, rate in enumerate(rates):
            assert rate == pytest.approx(read[f"dz{i + 1}/dt"], rel=1e-9, abs=1e-14)
        assert tension_rate == 0.0


@pytest.mark.parametrize("member", FORCES, ids=name_of)
def test_a_force_without_strength_is_exactly_zero(member):
    rng = np.random.default_rng(2)
    effect = member.silent("joint")
    for _ in range(50):
        assert compiled(effect, *arguments(rng).values(), states(member, rng))[0] == 0.0
        given = {**arguments(rng), "T": 0.0}
        assert compiled(effect, *given.values(), states(member, rng))[0] == 0.0


@pytest.mark.parametrize("member", FORCES, ids=name_of)
def test_no_motion_makes_a_force_that_is_no_number(member):
    s = [0.0] * len(member.state_units)
    for ground in (False, True):
        for bound in (0, 1):
            p = {name: q.bounds[bound] for name, q in member.at("joint", ground=ground).parameters.items()}
            effect = member.at("joint", ground=ground).with_values(**p)
            for x, v, T, k in itertools.product((0.0, -10.0, 1e3), (0.0, 1e3, -1e5), (0.0, 1e6), (0.0, 1e9)):
                force, rates, _ = compiled(effect, 1.0, x, v, T, k, 1e4, s)
                assert np.isfinite([force, *rates]).all(), (p, x, v, T, k)


def rate_arguments(rng) -> dict[str, float]:
    return {
        "T": 10 ** rng.uniform(0.5, 3.3),
        "x": 1e-4 * rng.uniform(-1, 1),
        "v": 0.07 * rng.uniform(-1, 1),
        "F": 80 * rng.uniform(-1, 1),
        "D": 20 * rng.uniform(-1, 1),
    }


@pytest.mark.parametrize("member", RATES, ids=name_of)
def test_the_changed_law_is_the_equation_with_the_law_put_in(member):
    rng = np.random.default_rng(3)
    for _ in range(30):
        p, given = drawn(member, rng), rate_arguments(rng)
        change = member.at("tension").with_values(**p)
        at = {"x": 1e-4, "v": 0.05, "F": 100.0, "D": 10.0}.values()
        follow = LAW.rate(given["T"], *at) / given["T"] / (LAW.rate(100.0, *at) / 100.0)
        names = {**given, **p, "rate": float(LAW.rate(*given.values())), "follow": float(follow)}
        expected = evaluated(member.equation, names)["F"]
        assert float(change.changed(LAW).rate(*given.values())) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("member", RATES, ids=name_of)
def test_a_change_of_law_without_strength_leaves_the_law(member):
    rng = np.random.default_rng(4)
    silent = member.silent("tension")
    assert isinstance(silent, LawChange)
    for _ in range(30):
        given = rate_arguments(rng)
        for still in ("", "F", "x", "D"):
            at = [0.0 if name == still else value for name, value in given.items()]
            expected = float(LAW.rate(*at))
            # compiled apart, the two may round apart
            assert float(silent.changed(LAW).rate(*at)) == pytest.approx(expected, rel=1e-13)
    assert float(silent.changed(LAW).rate(0.0, 0.0, 0.0, 0.0, 0.0)) == 0.0


def motion(rng) -> Motion:
    t = np.linspace(0, 2, 50)
    x = 1e-4 * rng.normal(size=50)
    return Motion(t, 0.5, x, 50 * rng.normal(size=50), {"lo": 1e-3 * rng.normal(size=50)})


@pytest.mark.parametrize("member", READINGS, ids=name_of)
def test_equation_and_function_of_a_reading_agree_and_it_can_be_taken_away(member):
    rng = np.random.default_rng(5)
    for _ in range(20):
        p, m = drawn(member, rng), motion(rng)
        reading = member.at("tension").with_values(**p)
        names = {"t": m.time, "t_hit": 0.5, "x": m.displacement, "F_J": m.link_force}
        expected = evaluated(member.equation, {**p, **names, "x_b": m.body_displacement["lo"]})["F"]
        assert reading.added(m) == pytest.approx(expected, rel=1e-9, abs=1e-15)
        tension = 100.0 + rng.normal(size=50)
        assert reading.remove(reading.apply(tension, m), m) == pytest.approx(tension, rel=1e-14)
        assert not member.silent("tension").added(m).any()


@pytest.mark.parametrize("member", SENSORS, ids=name_of)
def test_a_sensor_without_fault_shows_what_is_true(member):
    samples = np.random.default_rng(6).normal(size=100)
    silent = member.silent(f"{member.places[0]}_lo")
    assert (silent.apply(samples, 4800.0, samples[::-1]) == samples).all()
    assert (silent.remove(samples, 4800.0, samples[::-1]) == samples).all()


@pytest.mark.parametrize("member", POINTWISE, ids=name_of)
def test_equation_and_function_of_a_sensor_agree(member):
    rng = np.random.default_rng(7)
    true = 100.0 * rng.normal(size=40)
    p = drawn(member, rng)
    shown = member.at(member.places[0]).with_values(**p).apply(true, 1000.0, true[::-1])
    names = {**p, "y_true": true, "y_other": true[::-1], "t": np.arange(40) / 1000.0}
    assert shown == pytest.approx(evaluated(member.equation, names)["y"], rel=1e-9)


@pytest.mark.parametrize("member", [*FORCES, *RATES, *READINGS, *POINTWISE], ids=name_of)
def test_an_equation_means_the_same_in_other_units(member):
    rng = np.random.default_rng(8)
    units = {
        **{"t": "s", "t_hit": "s", "x": "m", "v": "m/s", "T": "N", "k": "N/m", "c": "N s/m", "D": "N"},
        **{"rate": "N/s", "follow": "1", "F_J": "N", "x_b": "m"},
        "y_true": "m/s2" if "acceleration" in member.places[0] else "N",
        "y_other": "m/s2",
        **{f"z{i + 1}": unit for i, unit in enumerate(member.state_units)},
        **{name: p.unit for name, p in member.parameters.items()},
    }
    units = {name: units["y_true"] if unit == OF_CHANNEL else unit for name, unit in units.items()}
    if member.kind == "tension rate":
        units["F"] = "N"
    result, unit = {"sensor": ("y", units["y_true"]), "tension rate": ("F", "N/s")}.get(
        member.kind, ("F", "N")
    )
    for _ in range(10):
        given = {**arguments(rng), **rate_arguments(rng), "rate": -3.0, "follow": 0.7}
        given |= {
            "F_J": 50.0,
            "t_hit": 0.5,
            "x_b": 1e-3,
            "y_true": 20.0,
            "y_other": 30.0,
            **drawn(member, rng),
        }
        given |= {f"z{i + 1}": value for i, value in enumerate(states(member, rng))}
        names = {name: given[name] for name in units}
        here = evaluated(member.equation, names)
        there = evaluated(
            rescaled(member.equation), {name: value * scale_of(units[name]) for name, value in names.items()}
        )
        assert there[result] == pytest.approx(here[result] * scale_of(unit), rel=1e-9)
        for i, of_state in enumerate(member.state_units):
            rate = f"dz{i + 1}/dt"
            assert there[rate] == pytest.approx(here[rate] * scale_of(of_state) / scale_of("s"), rel=1e-9)


@pytest.mark.parametrize("member", FORCES, ids=name_of)
def test_linear_in_its_strengths_means_linear(member):
    rng, once, twice = np.random.default_rng(9), [], []
    for _ in range(20):
        p, given, s = drawn(member, rng), {**arguments(rng), "k": 1e6}, states(member, rng)
        strengths = {name: 0.4 * p[name] for name in member.strengths}
        weak = member.at("joint").with_values(**{**p, **strengths})
        strong = member.at("joint").with_values(**{**p, **{name: 2 * v for name, v in strengths.items()}})
        (force, rates, _), (double, others, _) = (compiled(e, *given.values(), s) for e in (weak, strong))
        once += [2 * force, *rates]
        twice += [double, *others]
    assert (np.allclose(once, twice, rtol=1e-9, atol=0.0)) is member.linear


@pytest.mark.parametrize("member", RATES, ids=name_of)
def test_linear_in_its_strengths_means_linear_in_the_rate(member):
    rng, changes = np.random.default_rng(10), []
    for _ in range(10):
        p, given = drawn(member, rng), tuple(rate_arguments(rng).values())
        strengths = {name: 0.4 * p[name] for name in member.strengths}
        for factor in (1.0, 2.0):
            values = {**p, **{name: factor * value for name, value in strengths.items()}}
            law = member.at("tension").with_values(**values).changed(LAW)
            changes.append(float(law.rate(*given)) - float(LAW.rate(*given)))
    once, twice = np.array(changes[::2]), np.array(changes[1::2])
    assert bool(np.allclose(2 * once, twice, rtol=1e-5, atol=1e-9)) is member.linear
