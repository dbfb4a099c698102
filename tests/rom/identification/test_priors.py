"""What a tie counts: nothing beside noise, much beside a misfit that is alike in neighbouring lines."""

from __future__ import annotations

import numpy as np
import pytest

from rom.identification.output_error import fit_output_error, values_of
from rom.identification.priors import PriorConstraint, misfits, pull
from rom.identification.spectral_model import SpectralRecord
from rom.identification.uncoupled_priors import fit_near
from tests.rom.identification.test_output_error import LINKS, RATE_HZ, SAMPLES, one_body
from tests.rom.lumped import noisy, pulse, respond

STIFF = PriorConstraint({"k": 1.0, "mass": -1.0}, float(np.log(2000.0)), 0.01, ("k",), "k and a frequency")


def record(gain: float) -> SpectralRecord:
    """Return a struck body with noise, its force read wrong by a factor."""
    force = pulse(100.0, SAMPLES, RATE_HZ, 0.5, 8e-3)
    motion = respond({"m": 2.0}, LINKS, {"m": force}, RATE_HZ)["acceleration_m"]
    return one_body(noisy(np.random.default_rng(3), motion, 0.01), gain * force, "acceleration")


def test_a_wrong_gain_is_no_noise_and_noise_is_none_of_it() -> None:
    for gain, low, high in ((1.0, 0.0, 0.2), (1.2, 0.6, 1.0)):
        (found,) = fit_output_error([record(gain)]).misfits
        assert low <= found.share <= high
        assert (found.systematic > 0) == (gain != 1.0)


def test_a_tie_weighs_with_the_misfit_of_the_records_that_its_coefficient_is_in() -> None:
    found = [fit_output_error([record(gain)]).misfits for gain in (1.0, 1.2)]
    elsewhere = PriorConstraint({"other": 1.0}, 0.0, 0.1, ("other",), "another")
    assert pull([STIFF, elsewhere], [record(1.0)], found[0]) == (0.0, 0.0)
    weight, other = pull([STIFF, elsewhere], [record(1.2)], found[1])
    assert weight > 10
    assert other == 0


def test_a_wrong_tie_changes_nothing_where_the_model_fits() -> None:
    wrong = PriorConstraint(
        {"k": 1.0, "mass": -1.0}, float(np.log(3000.0)), 0.01, ("k",), "k and a wrong frequency"
    )
    free, near = fit_output_error([record(1.0)]), fit_near([record(1.0)], [wrong])
    assert np.array_equal(near.logarithms, free.logarithms)
    assert np.array_equal(near.covariance, free.covariance)


def test_a_tie_holds_its_coefficient_where_the_model_does_not_fit() -> None:
    records = [record(1.2)]
    tied = fit_near(records, [STIFF])
    assert tied.value("k") == pytest.approx(4000.0, rel=0.02)
    assert abs(STIFF.offset(values_of(records, tied))) < 2


def test_an_offset_counts_standard_errors_to_the_target() -> None:
    assert STIFF.offset({"k": 4000.0 * np.exp(-0.03), "mass": 2.0}) == pytest.approx(3.0)


def test_no_lines_no_misfit() -> None:
    assert misfits([], []) == ()
