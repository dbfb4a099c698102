"""The linear fit against structures that are known: values, limits, and what no record tells."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rom.identification.ambient_noise import ambient_forces, whitener
from rom.identification.output_error import OutputErrorFit, fit_output_error
from rom.identification.small_matrices import root_of
from rom.identification.spectral_model import (
    CORNER,
    DERIVATIVE_ORDER,
    SpectralRecord,
    Term,
    linearise,
    spectrum,
)
from tests.rom.lumped import noisy, pulse, random_force, respond

RATE_HZ, SAMPLES = 1000.0, 4000
LINKS = [("s", ("m", "ground"), "linear", 4000.0, 3.0)]
ONE = np.array([1.0])


def one_body(
    motion: np.ndarray, force: np.ndarray, kind: str, *, known_mass: bool = True, start: float = 1.3
) -> SpectralRecord:
    """Return the spectra of a body of 2 kg on a spring, every free value off by the factor `start`."""
    band = (1.0, 150.0)
    frequency, lines = spectrum(force[:, None], RATE_HZ, band)
    terms = (
        Term("mass", "mass", ONE, 2.0 if known_mass else 2.0 * start, free=not known_mass),
        Term("k", "stiffness", ONE, 4000.0 * start),
        Term("c", "damping", ONE, 3.0 * start),
        *((Term(CORNER, "corner", np.zeros(1), 0.5),) if kind == "acceleration" else ()),
    )
    _, motion_lines = spectrum(motion[:, None], RATE_HZ, band)
    return SpectralRecord("a", "all", frequency, lines, motion_lines, (DERIVATIVE_ORDER[kind],), terms)


def fit_of_noise(seed: int, kind: str) -> OutputErrorFit:
    """Return a fit of one driven record with 5 % noise."""
    rng = np.random.default_rng(seed)
    force = random_force(rng, SAMPLES, RATE_HZ, 60.0)
    motion = noisy(rng, respond({"m": 2.0}, LINKS, {"m": force}, RATE_HZ)[f"{kind}_m"], 0.05)
    return fit_output_error([one_body(motion, force, kind, known_mass=False)])


@pytest.mark.parametrize("kind", ["displacement", "velocity", "acceleration"])
def test_limits_hold_the_truth_as_often_as_they_say(kind: str) -> None:
    truth = {"mass": 2.0, "k": 4000.0, "c": 3.0}
    held, offsets = [], []
    for seed in range(20):
        fit = fit_of_noise(seed, kind)
        assert fit.converged
        offset = {n: np.log(fit.value(n) / v) / fit.relative_error(n) for n, v in truth.items()}
        held += [abs(z) < 1.96 for z in offset.values()]
        offsets += list(offset.values())
    assert 0.85 <= np.mean(held) <= 1.0
    assert abs(np.mean(offsets)) < 0.7  # 60 draws in threes that go together: five standard errors
    assert np.std(offsets) == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("kind", DERIVATIVE_ORDER)
def test_a_record_that_is_cut_while_it_rings_is_told_to_the_last_digits(kind: str) -> None:
    """Its lines are sums over samples: taken for integrals they are off by half a sample of what rings."""
    force = pulse(100.0, SAMPLES, RATE_HZ, 0.5, 20e-3)
    motion = respond({"m": 2.0}, LINKS, {"m": force}, RATE_HZ)[f"{kind}_m"]
    cut = slice(0, 900)
    record = one_body(motion[cut], force[cut], kind, start=1.0)
    plain = np.ones((len(record.frequency), 1, 1), dtype=np.complex128)
    values = {term.name: 1e-12 if term.name == CORNER else term.value for term in record.terms}
    off = [
        float(np.linalg.norm(linearise(replace(record, step_s=step), values, plain).residual))
        for step in (0.0, 1 / RATE_HZ)
    ]
    assert off[1] < 5e-4 * np.linalg.norm(record.motion)
    assert off[1] < 0.2 * off[0]


def test_clean_records_give_the_truth_whether_or_not_the_sensor_has_a_corner() -> None:
    force = pulse(100.0, SAMPLES, RATE_HZ, 0.5, 8e-3)
    motion = respond({"m": 2.0}, LINKS, {"m": force}, RATE_HZ)["acceleration_m"]
    record = one_body(motion, force, "acceleration")
    for corner in (0.0, 1.2):
        s = 2j * np.pi * record.frequency[:, None]
        measured = replace(record, motion=record.motion * s / (s + corner))
        fit = fit_output_error([measured])
        assert fit.value("k") == pytest.approx(4000.0, rel=1e-4)
        assert fit.value("c") == pytest.approx(3.0, rel=5e-3)
    assert fit.value(CORNER) == pytest.approx(1.2, rel=0.1)


def test_a_free_decay_tells_the_ratios_and_leaves_the_scale_open() -> None:
    motion = respond({"m": 2.0}, LINKS, {"m": np.zeros(SAMPLES)}, RATE_HZ, np.array([0.01, 0.2]))
    samples = noisy(np.random.default_rng(4), motion["displacement_m"], 0.01)
    fit = fit_output_error([one_body(samples, np.zeros(SAMPLES), "displacement", known_mass=False)])
    assert fit.value("k") / fit.value("mass") == pytest.approx(2000.0, rel=1e-3)
    assert fit.relative_error("k") > 1.0
    assert fit.relative_error("mass") > 1.0
    bound = fit_output_error([one_body(samples, np.zeros(SAMPLES), "displacement")])
    assert bound.value("k") == pytest.approx(4000.0, rel=1e-3)
    assert bound.relative_error("k") < 1e-3


def test_samples_too_far_apart_for_the_pulse_widen_the_limits_and_shift_nothing() -> None:
    fine, coarse = 16, 1.0
    force = pulse(100.0, SAMPLES * fine, RATE_HZ * fine, 0.5003, 2.5e-3)  # two or three samples at 1 kHz
    motion = respond({"m": 2.0}, LINKS, {"m": force}, RATE_HZ * fine)["displacement_m"][::fine]
    seen = force[::fine]
    assert abs(seen.sum() / force.sum() * fine - coarse) > 5e-3
    record = one_body(motion, seen, "displacement", known_mass=False)
    blind, told = (
        fit_output_error([record]),
        fit_output_error([replace(record, sampling_errors=(0.05, 2e-5))]),
    )
    assert blind.relative_error("mass") < 2e-3 < abs(np.log(blind.value("mass") / 2.0))
    assert abs(np.log(told.value("mass") / 2.0)) < 2 * told.relative_error("mass")
    assert told.value("k") / told.value("mass") == pytest.approx(2000.0, rel=1e-3)


def test_what_is_estimated_beside_the_end_states_leaves_noise_alone_and_no_more() -> None:
    """A stiffness that scatters from record to record, 30 standard errors in one of them."""
    rng, squares, spread = np.random.default_rng(7), [], 30.0
    force = pulse(100.0, SAMPLES, RATE_HZ, 0.5, 8e-3)
    for _ in range(20):
        off = float(rng.normal())
        clean = respond({"m": 2.0}, [("s", ("m", "ground"), "linear", 4000.0, 3.0)], {"m": force}, RATE_HZ)
        record = one_body(clean["displacement_m"], force, "displacement", start=1.0)
        quiet = 1e-9 * np.ones((len(record.frequency), 1, 1))
        values = {term.name: term.value for term in record.terms}
        plain = linearise(record, values, (1 / quiet).astype(np.complex128))
        slope = plain.jacobian[:, plain.columns.index("k")]
        change = spread * slope / np.linalg.norm(slope)
        seen = replace(plain, residual=rng.normal(size=len(slope)) + off * change)
        beside = seen.beside(change)
        squares.append((float(np.mean(seen.residual**2)), float(np.mean(beside.residual**2))))
        shown = beside.projected(record.motion)
        assert abs(beside.ends[:, -1] @ shown) < 1e-9 * spread * np.linalg.norm(shown)
    before, after = np.mean(squares, axis=0)
    assert after == pytest.approx(1.0, abs=0.05)
    assert before > 1.2


def test_limits_hold_where_one_record_of_a_shaken_floor_ends_before_the_ringing_does() -> None:
    """The mode is a single line there, which end states and coefficients follow: it tells no floor."""
    links = [("s", ("m", "ground"), "linear", 4000.0, 1.0)]  # it decays in 4 s, as long as the record
    offsets = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        force = pulse(30.0, SAMPLES, RATE_HZ, 0.1, 8e-3)
        shaken = force + 0.5 * rng.normal(size=SAMPLES)
        motion = respond({"m": 2.0}, links, {"m": shaken}, RATE_HZ)["acceleration_m"]
        fit = fit_output_error([one_body(noisy(rng, motion, 0.003), force, "acceleration")])
        offsets.append(
            [np.log(fit.value(n) / v) / fit.relative_error(n) for n, v in (("k", 4000.0), ("c", 1.0))]
        )
    assert 0.4 < np.sqrt(np.mean(np.square(offsets))) < 1.6


def test_no_record_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one record"):
        fit_output_error([])


def test_ambient_forces_through_bodies_that_hardly_move_apart_leave_power_on_all_channels() -> None:
    rng = np.random.default_rng(0)
    both, apart = rng.normal(size=(2, 200, 2, 1)) + 1j * rng.normal(size=(2, 200, 2, 1))
    gain = both @ np.ones((1, 2)) + 1e-9 * apart @ np.array([[1.0, -1.0]])
    ambient = np.broadcast_to(1e12 * np.array([[1.0, -1.0], [-1.0, 1.0]]) + np.eye(2), gain.shape)
    sensor = np.array([3e-7, 8e-7])
    found = whitener(gain, root_of(ambient.astype(complex)), sensor)
    assert np.isfinite(found).all()
    together = np.linalg.norm(found @ gain @ np.ones(2) / np.sqrt(2), axis=1)
    assert together.max() < 1.0 + 1e-6  # a unit of power that S holds
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(gain @ ambient @ gain.conj().swapaxes(1, 2) + np.diag(sensor))


@pytest.mark.parametrize("bodies", [2, 3])
def test_of_a_joint_that_is_all_but_rigid_ambient_forces_are_the_least_that_do_the_same(bodies: int) -> None:
    rng = np.random.default_rng(0)
    lines = 400
    gain = np.ones((lines, bodies, bodies), dtype=complex)  # all bodies move as one
    moved = (rng.normal(size=(lines, 1)) + 1j * rng.normal(size=(lines, 1))) * np.ones((1, bodies))
    part = SimpleNamespace(gain=gain, unweighted=moved)
    found = ambient_forces(
        np.linspace(0, 100, lines),
        [part],
        np.full(bodies, 1e-9),
        [np.ones(lines)],  # type: ignore[list-item]
    )
    assert np.isfinite(found).all()
    # each takes 1 / n of the sum, whose mean square is 2
    np.testing.assert_allclose(found.mean(axis=0).real, 2 / bodies**2, rtol=0.2)
