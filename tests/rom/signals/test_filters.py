import runpy
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy import integrate, signal

from rom.signals.decimation import decimate
from rom.signals.filters import FilterChain, find_impact, for_straight_lines, split_tension

FloatArray = npt.NDArray[np.float64]

TABLE = runpy.run_path(str(Path(__file__).parents[3] / "benchmarks" / "tension_split.py"))
RATE_HZ, WINDOW_S, IMPACT_S, IMPACT, STEP_N = (
    TABLE[name] for name in ("RATE_HZ", "WINDOW_S", "IMPACT_S", "IMPACT", "STEP_N")
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20250)


def ring(
    rate_hz: float, duration_s: float, start_s: float = 0.5
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Displacement, velocity, acceleration of a 15.8 Hz ring that starts smoothly at start_s."""
    time = np.arange(round(rate_hz * duration_s)) / rate_hz
    since = np.maximum(time - start_s, 0)
    pole = 2 * np.pi * 15.8 * (-0.01 + 1j)
    rise = 200.0  # (1 - exp(-rise t))^4 keeps all three continuous
    terms = [(1, 0), (-4, 1), (6, 2), (-4, 3), (1, 4)]
    motion = [
        sum(c * (pole - n * rise) ** d * np.exp((pole - n * rise) * since) for c, n in terms)
        for d in range(3)
    ]
    return tuple(np.where(time >= start_s, np.imag(values), 0.0) for values in motion)  # type: ignore[return-value]


def hit(
    rate_hz: float, peak: float, at_s: float, duration_s: float = 1.05e-3, record_s: float = 2.0
) -> FloatArray:
    time = np.arange(round(rate_hz * record_s)) / rate_hz - at_s
    return np.where((time >= 0) & (time < duration_s), peak * np.sin(np.pi * time / duration_s), 0.0)


def test_chain_is_the_printed_one_away_from_the_edges(rng: np.random.Generator) -> None:
    rate = 4800.0
    acceleration = ring(rate, 8)[2] + rng.standard_normal(round(8 * rate))
    b, a = signal.butter(3, 5.0, "highpass", fs=rate)
    expected = signal.filtfilt(b, a, acceleration)
    for _ in range(2):
        expected = integrate.cumulative_trapezoid(expected, dx=1 / rate, initial=0)
        expected = signal.filtfilt(b, a, expected)
    found = FilterChain(5.0).displacement(acceleration, rate)
    inside = slice(round(rate), -round(rate))
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-4 * np.abs(expected).max())


def test_edges_are_quieter_than_with_the_padding_of_filtfilt(rng: np.random.Generator) -> None:
    """Against the same chain over a record that goes on: for noise, and for a ring cut at both ends."""
    rate, chain = 4800.0, FilterChain(5.0)
    sections = signal.butter(3, 5.0, "highpass", fs=rate, output="sos")
    cut, edge = slice(24000, 43200), slice(0, 1440)
    turn = 2 * np.pi * 15.8 * np.arange(67200) / rate
    for factor, kind in ((0.3, "noise"), (0.8, "ring")):
        ours, theirs = [], []
        for _ in range(10):
            record = (
                rng.standard_normal(67200) if kind == "noise" else np.cos(turn + rng.uniform(0, 2 * np.pi))
            )
            truth = chain.displacement(record, rate)[cut]
            short = signal.sosfiltfilt(sections, record[cut])
            for _ in range(2):
                short = integrate.cumulative_trapezoid(short, dx=1 / rate, initial=0)
                short = signal.sosfiltfilt(sections, short)
            ours.append((chain.displacement(record[cut], rate) - truth)[edge])
            theirs.append((short - truth)[edge])
        assert np.std(ours) < factor * np.std(theirs), kind


def test_chain_recovers_motion_whose_frequency_is_far_above_the_cutoff() -> None:
    displacement, velocity, acceleration = ring(19200, 8)
    chain = FilterChain(1.0)
    late = slice(19200, 3 * 19200)
    for found, expected in (
        (chain.displacement(acceleration, 19200), displacement),
        (chain.velocity(acceleration, 19200), velocity),
        (chain.integrated(velocity, 19200, 1), displacement),
        (chain.integrated(displacement, 19200, 0), displacement),
    ):
        np.testing.assert_allclose(found[late], expected[late], atol=4e-3 * np.abs(expected).max())


def test_like_compares_with_like_whichever_channel_was_measured() -> None:
    """Filters and integration commute up to edges and the trapezoid: three passes on each side agree."""
    displacement, velocity, acceleration = ring(19200, 4)
    chain = FilterChain(5.0)
    expected = chain.highpass(displacement, 19200, passes=3)
    inside = slice(4800, -19200)
    limit = 2e-3 * np.abs(expected).max()
    np.testing.assert_allclose(chain.displacement(acceleration, 19200)[inside], expected[inside], atol=limit)
    twice = chain.highpass(displacement, 19200, passes=2)
    np.testing.assert_allclose(chain.integrated(velocity, 19200, 1)[inside], twice[inside], atol=limit)


def test_chain_has_no_phase_and_halves_the_amplitude_at_the_cutoff() -> None:
    time = np.arange(40000) / 1000.0
    for frequency, gain in ((5.0, 0.5), (50.0, 1.0), (1.0, 6.4e-5)):
        wave = np.sin(2 * np.pi * frequency * time)
        found = FilterChain(5.0).highpass(wave, 1000.0)[15000:25000]
        assert np.abs(found - gain * wave[15000:25000]).max() < 2e-3 * gain + 1e-5


def test_rows_are_filtered_as_if_alone(rng: np.random.Generator) -> None:
    rows = rng.standard_normal((2, 3, 3000))
    together = FilterChain(5.0).displacement(rows, 1000.0)
    np.testing.assert_array_equal(together[1, 2], FilterChain(5.0).displacement(rows[1, 2], 1000.0))


@pytest.mark.parametrize(("rows", "samples"), [(4, 3000), (21, 700), (5, 90)])  # the last: shorter than a pad
@pytest.mark.parametrize("times", [0, 2])
def test_many_rows_side_by_side_are_as_each_alone(
    rows: int, samples: int, times: int, rng: np.random.Generator
) -> None:
    signals = rng.standard_normal((rows, samples)) + 3.0
    alone = np.stack([FilterChain(5.0).integrated(row, 1000.0, times) for row in signals])
    together = FilterChain(5.0).integrated(signals, 1000.0, times)
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-12 * np.abs(alone).max())


@pytest.mark.parametrize(
    ("chain", "samples", "message"),
    [
        ((5.0, 3), np.ones(1), "at least 2 samples"),
        ((5.0, 3), np.array([0.0, np.nan, 1.0]), "1 samples are not"),
        ((500.0, 3), np.ones(100), "half the sampling rate"),
        ((1e-7, 3), np.ones(100), "above 1e-08 of that rate"),
    ],
)
def test_chain_refuses_what_it_cannot_filter(
    chain: tuple[float, int], samples: FloatArray, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        FilterChain(*chain).highpass(samples, 1000.0)


@pytest.mark.parametrize("arguments", [(0.0,), (-1.0,), (np.nan,), (5.0, 0)])
def test_chain_refuses_settings_that_cannot_be(arguments: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="must be"):
        FilterChain(*arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(("rate", "target"), [(19200.0, 4800.0), (1000.0, 300.0), (5000.0, 4800.0)])
def test_decimation_keeps_what_is_below_and_removes_what_would_fold(rate: float, target: float) -> None:
    time, coarse = np.arange(round(4 * rate)) / rate, np.arange(round(4 * target)) / target
    kept = decimate(3000 + np.sin(2 * np.pi * 0.3 * target * time), rate, target)
    assert kept.size == coarse.size
    inside = slice(60, -60)
    np.testing.assert_allclose(
        kept[inside], 3000 + np.sin(2 * np.pi * 0.3 * target * coarse[inside]), atol=2e-3 * 3
    )
    fold = min(0.55 * target, 0.49 * rate)
    if fold > 0.5 * target:
        assert np.abs(decimate(np.sin(2 * np.pi * fold * time), rate, target)[inside]).max() < 2e-3


def test_decimation_leaves_a_level_alone_up_to_the_last_sample() -> None:
    np.testing.assert_allclose(decimate(np.full(10000, 3000.0), 19200.0, 4800.0), 3000.0, rtol=1e-3)


@pytest.mark.parametrize("target", [0.0, -1.0, 20000.0, 19200 / np.pi])
def test_decimation_refuses_other_ratios(target: float) -> None:
    with pytest.raises(ValueError, match="simple fraction"):
        decimate(np.ones(100), 19200.0, target)


@pytest.mark.parametrize("rate", [19200.0, 4800.0])
@pytest.mark.parametrize(("peak", "noise"), [(28.0, 0.3), (-28.0, 0.3), (1600.0, 2.0), (28.0, 0.0)])
def test_impact_is_found_within_two_tenths_of_a_millisecond(
    rate: float, peak: float, noise: float, rng: np.random.Generator
) -> None:
    for _ in range(10):
        at = rng.uniform(0.1, 1.5)
        force = hit(rate, peak, at) + noise * rng.standard_normal(round(2 * rate)) + 0.7
        found = find_impact(force, rate)
        assert found is not None
        assert abs(found - at) < 2e-4 + 1 / rate


def test_impact_is_the_first_of_two_hits_and_not_a_spike() -> None:
    force = hit(19200, 100.0, 0.5) + hit(19200, 150.0, 0.53)
    force[1000] = 900.0
    assert find_impact(force, 19200.0) == pytest.approx(0.5, abs=1e-4)


def test_impact_of_a_quantised_force() -> None:
    force = np.round(hit(19200, 28.0, 0.5) / 0.5) * 0.5
    force[::7] += 0.5
    assert find_impact(force, 19200.0) == pytest.approx(0.5, abs=2e-4)


def test_impact_beside_a_hum_of_a_seventh_of_it(rng: np.random.Generator) -> None:
    time = np.arange(2 * 19200) / 19200
    hum = 4.0 * np.sin(2 * np.pi * 51 * time) + 0.15 * rng.standard_normal(time.size)
    assert find_impact(hit(19200, 28.0, 0.5) + hum, 19200.0) == pytest.approx(0.5, abs=4e-4)
    assert find_impact(hum, 19200.0) is None


def test_no_impact_in_noise_silence_or_a_driven_force(rng: np.random.Generator) -> None:
    time = np.arange(100_000) / 19200
    assert find_impact(rng.standard_normal(500_000), 19200.0) is None
    assert find_impact(np.full(1000, 3.0), 19200.0) is None
    assert find_impact(50 * np.sin(2 * np.pi * 3 * time), 19200.0) is None
    assert find_impact(np.where((time > 1) & (time < 1.5), 30.0, 0.0), 19200.0) is None


@pytest.mark.parametrize("time_constant_ms", TABLE["TIME_CONSTANTS_MS"])
@pytest.mark.parametrize(
    ("amplitude", "noise", "mean", "early", "late"), [(1, 0.02, 2, 2.5, 0.5), (10, 1, 3, 7, 1)]
)
def test_split_bias_on_known_steps(
    time_constant_ms: float, amplitude: float, noise: float, mean: float, early: float, late: float
) -> None:
    """Bounds in percent of the step; plain moving means err by 8 to 30 % in the first 60 ms."""
    found = TABLE["errors"](TABLE["ours"], time_constant_ms, amplitude, noise)
    assert np.all(np.abs(found) < (mean, early, late))


def test_split_keeps_the_step_sharp_and_adds_up() -> None:
    tension = TABLE["known_tension"](0.5)
    smooth, oscillatory = split_tension(tension, RATE_HZ, WINDOW_S, IMPACT_S)
    np.testing.assert_allclose(smooth + oscillatory, tension, rtol=1e-14)
    np.testing.assert_allclose(smooth[:IMPACT], 150.0, rtol=1e-12)
    assert smooth[IMPACT + round(0.005 * RATE_HZ)] == pytest.approx(150 + STEP_N, abs=0.05 * abs(STEP_N))


def test_split_is_linear_so_that_its_bias_cancels_between_two_sides(rng: np.random.Generator) -> None:
    one, two = rng.standard_normal((2, 9600))
    parts = [split_tension(values, RATE_HZ, WINDOW_S, 0.5)[0] for values in (one, two, 2 * one - 3 * two)]
    np.testing.assert_allclose(2 * parts[0] - 3 * parts[1], parts[2], atol=1e-10)


def test_split_cancels_an_oscillation_up_to_the_edges_without_an_impact() -> None:
    time = np.arange(9600) / RATE_HZ
    smooth, _ = split_tension(500 + 5 * np.sin(2 * np.pi * 15.8 * time), RATE_HZ, 2 / 15.8)
    np.testing.assert_allclose(smooth, 500, atol=0.02)


def test_split_of_a_record_shorter_than_its_window_is_its_mean() -> None:
    smooth, _ = split_tension(np.arange(100.0), RATE_HZ, 1.0, impact_s=0.0)
    np.testing.assert_allclose(smooth, 49.5)


@pytest.mark.parametrize(
    ("window", "impact", "periods"), [(1e-5, None, 2), (0.1, 9.0, 2), (0.1, -1.0, 2), (0.1, None, 0)]
)
def test_split_refuses_windows_and_impacts_that_cannot_be(
    window: float, impact: float | None, periods: int
) -> None:
    with pytest.raises(ValueError, match="must"):
        split_tension(np.ones(4800), RATE_HZ, window, impact, periods)


@pytest.mark.parametrize(("terms", "next_term"), [(2, 560), (4, 16632)])
@pytest.mark.parametrize("cycles_per_sample", [0.01, 0.05, 0.1, 0.16])
def test_straight_lines_keep_the_amplitude(cycles_per_sample: float, terms: int, next_term: int) -> None:
    """Lines weaken a wave by sinc^2; what is left after the correction is the next term of the series."""
    wave = np.cos(2 * np.pi * cycles_per_sample * np.arange(1000))
    gain = (for_straight_lines(wave, terms) / wave)[500]
    left = gain * np.sinc(cycles_per_sample) ** 2 - 1
    s = 4 * np.sin(np.pi * cycles_per_sample) ** 2
    assert -1.3 * s ** (terms + 1) / next_term - 1e-9 < left < 1e-9
    assert abs(left) < 0.1 * abs(np.sinc(cycles_per_sample) ** 2 - 1)
