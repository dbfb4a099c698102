"""A closed loop that starts from a law found before: which models it takes, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import discovery
import rom
from discovery.courses.tension_likelihood import rate_uncertainty_of
from discovery.loop.declared_law import declared_law
from discovery.residual.tension import TensionResidual
from experiments.studies import rig
from rom.campaign.campaign import CampaignSettings
from rom.effects import make
from rom.identification.identify import identify_campaign
from rom.model.laws import Parameter, free_form_law
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty
from tests.rom.sound_campaign import sound_settings


def campaign(**changed: Any) -> Any:
    """Settings alone: nothing else is read."""
    settings = CampaignSettings.model_validate(paper() | changed)

    def select(test: str, *, hold_out: bool) -> list[Any]:
        return [r for r in settings.record if r.test == test and r.hold_out is hold_out]

    return SimpleNamespace(
        path=Path("here"), settings=settings, select=select, digest="", digests={}, criteria=None
    )


def paper() -> dict[str, Any]:
    """A campaign of the structure of the paper's model."""
    content = sound_settings()
    content["link"][1] = {"name": "flexure_so", "between": ["so", "ground"], "law": "linear"}
    content["record"] = [r for r in content["record"] if r["test"] in ("uncoupled", "coupled", "loosening")]
    return content


def with_change(model: Model) -> Model:
    return model.with_effect(make("loosening-power", "tension", {"q_v": Parameter(-1.5, "1")}))


def test_what_a_fit_knows_of_a_changed_law_has_the_names_of_the_model() -> None:
    """The numbers of a reading that was fitted beside it are of no rate."""
    model = with_change(rom.paper_model())
    names, errors = (
        ("gamma_d", "A", "loosening_power_q_v"),
        np.array([[4.0, 0.1, 0.2], [0.1, 9.0, 0.3], [0.2, 0.3, 1.0]]),
    )
    found = rate_uncertainty_of(model, RateUncertainty.of(names, errors, (0.3, -0.1), 7))
    assert found.parameters == ("gamma_d", "tension.loosening-power.q_v")
    assert found.covariance == ((4.0, 0.2), (0.2, 1.0))
    assert (found.of_a_test(100.0), found.degrees_of_freedom) == (0.3, 7)
    assert all(model.parameter(path) for path in found.parameters[1:])


def test_the_law_of_a_model_has_the_changes_that_were_found() -> None:
    model = rom.paper_model()
    rate = model.link_laws["joint"].tension_rate
    assert rate is not None
    assert declared_law(model, campaign()) == rate
    changed = declared_law(with_change(model), campaign())
    motion = (np.array([20.0, 300.0]), 1e-5, np.array([0.02, -0.06]))
    expected = rate.rate(*motion) * (np.abs(motion[2]) / 0.05) ** -1.5
    np.testing.assert_allclose(changed.rate(*motion), expected, rtol=1e-12)
    # the same change may be found in it once more
    again = with_change(model.with_tension_law(changed))
    np.testing.assert_allclose(
        declared_law(again, campaign()).rate(*motion),
        expected * (np.abs(motion[2]) / 0.05) ** -1.5,
        rtol=1e-12,
    )


def test_a_model_of_another_structure_is_one_clear_line() -> None:
    other = campaign(body=[{"name": "lo"}, {"name": "top"}], link=[
        {"name": "flexure_lo", "between": ["lo", "ground"], "law": "linear"},
        {"name": "joint", "between": ["lo", "top"], "law": "bolted"},
    ], record=[{"file": "a.h5", "test": "loosening"}])  # fmt: skip
    with pytest.raises(ValueError, match="model: found bodies lo, so and links") as refused:
        discovery.close_loop(other, model=rom.paper_model())
    assert "expected the structure of here: bodies lo, top and links" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_campaign_without_a_bolt_or_without_loosening_takes_no_law() -> None:
    content = paper()
    no_bolt = campaign(
        link=content["link"][:2], bolt=None, record=[{"file": "a.h5", "test": "uncoupled", "bodies": ["lo"]}]
    )
    with pytest.raises(ValueError, match="here: found 0 bolted links, expected one bolt"):
        declared_law(rom.paper_model(), no_bolt)
    still = campaign(record=[r for r in content["record"] if r["test"] != "loosening"])
    with pytest.raises(ValueError, match="here: found no loosening record to fit, expected one bolt"):
        declared_law(rom.paper_model(), still)


@pytest.mark.variant
def test_from_the_law_that_a_bolt_follows_no_change_of_it_is_named(tmp_path: Path) -> None:
    """The bolt follows ``|v|^2 T gamma(T)``; the given law has that form and the numbers of another."""
    rig.run(
        tmp_path / "campaign", 8, 1.0, 3, 1, duration_s=2.5, strengths=(1.0, 0.7), law="power-2",
        hold_out_every=5,
    )  # fmt: skip
    measured = rom.read_campaign(tmp_path / "campaign")
    numbers = {"gamma": (1e7, "s/m^2"), "n": (2.3, "1"), "gamma_i": (6.0, "1"), "rho": (-0.006, "1/N")}
    limited = {n: Parameter(v, unit, v - abs(v) / 2, v + abs(v) / 2) for n, (v, unit) in numbers.items()}
    rate = "-gamma * abs(v) ** n * max(T, 0) * 10 ** (-gamma_i / (1 + exp(rho * max(T, 0))))"
    law = free_form_law("found elsewhere", rate, "tension rate", limited)
    found = discovery.close_loop(measured, model=rom.paper_model().with_tension_law(law))
    assert found.verdict == "no-effect"
    refitted = found.model.link_laws["joint"].tension_rate
    assert refitted is not None
    assert refitted.equation == rate
    # two half-widths of its 95 % limits; the start was 0.3 off
    assert refitted.parameters["n"].value == pytest.approx(2.0, abs=0.05)
    identification = identify_campaign(measured)
    standing = TensionResidual(measured, identification, replace(identification.model, identification=None))
    assert standing.misfit.level > 10  # gamma(T) |v|^4 T leaves far more than noise
