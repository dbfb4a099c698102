"""What pysindy alone is given in the benchmark is enough: without noise it finds the hidden term."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.discovery_peers import Samples
from benchmarks.pysindy_user import TERMS, library, of_pysindy


def test_without_noise_pysindy_alone_finds_the_hidden_term() -> None:
    time = np.arange(1200) / 4800
    tensions, motions, damping = [], [], []
    for initial, c, frequency in ((20.0, 950.0, 40.0), (150.0, 600.0, 60.0), (1500.0, 140.0, 90.0)):
        v = 0.06 * np.exp(-10 * time) * np.sin(2 * np.pi * frequency * time)
        x = np.cumsum(v) / 4800
        power = c * v**2
        lost = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) / 4800])
        tensions.append(initial * np.exp(-6.0 * lost))
        motions.append(np.column_stack([v, x]))
        damping.append(c * v)
    samples = Samples((time,) * 3, tuple(tensions), tuple(motions), (150.0, 0.06, 1e-4))
    found = of_pysindy(samples, damping, smoothed=False, most=1)
    assert found == {"abs(D * v) * T": pytest.approx(-6.0, rel=0.01)}


def test_the_library_has_the_terms_by_name() -> None:
    inputs = np.array([[-0.05, 1e-5, 150.0, 3.0, -20.0], [0.02, 0.0, 100.0, 1.0, 10.0]])
    columns = library("v, x, T, F, D").fit(inputs)
    assert columns.get_feature_names() == list(TERMS)
    row = dict(zip("vxTFD", inputs[0], strict=True))
    expected = [eval(term, {}, row) for term in TERMS]
    assert np.asarray(columns.transform(inputs))[0] == pytest.approx(expected)
