"""Driven bodies without measured displacements: followed by simulation, noise of their forces allowed for."""

from pathlib import Path

import numpy as np
import pytest

from discovery.loop.close_loop import close_loop
from discovery.loop.free_refits import FreeRefits
from discovery.options import Options
from rom.identification.force_noise import ForceNoise
from tests.discovery import driven_twins as twins


@pytest.mark.parametrize("kind", ["velocity", "acceleration"])
@pytest.mark.parametrize("noise_m", [2e-6, pytest.param(2e-5, marks=pytest.mark.variant)])
def test_a_sound_model_leaves_noise_alone(tmp_path: Path, kind: str, noise_m: float) -> None:
    """Noise of the force rings in the simulation; an accelerometer shows the measured force at once."""
    campaign = twins.driven(tmp_path / "clean", kind=kind, noise_m=noise_m, sizes=(1.0, 1.0))
    state = FreeRefits.of_driven(campaign, Options()).start()
    assert 0.5 < state.level < 1.1  # without force noise 2.8 to 215, with sharpened forces up to 39
    assert state.model.parameter("body.mass.mass").value == pytest.approx(2.0, rel=5e-4)
    assert state.model.parameter("guide.stiffness.k").value == pytest.approx(8000.0, rel=5e-4)
    assert state.model.parameter("guide.damping.c").value == pytest.approx(6.0, rel=2e-3)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_friction_is_named_by_an_accelerometer(tmp_path: Path) -> None:
    def friction(_x: twins.FloatArray, v: twins.FloatArray) -> twins.FloatArray:
        return np.asarray(0.8 * np.tanh(v / 1e-3))

    rubbed = {"kind": "acceleration", "extra": friction, "sizes": (1.0, 1.0), "seconds": 2.0}
    found = close_loop(twins.driven(tmp_path / "rubs", **rubbed))
    assert found.verdict == "closed"
    (first,) = found.effects
    assert first.effect.name == "coulomb-friction"
    assert first.effect.parameters["F_c"].value == pytest.approx(0.8, rel=0.01)
    before, after = (step.errors["hold_out"]["motion_nrmse"] for step in found.steps)
    assert before is not None
    assert after is not None
    assert after < 0.05 * before


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_a_spring_is_named_that_leaves_a_linear_model_out_of_phase(tmp_path: Path) -> None:
    def cubic(x: twins.FloatArray, _v: twins.FloatArray) -> twins.FloatArray:
        return 2e8 * x**3  # three times the spring at the largest deflection

    strong = {"kind": "acceleration", "extra": cubic, "sizes": (1.0, 1.0), "seconds": 1.5}
    found = close_loop(twins.driven(tmp_path / "stiffens", **strong))
    assert found.verdict == "closed"
    (only,) = found.effects
    assert only.effect.name == "cubic-stiffness"
    assert only.effect.parameters["k3"].value == pytest.approx(2e8, rel=2e-3)
    before, after = (step.errors["hold_out"]["motion_nrmse"] for step in found.steps)
    assert before is not None
    assert after is not None
    assert before > 0.5
    assert after < 0.005


def test_noise_of_a_force_is_white_behind_the_whitener() -> None:
    """White force noise through two coupled bodies, seen by two sensors, beside their own white noise."""
    rng, rate, count = np.random.default_rng(3), 200.0, 40000
    mass, damping = np.diag([1.5, 0.8]), np.array([[4.0, -1.0], [-1.0, 2.0]])
    stiffness, orders, sensor = np.array([[5e3, -2e3], [-2e3, 9e3]]), np.array([1, 2]), np.array([1e-3, 0.2])
    omega = 2j * np.pi * np.fft.rfftfreq(count, 1 / rate)[:, None, None]
    gain = omega ** orders[:, None] * np.linalg.inv(mass * omega**2 + damping * omega + stiffness)
    force = np.fft.rfft(rng.normal(0, [[0.3], [0.0]], (2, count)))
    shown = np.fft.irfft(np.einsum("fij,jf->if", gain, force), count) + rng.normal(
        0, sensor[:, None], (2, count)
    )
    system, still = (mass, damping, stiffness), np.zeros((2, 2))
    noise = ForceNoise(system, np.eye(2), np.eye(2), still, orders, sensor, np.array([0.3, 0.0]), rate)
    lines = np.fft.rfft(noise.whitened(shown / sensor[:, None])) / np.sqrt(count)
    parts = np.array_split(lines, 40, axis=1)
    found = np.array([part @ part.conj().T / part.shape[1] for part in parts])
    assert np.abs(found - np.eye(2)).max() < 0.2  # power at the first resonance was 90, all of it common


def test_excitation_up_to_the_top_of_the_band_is_not_taken_for_noise(tmp_path: Path) -> None:
    campaign = twins.driven(tmp_path / "white", kind="velocity", sizes=(1.0, 1.0), force_noise_n=4.0)
    refits = FreeRefits.of_driven(campaign, Options())
    assert all(ring.beside is None for ring in refits.rings)
    assert "top of the band" in refits.warnings[-1]
