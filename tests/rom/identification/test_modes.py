"""Modes of a beam from its accelerometers: poles, shapes and modal masses against the truth."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

import rom
from rom.evaluation.evaluate import evaluate
from rom.identification.identify import Identification, identify_campaign
from rom.identification.modal_complexity import phase_collinearities
from rom.identification.modal_fit import fit_modes
from rom.identification.modal_model import _pole_number
from rom.identification.modal_responses import ModalRecord
from rom.identification.ring_down import ring_down
from rom.model.laws import Parameter
from rom.signals.measured_records import measured_record
from tests.rom import beams


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> rom.Campaign:
    return beams.campaign(tmp_path_factory.mktemp("beam") / "folder", noise=0.02)


@pytest.fixture(scope="module")
def found(campaign: rom.Campaign) -> Identification:
    return identify_campaign(campaign)


def _near(number: Parameter, truth: float, accuracy: float) -> None:
    """Within an accuracy, and within twice the 95 % limits: of many numbers some are outside these."""
    assert number.low is not None
    assert number.high is not None
    assert number.value == pytest.approx(truth, abs=accuracy)
    assert abs(number.value - truth) < number.high - number.low


def test_poles_shapes_and_masses(found: Identification) -> None:
    truth = beams.shapes()
    for k, mode in enumerate(found.modes):
        _near(mode.frequency_hz, beams.FREQUENCY[k], 1e-4 * beams.FREQUENCY[k])
        _near(mode.damping_ratio, beams.RATIO[k], 0.02 * beams.RATIO[k])
        mass = next(body.mass for body in found.model.structure.bodies if body.name == mode.name)
        assert mass == pytest.approx(beams.MASS, rel=0.02)
        assert mode.shape["tip"].value == 1.0
        for s, place in enumerate(beams.PLACES):
            if place != "tip":
                _near(mode.shape[place], truth[s, k], 4e-3)
    assert not found.warnings


def test_a_model_of_modes_is_written_read_and_predicts(found: Identification, tmp_path: Path) -> None:
    """Other records, with little noise: that of an accelerometer is large in a displacement."""
    found.model.save(tmp_path / "model.json")
    model = rom.load_model(tmp_path / "model.json")
    assert model == found.model
    assert model.shapes is not None
    assert model.shapes.at(("tip",)).tolist() == [[1.0, 1.0]]
    assert pickle.loads(pickle.dumps(model)) == model  # as processes exchange it
    quiet = beams.campaign(tmp_path / "quiet", noise=5e-4, seed=1)
    (held, *_) = evaluate([model], quiet, quiet.select("driven", hold_out=True))
    errors = held.comparisons[0].motion_nrmse
    assert set(errors) == set(beams.PLACES)
    assert errors["tip"] < 0.01
    text = found.summary()
    assert "natural frequency 6.5" in text
    assert "mode_2 shows" in text


@pytest.mark.parametrize("without", [(), ("middle",)])
def test_drive_points_may_differ_between_records(without: tuple[str, ...], tmp_path: Path) -> None:
    """With an accelerometer at one of them the masses are told, and the shape at the other one too."""
    drives = ("middle", "outer")
    found = identify_campaign(beams.campaign(tmp_path / "c", noise=0.02, drives=drives, without=without))
    _require_the_beam(found, without)
    assert not found.warnings


def test_a_held_out_record_that_is_driven_where_no_shape_is_known_is_named(tmp_path: Path) -> None:
    drives = (*4 * ("middle",), "outer")
    campaign = beams.campaign(tmp_path / "c", noise=0.02, drives=drives, without=("outer",))
    model = identify_campaign(campaign).model
    with pytest.raises(ValueError, match=r"records/4\.h5: force_outer: found no mode shape there"):
        list(evaluate([model], campaign, campaign.select("driven", hold_out=True)))


def test_without_a_sensor_at_the_drive_point_masses_go_with_the_shape_there(tmp_path: Path) -> None:
    """A mode shape that is against the force at the tip has a minus there: a mass is above zero."""
    found = identify_campaign(beams.campaign(tmp_path / "c", noise=0.02, without=(beams.DRIVE,)))
    at_drive = beams.shapes()[list(beams.PLACES).index(beams.DRIVE)]
    _require_the_beam(found, (beams.DRIVE,), np.abs(at_drive).tolist())
    for k, mode in enumerate(found.modes):
        assert mode.shape["tip"].value == np.sign(at_drive[k])
    assert found.warnings[0].startswith(f"modes: no sensor stands at the drive point {beams.DRIVE}")


def _require_the_beam(
    found: Identification, without: tuple[str, ...], at_drive: Sequence[float] = (1.0, 1.0)
) -> None:
    truth = beams.shapes()
    for k, mode in enumerate(found.modes):
        assert mode.frequency_hz.value == pytest.approx(beams.FREQUENCY[k], rel=1e-4)
        mass = next(body.mass for body in found.model.structure.bodies if body.name == mode.name)
        assert mass == pytest.approx(beams.MASS / at_drive[k], rel=0.03)
        for s, place in enumerate(beams.PLACES):
            if place not in without:
                assert mode.shape[place].value * mode.shape["tip"].value == pytest.approx(
                    truth[s, k], abs=6e-3
                )


def test_a_pole_that_the_records_leave_open_has_no_limits() -> None:
    """Its error as a factor is beyond all numbers."""
    pole: Any = SimpleNamespace(error=lambda _: 1e3)
    number = _pole_number(pole, 0.01, "1", 0)
    assert (number.value, number.low, number.high) == (0.01, None, None)


def test_without_a_force_the_masses_are_not_told(campaign: rom.Campaign) -> None:
    free = tuple(record for record in campaign.settings.record if record.test == "free")
    alone = replace(campaign, settings=campaign.settings.model_copy(update={"record": free}))
    found = identify_campaign(alone)
    assert [body.mass for body in found.model.structure.bodies] == [1.0, 1.0]
    assert "1 kg stands in" in found.warnings[0]
    assert found.modes[1].frequency_hz.value == pytest.approx(beams.FREQUENCY[1], rel=1e-3)


def test_a_line_beyond_what_the_rate_can_show_makes_no_more_parts_than_samples(
    campaign: rom.Campaign,
) -> None:
    """Of a record whose rate is a millionth of the declared one each part was less than a sample."""
    record = next(r for r in campaign.settings.record if r.test == "free")
    seen = measured_record(campaign, record).measurement
    ring = ring_down(replace(seen, rate_hz=1e-6 * seen.rate_hz), modal=True)
    lengths = [part.measurement.samples for part in ring.parts(6.0)]
    assert (min(lengths), sum(lengths)) == (12, seen.samples)
    assert [part.measurement.samples for part in ring.parts(6.0, most=1)] == lengths[:1]


def test_a_wave_that_travels_is_no_real_mode(campaign: rom.Campaign) -> None:
    """Sensors whose decays are a quarter of a period apart."""
    record = next(r for r in campaign.settings.record if r.test == "free")
    seen = measured_record(campaign, record).measurement
    time = np.arange(seen.samples) / seen.rate_hz
    decay = np.exp((-0.02 + 1j) * 2 * np.pi * 20.0 * time)
    turned = {
        name: replace(motion, samples=(decay * np.exp(1j * phase)).real)
        for (name, motion), phase in zip(seen.motion.items(), (0.0, 0.5, 1.0, 1.5), strict=True)
    }
    standing = {name: replace(motion, samples=decay.real) for name, motion in seen.motion.items()}
    collinearity = []
    for motion in (turned, standing):
        records = [ModalRecord(ring_down(replace(seen, motion=motion), modal=True), ())]
        collinearity += phase_collinearities(records, fit_modes(records, 1, beams.BAND))
    assert collinearity[0] < 0.7
    assert collinearity[1] == pytest.approx(1.0, abs=1e-3)


def test_a_wave_travels_the_same_way_in_a_decay_and_behind_a_force(campaign: rom.Campaign) -> None:
    pole = (-0.02 + 1j) * 2 * np.pi * 20.0
    records, each, forces = list[ModalRecord](), list[float](), tuple[str, ...]()
    for test in ("driven", "free"):
        record = next(r for r in campaign.settings.record if r.test == test)
        seen = measured_record(campaign, record).measurement
        turned = np.exp(pole / seen.rate_hz)
        forces = forces or tuple(seen.applied_force)
        force = next(iter(seen.applied_force.values()), np.eye(1, seen.samples)[0])
        moved = pole**2 * signal.lfilter([1.0], [1.0, -turned], force.astype(complex))
        motion = {
            name: replace(one, samples=(moved * np.exp(1j * phase)).real)
            for (name, one), phase in zip(seen.motion.items(), (0.0, 0.5, 1.0, 1.5), strict=True)
        }
        records.append(ModalRecord(ring_down(replace(seen, motion=motion), modal=True), forces))
        each += phase_collinearities(records[-1:], fit_modes(records[-1:], 1, beams.BAND))
    both = phase_collinearities(records, fit_modes(records, 1, beams.BAND))
    assert max(each) < 0.7
    assert both[0] == pytest.approx(np.mean(each), abs=0.1)
