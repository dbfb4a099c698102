# ruff: noqa: ARG001 - effects have the arguments of their place
"""Order of convergence for each kind of term, energy balance, and effects with states."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from rom.kernels.block import advance, free_motion, linearise, restart
from rom.kernels.exponential_integrator import Task, parts
from rom.kernels.propagators import NODES, SAMPLE, TICKS, allocate, build
from rom.kernels.start import clear, empty_block, enter
from rom.kernels.sweeps import solve, solve_laws
from rom.model.effect import Effect
from rom.model.laws import Parameter, constant_damping, constant_stiffness, no_loosening, power_loosening
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from rom.parameters.he_2025 import paper_model

RATE = 19200.0


def cubic(t, x, v, T, k, c, s, p, ds, dT):
    return p[0] * x * x * x


def maxwell(t, x, v, T, k, c, s, p, ds, dT):
    ds[0] = v - s[0] / p[1]
    return p[0] * s[0]


def jenkins(t, x, v, T, k, c, s, p, ds, dT):
    """A spring kappa k in series with a slider of strength mu T, in place of a share kappa of the joint."""
    spring = p[0] * k
    limit = p[1] * max(T, 0.0)
    force = min(max(spring * s[0], -limit), limit)
    slips = abs(spring * s[0]) >= limit and s[0] * v > 0.0
    ds[0] = 0.0 if slips else v
    return force - spring * x


def meter(t, x, v, T, k, c, s, p, ds, dT):
    ds[0] = (k * x + c * v) * v
    return 0.0


def effect(name, function, states, enters="joint", **values):
    parameters = {key: Parameter(value, "SI") for key, value in values.items()}
    return Effect(name, enters, "", parameters, function, states, on_disk=False)


def with_joint(model: Model, **laws) -> Model:
    joint = replace(model.link_laws["joint"], **laws)
    return replace(model, link_laws={**model.link_laws, "joint": joint})


def constant_joint() -> LinkLaws:
    return LinkLaws(constant_stiffness(5e5), constant_damping(200.0), no_loosening())


@njit(error_model="numpy")
def march(at, program, p, task, block, tables, level, samples):
    """A free motion in blocks of one level; `block` holds its end."""
    clear(block, task.y0, task.tensions)
    enter(program, p, task.driven, block.active, tables)
    linearise(at.linearise, (program, p, block, tables))
    restart(at.restart, (program, p, block, 0.0))
    build(at.build, (tables, max(level, SAMPLE), 1 / task.rate))
    d, goal = 2.0**level / TICKS / task.rate, (1e-14, 1e-13, 1e-14)
    for number in range(samples * TICKS // (4 * 2**level)):
        tick = number * 4 * 2**level
        free_motion(at.free_motion, (block.free, block.y, tables.E, tables.W, task.force, level, tick))
        if program.effects.shape[0]:
            t = tick / TICKS / task.rate
            solve(at.solve, (program, p, block, tables.H, level, t, d, goal))
        else:
            solve_laws(at.solve_laws, (program, p, block, tables.H, level, d, goal, 2.0))
        advance(block)


def marched(model: Model, level: int, samples: int) -> np.ndarray:
    """State after a free motion in blocks of one level: the motion, the tension's change, the states."""
    assembly, force = model.assembly, np.zeros((1, samples + 1))
    force.flags.writeable = False
    start = assembly.full_start(np.array([1e-4, -1e-4, 0.03, -0.05]))
    last = np.array([samples, samples + 1])
    task = Task(RATE, np.array([0]), assembly.active, force, start, np.array([20.0]), last, 1, 1e-9)
    program = assembly.program
    block, tables = empty_block(program, assembly.active, 0), allocate(4, 1, assembly.active.size)
    at = parts(bool(model.effects))
    march(at, program, assembly.coefficients, task, block, tables, level, samples)
    return np.concatenate([block.y[0], block.z[0]])


TERMS = {
    "stiffness and damping of the tension": lambda m: with_joint(m, tension_rate=power_loosening(3e6)),
    "tension law": lambda m: with_joint(
        m,
        stiffness=constant_stiffness(5e5),
        damping=constant_damping(200.0),
        tension_rate=power_loosening(3e6),
    ),
    "force": lambda m: with_joint(m, tension_rate=no_loosening()).with_effect(
        effect("cubic", cubic, 0, k3=5e13)
    ),
    "state": lambda m: with_joint(m, tension_rate=no_loosening()).with_effect(
        effect("maxwell", maxwell, 1, k_m=2e5, tau=5e-4)
    ),
}


@pytest.mark.parametrize("term", TERMS)
def test_every_kind_of_term_converges_with_fifth_order_or_better(term):
    model = TERMS[term](paper_model())
    finest = marched(model, SAMPLE - 2, 64)
    moved = finest != 0.0
    finest = finest[moved]
    levels = range(SAMPLE - 1, SAMPLE + 2)
    errors = [np.linalg.norm(marched(model, level, 64)[moved] / finest - 1.0) for level in levels]
    assert errors[0] < 1e-7
    assert math.log2(errors[2] / errors[1]) > 4.5
    assert math.log2(errors[1] / errors[0]) > 4.5


def test_the_linear_part_is_exact_at_any_length_of_block():
    model = replace(paper_model(), link_laws={**paper_model().link_laws, "joint": constant_joint()})
    short, long = marched(model, SAMPLE - 2, 256), marched(model, SAMPLE + 6, 256)
    assert abs(long - short)[: NODES - 1].max() < 1e-12


@pytest.mark.parametrize("tension", [6.4, 20.0, 61.3, 152.7, 317.0, 2999.3])
def test_work_of_the_force_is_kinetic_potential_and_dissipated_energy(tension):
    model = paper_model()
    for link in model.structure.link_names:
        model = model.with_effect(effect("meter", meter, 1, enters=link))
    time = np.arange(9600) / RATE
    force = 1608.7 * np.sin(np.pi * time / 0.65e-3) * (time < 0.65e-3)
    response = model.simulate({"lo": force}, RATE, tension)
    v, a, h = response.velocity["lo"], response.acceleration["lo"], 1 / RATE
    # integral of a linear force times the velocity's Hermite cubic
    work = h * np.sum(
        force[:-1] * (0.35 * v[:-1] + 0.15 * v[1:] + h * (a[:-1] / 20 - a[1:] / 30))
        + force[1:] * (0.15 * v[:-1] + 0.35 * v[1:] + h * (a[:-1] / 30 - a[1:] / 20))
    )
    kinetic = 0.5 * (8.625 * v[-1] ** 2 + 0.9888 * response.velocity["so"][-1] ** 2)
    assert kinetic + response.states[:, -1].sum() == pytest.approx(work, rel=1e-6)


def test_a_slider_with_memory_slips_at_its_limit_and_follows_the_fine_solution():
    slider = effect("jenkins-slip", jenkins, 1, kappa=0.9, mu=0.15)
    model = paper_model().with_effect(slider)
    time = np.arange(3840) / RATE
    force = 1608.7 * np.sin(np.pi * time / 0.65e-3) * (time < 0.65e-3)
    response = model.simulate({"lo": force}, RATE, 152.7)
    spring = 0.9 * paper_model().link_laws["joint"].stiffness(response.tension) * response.states[0]
    assert abs(spring).max() == pytest.approx(0.15 * 152.7, rel=0.2)
    fine = model.simulate({"lo": np.interp(np.arange(4 * 3840) / 4, np.arange(3840), force)}, 4 * RATE, 152.7)
    x, x_fine = response.displacement["lo"], fine.displacement["lo"][::4]
    assert abs(x - x_fine).max() < 1e-3 * abs(x).max()
    without = paper_model().simulate({"lo": force}, RATE, 152.7)
    assert abs(x - without.displacement["lo"]).max() > 0.05 * abs(x).max()


def test_an_effect_with_memory_loses_on_the_fast_path_what_its_response_loses():
    slider = effect("jenkins-slip", jenkins, 1, kappa=0.9, mu=0.15)
    time = np.arange(9600) / RATE - 0.05
    force = 1608.7 * np.sin(np.pi * time / 0.65e-3) * ((time > 0) & (time < 0.65e-3))
    for added in (slider, effect("maxwell", maxwell, 1, k_m=2e5, tau=5e-4)):
        model = paper_model().with_effect(added)
        tension = model.simulate({"lo": force}, RATE, 152.7).tension
        loss = 152.7 - tension[-1]
        edges = np.array([0, 964, 1000, 5000, 9600])
        means = [tension[a:b].mean() for a, b in pairwise(edges)]
        final = model.final_tension([force], RATE, [152.7])[0]
        assert final == pytest.approx(tension[-1], abs=3e-4 * loss)
        assert model.mean_tensions([force], RATE, [152.7], edges / RATE)[0] == pytest.approx(
            means, abs=3e-4 * loss
        )


def test_a_slider_that_slips_fifty_times_its_stick_is_followed_in_few_blocks_as_by_radau():
    mass, k, share, limit = 1.7, 790.0, 0.1, 0.06

    def slips(t, x, v, T, k, c, s, p, ds, dT):
        z = x - s[0]
        over = abs(p[0] * k * z) / p[1] - 1.0
        u = min(max(1.0 + 200.0 * over, 0.0), 1.0) if v * z > 0.0 else 0.0
        ds[0] = v * u * u * (3.0 - 2.0 * u) + 2.0 * abs(v) * min(max(over, 0.0), 1.0) * (1 if z > 0 else -1)
        return -p[0] * k * s[0]

    def rates(_time, y):
        (x, v, _), rate = y, [0.0]
        force = k * x + slips(0.0, x, v, 0.0, k, 0.0, y[2:], (share, limit), rate, None)
        return [v, -force / mass, rate[0]]

    structure = Structure((Body("cart", mass),), (Link("spring", "cart", "ground"),))
    link = LinkLaws(constant_stiffness(k), constant_damping(0.0), None)
    slider = effect("slider", slips, 1, enters="spring", kappa=share, F_s=limit)
    model = Model(structure, {"spring": link}).with_effect(slider)
    found = model.simulate({"cart": np.zeros(400)}, 200.0, initial_displacement={"cart": 0.036})
    ends = (0.0, found.time[-1])
    known = solve_ivp(rates, ends, [0.036, 0.0, 0.0], "Radau", found.time, rtol=1e-9, atol=1e-12)
    assert known.success
    assert abs(found.displacement["cart"] - known.y[0]).max() < 1e-5 * 0.036
    swings = 2 * found.time[-1] * np.sqrt(k / mass) / (2 * np.pi)
    assert found.steps < 180 * swings  # plain sweeps: 354 a swing


@pytest.mark.parametrize("faster", [1.0, 100.0])
def test_a_contact_between_the_nodes_of_a_long_block_is_not_missed(faster):
    """25 samples a period, a stop at less than half the amplitude: as sampled eight times as fast."""

    def stop(t, x, v, T, k, c, s, p, ds, dT):
        return p[0] * max(x - p[1], 0.0)

    structure = Structure((Body("m", 248.0 / faster**2),), (Link("spring", "m", "ground"),))
    link = LinkLaws(constant_stiffness(29_700.0), constant_damping(48.5 / faster), None)
    gap = effect("stop", stop, 0, enters="spring", k_g=4900.0, delta=2.1e-4)
    model = Model(structure, {"spring": link}).with_effect(gap)
    start = {"initial_displacement": {"m": 4.6e-4}, "tolerance": 1e-7}
    found = model.simulate({"m": np.zeros(675)}, 43.4 * faster, **start)
    coarse = found.displacement["m"]
    fine = model.simulate({"m": np.zeros(674 * 8 + 1)}, 8 * 43.4 * faster, **start).displacement["m"][::8]
    assert found.steps < 1000  # 15,000 of a fast mass where ten times its displacement was expected
    assert abs(coarse - fine).max() < 2e-5 * abs(fine).max()  # 3.5e-3 where blocks go over contacts


def test_a_body_effect_acts_on_its_body_alone():
    spring = effect("cubic", cubic, 0, enters="body:so", k3=1e10)
    force = np.zeros(960)
    force[10:20] = 1000.0
    plain = paper_model().simulate({"lo": force}, RATE, 300.0)
    held = paper_model().with_effect(spring).simulate({"lo": force}, RATE, 300.0)
    at = np.argmax(abs(held.displacement["so"]))
    x, v = held.displacement["so"][at], held.velocity["so"][at]
    joint = paper_model().link_laws["joint"]
    relative = held.displacement["lo"][at] - x, held.velocity["lo"][at] - v
    expected = joint.stiffness(held.tension[at]) * relative[0] + joint.damping(held.tension[at]) * relative[1]
    expected -= 91800.0 * x + 2.696 * v + 1e10 * x**3
    assert held.acceleration["so"][at] == pytest.approx(expected / 0.9888, rel=1e-9)
    assert abs(held.displacement["so"] - plain.displacement["so"]).max() > 1e-6


def test_machine_code_of_older_sources_is_not_used(tmp_path):
    from rom.kernels import _drop_stale_cache

    cache = tmp_path / "__pycache__"
    cache.mkdir()
    (tmp_path / "kernel.py").write_text("a = 1")
    _drop_stale_cache(tmp_path)
    (cache / "kernel.nbi").write_text("code")
    _drop_stale_cache(tmp_path)
    assert (cache / "kernel.nbi").exists()
    (tmp_path / "kernel.py").write_text("a = 2")
    _drop_stale_cache(tmp_path)
    assert not (cache / "kernel.nbi").exists()
