"""Rates that files state, against those of a campaign."""

from __future__ import annotations

from pathlib import Path

import h5py
import pytest

from rom.campaign.campaign import CampaignError, read_campaign
from tests.rom.sound_campaign import DRIVEN, FILES, FREE, HOLD, LOOSENING, UNCOUPLED, write_sound_campaign


def _slow(path: Path, times: float) -> None:
    """Let a record's file state times that are so many times as long, as those in ms are that stand for s."""
    if path.suffix == ".csv":
        head, *rows = path.read_text().splitlines()
        parts = [row.partition(",") for row in rows]
        path.write_text("\n".join([head, *(f"{times * float(at):.9g},{rest}" for at, _, rest in parts)]))
    else:
        with h5py.File(path, "r+") as file:
            for channel in file.values():
                channel.attrs["rate_hz"] = channel.attrs["rate_hz"] / times


@pytest.mark.parametrize(
    ("file", "times", "fault"),
    [
        (LOOSENING, 10.0, "acceleration_lo: found 40 Hz"),
        (UNCOUPLED, 1e6, "force_lo: found 0.0004 Hz"),
        (LOOSENING, 0.01, "acceleration_lo: found 40000 Hz"),
        (DRIVEN, 1e3, "force_lo: found 0.4 Hz"),
        (FREE, 1e3, "displacement_lo: found 0.4 Hz"),
        (LOOSENING, 4 / 3, ""),
        (DRIVEN, 10.0, ""),
        (HOLD, 1e3, ""),
    ],
)
def test_times_in_another_unit_are_refused_and_a_rate_of_its_own_is_not(
    file: str, times: float, fault: str, tmp_path: Path
) -> None:
    folder = tmp_path / "campaign"
    write_sound_campaign(folder)
    _slow(folder / file, times)
    if not fault:
        assert len(read_campaign(folder).settings.record) == len(FILES)
        return
    with pytest.raises(CampaignError) as refusal:
        read_campaign(folder)
    (line,) = refusal.value.faults
    assert line.startswith(f"{file}: {fault}, expected a rate near 400 Hz of [sampling]")
