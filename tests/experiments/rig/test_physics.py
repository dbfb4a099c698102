"""The virtual rig against closed forms, the paper's numbers and itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, linalg

from experiments.rig import simulation
from experiments.rig.equations import tension_rate
from experiments.rig.excitation import FLOOR_RATE_HZ, STEP_RATE_HZ, Hit, contact_time, floor_motion
from experiments.rig.plant import LooseningTerm, Plant
from experiments.rig.rivals import RIVALS
from experiments.rig.sensors import SENSITIVE
from experiments.rig.simulation import SETTLING_RATE_HZ, run

NOMINAL = Hit("lo", 1608.7, 0.0100003, contact_time(1608.7))  # edges between steps
HOLDING = replace(Plant(), loosening=())


def joint(tension: float) -> tuple[float, float]:
    stiffness = 9.763e5 / (1 + np.exp(-0.0608 * (tension - 2.003)))
    damping = 1853.0 - 1717.4 / (1 + np.exp(-0.00922 * tension))
    return stiffness, damping


def state_matrix(tension: float) -> np.ndarray:
    k, c = joint(tension)
    mass = np.diag([8.625, 0.9888])
    stiffness = np.array([[8148.7 * 1.1 + k, -k], [-k, 76500 * 1.2 + k]])
    damping = np.array([[8.2 + c, -c], [-c, 2.696 + c]])
    bottom = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), bottom])


# --- physics ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tension", [6.0, 60.0, 3000.0])
def test_free_motion_is_the_matrix_exponential(tension: float) -> None:
    motion = run(HOLDING, NOMINAL, tension, 0.5)
    states = np.array(
        [motion.displacement_lo, motion.displacement_so, motion.velocity_lo, motion.velocity_so]
    )
    first, steps = 1000, 30_000  # from after the pulse
    expected = linalg.expm(state_matrix(tension) * steps / STEP_RATE_HZ) @ states[:, first]
    assert states[:, first + steps] == pytest.approx(expected, rel=1e-7)


def test_first_mode_rings_at_the_papers_frequency() -> None:
    motion = run(HOLDING, NOMINAL, 3000.0, 3.0)
    late = motion.displacement_lo[round(0.2 * STEP_RATE_HZ) :]
    crossings = np.flatnonzero(np.diff(np.signbit(late)))
    frequency = 0.5 * STEP_RATE_HZ / np.mean(np.diff(crossings))
    assert frequency == pytest.approx(15.77, abs=0.02)  # Section 3.2, plateau
    slow = linalg.eigvals(state_matrix(3000.0))
    assert frequency == pytest.approx(np.min(np.abs(slow.imag)) / (2 * np.pi), rel=1e-4)


def test_the_hit_hands_over_its_impulse() -> None:
    free = replace(Plant(), stiffness_lo=0.0, stiffness_so=0.0, damping_lo=0.0, damping_so=0.0)
    for body in ("lo", "so"):
        motion = run(free, replace(NOMINAL, body=body), 300.0, 0.05)
        momentum = 8.625 * motion.velocity_lo[-1] + 0.9888 * motion.velocity_so[-1]
        assert momentum == pytest.approx(2 / np.pi * NOMINAL.strength * NOMINAL.duration, rel=1e-7)


def test_energy_only_falls_after_the_hit_and_by_what_the_dampers_take() -> None:
    motion = run(HOLDING, NOMINAL, 60.0, 1.0)
    x, y, v, w = motion.displacement_lo, motion.displacement_so, motion.velocity_lo, motion.velocity_so
    k, c = joint(60.0)
    kinetic = 8.625 * v**2 + 0.9888 * w**2
    energy = 0.5 * (kinetic + 8148.7 * 1.1 * x**2 + 76500 * 1.2 * y**2 + k * (x - y) ** 2)[2000:]
    power = (8.2 * v**2 + 2.696 * w**2 + c * (v - w) ** 2)[2000:]
    assert np.all(np.diff(energy) < 0.0)
    taken = integrate.trapezoid(power, dx=1 / STEP_RATE_HZ)
    assert energy[0] - energy[-1] == pytest.approx(taken, rel=1e-6)


def test_halving_the_step_leaves_the_loss() -> None:
    for tension in (6.4, 61.3, 700.2):
        coarse, fine = (
            tension - run(Plant(), NOMINAL, tension, 0.6, step_rate_hz=rate).tension[-1]
            for rate in (STEP_RATE_HZ, 2 * STEP_RATE_HZ)
        )
        assert coarse == pytest.approx(fine, rel=1e-6)


def paper_model(strength: float, tension: float) -> float:
    """Loss by an adaptive integrator of another kind, restarted at the end of the pulse."""
    duration = contact_time(strength)

    def slope(t: float, s: np.ndarray) -> list[float]:
        k, c = joint(s[4])
        force = strength * np.sin(np.pi * t / duration) if t < duration else 0.0
        link = k * (s[0] - s[2]) + c * (s[1] - s[3])
        gamma = 10 ** (11.79 - 7.974 / (1 + np.exp(-0.00362 * s[4])))
        on_lo = force - link - 8963.57 * s[0] - 8.2 * s[1]
        on_so = link - 91800.0 * s[2] - 2.696 * s[3]
        return [s[1], on_lo / 8.625, s[3], on_so / 0.9888, -gamma * (s[1] - s[3]) ** 4 * s[4]]

    state = np.array([0.0, 0.0, 0.0, 0.0, tension])
    for span in ((0.0, duration), (duration, 0.5)):
        state = integrate.solve_ivp(slope, span, state, method="DOP853", rtol=1e-10, atol=1e-14).y[:, -1]
    return float(tension - state[4])


@pytest.mark.parametrize(
    ("tension", "strength"), [(6.4, 1608.7), (152.7, 1608.7), (2999.3, 1608.7), (21.5, 965.0)]
)
def test_losses_are_those_of_another_integrator(tension: float, strength: float) -> None:
    hit = Hit("lo", strength, NOMINAL.start, contact_time(strength))
    loss = tension - run(Plant(), hit, tension, 0.51).tension[-1]
    assert loss == pytest.approx(paper_model(strength, tension), rel=1e-6)


CHECKED = {6.4: 1.36, 21.5: 3.55, 61.3: 6.30, 152.7: 6.38, 317.0: 3.08, 700.2: 0.52, 2999.3: 0.59}


@pytest.mark.parametrize(("tension", "loss"), CHECKED.items())
def test_losses_of_the_nominal_pulse(tension: float, loss: float) -> None:
    # A loss goes with the fourth power of the impulse: 1 % of impulse is the 4 % by which they all differ.
    assert tension - run(Plant(), NOMINAL, tension, 1.0).tension[-1] == pytest.approx(loss, rel=0.055)


@pytest.mark.parametrize(("tension", "strength", "loss"), [(5.9, 26.9, 5.1e-7), (3013.2, 29.1, 3.6e-7)])
def test_low_hits_leave_the_tension_alone(tension: float, strength: float, loss: float) -> None:
    hit = Hit("lo", strength, 0.01, contact_time(strength))
    motion = run(Plant(), hit, tension, 1.0)
    assert tension - motion.tension[-1] == pytest.approx(loss, rel=0.055)
    assert np.max(np.abs(motion.displacement_lo)) == pytest.approx(0.020e-3, rel=0.05)


def test_pulse_length_follows_strength() -> None:
    assert contact_time(28.0) == pytest.approx(1.05e-3)
    assert contact_time(1600.0) == pytest.approx(0.65e-3, rel=0.005)


@pytest.mark.parametrize(
    ("term", "expected"),
    [
        (LooseningTerm(), 10 ** (11.79 - 7.974 / (1 + np.exp(-0.362))) * 0.05**4),
        (LooseningTerm(3.0, 0.0, velocity_power=2.0), 1e3 * 0.05**2),
        (LooseningTerm(5.0, 0.0, velocity_power=0.0, displacement_power=1.5), 1e5 * 4e-5**1.5),
        (LooseningTerm(6.0, 0.0, velocity_power=3.0, velocity_threshold=0.02), 1e6 * 0.03**3),
        (LooseningTerm(6.0, 0.0, velocity_threshold=0.06), 0.0),
        (LooseningTerm(6.0, 0.0, velocity_power=1, displacement_power=1, displacement_threshold=1e-5), 1.5),
        (LooseningTerm(1.0, 0.0, velocity_power=0.0, dissipation_power=1.0), 10 * 40 * 0.05),
    ],
)
def test_tension_laws(term: LooseningTerm, expected: float) -> None:
    for x, v in ((4e-5, 0.05), (-4e-5, -0.05)):
        found = tension_rate(x, v, 100.0, (term.row(1.0),), 40 * abs(v))
        assert found == pytest.approx(-100.0 * expected, rel=1e-12)
    twice = tension_rate(4e-5, 0.05, 100.0, (term.row(1.0), term.row(-0.5)), 40 * 0.05)
    assert twice == pytest.approx(-50.0 * expected, rel=1e-12)


@pytest.mark.parametrize("name", RIVALS)
def test_rival_laws_lose_the_same_once_and_otherwise_elsewhere(name: str) -> None:
    def loss(loosening: tuple[LooseningTerm, ...], tension: float, strength: float) -> float:
        hit = Hit("lo", strength, NOMINAL.start, NOMINAL.duration)
        return float(tension - run(Plant(loosening=loosening), hit, tension, 3.0).tension[-1])

    paper, rival = Plant().loosening, RIVALS[name]
    assert loss(rival, 150.0, 1608.7) == pytest.approx(loss(paper, 150.0, 1608.7), rel=0.04)
    elsewhere = [(150.0, 800.0), (20.0, 1608.7)]
    ratios = [loss(rival, *test) / loss(paper, *test) for test in elsewhere]
    assert max(abs(np.log(ratio)) for ratio in ratios) > 0.1


def test_negative_gamma_tightens_and_no_term_holds() -> None:
    assert run(Plant(), NOMINAL, 300.0, 0.2, gamma_factor=-1.0).tension[-1] > 301.0
    assert np.all(run(HOLDING, NOMINAL, 300.0, 0.2).tension == 300.0)


def test_the_floor_moves_in_its_band_and_the_structure_with_it() -> None:
    displacement, velocity = floor_motion(3e-7, -12.0, 30.0, np.random.default_rng(1))
    assert np.std(displacement) == pytest.approx(3e-7, rel=0.5)
    spectrum = np.abs(np.fft.rfft(displacement))
    frequency = np.fft.rfftfreq(displacement.size, 1 / FLOOR_RATE_HZ)
    outside = (frequency < 1.99) | (frequency > 30.01)
    assert np.max(spectrum[outside]) < 1e-9 * np.max(spectrum)
    assert np.gradient(displacement, 1 / FLOOR_RATE_HZ)[1:-1] == pytest.approx(velocity[1:-1], abs=1e-6)
    motion = run(
        HOLDING, replace(NOMINAL, strength=0.0), 300.0, 8.0, floor_rms=3e-7, rng=np.random.default_rng(2)
    )
    assert (
        0.2e-6 < np.std(motion.displacement_lo[: round(2.0 * STEP_RATE_HZ)]) < 1.2e-6
    )  # settled from the first sample
    assert 0.03 < np.max(np.abs(motion.displacement_lo)) / 0.020e-3 < 0.10


@pytest.mark.parametrize("tension", [6.0, 3000.0])
def test_finer_settling_is_not_to_be_seen_by_a_converter(
    tension: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    for finer in (1, 4):
        monkeypatch.setattr(simulation, "SETTLING_RATE_HZ", finer * SETTLING_RATE_HZ)
        rng = np.random.default_rng(1)
        found.append(run(Plant(), NOMINAL, tension, 0.009, floor_rms=3e-7, rng=rng).acceleration_so)
    assert np.max(np.abs(found[0])) > 1e-4
    assert np.max(np.abs(found[0] - found[1])) < 0.01 * SENSITIVE.step
