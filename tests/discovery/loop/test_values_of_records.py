"""Records with masses and springs of their own: laws and verdicts over all of them together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rom
from discovery.courses.fit import fit
from discovery.courses.frozen_motion import freeze
from discovery.courses.prediction import resimulate
from discovery.laws.candidate import Candidate, Term
from discovery.laws.factors import tension_power, velocity_power
from discovery.loop.close_loop import close_loop
from rom.campaign.campaign import Campaign
from tests.rom.identification.test_values_of_records import hold_out_error, identified_block
from tests.rom.lumped import campaign, noisy, random_force, respond

STIFFNESS, DAMPING = 4000.0, 8.0


def one_body(folder: Path, test: str, own: bool = True) -> Campaign:
    """A body of 2 kg, with 0.8 kg more in every second record and a spring of 5500 N/m in every third."""
    rng, records, rate, samples = np.random.default_rng(4), [], 500.0, 3000
    for i in range(6):
        mass, k = 2.0 + 0.8 * (i % 2), 5500.0 if i % 3 == 1 else STIFFNESS
        force = 10 * random_force(rng, samples, rate, 20.0) if test == "driven" else np.zeros(samples)
        initial = rng.normal(0, [0.01, 0.3]) if test == "free" else None
        link = ("s", ("m", "ground"), "linear", k, DAMPING)
        x = respond({"m": mass}, [link], {"m": force}, rate, initial)["displacement_m"]
        shown = {"displacement_m": noisy(rng, x, 0.002)}
        shown |= {"force_m": noisy(rng, force, 0.002)} if test == "driven" else {}
        given: dict[str, Any] = {"mass_kg": {"m": mass}, "stiffness_n_per_m": {"s": k}} if own else {}
        kept = {key: table for key, table in given.items() if (i % 2 if key == "mass_kg" else i % 3 == 1)}
        records.append(({"file": f"{i}.h5", "test": test, "hold_out": i > 3, **kept}, shown))
    return campaign(folder, {"m": 2.0}, [("s", ("m", "ground"), "linear", 0.0, 0.0)], records, rate)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.parametrize("test", ["driven", "free"])
def test_nothing_is_found_where_added_masses_and_other_springs_are_given(tmp_path: Path, test: str) -> None:
    found = close_loop(one_body(tmp_path / "c", test))
    assert found.verdict == "no-effect"
    assert found.model.parameter("s.stiffness.k").value == pytest.approx(STIFFNESS, rel=2e-3)
    assert found.model.parameter("s.damping.c").value == pytest.approx(DAMPING, rel=2e-2)
    error = found.steps[-1].errors["hold_out"]["motion_nrmse"]
    assert error is not None
    assert error < 0.01
    blind = one_body(tmp_path / "blind", test, own=False)
    assert hold_out_error(rom.identify(blind), blind) > 0.1


def test_a_tension_law_over_tests_with_and_without_an_added_mass() -> None:
    _, _, model = identified_block()
    assert model.identification is not None
    courses = model.identification.courses
    blind = tuple(replace(course, given={}) for course in courses)
    start = Candidate("power", (Term(velocity_power(3.5), tension_power(1.0)),), (500.0,))
    (fitted, motion), (wrong, _) = ((fit(start, m), m) for m in (freeze(model, c) for c in (courses, blind)))
    exponent = fitted.candidate.parameters["n"].value
    assert exponent == pytest.approx(4.0, abs=0.05)
    assert fitted.tau(100.0) < 0.02  # one rate for all tests
    assert wrong.tau(100.0) > 0.1
    simulated = resimulate(fitted.candidate, motion, fitted.deviations)
    assert np.abs(simulated - motion.change)[:, -1].max() < 1.0
