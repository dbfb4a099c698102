"""Scalar functions over whole records."""

import math

import numpy as np
import pytest

from rom.kernels.elementwise import elementwise


@elementwise
def decay(t, amplitude, tau):
    return amplitude * math.exp(-t / tau)


def test_every_sample_gets_the_scalar_functions_value():
    ticks = np.arange(7)  # whole numbers too

    found = decay(ticks, 3.0, 2.0)

    assert found.dtype == np.float64
    np.testing.assert_allclose(found, [decay.__wrapped__(tick, 3.0, 2.0) for tick in range(7)], rtol=1e-15)


def test_one_argument_too_many_is_refused_and_left_alone():
    spare = np.zeros(2)

    with pytest.raises(TypeError, match="decay takes 3 arguments, got 4"):
        decay(np.ones(2), 1.0, 1.0, spare)

    assert not spare.any()


def test_arrays_and_numbers_broadcast():
    assert decay(np.zeros((4, 1)), np.ones(3), 1.0).shape == (4, 3)
