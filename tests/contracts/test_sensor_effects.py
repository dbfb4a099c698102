"""Sensor faults against limits known in closed form; each can be undone."""

import numpy as np
import pytest

from rom.effects import CATALOGUE, SensorFault
from tests.contracts.effect_cases import drawn, members, name_of

RATE = 19200.0
TIME = np.arange(19200) / RATE


def fault(name: str, enters: str, **values) -> SensorFault:
    effect = CATALOGUE[name].at(enters).with_values(**values)
    assert isinstance(effect, SensorFault)
    return effect


def ringing(frequency=15.8) -> np.ndarray:
    """A ring that begins and ends smoothly: what falls off the end of a record is lost to a skew."""
    onset = np.clip((TIME - 0.3) / 0.05, 0, 1) * np.clip((0.98 - TIME) / 0.05, 0, 1)
    return np.sin(0.5 * np.pi * onset) ** 6 * np.sin(2 * np.pi * frequency * TIME)


@pytest.mark.parametrize("member", members("sensor"), ids=name_of)
def test_a_fault_can_be_undone(member):
    true = 50.0 * ringing() + (200.0 if "tension" in member.places[0] else 0.0)
    p = drawn(member, np.random.default_rng(1))
    effect = member.at(f"{member.places[0]}_lo").with_values(**p)
    other = 30.0 * ringing(173.0)
    shown = effect.apply(true, RATE, other)
    assert abs(shown - true).max() > 1e-3 * np.ptp(true)
    assert effect.remove(shown, RATE, other) == pytest.approx(true, abs=1e-6 * np.ptp(true))


def test_a_fault_names_its_channel():
    effect = fault("acceleration-gain", "sensor:acceleration_so")
    assert (effect.channel, effect.place) == ("acceleration_so", "sensor")


@pytest.mark.parametrize("name", ["tension-skew", "acceleration-skew"])
@pytest.mark.parametrize("tau", [3.3e-4, -1.7e-4])
def test_a_skew_is_a_delay(name, tau):
    shown = fault(name, "sensor:tension", tau=tau).apply(np.sin(2 * np.pi * 173 * TIME), RATE)
    inside = slice(200, -200)
    assert shown[inside] == pytest.approx(np.sin(2 * np.pi * 173 * (TIME - tau))[inside], abs=1e-6)


def test_hum_is_a_line_of_the_mains():
    shown = fault("hum", "sensor:force_lo", A=0.3, B=-0.4, f=50.0).apply(np.zeros_like(TIME), RATE)
    lines = np.fft.rfft(shown) * 2 / len(TIME)
    assert lines[50] == pytest.approx(0.3 + 0.4j, abs=1e-9)  # B sin is -i B in a transform
    assert abs(np.delete(lines, 50)).max() < 1e-9


def test_coupling_lets_pass_what_is_fast_and_leads_what_is_slow():
    r, frequency = 5.0, 2.0
    time = np.arange(5 * 19200) / RATE
    shown = fault("ac-coupling", "sensor:acceleration_lo", r=r).apply(
        np.sin(2 * np.pi * frequency * time), RATE
    )
    s = 2j * np.pi * frequency
    expected = np.imag(s / (s + r) * np.exp(s * time))
    assert shown[-19200:] == pytest.approx(expected[-19200:], abs=1e-4)
    step = fault("ac-coupling", "sensor:acceleration_lo", r=r).apply(np.ones_like(time), RATE)
    assert step[19200] == pytest.approx(np.exp(-r), rel=1e-2)


def test_calibration_moves_the_whole_curve():
    effect = fault("calibration-error", "sensor:tension", T_0=4.0, c_1=0.2, c_2=5e-5)
    shown = effect.apply(np.array([0.0, 100.0, 3000.0]), 4800.0)
    assert shown == pytest.approx([4.0, 124.5, 4054.0])


def test_cross_talk_needs_the_other_channel():
    effect = fault("cross-axis", "sensor:acceleration_so", epsilon=0.05)
    assert effect.apply([1.0, 2.0], RATE, [10.0, -20.0]) == pytest.approx([1.5, 1.0])
    with pytest.raises(ValueError, match="cross-axis in acceleration_so needs the acceleration of another"):
        effect.apply([1.0, 2.0], RATE)
