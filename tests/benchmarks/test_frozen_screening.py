import numpy as np
import pytest

from benchmarks.frozen_screening import freeze, screen
from rom.model.laws import constant_damping, logistic_loosening, no_loosening, power_loosening
from rom.parameters.he_2025 import paper_model

RATE = 19200.0
TENSIONS = np.array([21.5, 60.0, 152.7, 317.0, 700.0, 2999.3])


@pytest.fixture(scope="module")
def forces():
    time = np.arange(int(1.5 * RATE)) / RATE - 0.1
    rng = np.random.default_rng(0)
    pulse = np.sin(np.pi * time / 0.65e-3) * ((time > 0) & (time < 0.65e-3))
    return np.stack([peak * pulse + 0.2 * rng.normal(size=time.size) for peak in rng.normal(1608.7, 80.0, 6)])


@pytest.fixture(scope="module")
def motion(forces):
    return freeze(paper_model(), forces, RATE, TENSIONS, 0.1)


def test_the_model_s_own_law_loses_what_the_full_simulation_loses(motion, forces):
    loss = TENSIONS - paper_model().final_tension(forces, RATE, TENSIONS)
    law = paper_model().link_laws["joint"].tension_rate
    screened = TENSIONS - screen(motion, [law, no_loosening()])
    assert screened[0] == pytest.approx(loss, rel=2e-3)
    assert not screened[1].any()


def test_screening_keeps_the_best_of_the_full_simulation(motion, forces):
    model, rng = paper_model(), np.random.default_rng(2)
    measured = model.final_tension(forces, RATE, TENSIONS)
    laws = [
        logistic_loosening(11.79 + d, 7.974 + i, -0.00362 * r)
        for d, i, r in rng.normal([0, 0, 1], [0.4, 0.4, 0.2], (100, 3))
    ]
    paths = [f"joint.tension_rate.{name}" for name in ("gamma_d", "gamma_i", "rho")]
    full = np.array(
        [
            model.final_tension(
                forces,
                RATE,
                TENSIONS,
                {path: np.full(6, v) for path, v in zip(paths, law.values[:3], strict=True)},
            )
            for law in laws
        ]
    )
    score = [
        np.median(abs(final - measured) / (TENSIONS - measured), axis=1)
        for final in (full, screen(motion, laws))
    ]
    best, kept = set(np.argsort(score[0])[:5]), set(np.argsort(score[1])[:15])
    assert best <= kept


def test_threads_give_the_same_numbers(motion):
    laws = [power_loosening(gamma) for gamma in np.geomspace(1e3, 1e8, 17)]
    assert np.array_equal(screen(motion, laws), screen(motion, laws, jobs=2))
    assert screen(motion, []).shape == (0, 6)


def test_a_runaway_law_is_marked(motion):
    final = screen(motion, [power_loosening(-1e30)])
    assert np.isnan(final).all() or (final > 1e6).all()


def test_other_laws_are_refused(motion):
    with pytest.raises(ValueError, match="must enter as tension rate, got constant damping"):
        screen(motion, [constant_damping(1.0)])
