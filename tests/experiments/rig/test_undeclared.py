"""Undeclared physics of the rig against the catalogue, closed forms and itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg

from experiments.rig.equations import changed_rate
from experiments.rig.excitation import STEP_RATE_HZ, Hit, contact_time
from experiments.rig.plant import LooseningTerm, Plant
from experiments.rig.readings import Seen
from experiments.rig.simulation import SETTLING_RATE_HZ, run, table
from experiments.rig.strength import drawn
from experiments.rig.undeclared import KINDS, Undeclared, undeclared_from_text
from rom.effects import CATALOGUE, Motion
from rom.effects.member import OF_CHANNEL
from rom.model.model import Model
from rom.parameters.he_2025 import paper_model

NOMINAL = Hit("lo", 1608.7, 0.0100003, contact_time(1608.7))
HOLDING = replace(Plant(), loosening=())
SHARED = [name for name in KINDS if name in CATALOGUE]
ELASTIC_STATE = (
    "bouc-wen",
    "lugre",
    "valanis",
)  # the rig's state is what is left of x, the model's what slipped

UNFELT = ("constant-force", "loosening-slip-gate")  # by a relative motion; by a joint that slips all the time


def acting(*acts: str) -> list[str]:
    return [name for name in SHARED if KINDS[name].acts in acts]


def random_numbers(name: str, place: str, rng: np.random.Generator) -> dict[str, float]:
    numbers, strengths = KINDS[name].numbers_at(place), KINDS[name].strengths
    return {
        key: rng.uniform(0.3, 1.0) * number.value if key in strengths else drawn(number, rng)
        for key, number in numbers.items()
    }


# --- the catalogue ------------------------------------------------------------------------------------------


def test_the_whole_core_of_the_catalogue_can_be_undeclared_and_a_dozen_outside_it() -> None:
    assert {name for name, member in CATALOGUE.items() if member.core} <= set(KINDS)
    outside = [name for name, kind in KINDS.items() if kind.outside]
    assert len(outside) >= 12
    assert not set(outside) & set(CATALOGUE)
    assert set(KINDS) == set(SHARED) | set(outside)


@pytest.mark.parametrize("name", SHARED)
def test_names_units_and_strengths_are_the_catalogues(name: str) -> None:
    kind, member = KINDS[name], CATALOGUE[name]
    assert list(kind.numbers) == list(member.parameters)
    assert set(kind.strengths) == set(member.strengths)
    assert set(kind.places) == set(member.places)
    for place in kind.allowed:
        for key, number in kind.numbers_at(place).items():
            if member.parameters[key].unit != OF_CHANNEL:
                assert number.unit == member.parameters[key].unit
            bounds = (member.ground if "flexure" in place else {}).get(key, member.parameters[key]).bounds
            assert bounds[0] <= number.low <= number.high <= bounds[1]


@pytest.mark.parametrize("name", acting("force"))
def test_forces_are_the_catalogues(name: str) -> None:
    """Where the model is smooth and the rig sharp, away from the edge or to within its width."""
    kind, rng = KINDS[name], np.random.default_rng(8)
    k = 9e5
    for _ in range(300):
        p = random_numbers(name, kind.usual, rng)
        x, v, T = rng.normal(0.0, 6e-5), rng.normal(0.0, 0.03), rng.uniform(5.0, 1000.0)
        own = rng.normal(0.0, 3e-5, 2)
        if name == "jenkins-slip":  # below a limit that has fallen each gives way at a rate of its own
            limit = (p["F_s"] + p["mu"] * T) / (p["kappa"] * k)
            own[0] = x - np.clip(x - own[0], -(1 + 1e-9) * limit, (1 + 1e-9) * limit)
        theirs, ours = np.zeros(2), np.zeros(2)
        values = tuple(p.values())
        expected = CATALOGUE[name].function(0.3, x, v, T, k, 1e3, own, values, theirs, np.zeros(1))
        state = x - own if name in ELASTIC_STATE else own
        force = kind.function(0.3, x, v, T, k, state, values, ours)
        edge = 0.05 * p["delta"] * p["k_g"] if "gap" in name else 0.0
        assert force == pytest.approx(expected, rel=1e-9, abs=1e-9 + 1.0001 * edge)
        if name in ELASTIC_STATE:
            ours = v - ours
        far = name != "jenkins-slip" or not 0.9 < abs(x - own[0]) / limit < 1.0
        if far and kind.states:
            assert ours[: kind.states] == pytest.approx(theirs[: kind.states], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", acting("rate"))
def test_rates_are_the_catalogues(name: str) -> None:
    rng = np.random.default_rng(9)
    law = paper_model().link_laws["joint"].tension_rate
    assert law is not None
    for _ in range(100):
        p = random_numbers(name, "tension", rng)
        changed = CATALOGUE[name].at("tension").with_values(**p).changed(law)
        x, v, T = rng.normal(0.0, 6e-5), rng.normal(0.0, 0.03), rng.uniform(5.0, 1000.0)
        D = 1500.0 * v
        F = 8e5 * x + D
        if name == "loosening-slip-gate" and 0.15 < abs(F) / (p["mu_t"] * T) < 8.0:
            continue
        terms = (LooseningTerm().row(1.0),)
        added, _ = table((Undeclared(name, parameters=p),), terms)
        base = float(law.rate(T, x, v, F, D))
        rate = changed_rate(base, T, (x, v, 0.0, F, D), terms, added)
        assert rate == pytest.approx(
            float(changed.rate(T, x, v, F, D)), rel=1e-6, abs=1e-6 * abs(base) + 1e-9
        )


@pytest.mark.parametrize("name", acting("force", "rate"))
def test_the_model_with_the_effect_moves_as_the_rig_with_it(name: str) -> None:
    """Signs, places and states: two integrators that share nothing, at a low tension."""
    tension, steps = 30.0, round(0.25 * STEP_RATE_HZ)
    force = NOMINAL.force(np.arange(steps) / STEP_RATE_HZ)

    def distance(effect: Undeclared, model: Model) -> tuple[float, float]:
        motion = run(replace(Plant(), effects=(effect,)), NOMINAL, tension, 0.25)
        response = model.simulate({"lo": force}, rate_hz=STEP_RATE_HZ, initial_tension=tension)
        ours = (motion.displacement_lo - motion.displacement_so)[:steps]
        theirs = response.displacement["lo"] - response.displacement["so"]
        lost, share = tension - motion.tension[steps - 1], np.asarray(response.tension)
        return float(np.std(ours - theirs) / np.std(theirs)), lost / float(share[0] - share[-1]) - 1.0

    for place in KINDS[name].allowed:
        if place.startswith("body") and name == "ground-motion":
            continue  # the rig has moved with it for long, the model starts at rest
        effect = Undeclared(name, place)
        member = CATALOGUE[name].at(place, ground="flexure" in place).with_values(**effect.parameters)
        motion, loss = distance(effect, member.added_to(paper_model()))
        without = distance(effect, paper_model())
        edge = 0.25 * without[0] if "gap" in name else 4e-3 if name == "jenkins-slip" else 0.0
        assert motion < 5e-4 + edge
        assert abs(loss) < 3e-3 + (0.01 if edge else 0.0)
        felt = without[0] > 2.0 * motion or abs(without[1]) > 3.0 * abs(loss)
        assert felt != (name in UNFELT)


@pytest.mark.parametrize("name", acting("reading"))
def test_signs_in_the_tension_are_the_catalogues(name: str) -> None:
    rng = np.random.default_rng(10)
    time = np.linspace(0.0, 3.0, 500)
    x, x_lo, force = (scale * rng.standard_normal(time.size) for scale in (1e-4, 1e-3, 50.0))
    seen = Seen(time, np.maximum(time - 0.5, 0.0), x, np.zeros_like(x), force, x_lo)
    p = random_numbers(name, "tension", rng)
    expected = CATALOGUE[name].at("tension").with_values(**p).added(Motion(time, 0.5, x, force, {"lo": x_lo}))
    assert KINDS[name].function(seen, tuple(p.values())) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", acting("fault"))
def test_faults_are_the_catalogues(name: str) -> None:
    rng, kind = np.random.default_rng(11), KINDS[name]
    time = np.arange(round(0.5 * STEP_RATE_HZ)) / STEP_RATE_HZ
    rise = 1.0 - np.exp(-((time / 0.05) ** 2))
    analog, other = (rise * np.sin(2 * np.pi * f * time) for f in (60.0, 90.0))
    p = random_numbers(name, kind.usual, rng)
    fault = CATALOGUE[name].at(kind.usual).with_values(**p)
    expected = fault.apply(analog, STEP_RATE_HZ, other if fault.other else None)
    shown = kind.function(analog, time, tuple(p.values()), other)
    assert shown == pytest.approx(expected, abs=2e-5)
    assert np.max(np.abs(shown - analog)) > 1e-3


# --- energy -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if kind.passive])
def test_passive_ones_dissipate(name: str) -> None:
    """What has gone in since it was at rest is nowhere negative, where the link passes its centre again."""
    kind, p = KINDS[name], Undeclared(name).values
    for frequency, T in ((15.8, 80.0), (173.0, 300.0)):
        state, slope, work = np.zeros(2), np.zeros(2), np.zeros(8001)
        omega, step = 2 * np.pi * frequency, 0.001 / frequency
        for place in range(8001):
            x, v = 1.5e-4 * np.sin(omega * place * step), 1.5e-4 * omega * np.cos(omega * place * step)
            work[place] = kind.function(0.0, x, v, T, 9e5, state, p, slope) * v * step
            state = state + step * slope
        done = np.cumsum(0.5 * (work[1:] + work[:-1]))[999::1000]
        assert np.all(done >= -1e-3 * np.max(np.abs(work)) * 1000)
    assert np.max(done) > 0.0


# --- the integrator -----------------------------------------------------------------------------------------


def test_an_extra_mode_is_a_third_mass() -> None:
    mode = Undeclared("extra-mode", "body:so", {"m3": 0.08, "f3": 200.0, "zeta3": 0.03})
    motion = run(replace(HOLDING, effects=(mode,)), NOMINAL, 3000.0, 0.3)
    w, T = 2 * np.pi * 200.0, 3000.0
    k = 9.763e5 / (1 + np.exp(-0.0608 * (T - 2.003)))
    c = 1853.0 - 1717.4 / (1 + np.exp(-0.00922 * T))
    k3, c3 = 0.08 * w**2, 2 * 0.03 * w * 0.08
    stiffness = np.array([[8963.57 + k, -k, 0], [-k, 91800 + k + k3, -k3], [0, -k3, k3]])
    damping = np.array([[8.2 + c, -c, 0], [-c, 2.696 + c + c3, -c3], [0, -c3, c3]])
    mass = np.diag([8.625, 0.9888, 0.08])
    bottom = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    matrix = np.vstack([np.hstack([np.zeros((3, 3)), np.eye(3)]), bottom])
    states = np.array(
        [motion.displacement_lo, motion.displacement_so, motion.velocity_lo, motion.velocity_so]
    )
    # The mass itself is not recorded: find where it was from the first instants, then predict the rest.
    first, steps = 1000, 12_000
    seen = [0, 1, 3, 4]
    passages = [linalg.expm(matrix * n / STEP_RATE_HZ) for n in (0, 100, 200, 300)]
    observed = np.concatenate([states[:, first + n] for n in (0, 100, 200, 300)])
    start = np.linalg.lstsq(np.vstack([passage[seen] for passage in passages]), observed)[0]
    expected = (linalg.expm(matrix * steps / STEP_RATE_HZ) @ start)[seen]
    assert states[:, first + steps] == pytest.approx(expected, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize(
    "effect",
    [
        Undeclared("jenkins-slip", parameters={"mu": 0.06}),
        Undeclared("bouc-wen"),
        Undeclared("two-sided-gap"),
        Undeclared("loosening-slip-gate"),
        Undeclared("outside-uneven-slip"),
        Undeclared("outside-rattling-mass"),
    ],
    ids=lambda effect: effect.name,
)
def test_halving_the_step_leaves_the_sharp_ones(effect: Undeclared) -> None:
    plant = replace(Plant(), effects=(effect,))
    coarse, fine = (run(plant, NOMINAL, 100.0, 0.1, step_rate_hz=f * STEP_RATE_HZ) for f in (1, 2))
    relative = [(m.displacement_lo - m.displacement_so)[:: i + 1] for i, m in enumerate((coarse, fine))]
    assert np.max(np.abs(relative[0] - relative[1])) < 3e-3 * np.max(np.abs(relative[1]))
    losses = [100.0 - motion.tension[-1] for motion in (coarse, fine)]
    assert losses[0] == pytest.approx(losses[1], rel=5e-3)


def test_a_constant_force_holds_the_rig_off_its_centre_before_the_hit() -> None:
    force = Undeclared("constant-force", "body:lo", {"F_0": 2.0})
    before = run(replace(HOLDING, effects=(force,)), NOMINAL, 300.0, 0.009)
    k = 9.763e5 / (1 + np.exp(-0.0608 * (300.0 - 2.003)))
    stiffness = 8963.57 + 1.0 / (1.0 / k + 1.0 / 91800)
    assert before.displacement_lo == pytest.approx(2.0 / stiffness, rel=1e-6)


def test_steep_friction_settles_stably() -> None:
    friction = Undeclared("coulomb-friction", parameters={"F_c": 0.0, "mu": 5e-3, "v_s": 3e-4})
    plant = replace(Plant(), effects=(friction,))
    motion = run(plant, NOMINAL, 3000.0, 0.009, floor_rms=3e-7, rng=np.random.default_rng(1))
    relative = np.abs(motion.velocity_lo - motion.velocity_so)
    assert np.max(relative) < 1e-5  # at SETTLING_RATE_HZ it would chatter at some 1e-4 m/s
    assert 2.8 * SETTLING_RATE_HZ < 15.0 / 3e-4 / 0.887


def test_two_effects_in_two_links_add_up() -> None:
    lo = Undeclared("tension-dependent-stiffness", "flexure_lo", {"epsilon": 0.1, "T_g": 100.0})
    so = Undeclared("tension-dependent-stiffness", "flexure_so", {"epsilon": 0.2, "T_g": 100.0})
    both = run(replace(HOLDING, effects=(lo, so)), NOMINAL, 5000.0, 0.3)
    factor = 1.0 - np.exp(-50.0)
    plain = replace(HOLDING, stiffening_lo=1.10 * (1 + 0.1 * factor), stiffening_so=1.20 * (1 + 0.2 * factor))
    assert both.displacement_so == pytest.approx(
        run(plain, NOMINAL, 5000.0, 0.3).displacement_so, rel=1e-6, abs=1e-12
    )


def test_too_strong_ones_are_refused() -> None:
    wild = Undeclared("quadratic-damping", parameters={"c2": 1e12})
    with pytest.raises(ValueError, match="diverges with quadratic-damping"):
        run(replace(Plant(), effects=(wild,)), NOMINAL, 100.0, 0.1)


# --- naming one ---------------------------------------------------------------------------------------------


def test_what_is_not_said_takes_its_usual_value_and_place() -> None:
    effect = undeclared_from_text("coulomb-friction:F_c=2.5")
    assert effect == Undeclared("coulomb-friction", "joint", {"F_c": 2.5, "mu": 1.2e-3, "v_s": 1e-3})
    assert undeclared_from_text("coulomb-friction@flexure_so").parameters["F_c"] == 0.1
    assert undeclared_from_text("extra-mode@body:lo:m3=0.2,f3=90").parameters["f3"] == 90.0
    assert undeclared_from_text("hum@sensor:strain").enters == "sensor:tension"
    assert undeclared_from_text("extra-mode@body:so").enters == "body:so"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("colomb-friction", ("colomb-friction", "did you mean 'coulomb-friction'")),
        ("xyz", ("xyz", "expected one of", "coulomb-friction", "outside-")),
        ("coulomb-friction@flexure_la", ("flexure_la", "did you mean 'flexure_lo'")),
        ("coulomb-friction@tension", ("tension", "expected one of joint, flexure_lo, flexure_so")),
        ("coulomb-friction:Fc=2", ("Fc", "did you mean 'F_c'")),
        ("coulomb-friction:F_c=much", ("F_c=much", "EFFECT[@PLACE][:key=value,...]")),
        ("coulomb-friction:F_c=-2", ("F_c", "-2", "0 or more")),
        ("coulomb-friction:v_s=0", ("v_s", "got 0", "more than 0")),
        ("cubic-stiffness:k3=nan", ("k3", "nan", "finite")),
    ],
)
def test_a_wrong_one_is_refused_in_one_line(text: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="undeclared") as caught:
        undeclared_from_text(text)
    message = str(caught.value)
    assert "\n" not in message
    assert all(word in message for word in words)
