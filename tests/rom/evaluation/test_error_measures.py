"""Error measures on records that the model itself made, and on ones of which it cannot say anything."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from rom.campaign.campaign import WindowSettings
from rom.campaign.channels import Channel
from rom.evaluation.error_measures import Comparison, compare, compare_all, simulate_measurement, summarise
from rom.model.laws import (
    constant_damping,
    constant_stiffness,
    logistic_stiffness,
    no_loosening,
    power_loosening,
)
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from rom.signals.filters import FilterChain
from rom.signals.motion import Motion
from rom.signals.processing import Measurement, TensionRecord
from tests.rom.lumped import pulse, respond

RATE_HZ, SAMPLES = 4800.0, 9600
WINDOWS = WindowSettings(initial_s=(0.0, 0.2), final_s=(1.0, 8.0))
MASSES = {"a": 3.0, "b": 1.0}
LINKS = [
    ("ga", ("a", "ground"), "linear", 9000.0, 5.0),
    ("bg", ("ground", "b"), "linear", 20000.0, 3.0),
    ("joint", ("b", "a"), "bolted", 2e5, 80.0),
]
FORCE = pulse(500.0, SAMPLES, RATE_HZ, 0.3)


def model(loosening: float = 0.0) -> Model:
    """Return the structure of `LINKS`, its bolt at constant stiffness."""
    laws = {
        name: LinkLaws(
            constant_stiffness(k),
            constant_damping(c),
            None if law != "bolted" else power_loosening(loosening) if loosening else no_loosening(),
        )
        for name, _, law, k, c in LINKS
    }
    bodies = tuple(Body(name, mass) for name, mass in MASSES.items())
    return Model(Structure(bodies, tuple(Link(n, *ends, law) for n, ends, law, _, _ in LINKS)), laws)


def tension(samples: np.ndarray) -> TensionRecord:
    """Return a tension as processed: the windows' means, nothing oscillating."""
    initial, final = float(samples[: int(0.2 * RATE_HZ)].mean()), float(samples[int(RATE_HZ) :].mean())
    return TensionRecord(samples, samples, RATE_HZ, initial, final, 0.0, 0.0, 1.0)


def measurement(test: str, motion: dict[str, Motion], **others: object) -> Measurement:
    """Return a record without noise."""
    made = Measurement(
        file="a.h5",
        test=test,
        hold_out=False,
        preload_n=None,
        rate_hz=RATE_HZ,
        samples=SAMPLES,
        force={"a": FORCE},
        force_noise={"a": 0.0},
        strongest_hz=20.0,
        motion=motion,
        impact_s=0.3,
        chain=FilterChain(5.0),
        tension=None,
        link={},
    )
    return replace(made, **others)  # type: ignore[arg-type]


def seen(kind: str, links: list = LINKS, bodies: tuple[str, ...] = ("a", "b")) -> dict[str, Motion]:
    """Return what a sensor sees of the true structure."""
    out = respond({body: MASSES[body] for body in bodies}, links, {bodies[0]: FORCE}, RATE_HZ)
    return {body: Motion(kind, out[f"{kind}_{body}"]) for body in bodies}  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["displacement", "velocity", "acceleration"])
def test_the_true_model_has_no_error(kind: str) -> None:
    found = compare(model(), measurement("coupled", seen(kind), preload_n=100.0), WINDOWS)
    assert found.finished
    assert max(found.motion_nrmse.values()) < 2e-3
    assert found.relative_motion_nrmse < 2e-2  # a difference of nearly equal motions


def test_a_wrong_model_has_an_error_of_its_size() -> None:
    wrong = model().with_values({"ga.stiffness.k": 1.2 * 9000.0})
    found = compare(wrong, measurement("coupled", seen("displacement"), preload_n=100.0), WINDOWS)
    assert min(found.motion_nrmse.values()) > 0.1


def test_an_error_whose_square_is_no_number_is_one() -> None:
    huge = measurement("coupled", seen("displacement"), preload_n=100.0, force={"a": 1e200 * FORCE})
    found = compare(model(), huge, WINDOWS)
    assert all(1e199 < error < 1e201 for error in found.motion_nrmse.values())


def test_models_side_by_side_are_as_each_alone() -> None:
    stiff = [model().with_values({"ga.stiffness.k": k}) for k in (8000.0, 9000.0, 1e4)]
    runaway = model().with_values({"ga.stiffness.k": -1e9})
    samples = np.where(np.arange(SAMPLES) < 0.3 * RATE_HZ, 200.0, 150.0)
    record = measurement("loosening", seen("acceleration"), tension=tension(samples))
    together = compare_all([stiff[0], runaway, *stiff[1:]], record, WINDOWS)
    assert [found.finished for found in together] == [True, False, True, True]
    for one, found in zip(stiff, (together[0], *together[2:]), strict=True):
        alone = compare(one, record, WINDOWS)
        assert found.motion_nrmse == pytest.approx(alone.motion_nrmse, rel=1e-9)
        assert found.relative_motion_nrmse == pytest.approx(alone.relative_motion_nrmse, rel=1e-9)
        assert found.simulated_final == alone.simulated_final


def test_a_body_at_rest_is_ground_and_the_bolt_is_out() -> None:
    between = ("tie", ("a", "b"), "linear", 4000.0, 2.0)
    alone = [LINKS[0], ("tie", ("a", "ground"), "linear", 4000.0, 2.0)]
    full = model()
    links = (*full.structure.links, Link("tie", "a", "b", "linear"))
    laws = {**full.link_laws, "tie": LinkLaws(constant_stiffness(between[3]), constant_damping(between[4]))}
    tied = replace(full, structure=replace(full.structure, links=links), link_laws=laws)
    record = measurement("uncoupled", seen("acceleration", alone, ("a",)))
    assert compare(tied, record, WINDOWS).motion_nrmse["a"] < 2e-3
    assert set(simulate_measurement(tied, record).displacement) == {"a"}


def test_a_free_decay_finds_its_own_state() -> None:
    silent = respond(MASSES, LINKS, {"a": np.zeros(SAMPLES)}, RATE_HZ, np.array([0.01, 0.0, -0.1, 0.4]))
    motion = {body: Motion("displacement", silent[f"displacement_{body}"]) for body in MASSES}
    record = measurement("free", motion, force={}, force_noise={}, impact_s=None, preload_n=50.0)
    assert max(compare(model(), record, WINDOWS).motion_nrmse.values()) < 1e-3


def test_tension_is_compared_over_the_campaigns_windows() -> None:
    samples = np.where(np.arange(SAMPLES) < 0.3 * RATE_HZ, 200.0, 150.0)
    record = measurement("loosening", seen("displacement"), tension=tension(samples))
    found = compare(model(), record, WINDOWS)
    assert (found.initial_tension, found.measured_final, found.simulated_final) == (200.0, 150.0, 200.0)
    assert found.tension_rmse == pytest.approx(50.0, rel=1e-3)
    errors = summarise([found])
    assert errors["final_tension_error_percent_max"] == pytest.approx(100 * 50 / 150)
    assert errors["tension_loss_error_percent_median"] == pytest.approx(100.0)


@pytest.mark.parametrize("level", [0.0, 80.0])
def test_no_loss_and_no_tension_divide_nothing_by_zero(level: float) -> None:
    record = measurement("loosening", seen("displacement"), tension=tension(np.full(SAMPLES, level)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        errors = summarise([compare(model(), record, WINDOWS)])
    assert errors["tension_loss_error_percent_median"] is None
    assert errors["final_tension_error_percent_median"] == (None if level == 0 else 0.0)
    assert errors["tension_rmse_n"] == pytest.approx(0.0, abs=1e-12)


def test_what_cannot_be_simulated_is_not_measured() -> None:
    laws = model().link_laws
    curve = replace(laws["joint"], stiffness=logistic_stiffness(2e5, -0.05, 2.0))
    needs = replace(model(), link_laws={**laws, "joint": curve})
    record = measurement("coupled", seen("displacement"))
    assert compare(needs, record, WINDOWS) == Comparison("a.h5", "coupled", True, {})
    assert compare(model(), record, WINDOWS).motion_nrmse["a"] < 2e-3  # constant laws need no tension
    with pytest.raises(ValueError, match=r"a\.h5: found no strain, tension or preload_n"):
        simulate_measurement(needs, record)


def test_a_simulation_that_diverges_is_counted_not_averaged() -> None:
    wild = model(loosening=-1e10)
    record = measurement("loosening", seen("displacement"), tension=tension(np.full(SAMPLES, 500.0)))
    good = compare(model(), record, WINDOWS)
    errors = summarise([good, compare(wild, record, WINDOWS)])
    assert (errors["records"], errors["failed"]) == (2, 1)
    assert errors["motion_nrmse"] == pytest.approx(np.mean(list(good.motion_nrmse.values())))


def test_a_driven_link_is_judged_by_its_force() -> None:
    time = np.arange(SAMPLES) / RATE_HZ
    displacement, velocity = 1e-3 * np.sin(30 * time), 0.03 * np.cos(30 * time)
    link = {
        "link_displacement_joint": Channel("link_displacement_joint", displacement, RATE_HZ),
        "link_force_joint": Channel("link_force_joint", 2e5 * displacement + 80.0 * velocity, RATE_HZ),
    }
    record = measurement("cycled", {}, force={}, impact_s=None, link=link)
    found = compare(model(), record, WINDOWS)
    assert found.link_force_nrmse < 2e-3
    assert summarise([found])["motion_nrmse"] is None


def test_nothing_is_null_not_nan() -> None:
    errors = summarise([])
    assert errors == dict.fromkeys(errors, None) | {"records": 0, "failed": 0}
    rest = compare(model(), measurement("hold", {}, force={}, impact_s=None), WINDOWS)
    assert summarise([rest])["motion_nrmse"] is None
