import numpy as np
import numpy.typing as npt
import pytest

from rom.signals.calibration import Calibration, fit_calibration

FloatArray = npt.NDArray[np.float64]

PRINTED = (2718.7, 2363.7, -575.63)
STRAINS = np.array([0.05, 0.2, 0.5, 1.0, 1.6, 1.9])


def strain_of(tension: FloatArray) -> FloatArray:
    grid = np.linspace(-0.05, 2.3, 20000)
    return np.interp(tension, Calibration(PRINTED).tension(grid), grid)


def tensile_test(
    rng: np.random.Generator, clock_s: float = 1.37, cycles: int = 4, noise: float = 1.0, ramp_s: float = 20.0
) -> tuple[FloatArray, FloatArray]:
    """Force at 100 Hz and strain at 4800 Hz: jaws settle in the first cycle and slip (a plateau) in three."""
    times, forces, first_end = [0.0], [10.0], 0.0
    for cycle in range(cycles):
        stop = rng.uniform(3000, 8000)
        legs = [((stop - 10) / 9990 * ramp_s, stop), (0.0 if cycle == 2 else rng.uniform(1, 4), stop)]
        for duration, force in [*legs, ((1e4 - stop) / 9990 * ramp_s, 1e4), (ramp_s, 10.0)]:
            times.append(times[-1] + duration)
            forces.append(force)
        first_end = first_end or times[-1]
    duration = times[-1] + 2.0
    force_time, strain_time = np.arange(round(duration * 100)) / 100, np.arange(round(duration * 4800)) / 4800
    strain = strain_of(np.interp(strain_time - clock_s, times, forces))
    strain = np.where(strain_time - clock_s < first_end, 0.93 * strain + 0.01, strain)
    force = np.interp(force_time, times, forces) + 5 * noise * rng.standard_normal(force_time.size)
    return force, strain + 5e-4 * noise * rng.standard_normal(strain.size)


class TestCalibration:
    def test_is_equation_1(self) -> None:
        calibration = Calibration(PRINTED)
        strain = np.array([[0.0, 0.1], [1.0, 2.0]])
        expected = -575.63 * strain**3 + 2363.7 * strain**2 + 2718.7 * strain
        np.testing.assert_allclose(calibration.tension(strain), expected, rtol=1e-14)
        step = 1e-6
        slope = (calibration.tension(strain + step) - calibration.tension(strain - step)) / (2 * step)
        np.testing.assert_allclose(calibration.sensitivity(strain), slope, rtol=1e-7)

    def test_standard_error_is_that_of_drawn_coefficients(self) -> None:
        root = np.array([[3.0, 0, 0], [-4.0, 2.0, 0], [1.0, -1.0, 0.5]])
        calibration = Calibration(PRINTED, root @ root.T)
        drawn = np.array(PRINTED) + np.random.default_rng(0).standard_normal((20000, 3)) @ root.T
        scatter = np.std([Calibration(tuple(row)).tension(STRAINS) for row in drawn], axis=0)
        np.testing.assert_allclose(calibration.tension_standard_error(STRAINS), scatter, rtol=0.03)
        with pytest.raises(ValueError, match="no covariance"):
            Calibration(PRINTED).tension_standard_error(1.0)

    def test_extrapolation_is_said_in_words(self) -> None:
        calibration = Calibration(PRINTED, strain_range=(0.0, 2.0))
        assert calibration.warning([-0.01, 0.5, 2.01]) is None
        assert not calibration.extrapolated([0.0, 2.0])
        message = calibration.warning([0.5, 2.5, 1.0, 1.5])
        assert message is not None
        assert "2.5" in message
        assert "25.0%" in message
        assert calibration.extrapolated(-0.1)
        assert not Calibration(PRINTED).extrapolated(99.0)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (((),), "finite coefficients"),
            (((np.nan,),), "finite coefficients"),
            ((PRINTED, np.eye(2)), "must have shape"),
        ],
    )
    def test_refuses_what_is_no_calibration(self, arguments: tuple[object, ...], message: str) -> None:
        with pytest.raises(ValueError, match=message):
            Calibration(*arguments)  # type: ignore[arg-type]


class TestFit:
    def test_recovers_equation_1_within_its_own_limits(self) -> None:
        scores, tension_scores, errors = [], [], []
        for seed in range(30):
            rng = np.random.default_rng(seed)
            force, strain = tensile_test(rng, clock_s=rng.uniform(-1, 2))
            found = fit_calibration(force, 100.0, strain, 4800.0)
            assert found.covariance is not None
            scores.append((np.array(found.coefficients) - PRINTED) / np.sqrt(np.diag(found.covariance)))
            error = found.tension(STRAINS) - Calibration(PRINTED).tension(STRAINS)
            tension_scores.append(error / found.tension_standard_error(STRAINS))
            errors.append(error)
        assert 0.85 <= np.mean(np.abs(scores) < 1.96) <= 1.0
        assert 0.85 <= np.mean(np.abs(tension_scores) < 1.96) <= 1.0
        assert np.abs(errors).max() < 2.0  # N, of 10000
        assert np.abs(np.mean(errors, axis=0)).max() < 0.3

    def test_range_and_degree(self) -> None:
        force, strain = tensile_test(np.random.default_rng(1))
        found = fit_calibration(force, 100.0, strain, 4800.0, degree=4)
        assert len(found.coefficients) == 4
        assert found.strain_range is not None
        top = float(strain_of(np.array(1e4)))
        assert found.strain_range == pytest.approx((0.0, top), abs=0.01 * top)

    def test_the_first_cycle_counts_for_nothing(self) -> None:
        force, strain = tensile_test(np.random.default_rng(2), cycles=3)
        first = int(0.2 * strain.size)
        spoilt = np.concatenate((1.1 * strain[:first], strain[first:]))
        original = fit_calibration(force, 100.0, strain, 4800.0)
        np.testing.assert_allclose(
            fit_calibration(force, 100.0, spoilt, 4800.0).coefficients, original.coefficients, rtol=1e-9
        )

    def test_a_late_clock_changes_nothing(self) -> None:
        force, strain = tensile_test(np.random.default_rng(3), clock_s=0.0, noise=0.2)
        late = np.concatenate((np.full(2400, strain[0]), strain))
        found = [fit_calibration(force, 100.0, row, 4800.0) for row in (strain, late)]
        np.testing.assert_allclose(found[0].tension(STRAINS), found[1].tension(STRAINS), atol=0.2)

    @pytest.mark.parametrize("cycles", [1, 3])
    def test_refuses_too_few_or_unequal_cycles(self, cycles: int) -> None:
        force, strain = tensile_test(np.random.default_rng(0), cycles=cycles)
        part = slice(0, round(0.6 * strain.size) if cycles > 1 else None)
        with pytest.raises(ValueError, match="the same two or more load cycles"):
            fit_calibration(force, 100.0, strain[part], 4800.0)

    @pytest.mark.parametrize("force", [np.ones((20, 2)), np.ones(3), np.full(100, np.nan)])
    def test_refuses_records_that_are_none(self, force: FloatArray) -> None:
        with pytest.raises(ValueError, match="force record must be"):
            fit_calibration(force, 100.0, np.ones(5000), 4800.0)

    def test_refuses_a_constant_force(self) -> None:
        with pytest.raises(ValueError, match="instead found 0 in the force"):
            fit_calibration(np.ones(1000), 100.0, np.ones(48000), 4800.0)
