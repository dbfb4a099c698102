"""Changes of the tension law and readings of the tension against limits known in closed form."""

import numpy as np
import pytest

from rom.effects import CATALOGUE, LawChange, Motion, free_form
from rom.effects.observation import tension_reading
from rom.model.laws import Parameter, free_form_law, logistic_loosening, no_loosening, power_loosening
from rom.parameters.he_2025 import nominal_impact, paper_model

LAW = logistic_loosening(11.79, 7.974, -0.00362)
TENSIONS = np.array([3.0, 60.0, 300.0, 1000.0, 3000.0])


def changed(name: str, law=LAW, **values):
    change = CATALOGUE[name].at("tension").with_values(**values)
    assert isinstance(change, LawChange)
    return change.changed(law)


def test_another_power_is_another_exponent():
    v = np.array([-0.07, 0.003, 0.05])[:, None]
    power = changed("loosening-power", power_loosening(2e6), q_v=-1.5)
    twin = power_loosening(2e6 * 0.05**1.5, 2.5)
    assert power.rate(TENSIONS, 0.0, v) == pytest.approx(twin.rate(TENSIONS, 0.0, v), rel=1e-9)


def test_below_its_threshold_nothing_loosens():
    law = changed("loosening-threshold", v_th=0.03)
    assert (law.rate(TENSIONS, 1e-4, [[0.0299], [-0.0299], [0.0]]) == 0.0).all()
    expected = LAW.rate(TENSIONS, 0.0, 0.05) * (0.02 / 0.05) ** 4
    assert law.rate(TENSIONS, 0.0, -0.05) == pytest.approx(expected)


def test_a_gate_opens_where_the_link_slips():
    law = changed("loosening-slip-gate", mu_t=0.1)
    for share, opened in ((0.5, 0.004), (1.0, 0.5), (2.0, 0.996)):
        gated = law.rate(TENSIONS, 0.0, 0.05, -share * 0.1 * TENSIONS)
        assert gated == pytest.approx(opened * LAW.rate(TENSIONS, 0.0, 0.05), rel=0.03)


@pytest.mark.parametrize("follow", [0.0, 1.0])
def test_displacement_and_path_loosen_in_proportion_or_as_the_law_does(follow):
    slower = changed("loosening-displacement", g_x=0.5, p_x=2.0, h_x=follow)
    added = slower.rate(TENSIONS, -2e-4, 0.0) / -TENSIONS
    ratio = LAW.rate(TENSIONS, 0.0, 0.05) / TENSIONS / (LAW.rate(100.0, 0.0, 0.05) / 100.0)
    assert added == pytest.approx(0.5 * 4.0 * ratio**follow)
    path = changed("loosening-ratchet", no_loosening(), r=2.0, h_r=follow)
    assert path.rate(TENSIONS, 1e-4, -0.03) == pytest.approx(-2.0 * 0.03 * TENSIONS)


def test_slip_alone_loosens_beyond_its_onset():
    law = changed("loosening-ratchet", no_loosening(), r=2.0, x_r=3e-5)
    assert law.rate(100.0, 2.9e-5, 0.05) == 0.0
    assert float(law.rate(100.0, -6e-5, 0.05)) == pytest.approx(-2.0 * 0.05 * 100.0 * 0.5)


def test_dissipated_energy_loosens_by_its_share():
    law = changed("loosening-dissipation", no_loosening(), g_e=5.0)
    assert float(law.rate(200.0, 0.0, 0.05, 50.0, 8.0)) == pytest.approx(-5.0 * 200.0 * 8.0 * 0.05)


def test_tightening_undoes_loosening_of_its_own_power():
    rate = float(LAW.rate(100.0, 0.0, 0.05)) / 100.0
    law = changed("tightening", g_t=-rate, q_t=4.0, h_t=1.0)
    balanced = law.rate(TENSIONS, 0.0, [[0.02], [0.06]])
    assert abs(balanced).max() < 1e-9 * abs(LAW.rate(TENSIONS, 0.0, 0.06)).max()


def test_a_changed_model_loosens_otherwise_and_can_be_fitted_by_path():
    model = paper_model()
    change = CATALOGUE["tightening"].at("tension")
    assert isinstance(change, LawChange)
    tight = change.added_to(model)
    force = {"lo": nominal_impact(1608.7, 19200, 1.0)}
    loss = [100.0 - m.simulate(force, 19200, 100.0).tension[-1] for m in (model, tight)]
    assert loss[1] < 0.9 * loss[0]
    off = tight.with_values({"tension.tightening.g_t": 0.0})
    same = 100.0 - off.simulate(force, 19200, 100.0).tension[-1]
    assert same == pytest.approx(loss[0], rel=1e-5)
    assert off.link_laws == model.link_laws
    assert off.acting_laws["joint"].tension_rate.name == "logistic loosening + tightening"
    forces, rates = np.stack([force["lo"]] * 2), {"tension.tightening.g_t": [0.0, 10.0]}
    assert tight.final_tension(forces, 19200, [100.0, 100.0], rates) == pytest.approx(
        [m.simulate(force, 19200, 100.0).tension[-1] for m in (model, tight)], rel=1e-6
    )


def test_a_rate_found_without_the_catalogue_changes_the_law():
    model = paper_model()
    twice = free_form("twice * rate", "tension", {"twice": Parameter(2.0, "1")}).added_to(model)
    force = {"lo": nominal_impact(1608.7, 19200, 0.2)}
    loss = [3000.0 - m.simulate(force, 19200, 3000.0).tension[-1] for m in (model, twice)]
    assert loss[1] == pytest.approx(2 * loss[0], rel=1e-3)
    with pytest.raises(ValueError, match="may use T, x, v, F, D, rate, follow, twice, got 'k'"):
        free_form("k * rate", "tension", {"twice": Parameter(2.0, "1")})


def test_a_law_that_does_nothing_at_the_reference_is_followed_nowhere():
    idle = free_form_law(
        "idle", "-g * max(abs(v) - 0.2, 0) * T", "tension rate", {"g": Parameter(3.0, "1/m")}
    )
    law = changed("loosening-displacement", idle, g_x=0.5, h_x=0.7)
    assert law.rate(TENSIONS, 1e-4, [[0.1], [0.3]]) == pytest.approx(idle.rate(TENSIONS, 0.0, [[0.1], [0.3]]))


def test_changes_add_up_and_each_follows_the_first_law():
    model = paper_model()
    for name in ("tightening", "loosening-displacement", "loosening-ratchet", "loosening-dissipation"):
        model = CATALOGUE[name].at("tension").added_to(model)
    first, law = (laws["joint"].tension_rate for laws in (model.link_laws, model.acting_laws))
    assert len(law.equation) < 3000
    alone = [effect.changed(first).rate(TENSIONS, 1e-4, 0.04, 30.0, 3.0) for effect in model.effects]
    base = first.rate(TENSIONS, 1e-4, 0.04)
    assert law.rate(TENSIONS, 1e-4, 0.04, 30.0, 3.0) == pytest.approx(base + sum(a - base for a in alone))


def test_changes_add_up_but_not_with_themselves():
    model = CATALOGUE["tightening"].at("tension").added_to(paper_model())
    both = CATALOGUE["loosening-threshold"].at("tension").added_to(model)
    assert both.simulate({"lo": nominal_impact(1608.7, 19200, 0.7)}, 19200, 60.0).status == "ok"
    with pytest.raises(ValueError, match="got two 'tightening' at 'tension'"):
        CATALOGUE["tightening"].at("tension").added_to(model)
    once = changed("tightening")
    with pytest.raises(ValueError, match="must not have the parameters of 'tightening'"):
        CATALOGUE["tightening"].at("tension").changed(once)
    with pytest.raises(ValueError, match="must enter at a bolted link, which the model lacks"):
        CATALOGUE["tightening"].at("tension").added_to(paper_model().without_bolt())


def readings(name: str, motion: Motion, **values) -> np.ndarray:
    return CATALOGUE[name].at("tension").with_values(**values).added(motion)


def test_slow_changes_start_at_the_impact_or_with_the_record():
    time = np.linspace(0, 8, 801)
    motion = Motion(time, 0.5, np.zeros_like(time))
    creep = readings("relaxation-log", motion, A=0.4, t_0=0.05)
    assert not creep[time <= 0.5].any()
    decade = np.interp([0.5 + 0.5, 0.5 + 5.0], time, creep)
    assert decade[1] - decade[0] == pytest.approx(-0.4 * np.log(10), rel=0.05)
    settled = readings("relaxation-stretched", motion, A=2.0, tau=0.1, b=1.0)
    assert settled[-1] == pytest.approx(-2.0, rel=1e-6)
    assert np.diff(readings("tension-drift", motion, d=0.1)) == pytest.approx(0.1 * 0.01)


def test_readings_follow_the_motion():
    time = np.arange(4000) / 4800
    x = 1e-4 * np.sin(2 * np.pi * 16 * time)
    motion = Motion(time, 0.0, x)
    assert readings("tension-follows-displacement", motion, a=1e4).max() == pytest.approx(1.0, rel=1e-3)
    square = readings("tension-follows-displacement-squared", motion, b=1e9)
    assert square.min() >= 0.0
    assert square.mean() == pytest.approx(5.0, rel=0.02)
    with pytest.raises(ValueError, match="follows the joint's force needs"):
        readings("tension-follows-joint-force", motion)
    with pytest.raises(ValueError, match="follows a body needs"):
        readings("tension-follows-body", motion)


def test_a_reading_in_a_model_leaves_its_motion_alone():
    force = {"lo": nominal_impact(1608.7, 19200, 0.7)}
    reading = CATALOGUE["tension-follows-displacement"].at("tension")
    with_it = paper_model().with_effect(reading).simulate(force, 19200, 100.0)
    without = paper_model().simulate(force, 19200, 100.0)
    assert with_it.tension == pytest.approx(without.tension, rel=1e-7)
    x = without.displacement["lo"]
    assert with_it.displacement["lo"] == pytest.approx(x, abs=1e-6 * abs(x).max())


def test_the_gauge_shows_the_tension_and_every_reading_of_a_model():
    model = paper_model()
    for name in ("tension-follows-displacement-squared", "tension-follows-joint-force", "relaxation-log"):
        model = CATALOGUE[name].at("tension").added_to(model)
    response = model.simulate({"lo": nominal_impact(1608.7, 19200, 1.5)}, 19200, 100.0)
    shown = tension_reading(model, response, impact_s=0.5) - response.tension
    x = response.displacement["lo"] - response.displacement["so"]
    v = response.velocity["lo"] - response.velocity["so"]
    laws = model.link_laws["joint"]
    force = laws.stiffness(response.tension) * x + laws.damping(response.tension) * v
    creep = 0.3 * np.log1p(np.maximum(response.time - 0.5, 0.0) / 0.05)
    assert shown == pytest.approx(2e8 * x**2 + 0.02 * force - creep, abs=1e-12)
    with pytest.raises(ValueError, match="needs one bolted link, the model has 0"):
        tension_reading(paper_model().without_bolt(), response)
