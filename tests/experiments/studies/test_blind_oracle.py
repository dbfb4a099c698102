"""What could be reached on a campaign with a known effect in it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from discovery.loop import impact_refits
from experiments.studies import rig
from experiments.studies.blind import oracle as blind_oracle
from experiments.studies.blind.oracle import declared_errors, oracle_errors
from rom.campaign.campaign import Campaign, read_campaign
from rom.evaluation.error_measures import ErrorsByKind
from rom.identification.identify import Identification, identify_campaign

pytestmark = pytest.mark.variant
SMALL = {"cases": 6, "noise": 1.0, "seed": 1, "jobs": 1, "duration_s": 2.5, "hold_out_every": 3}


@pytest.fixture(scope="module", autouse=True)
def identified_once() -> Iterator[None]:
    """Each campaign is identified once for all tests: whatever is refitted starts from there."""
    known: dict[Path, Identification] = {}

    def identify_once(campaign: Campaign, *_: object) -> Identification:
        if campaign.path not in known:  # it may be the same with its records stored
            known[campaign.path] = identify_campaign(campaign)
        return known[campaign.path]

    with pytest.MonkeyPatch.context() as patch:
        for module in (blind_oracle, impact_refits):
            patch.setattr(module, "identify_campaign", identify_once)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    hidden = rig.Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e9})
    return rig.run(tmp_path_factory.mktemp("oracle") / "campaign", **SMALL, undeclared=(hidden,))


@pytest.fixture(scope="module")
def campaign(folder: Path) -> Campaign:
    return read_campaign(folder)


@pytest.fixture(scope="module")
def twin(folder: Path) -> Campaign:
    return read_campaign(rig.run(folder.with_name("twin"), **SMALL))


@pytest.fixture(scope="module")
def truths(folder: Path) -> list[blind_oracle.Truth]:
    told: list[blind_oracle.Truth] = json.loads(rig.truth_path(folder).read_text())["undeclared"]
    return told


@pytest.fixture(scope="module")
def oracle(campaign: Campaign, twin: Campaign, truths: list[blind_oracle.Truth]) -> ErrorsByKind:
    (refitted,) = oracle_errors(campaign, twin, truths)  # a force has no true value that is held
    return refitted


def test_the_true_effect_refitted_is_as_good_as_the_declared_model_where_nothing_is_hidden(
    campaign: Campaign, twin: Campaign, oracle: ErrorsByKind
) -> None:
    name = "motion_nrmse"
    reached = oracle["hold_out"][name]
    before = declared_errors(campaign)["hold_out"][name]
    clean = declared_errors(twin)["hold_out"][name]
    assert reached is not None
    assert before is not None
    assert clean is not None
    assert reached < 0.8 * before
    assert reached == pytest.approx(clean, rel=0.05)


def test_errors_are_filtered_as_a_closure_has_them_whatever_suits_the_twin(
    campaign: Campaign,
    twin: Campaign,
    truths: list[blind_oracle.Truth],
    oracle: ErrorsByKind,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    as_it_is = blind_oracle.identify_campaign

    def otherwise(one: Campaign) -> Identification:
        found = as_it_is(one)
        if one.path == campaign.path:
            return found
        cutoffs = {kind: 3 * cutoff for kind, cutoff in found.model.filter_cutoff_hz.items()}
        return replace(found, model=replace(found.model, filter_cutoff_hz=cutoffs))

    monkeypatch.setattr(blind_oracle, "identify_campaign", otherwise)
    assert oracle_errors(campaign, twin, truths) == [oracle]


def test_an_effect_that_the_catalogue_does_not_have_there_is_refused(
    campaign: Campaign, twin: Campaign
) -> None:
    truth = {"name": "cubic-stiffness", "enters": "moon", "parameters": {"k3": {"value": 1.0}}}
    with pytest.raises(ValueError, match="no effect cubic-stiffness that can enter at moon"):
        oracle_errors(campaign, twin, [truth])


def test_faults_and_what_acts_in_the_tension_are_refitted_too_wherever_they_start(tmp_path: Path) -> None:
    hidden = (
        rig.Undeclared("acceleration-gain", "sensor:acceleration_so", {"g": 0.1}),
        rig.Undeclared("loosening-ratchet", "tension", {"r": 8.8, "x_r": 0.0, "h_r": 0.9}),
        rig.Undeclared("tension-drift", "tension", {"d": 0.5}),
    )
    still = {**SMALL, "scatter": 0.0}  # of gamma: what it does to two held-out losses would drown the rest
    folder = rig.run(tmp_path / "campaign", **still, undeclared=hidden)
    measured, twin = read_campaign(folder), read_campaign(rig.run(tmp_path / "twin", **still))
    truths = json.loads(rig.truth_path(folder).read_text())["undeclared"]
    astray = [
        {**one, "parameters": {name: {"value": 0.8 * p["value"]} for name, p in one["parameters"].items()}}
        for one in truths
    ]
    (right, true), (refound, off) = (
        [one["hold_out"] for one in oracle_errors(measured, twin, told)] for told in (truths, astray)
    )
    before = declared_errors(measured)["hold_out"]
    for name, closeness in (("motion_nrmse", 0.05), ("tension_rmse_n", 0.002)):
        assert right[name] < 0.95 * before[name]  # type: ignore[literal-required]
        assert refound[name] == pytest.approx(right[name], rel=closeness)  # type: ignore[literal-required]
        assert off[name] != pytest.approx(true[name], rel=closeness)  # type: ignore[literal-required]
