"""A table [modes] in place of bodies and links: what is refused, in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rom
from rom.campaign.campaign import CampaignError, CampaignSettings, write_campaign
from rom.campaign.channels import Channel

_START = 'format = "boltlaw-campaign/1"\nname = "beam"\n[modes]\ncount = {count}\n{more}'
_SAMPLING = "[sampling]\nmotion_rate_hz = 100\npretrigger_s = 0\n"
_RECORD = '[[record]]\nfile = "{file}"\ntest = "{test}"\n{more}'
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(
        names: str = "force_tip acceleration_tip acceleration_root", test: str = "driven", count: str = "2",
        more: str = "", of_record: str = "", others: str = "",
    ) -> Path:  # fmt: skip
        text = _START.format(count=count, more=more) + _SAMPLING
        for file, channels in (("a.csv", names), ("b.csv", others)):
            if channels:
                columns = channels.split()
                rows = np.random.default_rng(0).normal(size=(64, len(columns)))
                lines = [",".join(["time_s", *columns])]
                lines += [f"{k / 100:.2f}," + ",".join(map(repr, row.tolist())) for k, row in enumerate(rows)]
                (tmp_path / file).write_text("\n".join(lines) + "\n")
                text += _RECORD.format(file=file, test=test, more=of_record)
        (tmp_path / "campaign.toml").write_text(text)
        return tmp_path

    return write


def test_modes_stand_for_bodies_and_sensors_are_those_of_the_channels(write: Write, tmp_path: Path) -> None:
    campaign = rom.read_campaign(write())
    assert campaign.settings.body_names == ("mode_1", "mode_2")
    record = campaign.load(campaign.settings.record[0])
    assert record.bodies == ("root", "tip")
    assert record.driven == ("tip",)
    channels = {name: Channel(name, c.samples, c.rate_hz) for name, c in record.channels.items()}
    write_campaign(tmp_path / "copy", campaign.settings, [("a.csv", channels)])
    assert "[[body]]" not in (tmp_path / "copy" / "campaign.toml").read_text()
    assert rom.read_campaign(tmp_path / "copy").settings == campaign.settings


_TWO = "acceleration_tip acceleration_root"


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"count": "3"}, "modes.count: found 3 modes and 2 sensors (root, tip), expected no more modes"),
        ({"count": "0"}, "modes.count: found 0, expected a whole number from 1"),
        ({"count": "2\nshapes = 1"}, "modes.shapes: found an unknown key"),
        ({"more": '[[body]]\nname = "lo"\n'}, "modes: found [[body]] beside it, expected either"),
        ({"test": "loosening"}, 'record[0].test: found "loosening" beside [modes], expected "free" or'),
        ({"of_record": 'bodies = ["tip"]\n'}, "record[0].bodies: found it beside [modes], expected none"),
        ({"names": _TWO}, "force_PLACE: found no force, expected one (driven test"),
        ({"names": f"force_tip strain {_TWO}"}, "strain: found an unknown channel, expected one of"),
        ({"names": f"force_tip acceleration_ground {_TWO}"}, "acceleration_ground: found it beside [modes]"),
        (
            {"others": f"force_tip {_TWO} acceleration_mid"},
            "found the sensors mid, root, tip, expected those",
        ),
    ],
)
def test_what_cannot_be_is_one_line(write: Write, given: dict[str, str], fault: str) -> None:
    with pytest.raises(CampaignError) as refused:
        rom.read_campaign(write(**given))
    assert len(refused.value.faults) == 1
    assert fault in refused.value.faults[0]


def test_settings_from_python_are_those_of_the_file(write: Write) -> None:
    settings = rom.read_campaign(write()).settings
    data = settings.model_dump(exclude={"body", "link"}, exclude_none=True)
    assert CampaignSettings.model_validate(data) == settings
