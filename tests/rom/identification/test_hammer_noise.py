"""What a hammer's noise leaves in its force: spectra of a record know its shape and size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discovery.loop.impact_refits import ImpactRefits
from discovery.options import Options
from experiments.rig.sensors import Instruments, chain
from experiments.studies import rig
from rom.campaign.campaign import read_campaign
from rom.identification.record_spectra import spectral_records
from rom.identification.spectral_model import spectrum
from rom.signals.processing import process

DRAWS = 200


@pytest.mark.parametrize("part", [0, 1])
def test_white_noise_in_the_contact_is_made_of_the_shapes(rig_campaign: Path, part: int) -> None:
    """Noise drawn in the contact's samples is a sum of the shapes, each by a number of unit variance."""
    campaign = read_campaign(rig_campaign)
    hit = process(campaign.load(campaign.select("coupled")[3]), campaign.settings)
    record = spectral_records(hit, campaign.settings)[part]
    assert record.force_errors is not None
    shapes = np.concatenate([record.force_errors[:, 0].real, record.force_errors[:, 0].imag])
    assert not np.any(record.force_errors[:, 1])  # nobody struck SO
    inside = np.flatnonzero(hit.force["lo"])
    noise = np.zeros((hit.samples, DRAWS))
    noise[inside] = np.random.default_rng(0).normal(0, hit.force_noise["lo"], (len(inside), DRAWS))
    band = (record.frequency[0], record.frequency[-1])
    lines = spectrum(noise[slice(*record.samples)], hit.rate_hz, band)[1]
    rows = np.concatenate([lines.real, lines.imag])
    numbers = np.linalg.lstsq(shapes, rows, rcond=1e-6)[0]
    assert np.linalg.norm(rows - shapes @ numbers) < 0.02 * np.linalg.norm(rows)
    drawn, told = np.mean(np.abs(lines) ** 2, axis=1), np.sum(np.abs(record.force_errors[:, 0]) ** 2, axis=1)
    assert np.mean(drawn) == pytest.approx(np.mean(told), rel=0.2)


def test_a_silent_hammer_leaves_no_errors(rig_campaign: Path) -> None:
    campaign = read_campaign(rig_campaign)
    hit = process(campaign.load(campaign.select("coupled")[0]), campaign.settings)
    for record in spectral_records(replace(hit, force_noise={"lo": 0.0}), campaign.settings):
        assert record.force_errors is not None
        assert record.force_errors.shape[2] == 0


@pytest.mark.slow
def test_a_hammer_much_noisier_than_the_accelerometers_leaves_noise_alone(tmp_path: Path) -> None:
    """Thirty times the usual noise, of which impulse and instant alone leave twice as much as noise."""
    loud = replace(Instruments(), force=chain(1.5, 22_240.0))
    made = rig.run(tmp_path / "loud", cases=6, seed=1, jobs=1, duration_s=2.5, instruments=loud)
    campaign = read_campaign(made)
    state = ImpactRefits.of(campaign, Options()).start()
    assert state.level < 1.1
