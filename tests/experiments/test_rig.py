"""The virtual rig against closed forms, the paper's numbers and itself."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from scipy import integrate, linalg

from experiments.rig import schedule, sensors
from experiments.rig.equations import tension_rate
from experiments.rig.excitation import FLOOR_RATE_HZ, Hit, contact_time, floor_motion
from experiments.rig.plant import LooseningTerm, Plant
from experiments.rig.rivals import RIVALS
from experiments.rig.simulation import STEP_RATE_HZ, Contribution, run
from experiments.studies import rig
from rom.campaign import read_campaign

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
    ],
)
def test_tension_laws(term: LooseningTerm, expected: float) -> None:
    for x, v in ((4e-5, 0.05), (-4e-5, -0.05)):
        assert tension_rate(x, v, 100.0, (term.row(1.0),)) == pytest.approx(-100.0 * expected, rel=1e-12)
    twice = tension_rate(4e-5, 0.05, 100.0, (term.row(1.0), term.row(-0.5)))
    assert twice == pytest.approx(-50.0 * expected, rel=1e-12)


@pytest.mark.parametrize("name", RIVALS)
def test_rival_laws_lose_the_same_once_and_otherwise_elsewhere(name: str) -> None:
    def loss(loosening: tuple[LooseningTerm, ...], tension: float, strength: float) -> float:
        hit = Hit("lo", strength, NOMINAL.start, NOMINAL.duration)
        return float(tension - run(Plant(loosening=loosening), hit, tension, 3.0).tension[-1])

    paper, rival = Plant().loosening, RIVALS[name]
    assert loss(rival, 150.0, 1608.7) == pytest.approx(loss(paper, 150.0, 1608.7), rel=0.03)
    elsewhere = [(150.0, 800.0), (20.0, 1608.7)]
    ratios = [loss(rival, *test) / loss(paper, *test) for test in elsewhere]
    assert max(abs(np.log(ratio)) for ratio in ratios) > 0.1


def test_negative_gamma_tightens_and_no_term_holds() -> None:
    assert run(Plant(), NOMINAL, 300.0, 0.2, gamma_factor=-1.0).tension[-1] > 301.0
    assert np.all(run(HOLDING, NOMINAL, 300.0, 0.2).tension == 300.0)


@njit
def dashpot(_time, _x_lo, v_lo, _x_so, v_so, _tension, parameters):  # type: ignore[no-untyped-def]
    return -parameters[0] * v_lo, -parameters[1] * v_so, 0.0


@njit
def leak(_time, _x_lo, _v_lo, _x_so, _v_so, tension, parameters):  # type: ignore[no-untyped-def]
    return 0.0, 0.0, -parameters[0] * tension


@dataclass(frozen=True)
class Toy:
    name: str
    contribution: Contribution
    parameters: tuple[float, ...]


def test_effects_add_to_forces_and_tension_rate() -> None:
    added = run(
        replace(HOLDING, effects=(Toy("dashpots", dashpot, (1.8, 1.304)), Toy("leak", leak, (0.5,)))),
        replace(NOMINAL, strength=28.0),
        3000.0,
        0.3,
    )
    assert added.tension[-1] == pytest.approx(3000.0 * np.exp(-0.15), rel=1e-9)
    plain = run(
        replace(HOLDING, damping_lo=10.0, damping_so=4.0), replace(NOMINAL, strength=28.0), 3000.0, 0.3
    )
    assert added.displacement_lo == pytest.approx(plain.displacement_lo, abs=1e-9)
    assert np.max(np.abs(plain.displacement_lo - run(HOLDING, NOMINAL, 3000.0, 0.3).displacement_lo)) > 1e-7


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
    assert 0.2e-6 < np.std(motion.displacement_lo[:STEP_START]) < 1.2e-6  # settled from the first sample
    assert 0.03 < np.max(np.abs(motion.displacement_lo)) / 0.020e-3 < 0.10


STEP_START = round(2.0 * STEP_RATE_HZ)

# --- sensors ------------------------------------------------------------------------------------------------


def test_readings_have_the_stated_noise_and_steps() -> None:
    sensor = sensors.Instruments().strain
    reading = sensor.read(np.full(200_000, 0.7), np.random.default_rng(3))
    assert np.std(reading) == pytest.approx(3e-4, rel=0.01)
    counts = reading / (16.0 / 2**24)
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    assert np.ptp(np.round(counts)) > 1000  # the noise, not the step, limits
    quiet = sensor.scaled(0.0)
    assert np.all(quiet.read(np.full(10, 0.7), np.random.default_rng(3)) == 0.7)
    assert np.max(sensor.read(np.full(10, 9.0), np.random.default_rng(3))) == 8.0


def test_ac_coupling_has_its_corner_and_forgets_a_step() -> None:
    time = np.arange(round(20 * STEP_RATE_HZ)) / STEP_RATE_HZ
    corner = 1 / (2 * np.pi * 1.5)
    passed = sensors.couple(np.sin(2 * np.pi * corner * time), 1.5)
    whole = time > 20 - 1 / corner
    assert np.sqrt(2) * np.std(passed[whole]) == pytest.approx(np.sqrt(0.5), rel=1e-3)
    step = sensors.couple((time >= 1.0).astype(float), 1.5)
    assert step[np.searchsorted(time, 2.5)] == pytest.approx(np.exp(-1.0), rel=1e-4)
    assert sensors.couple(time, None) is time


@pytest.mark.parametrize("rate", [19_200.0, 4_800.0])
def test_anti_alias_passes_the_band_and_stops_what_would_fold(rate: float) -> None:
    lead = sensors.reach(rate) + 0.001
    start = -round(lead * STEP_RATE_HZ) / STEP_RATE_HZ
    analog = start + np.arange(round((0.5 - 2 * start) * STEP_RATE_HZ) + 1) / STEP_RATE_HZ
    time = np.arange(round(0.5 * rate)) / rate
    low = sensors.sample(np.sin(2 * np.pi * 0.3 * rate * analog), start, rate, 0.5)
    assert low == pytest.approx(np.sin(2 * np.pi * 0.3 * rate * time), abs=1e-3)  # no delay, no loss
    assert np.max(np.abs(sensors.sample(np.sin(2 * np.pi * 0.65 * rate * analog), start, rate, 0.5))) < 2e-4
    assert sensors.sample(np.ones_like(analog), start, rate, 0.5) == pytest.approx(1.0, abs=1e-12)


def test_strain_is_equation_1_backwards() -> None:
    tension = np.array([-1.0, 0.0, 5.8, 300.0, 3100.0])
    e = sensors.strain_of(tension)
    assert 2718.7 * e + 2363.7 * e**2 - 575.63 * e**3 == pytest.approx(tension, abs=1e-9)


def test_drift_leaves_a_loss_at_3000_newton_measurable() -> None:
    time = np.linspace(0.0, 8.5, 500)
    change = [
        np.diff(sensors.drift(sensors.Instruments(), time, np.random.default_rng(s))[[0, -1]])
        for s in range(50)
    ]
    assert 0.005 < np.std(change) < 0.06  # a tenth of the 0.59 N lost there


# --- schedule -----------------------------------------------------------------------------------------------


def planned(cases: int | None = None, **changes: object) -> tuple[schedule.Case, ...]:
    options = {
        "strengths": (1.0,),
        "scatter": 1.0,
        "tightening": cases is None,
        "hold_out_every": 5,
    } | changes
    return schedule.plan(cases, seed=np.random.SeedSequence(4), **options)  # type: ignore[arg-type]


def test_full_scale_is_the_papers() -> None:
    cases = planned()
    tests = [case.test for case in cases]
    assert [tests.count(test) for test in ("uncoupled", "coupled", "loosening")] == [2, 58, 84]
    tightened = [case for case in cases if case.gamma_factor < 0.0]
    assert len(tightened) == 26
    assert max(case.tension for case in tightened) < 1110.0
    preloads = np.array([case.preload for case in cases if case.test == "coupled"])
    assert (preloads[0], preloads[-1]) == (5.8, 3013.0)
    assert np.all(np.diff(preloads) > 0.0)
    high = np.array([case.hit.strength for case in cases if case.test == "loosening"])
    assert np.mean(high) == pytest.approx(1608.7, abs=4 * 81.65 / np.sqrt(84))
    assert np.std(high) == pytest.approx(81.65, rel=0.3)
    assert all(20.0 <= case.hit.strength <= 45.0 for case in cases if case.test != "loosening")
    assert len({case.file for case in cases}) == 144


def test_options_change_what_they_name_only() -> None:
    plain, calm = planned(20), planned(20, scatter=0.0)
    assert len(plain) == 42
    assert {case.gamma_factor for case in calm} == {1.0}
    assert [case.hit for case in plain] == [case.hit for case in calm]
    three = planned(5, strengths=(1.0, 0.8, 0.6))
    hits = [case.hit.strength for case in three if case.test == "loosening"]
    assert len(hits) == 15
    assert np.mean(hits[2::3]) == pytest.approx(0.6 * 1608.7, rel=0.1)


def test_hold_out_spares_the_extremes_and_keeps_a_preload_together() -> None:
    for count in (None, 20, 7):
        cases = [case for case in planned(count) if case.preload is not None]
        held = {case.preload for case in cases if case.hold_out}
        assert held
        assert not held & {cases[0].preload, cases[-1].preload}
        assert not held & {case.preload for case in cases if not case.hold_out}
    assert not any(case.hold_out for case in planned(20, hold_out_every=0))


def test_scatter_shrinks_with_preload() -> None:
    rng = np.random.default_rng(5)
    spread = [
        np.std(np.log10([schedule.gamma_factor(t, 1.0, rng) for _ in range(500)])) for t in (50, 800, 2000)
    ]
    assert spread[0] > 1.3 * spread[1] > 4 * spread[2] > 0.0


# --- campaigns ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rig.run(tmp_path_factory.mktemp("rig") / "small", cases=2, seed=7, jobs=2, duration_s=3.0)


def test_same_seed_same_bytes_for_any_jobs(small: Path, tmp_path: Path) -> None:
    other = rig.run(tmp_path / "small", cases=2, seed=7, jobs=1, duration_s=3.0)
    files = sorted(path.relative_to(small) for path in small.rglob("*") if path.is_file())
    assert len(files) == 7
    for file in files:
        assert (small / file).read_bytes() == (other / file).read_bytes(), file
    assert rig.truth_path(small).read_bytes() == rig.truth_path(other).read_bytes()
    third = rig.run(tmp_path / "third", cases=2, seed=8, duration_s=3.0)
    assert (third / files[1]).read_bytes() != (small / files[1]).read_bytes()


def test_the_campaign_reads_and_measures_what_happened(small: Path) -> None:
    campaign = read_campaign(small)
    truth = {record["file"]: record for record in json.loads(rig.truth_path(small).read_text())["records"]}
    assert set(truth) == {record.file for record in campaign.settings.record}
    for settings in campaign.select("loosening"):
        record = campaign.load(settings)
        assert record.channels["force_lo"].samples.max() == pytest.approx(
            truth[record.file]["hit"]["strength"], rel=0.01
        )
        e = record.channels["strain"].samples
        tension = 2718.7 * e + 2363.7 * e**2 - 575.63 * e**3
        assert np.mean(tension[:1920]) == pytest.approx(truth[record.file]["initial_tension_n"], abs=0.15)
        assert np.mean(tension[9600:]) == pytest.approx(truth[record.file]["final_tension_n"], abs=0.15)


def test_pre_trigger_shows_each_chains_noise(small: Path) -> None:
    campaign = read_campaign(small)
    for test, acceleration in (("coupled", 0.003), ("loosening", 0.05)):
        channels = campaign.load(campaign.select(test)[-1]).channels
        for name, expected in (("acceleration_lo", acceleration), ("force_lo", 0.05), ("strain", 3e-4)):
            steps = np.diff(
                channels[name].samples[: round(0.4 * channels[name].rate_hz)]
            )  # sheds slow motion
            assert np.std(steps) / np.sqrt(2) == pytest.approx(expected, rel=0.06), name


def test_the_truth_is_beside_the_folder_and_never_in_it(small: Path) -> None:
    assert rig.truth_path(small).parent == small.parent
    names = {path.name for path in small.rglob("*")}
    assert not any("truth" in name for name in names)
    declared = (small / "campaign.toml").read_text()
    assert "gamma" not in declared
    assert "9.763" not in declared
    truth = json.loads(rig.truth_path(small).read_text())
    assert truth["plant"]["damping_so"] == 2.696
    assert truth["plant"]["loosening"][0]["velocity_power"] == 4.0
    assert not list(small.parent.glob("*.tmp"))


def test_without_noise_only_the_instrument_remains(tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    folder = rig.run(
        tmp_path / "quiet",
        cases=2,
        noise=0.0,
        scatter=0.0,
        duration_s=2.5,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert steps == [(done, 6) for done in range(1, 7)]
    campaign = read_campaign(folder)
    channels = campaign.load(campaign.select("loosening")[0]).channels
    assert np.max(np.abs(channels["acceleration_lo"].samples[:9000])) < 1e-9
    assert np.ptp(channels["strain"].samples[:2000]) < 1e-12
    impulse = channels["force_lo"].samples.sum() / 19_200
    hit = json.loads(rig.truth_path(folder).read_text())["records"][3]["hit"]
    assert impulse == pytest.approx(2 / np.pi * hit["strength"] * hit["duration"], rel=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cases": 1}, "cases"),
        ({"noise": -1.0}, "noise"),
        ({"duration_s": 1.0}, "duration_s"),
        ({"jobs": 0}, "jobs"),
    ],
)
def test_refuses_what_cannot_be(tmp_path: Path, options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rig.run(tmp_path / "new", **options)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_refuses_an_existing_folder_before_computing(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()

    def called(done: int, total: int) -> None:
        raise AssertionError(f"computed {done} of {total}")

    with pytest.raises(ValueError, match="exists already"):
        rig.run(tmp_path / "there", cases=2, progress=called)
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
