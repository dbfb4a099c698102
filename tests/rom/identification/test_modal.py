import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal

from rom.identification import modal
from rom.signals.filters import FilterChain

FloatArray = npt.NDArray[np.float64]

MASSES, STIFFNESS, DAMPING = (8.625, 0.9888), (8963.6, 91800.0), (8.200, 2.696)
SPRING = np.array([[1.0, -1.0], [-1.0, 1.0]])
TENSIONS = np.array([6, 16, 60, 152.7, 170, 200, 300, 1000, 3000])
K_C = 9.763e5 / (1 + np.exp(-0.0608 * (TENSIONS - 2.003)))
C_C = 1853.0 - 1717.4 / (1 + np.exp(-0.00922 * TENSIONS))


def pulse(rate_hz: float, duration_s: float, peak: float = 28.0, width_s: float = 1.05e-3) -> FloatArray:
    since = np.arange(round(rate_hz * (duration_s + 0.5))) / rate_hz - 0.5
    return np.where((since >= 0) & (since < width_s), peak * np.sin(np.pi * since / width_s), 0.0)


def accelerations(
    force: FloatArray, rate_hz: float, mass: FloatArray, damping: FloatArray, stiffness: FloatArray
):  # type: ignore[no-untyped-def]
    """Response to a force on the first body that is linear between samples: exact, body by body."""
    n = len(mass)
    inverse = np.linalg.inv(mass)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    drive = np.concatenate((np.zeros(n), inverse[:, 0]))[:, None]
    system = signal.StateSpace(state, drive, state[n:], drive[n:]).to_discrete(1 / rate_hz, "foh")
    numerators, denominator = signal.ss2tf(system.A, system.B, system.C, system.D)
    return np.stack([signal.lfilter(row, denominator, force) for row in numerators])


def single(force: FloatArray, rate_hz: float, frequency: float, ratio: float, mass: float) -> FloatArray:
    stiffness, damping = modal.oscillator_constants(mass, frequency, ratio)
    return accelerations(force, rate_hz, *(np.array([[value]]) for value in (mass, damping, stiffness)))[0]  # type: ignore[no-any-return]


def coupled(stiffness: float, damping: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    return np.diag(MASSES), np.diag(DAMPING) + damping * SPRING, np.diag(STIFFNESS) + stiffness * SPRING


def complex_modes(
    mass: FloatArray, damping: FloatArray, stiffness: FloatArray
) -> tuple[FloatArray, FloatArray]:
    inverse = np.linalg.inv(mass)
    poles = np.linalg.eigvals(
        np.block([[np.zeros_like(mass), np.eye(len(mass))], [-inverse @ stiffness, -inverse @ damping]])
    )
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    return np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles)


def one_frf(
    poles: list[complex], residues: list[complex], noise: float, rng: np.random.Generator
) -> modal.FrequencyResponse:
    frequency = np.arange(1, 3000) / 30
    s = 2j * np.pi * frequency
    frf = sum(r / (s - p) + np.conj(r) / (s - np.conj(p)) for p, r in zip(poles, residues, strict=True))
    frf = frf + noise * (rng.standard_normal((2, s.size)) * np.array([[1], [1j]])).sum(axis=0)
    # A long record: the ring has died out before its end.
    return modal.FrequencyResponse(frequency, frf, None, np.ones(s.size), 1e4, 0.0, 0.0, "displacement")


def pole(frequency: float, ratio: float) -> complex:
    return 2 * np.pi * frequency * complex(-ratio, np.sqrt(1 - ratio**2))


class TestRationalFit:
    @pytest.mark.parametrize(
        ("modes", "band"),
        [
            ([(4.892, 0.0155)], (3.0, 8.0)),
            ([(44.27, 0.0049)], (41.0, 48.0)),
            ([(15.4, 0.0147), (19.0, 0.02)], (10.0, 26.0)),
            ([(15.77, 0.006), (60.0, 0.12)], (8.0, 95.0)),
        ],
    )
    def test_recovers_poles_and_its_errors_cover(
        self, modes: list[tuple[float, float]], band: tuple[float, float]
    ) -> None:
        poles = [pole(*mode) for mode in modes]
        residues = [-1j / (2 * p.imag) for p in poles]
        level = 0.02 * min(abs(r / p.real) for r, p in zip(residues, poles, strict=True))
        scores, worst = [], np.zeros(2)
        for seed in range(50):
            response = one_frf(poles, residues, level, np.random.default_rng(seed))
            for mode, (frequency, ratio), residue in zip(
                modal.fit_modes(response, len(modes), band), modes, residues, strict=True
            ):
                found = (mode.natural_frequency, mode.damping_ratio)
                scores.append(
                    [(e.value - t) / e.standard_error for e, t in zip(found, (frequency, ratio), strict=True)]
                )
                wrong = np.abs([found[0].value / frequency - 1, found[1].value / ratio - 1])
                worst = np.maximum(worst, wrong / (1 if ratio < 0.1 else 5))
                assert mode.mass.value == pytest.approx(1.0, abs=5 * mode.mass.standard_error)
                assert abs(mode.residue - residue) < 6 * mode.residue_standard_error
        assert worst[0] < 1e-3
        assert worst[1] < 0.06
        covered = np.abs(scores) < 1.96
        assert 0.87 <= covered.mean() <= 0.995

    def test_is_exact_without_noise_whatever_lies_outside_the_band(self) -> None:
        poles = [pole(15.77, 0.006), pole(173.0, 0.07), pole(2.0, 0.3)]
        response = one_frf(poles, [-1j, -3j, -1j + 0.5], 0.0, np.random.default_rng(0))
        (mode,) = modal.fit_modes(response, 1, (15.0, 16.6))
        assert mode.natural_frequency.value == pytest.approx(15.77, rel=2e-5)
        assert mode.damping_ratio.value == pytest.approx(0.006, rel=5e-3)

    def test_refuses_a_band_with_too_few_lines(self) -> None:
        response = one_frf([pole(15.0, 0.01)], [-1j], 0.0, np.random.default_rng(0))
        with pytest.raises(ValueError, match="widen"):
            modal.fit_modes(response, 2, (15.0, 15.1))


class TestImpactRecords:
    @pytest.mark.parametrize("duration", [8.0, 30.0])
    @pytest.mark.parametrize(
        ("frequency", "ratio", "mass", "band"),
        [(4.892, 0.0155, 8.625, (2.5, 8.0)), (44.27, 0.0049, 0.9888, (38.0, 50.0))],
    )
    def test_poles_of_a_short_record_with_an_ac_coupled_sensor(
        self, duration: float, frequency: float, ratio: float, mass: float, band: tuple[float, float]
    ) -> None:
        rate = 19200.0
        force = pulse(rate, duration)
        clean = single(force, rate, frequency, ratio, mass)
        sensed = signal.sosfilt(signal.butter(1, 0.2, "highpass", fs=rate, output="sos"), clean)
        scores = []
        for seed in range(5):
            rng = np.random.default_rng(seed)
            noisy = sensed + 0.02 * rng.standard_normal(clean.size)
            response = modal.frequency_response(force + 0.05 * rng.standard_normal(clean.size), noisy, rate)
            (mode,) = modal.fit_modes(response, 1, band)
            assert mode.natural_frequency.value == pytest.approx(frequency, rel=1e-3)
            assert mode.damping_ratio.value == pytest.approx(ratio, rel=0.03)
            assert mode.mass.value == pytest.approx(mass, rel=0.03)
            scores.append((mode.damping_ratio.value - ratio) / mode.damping_ratio.standard_error)
        assert 0.3 < np.std(scores) < 2.0

    def test_errors_cover_on_a_trembling_floor(self) -> None:
        """Ambient force, white over the band, moves the body before and after the hit."""
        rate, mass, frequency, ratio = 1200.0, 9.61, 15.77, 0.0061
        scores = []
        for seed in range(40):
            rng = np.random.default_rng(seed)
            force = np.concatenate((np.zeros(round(15 * rate)), pulse(rate, 8.0, width_s=4e-3)))
            ambient = 0.05 * rng.standard_normal(force.size)
            moved = single(force + ambient, rate, frequency, ratio, mass)[round(15 * rate) :]
            measured = moved + 1e-3 * rng.standard_normal(moved.size)
            response = modal.frequency_response(force[round(15 * rate) :], measured, rate)
            (mode,) = modal.fit_modes(response, 1, (11.0, 21.0))
            found = (mode.natural_frequency, mode.damping_ratio, mode.mass)
            scores.append(
                [
                    (e.value - t) / e.standard_error
                    for e, t in zip(found, (frequency, ratio, mass), strict=True)
                ]
            )
        spread = np.std(scores, axis=0)
        assert np.all((spread > 0.6) & (spread < 1.5)), spread
        assert np.mean(np.abs(scores) < 1.96) > 0.87

    def test_the_same_filters_on_force_and_response_leave_the_pole(self) -> None:
        rate, chain = 4800.0, FilterChain(2.0)
        force = pulse(rate, 30.0, width_s=2e-3)
        clean = single(force, rate, 4.892, 0.0155, 8.625)
        response = modal.frequency_response(force, chain.displacement(clean, rate), rate, "displacement")
        (mode,) = modal.fit_modes(response, 1, (3.5, 7.0))
        assert mode.natural_frequency.value == pytest.approx(4.892, rel=1e-4)
        assert mode.damping_ratio.value == pytest.approx(0.0155, rel=0.01)

    def test_the_damping_of_an_exponential_window_is_taken_out(self) -> None:
        rate = 4800.0
        force = pulse(rate, 8.0, width_s=2e-3)
        acceleration = single(force, rate, 15.77, 0.006, 9.6)
        response = modal.frequency_response(force, acceleration, rate, window_end=0.01)
        assert response.window_decay == pytest.approx(np.log(100) / 8.0, rel=1e-3)
        (mode,) = modal.fit_modes(response, 1, (12.0, 20.0))
        assert mode.damping_ratio.value == pytest.approx(0.006, rel=1e-3)
        assert mode.mass.value == pytest.approx(9.6, rel=1e-3)

    def test_both_modes_of_the_coupled_structure(self) -> None:
        rate = 19200.0
        matrices = coupled(9.763e5, 135.6)
        force = pulse(rate, 8.0)
        noise = 0.01 * np.random.default_rng(0).standard_normal((2, force.size))
        measured = accelerations(force, rate, *matrices) + noise
        response = modal.frequency_response(force, measured[1], rate)
        for mode, frequency, ratio in zip(
            modal.fit_modes(response, 2, (8.0, 350.0)), *complex_modes(*matrices), strict=True
        ):
            assert mode.natural_frequency.value == pytest.approx(frequency, rel=2e-3)
            assert mode.damping_ratio.value == pytest.approx(ratio, rel=0.02)

    def test_coherence_falls_with_noise_and_needs_more_than_one_hit(self) -> None:
        rate, rng = 4800.0, np.random.default_rng(0)
        force = np.stack([peak * pulse(rate, 4.0, 1.0, 2e-3) for peak in (20.0, 28.0, 35.0, 30.0)])
        clean = np.stack([single(row, rate, 15.77, 0.006, 9.6) for row in force])
        assert modal.frequency_response(force[0], clean[0], rate).coherence is None
        pure = modal.frequency_response(force, clean, rate)
        noisy = modal.frequency_response(force, clean + 0.05 * rng.standard_normal(clean.shape), rate)
        assert pure.coherence is not None
        assert noisy.coherence is not None
        peak = int(np.argmin(np.abs(pure.frequency - 15.77)))
        off = pure.frequency > 500
        assert pure.coherence[peak] > 0.9999
        assert noisy.coherence[peak] > 0.99
        assert noisy.coherence[off & (pure.frequency < 900)].mean() < 0.9

    def test_refuses_silence_unequal_shapes_and_growing_windows(self) -> None:
        force = pulse(4800.0, 1.0)
        with pytest.raises(ValueError, match="one shape"):
            modal.frequency_response(force, force[:-1], 4800.0)
        with pytest.raises(ValueError, match="Record 2 of 2 has no hit"):
            modal.frequency_response(np.stack([force, 0 * force]), np.stack([force, force]), 4800.0)
        with pytest.raises(ValueError, match="within"):
            modal.frequency_response(force, force, 4800.0, window_end=1.5)


class TestPeaks:
    RATE = 19200.0

    def displacement(
        self, ratio: float = 0.008, offset: float = 0.0, noise: float = 0.0, seed: int = 0
    ) -> FloatArray:
        time = np.arange(round(4 * self.RATE)) / self.RATE
        p = pole(15.4, ratio)
        slow = signal.sosfilt(
            signal.butter(2, 40.0, fs=self.RATE, output="sos"),
            np.random.default_rng(seed).standard_normal(time.size),
        )
        return np.imag(np.exp(p * time)) + offset + noise * slow / slow.std()  # type: ignore[no-any-return]

    def test_a_pure_ring_comes_back(self) -> None:
        x = self.displacement()
        frequency = modal.average_period_frequency(x, self.RATE)
        assert frequency.value == pytest.approx(15.4 * np.sqrt(1 - 0.008**2), rel=1e-7)
        assert modal.logarithmic_decrement(x, self.RATE).value == pytest.approx(0.008, rel=1e-6)

    def test_an_offset_cancels_between_the_signs(self) -> None:
        found = modal.logarithmic_decrement(self.displacement(offset=0.02), self.RATE)
        assert found.value == pytest.approx(0.008, rel=0.01)

    def test_errors_have_the_size_of_the_scatter(self) -> None:
        found = [
            (
                modal.average_period_frequency(self.displacement(noise=0.005, seed=seed), self.RATE),
                modal.logarithmic_decrement(self.displacement(noise=0.005, seed=seed), self.RATE),
            )
            for seed in range(40)
        ]
        for estimates, truth in zip(zip(*found, strict=True), (15.4, 0.008), strict=True):
            scores = [(e.value - truth) / e.standard_error for e in estimates]
            assert 0.6 < np.std(scores) < 1.5
            assert abs(np.mean(scores)) < 0.6

    def test_a_ripple_at_twice_the_frequency_is_dropped_and_a_faster_mode_refused(self) -> None:
        x = self.displacement()
        time = np.arange(x.size) / self.RATE
        rippled = x + np.where(time < 0.5, 0.02 * np.sin(2 * np.pi * 400 * time), 0)
        assert modal.average_period_frequency(rippled, self.RATE).value == pytest.approx(15.4, rel=2e-3)
        with pytest.raises(ValueError, match="at least 3 periods"):
            modal.average_period_frequency(np.sin(2 * np.pi * 18 * time), self.RATE)

    def test_what_has_rung_down_into_noise_is_left_out(self) -> None:
        time = np.arange(round(3 * self.RATE)) / self.RATE
        drift = 1e-3 * np.sin(2 * np.pi * 9 * time)
        x = np.imag(np.exp(pole(74.0, 0.023) * time)) + drift
        band = {"max_hz": 80.0, "min_hz": 50.0}
        assert modal.average_period_frequency(x, self.RATE, **band).value == pytest.approx(74.0, rel=5e-3)
        assert modal.logarithmic_decrement(x, self.RATE, **band).value == pytest.approx(0.023, rel=0.05)
        assert (
            modal.average_period_frequency(x, self.RATE, max_hz=80.0).value < 50
        )  # periods of the drift too

    @pytest.mark.parametrize("peaks", [0, 1, 2])
    def test_a_sign_with_few_peaks_leaves_the_error_to_the_other(self, peaks: int) -> None:
        time = np.arange(round(1.2 * self.RATE)) / self.RATE
        x = np.cos(2 * np.pi * 5 * time) * np.exp(-0.5 * time)
        late = time > peaks / 5
        x[late] = np.maximum(x[late], 1e-9)  # as where a drift lifts the motion
        found = modal.average_period_frequency(x, self.RATE)
        assert found.value == pytest.approx(5.0, rel=1e-3)
        assert 0 < found.standard_error < 0.05

    @pytest.mark.parametrize("tension", [60.0, 3000.0])
    def test_the_filter_bends_the_first_peaks_of_a_decrement_not_the_frequency(self, tension: float) -> None:
        k_c, c_c = (float(np.interp(tension, TENSIONS, values)) for values in (K_C, C_C))
        acceleration = accelerations(pulse(self.RATE, 8.0), self.RATE, *coupled(k_c, c_c))
        frequency, ratio = complex_modes(*coupled(k_c, c_c))
        x = FilterChain(5.0).displacement(acceleration[0], self.RATE)
        assert modal.average_period_frequency(x, self.RATE, start_s=0.5).value == pytest.approx(
            frequency[0], rel=2e-4
        )
        printed = modal.logarithmic_decrement(x, self.RATE, start_s=0.5).value / ratio[0] - 1
        later = modal.logarithmic_decrement(x, self.RATE, start_s=0.5, first_peak=5).value / ratio[0] - 1
        assert -0.03 < printed < -0.01
        assert abs(later) < 0.002

    def test_refuses_too_little_motion(self) -> None:
        x = self.displacement()
        with pytest.raises(ValueError, match="at least 3 peaks"):
            modal.logarithmic_decrement(x, self.RATE, duration_s=0.2)
        with pytest.raises(ValueError, match="No samples"):
            modal.average_period_frequency(x, self.RATE, start_s=100.0)


class TestJoint:
    @pytest.mark.parametrize("stiffness", np.geomspace(1e3, 1e7, 17))
    @pytest.mark.parametrize("damping", [10.0, 135.6, 970.6, 1e4])
    def test_equations_3_9_10_come_back_from_the_eigenproblem(self, stiffness: float, damping: float) -> None:
        mass, damping_matrix, stiffness_matrix = coupled(stiffness, damping)
        frequency, shapes = modal.undamped_modes(mass, stiffness_matrix)
        np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(2), atol=1e-12)
        ratio = modal.modal_damping_ratio(frequency, shapes, damping_matrix)
        k_c = modal.joint_stiffness(frequency[0], MASSES, STIFFNESS)
        c_c = modal.joint_damping(frequency[0], ratio[0], stiffness, MASSES, STIFFNESS, DAMPING)
        assert k_c == pytest.approx(stiffness, rel=1e-10)
        assert c_c == pytest.approx(damping, rel=1e-10)

    def test_equations_3_and_10_as_printed(self) -> None:
        (m_1, m_2), (k_1, k_2), (c_1, c_2) = MASSES, STIFFNESS, DAMPING
        w, zeta, k = 2 * np.pi * 15.4, 0.0123, 4.0e5
        printed = (-k_1 * k_2 + (k_2 * m_1 + k_1 * m_2) * w**2 - m_1 * m_2 * w**4) / (
            k_1 + k_2 - (m_1 + m_2) * w**2
        )
        assert modal.joint_stiffness(15.4, MASSES, STIFFNESS) == pytest.approx(printed, rel=1e-10)
        d = k_2 * m_1 - k_1 * m_2
        P = np.sqrt(k**2 * (m_1 + m_2) ** 2 + 2 * k * (m_1 - m_2) * d + d**2)
        A = (m_1 * (k + k_2) - m_2 * (k + k_1)) * (m_1 * c_2 - m_2 * c_1)
        A += (4 * m_1 * m_2 * zeta * w - m_1 * c_2 - m_2 * c_1) * P
        B = -d * (m_1 - m_2) - k * (m_1 + m_2) ** 2 + (m_1 + m_2) * P
        found = modal.joint_damping(15.4, zeta, k, MASSES, STIFFNESS, DAMPING)
        assert found == pytest.approx(A / B, rel=1e-10)

    def test_the_order_of_the_bodies_does_not_matter(self) -> None:
        arguments = (15.5, 0.01, 6e5)
        swapped = modal.joint_damping(*arguments, MASSES[::-1], STIFFNESS[::-1], DAMPING[::-1])
        assert modal.joint_damping(*arguments, MASSES, STIFFNESS, DAMPING) == pytest.approx(
            swapped, rel=1e-10
        )

    def test_printed_numbers(self) -> None:
        stiffness, damping = modal.oscillator_constants(8.625, 4.892, 0.0155)
        assert stiffness == pytest.approx(8148.7, rel=1e-5)
        assert damping == pytest.approx(8.200, rel=0.0033)  # the printed ratio is rounded to +-0.3 %
        assert modal.maximum_frequency(MASSES, (8148.7, 76500.0)) == pytest.approx(14.93, abs=0.005)
        assert modal.maximum_frequency(MASSES, STIFFNESS) == pytest.approx(16.29, abs=0.005)
        # The small oscillator's 2.696 N s/m belongs to a ratio of 0.0049, not to the printed 0.004.
        assert modal.oscillator_constants(0.9888, 44.27, 0.0049)[1] == pytest.approx(2.696, rel=1e-3)
        assert modal.oscillator_constants(0.9888, 44.27, 0.004)[1] == pytest.approx(2.200, rel=1e-3)

    def test_stiffness_turns_negative_outside_its_range(self) -> None:
        highest = modal.maximum_frequency(MASSES, STIFFNESS)
        found = modal.joint_stiffness([5.0, 15.5, highest * 1.001], MASSES, STIFFNESS)
        assert found[0] < 0 < found[1]
        assert found[2] < 0

    def test_where_the_modal_ratio_departs_from_the_complex_pole(self) -> None:
        """Mode 1 is light and good to 1.5 % everywhere; mode 2 passes 0.2 below 193 N, never 1."""
        ratios = []
        for k_c, c_c in zip(K_C, C_C, strict=True):
            mass, damping, stiffness = coupled(k_c, c_c)
            frequency, shapes = modal.undamped_modes(mass, stiffness)
            first_order = modal.modal_damping_ratio(frequency, shapes, damping)
            exact = complex_modes(mass, damping, stiffness)[1]
            ratios.append((*first_order, *exact))
        first, second, exact_first, exact_second = np.array(ratios).T
        np.testing.assert_allclose(first, exact_first, rtol=0.015)
        np.testing.assert_allclose(second, exact_second, rtol=0.01)
        assert 0.0059 < exact_first.min() < exact_first.max() < 0.015
        assert 0.07 < exact_second.min() < exact_second.max() < 0.66
        assert np.all((exact_second > 0.2) == (TENSIONS < 193))
        departure = np.abs(first / exact_first - 1)
        assert departure[0] > 0.01
        assert departure[-1] < 1e-4

    def test_a_softer_joint_of_the_same_damping_breaks_the_modal_ratio(self) -> None:
        """With 1e5 N/m the second mode is overdamped: first order is off by a sixth, the frequency by 6 %."""
        mass, damping, stiffness = coupled(1e5, 1000.0)
        frequency, shapes = modal.undamped_modes(mass, stiffness)
        first_order = modal.modal_damping_ratio(frequency, shapes, damping)
        exact_frequency, exact = complex_modes(mass, damping, stiffness)
        assert first_order[1] > 1
        assert exact.size == 1
        assert first_order[0] / exact[0] == pytest.approx(1.17, abs=0.02)
        assert exact_frequency[0] / frequency[0] == pytest.approx(1.068, abs=0.01)
