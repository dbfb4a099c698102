import numpy as np
import pytest

from rom.parameters.he_2025 import paper_model
from tests.reference import two_oscillators

RATE = 19200.0


def struck(peak, seconds=0.04, start=0.002, length=0.65e-3):
    time = np.arange(int(seconds * RATE)) / RATE - start
    pulse = peak * np.sin(np.pi * time / length) * ((time > 0) & (time < length))
    return pulse + np.random.default_rng(0).normal(size=time.size)


@pytest.mark.parametrize("tension", [6.4, 61.3, 317.0, 2999.3])
def test_modular_model_is_the_paper_s_model(tension):
    force = struck(1608.7)
    expected = two_oscillators.simulate(force, RATE, tension)
    response = paper_model().simulate({"lo": force}, RATE, tension, tolerance=1e-11)
    loss = tension - expected[4, -1]
    assert abs(response.tension - expected[4]).max() < 1e-8 * loss
    for row, body in enumerate(("lo", "so")):
        for computed, states in (
            (response.displacement, expected[row]),
            (response.velocity, expected[2 + row]),
        ):
            assert abs(computed[body] - states).max() < 1e-8 * abs(states).max()
    joint = two_oscillators.k_c(expected[4]) * (expected[0] - expected[1])
    joint += two_oscillators.c_c(expected[4]) * (expected[2] - expected[3])
    acceleration = (joint - 91800.0 * expected[1] - 2.696 * expected[3]) / 0.9888
    assert abs(response.acceleration["so"] - acceleration).max() < 1e-8 * abs(acceleration).max()
