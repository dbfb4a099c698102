"""Forces and body effects against limits known in closed form."""

import numpy as np
import pytest
from scipy.special import ellipk

from rom.effects import CATALOGUE
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from tests.contracts.effect_cases import compiled, driven

RATE = 19200.0
STIFFNESS = 1e4  # with 1 kg: 15.9 Hz


def oscillator(stiffness=STIFFNESS, damping=0.0) -> Model:
    structure = Structure((Body("m", 1.0),), (Link("spring", "m", "ground"),))
    return Model(structure, {"spring": LinkLaws(constant_stiffness(stiffness), constant_damping(damping))})


def free(model: Model, x0: float, seconds: float):
    """Displacement and velocity of a release from rest."""
    force = {"m": np.zeros(round(seconds * RATE))}
    response = model.simulate(force, RATE, initial_displacement={"m": x0}, tolerance=1e-7)
    assert response.status == "ok"
    return response.displacement["m"], response.velocity["m"]


def at(name: str, enters="spring", **values):
    ground = enters not in ("joint",) and not enters.startswith("body:")
    return CATALOGUE[name].at(enters, ground=ground).with_values(**values)


def crossings(x: np.ndarray) -> np.ndarray:
    """Times at which x rises through zero [s]."""
    i = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    return (i - x[i] / (x[i + 1] - x[i])) / RATE


def loop(name: str, amplitude: float, frequency: float, cycles=3, k=9e5, T=150.0, **values):
    """Displacement, velocity and force of an effect over the last of some sinusoidal cycles."""
    samples = 4000
    step = 1 / frequency / samples
    t = 0.5 * step * np.arange(2 * samples * cycles + 1)
    w = 2 * np.pi * frequency
    path = t, amplitude * np.sin(w * t), amplitude * w * np.cos(w * t), step
    effect = at(name, "joint", **values)
    force = driven(effect.function, list(effect.values), effect.states, path, T=T, k=k)
    last = slice(-samples - 1, None)
    return path[1][::2][last], path[2][::2][last], force[last], step


def area(_, v, f, step) -> float:
    return float(np.trapezoid(f * v, dx=step))


def test_coulomb_friction_takes_an_equal_step_off_every_cycle():
    x, _ = free(oscillator().with_effect(at("coulomb-friction", F_c=0.5, v_s=3e-4)), 1e-3, 0.25)
    peaks = x[1:-1][(x[1:-1] > x[:-2]) & (x[1:-1] > x[2:])]
    assert len(peaks) >= 3
    assert -np.diff([1e-3, *peaks])[:3] == pytest.approx(4 * 0.5 / STIFFNESS, rel=0.02)


def test_friction_of_the_joint_goes_with_its_tension():
    force = [compiled(at("coulomb-friction", F_c=0.0, mu=2e-3), 0, 0, 1.0, T, 1e4, 1)[0] for T in (10, 300)]
    assert force == pytest.approx([0.02, 0.6])


@pytest.mark.parametrize("k3", [1e10, -4e9])
def test_cubic_stiffness_has_the_backbone_of_a_duffing_oscillator(k3):
    amplitude = 1e-3
    x, _ = free(oscillator().with_effect(at("cubic-stiffness", k3=k3)), amplitude, 0.5)
    stiff = STIFFNESS + k3 * amplitude**2
    period = 4 * ellipk(k3 * amplitude**2 / (2 * stiff)) / np.sqrt(stiff)
    assert np.diff(crossings(x)) == pytest.approx(period, rel=2e-5)


@pytest.mark.parametrize(
    ("name", "values", "potential"),
    [
        ("cubic-stiffness", {"k3": 8e9}, lambda x: 8e9 * x**4 / 4),
        ("quintic-stiffness", {"k5": 6e15}, lambda x: 6e15 * x**6 / 6),
        ("even-stiffness", {"k2": 2e6}, lambda x: 2e6 * x**3 / 3),
    ],
)
def test_polynomial_stiffness_keeps_its_energy(name, values, potential):
    x, v = free(oscillator().with_effect(at(name, **values)), 1e-3, 0.3)
    energy = 0.5 * v**2 + 0.5 * STIFFNESS * x**2 + potential(x)
    assert energy == pytest.approx(energy[0], rel=1e-5)


@pytest.mark.parametrize("name", ["cubic-stiffness", "quintic-stiffness", "even-stiffness"])
def test_negative_stiffness_leaves_a_tenth_of_the_links_own(name):
    member = CATALOGUE[name]
    (strength,) = member.strengths
    effect = at(name, "joint", **{strength: member.parameters[strength].bounds[0]})
    for x in (1e-3, 1e-2, 1.0):
        assert compiled(effect, 0, x, 0, 100, 9e5, 1)[0] == pytest.approx(-0.9 * 9e5 * x)


def test_quadratic_and_displacement_damping_take_their_share_of_a_cycle():
    amplitude, w = 1e-4, 2 * np.pi * 16
    taken = area(*loop("quadratic-damping", amplitude, 16.0, c2=2e3))
    assert taken == pytest.approx(8 / 3 * 2e3 * w**2 * amplitude**3, rel=1e-5)
    taken = area(*loop("displacement-damping", amplitude, 16.0, c_x=2e6))
    assert taken == pytest.approx(4 / 3 * 2e6 * w * amplitude**3, rel=1e-5)


@pytest.mark.parametrize("frequency", [0.2, 16.0, 400.0])
def test_maxwell_is_a_dashpot_when_slow_and_a_spring_when_fast(frequency):
    tau, spring, w = 4e-3, 0.1 * 9e5, 2 * np.pi * frequency
    x, v, force, _ = loop("maxwell-viscoelastic", 1e-4, frequency, cycles=20, kappa=0.1, tau=tau)
    complex_stiffness = spring * 1j * w * tau / (1 + 1j * w * tau)
    expected = complex_stiffness.real * x + complex_stiffness.imag / w * v
    assert force == pytest.approx(expected, rel=1e-3, abs=1e-3 * abs(force).max())
    slow, fast = (abs(force - limit).max() / abs(force).max() for limit in (spring * tau * v, spring * x))
    assert (slow < 0.12) == (frequency < 1)
    assert (fast < 0.12) == (frequency > 100)


@pytest.mark.parametrize("reach", [1.2, 2.0, 4.8])  # amplitude over the path at which it slips
@pytest.mark.parametrize("name", ["jenkins-slip", "elastic-slip"])
def test_a_slider_takes_four_limits_times_the_slipped_path_of_a_cycle(name, reach):
    """One that came to slip over a tenth of its limit took 2 % more just beyond it, 0.5 % less farther on."""
    spring, limit = 7.2e5, 15.0
    amplitude = reach * limit / spring
    numbers = {"jenkins-slip": {"kappa": spring / 9e5}, "elastic-slip": {"k_t": spring}}
    taken = area(*loop(name, amplitude, 16.0, F_s=limit, mu=0.0, **numbers[name]))
    assert taken == pytest.approx(4 * limit * (amplitude - limit / spring), rel=1e-3)


def test_a_slider_that_sticks_does_nothing():
    _, _, force, _ = loop("jenkins-slip", 1e-5, 16.0, kappa=0.8, mu=0.3)
    assert not force.any()


def test_the_loop_of_a_slider_does_not_depend_on_the_rate():
    slow, fast = (area(*loop("jenkins-slip", 1e-4, f, kappa=0.8, mu=0.1)) for f in (2.0, 60.0))
    assert slow == pytest.approx(fast, rel=1e-3)


def test_iwan_has_its_stiffness_its_limit_and_its_power_of_dissipation():
    values = {"kappa": 0.8, "mu": 0.1, "F_s": 0.0, "chi": -0.5, "beta": 0.5}
    limit, spring = 0.1 * 150.0, 0.8 * 9e5
    x, _, force, _ = loop("iwan-slip", 1e-3, 16.0, **values)
    assert max(force + spring * x) == pytest.approx(limit, rel=0.02)
    taken = [area(*loop("iwan-slip", amplitude, 16.0, **values)) for amplitude in (1.6e-6, 2.56e-5)]
    slope = np.log(taken[1] / taken[0]) / np.log(16)  # W goes with amplitude^(3 + chi) within microslip
    assert slope == pytest.approx(2.5, abs=0.25)


def pulled(name: str, velocity: float, seconds: float, k=9e5, T=150.0, **values):
    """Displacement and force of an effect that is pulled at a constant velocity from rest."""
    t = np.linspace(0, seconds, 8001)
    effect = at(name, "joint", **values)
    path = t, velocity * t, np.full_like(t, velocity), t[2]
    return path[1][::2], driven(effect.function, list(effect.values), effect.states, path, T=T, k=k)


@pytest.mark.parametrize("velocity", [-2e-3, 5e-3, 4e-2])
def test_lugre_slides_along_its_stribeck_curve(velocity):
    values = {"kappa": 0.5, "mu": 0.1, "rise": 0.4, "v_s": 5e-3, "sigma": 30.0}
    x, force = pulled("lugre", velocity, 8e-4 / abs(velocity), **values)
    friction = 0.1 * 150.0 * (1 + 0.4 * np.exp(-((velocity / 5e-3) ** 2)))
    assert force[-1] + 0.5 * 9e5 * x[-1] == pytest.approx(np.sign(velocity) * friction, rel=1e-4)


def test_valanis_goes_from_its_spring_to_its_tangent():
    x, force = pulled("valanis", 0.05, 0.02, kappa=0.4, tangent=0.6, curve=0.6, steepness=3e4)
    slope = np.diff(force) / np.diff(x) / (0.4 * 9e5)
    assert slope[0] == pytest.approx(0.0, abs=0.01)
    assert slope[-1] == pytest.approx(-(1 - 0.6), rel=1e-3)


def test_bouc_wen_yields_at_its_yield_displacement():
    x, _, force, _ = loop("bouc-wen", 1e-3, 16.0, kappa=0.3, x_y=6e-5, n=2.0, beta=0.5)
    spring = 0.3 * 9e5
    assert force + spring * x == pytest.approx(np.clip(force + spring * x, -spring * 6e-5, spring * 6e-5))
    assert max(force + spring * x) == pytest.approx(spring * 6e-5, rel=1e-3)
    _, _, small, _ = loop("bouc-wen", 1e-7, 16.0, kappa=0.3, x_y=6e-5, n=2.0, beta=0.5)
    assert abs(small).max() < 1e-4 * spring * 1e-7


@pytest.mark.parametrize("beta", [1.0, 1.5, 2.375, 3.5])
def test_bouc_wen_bends_by_beta_less_two_on_the_way_out_and_by_beta_on_the_way_back(beta):
    """With n = 1 dz/dx is 1 + (beta - 2) z / x_y where z grows and 1 + beta z / x_y where it falls."""
    effect, spring, x_y = CATALOGUE["bouc-wen"].at("joint"), 0.3 * 9e5, 2e-4
    t = np.linspace(0, 0.125, 8001)
    path = t, 1e-4 * np.sin(32 * np.pi * t), 32e-4 * np.pi * np.cos(32 * np.pi * t), t[2]
    x, force = path[1][::2], driven(effect.function, [0.3, x_y, 1.0, beta], effect.states, path)
    z = force / spring + x
    step, between = np.diff(x), (z[1:] + z[:-1]) / 2
    bend = np.where(between * step > 0, beta - 2, beta) * np.abs(between) / x_y
    steady = np.abs(step) > 0.1 * np.abs(step).max()  # away from where the motion turns
    assert (np.diff(z) / step)[steady] == pytest.approx(1 + bend[steady], rel=1e-3)


def test_microslip_softening_ends_at_its_share_of_the_stiffness():
    effect = at("microslip-softening", "joint", alpha=0.3, x_s=5e-5, q=2.0)
    assert compiled(effect, 0, 1e-8, 0, 100, 9e5, 1)[0] == pytest.approx(0, abs=1e-6 * 9e5 * 1e-8)
    assert compiled(effect, 0, 5e-5, 0, 100, 9e5, 1)[0] == pytest.approx(-0.15 * 9e5 * 5e-5)
    assert compiled(effect, 0, 1.0, 0, 100, 9e5, 1)[0] == pytest.approx(-0.3 * 9e5, rel=1e-6)


def test_gaps_are_nothing_within_their_clearance_and_springs_beyond():
    two = at("two-sided-gap", "joint", k_g=1e6, delta=5e-5)
    one = at("one-sided-gap", "joint", k_g=1e6, delta=5e-5, side=-1.0)

    def force(effect, x):
        return compiled(effect, 0, x, 0, 100, 9e5, 1)[0]

    inside = 4.97e-5  # half the width of the rounded knee further in
    assert force(two, inside) == force(two, -inside) == force(one, -inside) == force(one, 1.0) == 0.0
    assert force(two, 2e-4) - force(two, 1e-4) == pytest.approx(100.0)
    assert force(two, -2e-4) == force(one, -2e-4) == -force(two, 2e-4)
    assert force(two, 2e-4) == pytest.approx(1e6 * 1.5e-4, rel=1e-9)  # the knee is rounded about its place
    edge = 5.5e-5  # force and slope are steady where the gap has closed
    assert force(two, edge + 1e-10) - force(two, edge - 1e-10) == pytest.approx(2e-4, rel=1e-3)


def test_support_and_contact_stiffness_have_their_limits():
    support = at("tension-dependent-stiffness", epsilon=0.2, T_g=100.0)
    assert compiled(support, 0, 1e-3, 0, 0.0, 1e4, 1)[0] == 0.0
    assert compiled(support, 0, 1e-3, 0, 1e5, 1e4, 1)[0] == pytest.approx(0.2 * 1e4 * 1e-3)
    contact = at("contact-stiffness", "joint", compliance=2e-7, n=0.5)
    for T in (4.0, 100.0, 2500.0):
        series = 1 / (1 / 9e5 + 2e-7 * (100 / T) ** 0.5)
        assert compiled(contact, 0, 1e-4, 0, T, 9e5, 1)[0] == pytest.approx((series - 9e5) * 1e-4)


def test_oscillating_tension_moves_the_stiffness_along_its_law():
    from rom.parameters.he_2025 import paper_model

    law = paper_model().link_laws["joint"].stiffness
    effect = at("oscillating-tension-stiffness", "joint", a=1e5, b=3e9)
    for x in (-8e-5, 5e-5):
        now = 12.0 + 1e5 * x + 3e9 * x**2
        expected = (float(law(now)) - float(law(12.0))) * x
        assert compiled(effect, 0, x, 0, 12.0, float(law(12.0)), 1)[0] == pytest.approx(expected)


def test_an_extra_mode_is_a_further_body_on_its_spring():
    m3, f3, zeta3 = 0.05, 120.0, 0.03
    w = 2 * np.pi * f3
    effect = at("extra-mode", "body:m", m3=m3, f3=f3, zeta3=zeta3)
    held = oscillator(damping=1.0)
    structure = Structure((Body("m", 1.0), Body("e", m3)), (*held.structure.links, Link("extra", "m", "e")))
    spring = LinkLaws(constant_stiffness(m3 * w**2), constant_damping(2 * zeta3 * w * m3))
    two = Model(structure, {**held.link_laws, "extra": spring})
    force = np.zeros(9600)
    force[10:25] = 300.0
    added = held.with_effect(effect).simulate({"m": force}, RATE, tolerance=1e-8)
    expected = two.simulate({"m": force}, RATE, tolerance=1e-8)
    x = expected.displacement["m"]
    assert added.displacement["m"] == pytest.approx(x, abs=1e-6 * abs(x).max())
    assert added.states[0] == pytest.approx(expected.displacement["e"], abs=1e-5 * abs(x).max())
    plain = held.simulate({"m": force}, RATE).displacement["m"]
    assert abs(plain - x).max() > 0.01 * abs(x).max()


def test_forces_of_the_surroundings_push_the_body():
    push = oscillator(damping=40.0).with_effect(at("constant-force", "body:m", F_0=2.0))
    response = push.simulate({"m": np.zeros(40000)}, RATE)
    assert response.displacement["m"][-1] == pytest.approx(2.0 / STIFFNESS, rel=1e-4)
    shaken = oscillator(damping=40.0).with_effect(at("ground-motion", "body:m", F_a=0.0, F_b=1.0, f=5.0))
    x = shaken.simulate({"m": np.zeros(40000)}, RATE).displacement["m"]
    w = 2 * np.pi * 5.0
    amplitude = 1 / abs(STIFFNESS - w**2 + 40j * w)
    assert x[-8000:].max() == pytest.approx(amplitude, rel=1e-3)
