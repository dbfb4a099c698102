from __future__ import annotations

import pickle
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from rom.campaign.campaign import Campaign, CampaignError, CampaignSettings, read_campaign, write_campaign
from rom.campaign.record import Channel, RecordError, write_channels
from tests.rom.malformed import MALFORMED, Spoil
from tests.rom.sound_campaign import (
    COUPLED,
    CYCLED,
    DRIVEN,
    FILES,
    FREE,
    HOLD,
    LOOSENING,
    UNCOUPLED,
    sound_channels,
    sound_settings,
    write_sound_campaign,
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaigns") / "sound"
    write_sound_campaign(folder)
    return folder


@pytest.fixture(scope="module")
def campaign(sound: Path) -> Campaign:
    return read_campaign(sound)


@pytest.fixture
def edited(sound: Path, tmp_path: Path) -> Callable[[Callable[[dict[str, Any]], object]], Path]:
    def edit(change: Callable[[dict[str, Any]], object]) -> Path:
        folder = shutil.copytree(sound, tmp_path / "edited")
        data = tomllib.loads((folder / "campaign.toml").read_text())
        change(data)
        (folder / "campaign.toml").write_text(tomli_w.dumps(data))
        return folder

    return edit


@pytest.mark.parametrize("spoil", [spoil for _, spoil in MALFORMED], ids=[name for name, _ in MALFORMED])
def test_each_fault_is_one_line_that_says_where_what_and_what_instead(spoil: Spoil, tmp_path: Path) -> None:
    file, *words = spoil(tmp_path / "spoilt")
    with pytest.raises(CampaignError) as refusal:
        read_campaign(tmp_path / "spoilt")
    (line,) = refusal.value.faults
    assert "\n" not in line
    assert file in line.split(": ")[0]
    for word in (*words, "found", "expected"):
        assert word in line


JUNK = (
    0,
    -1,
    1.5,
    "",
    "lo",
    "ground",
    True,
    [],
    ["lo"],
    [1, 2],
    {},
    {"a": 1},
    [{}],
    float("nan"),
    10**400,
    "a\nb",
)


@given(st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_setting_may_be_junk(sound: Path, tmp_path: Path, data: st.DataObject) -> None:
    tables = sound_settings()
    table, key = tables, data.draw(st.sampled_from(sorted(tables)))
    while isinstance(table[key], dict | list) and table[key] and data.draw(st.booleans()):
        table = table[key]
        key = data.draw(st.sampled_from(sorted(table) if isinstance(table, dict) else range(len(table))))
    table[key] = data.draw(st.sampled_from(JUNK))
    folder = tmp_path / "junk"
    shutil.copytree(sound, folder, dirs_exist_ok=True)
    (folder / "campaign.toml").write_text(tomli_w.dumps(tables))
    try:
        read_campaign(folder)
    except CampaignError as refusal:
        for line in refusal.faults:
            assert "found" in line
            assert "expected" in line
            assert "\n" not in line


def test_settings_are_those_of_the_file(campaign: Campaign) -> None:
    found = campaign.settings
    assert found.body_names == ("lo", "so")
    assert found.body[1].mass_kg is None
    assert found.link[2].between == ("lo", "so")
    assert found.bolt is not None
    assert found.bolt.calibration == (2718.7, 2363.7, -575.63)
    assert found.windows.final_s == (2.0, 8.0)
    assert [record.test for record in found.record][:3] == ["uncoupled", "coupled", "loosening"]
    assert found.record[0].preload_n is None


def test_every_record_comes_back_as_written(campaign: Campaign) -> None:
    for one in campaign.settings.record:
        record = campaign.load(one)
        written = sound_channels(one.file)
        assert record.channels.keys() == written.keys()
        for name, channel in written.items():
            assert record.channels[name].rate_hz == channel.rate_hz
            np.testing.assert_allclose(record.channels[name].samples, channel.samples, rtol=1e-14)


def test_a_record_knows_its_bodies_motion_force_and_bolt(campaign: Campaign) -> None:
    records = {one.file: campaign.load(one) for one in campaign.settings.record}
    assert records[UNCOUPLED].bodies == ("lo",)
    assert records[LOOSENING].bodies == ("lo", "so")
    assert records[CYCLED].bodies == records[HOLD].bodies == ()
    assert records[UNCOUPLED].motion("lo")[0] == "velocity"
    assert records[FREE].motion("lo")[0] == "displacement"
    kind, channel = records[LOOSENING].motion("so")
    assert (kind, channel.name) == ("acceleration", "acceleration_so")
    force = records[LOOSENING].force("lo")
    assert force is not None
    assert force.name == "force_lo"
    assert records[LOOSENING].force("so") is None
    assert records[LOOSENING].tension_channel().name == "strain"
    assert records[HOLD].tension_channel().name == "tension"
    assert records[LOOSENING].preload_n == 152.7
    assert records[LOOSENING].duration_s == 3.0
    with pytest.raises(ValueError, match="no motion"):
        records[HOLD].motion("lo")
    with pytest.raises(ValueError, match="no bolt channel"):
        records[FREE].tension_channel()


def test_records_are_selected_by_test_and_hold_out(campaign: Campaign) -> None:
    def files(**choice: Any) -> list[str]:
        return [record.file for record in campaign.select(**choice)]

    assert files() == list(FILES)
    assert files(test="loosening") == [LOOSENING]
    assert files(test=("free", "coupled")) == [COUPLED, FREE]
    assert files(hold_out=True) == [DRIVEN]
    assert files(test="driven", hold_out=False) == []
    with pytest.raises(ValueError, match='"loosening"'):
        campaign.select(test="losening")


def test_folder_or_settings_file_one_job_or_two_give_the_same(sound: Path, campaign: Campaign) -> None:
    seen: list[tuple[int, int]] = []
    again = read_campaign(sound / "campaign.toml", jobs=2, progress=lambda done, of: seen.append((done, of)))
    assert again == campaign
    assert seen == [(done, len(FILES)) for done in range(len(FILES) + 1)]


def test_two_jobs_find_the_same_faults(sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "spoilt")
    (folder / COUPLED).write_bytes(b"nothing")
    (folder / HOLD).unlink()
    refusals = []
    for jobs in (1, 2):
        with pytest.raises(CampaignError) as refusal:
            read_campaign(folder, jobs=jobs)
        refusals.append(refusal.value.faults)
    assert refusals[0] == refusals[1]
    assert len(refusals[0]) == 2


def test_digest_tells_any_change(
    campaign: Campaign, sound: Path, tmp_path: Path, edited: Callable[..., Path]
) -> None:
    renamed = edited(lambda data: data.update(name="another"))
    record = shutil.copytree(sound, tmp_path / "record")
    hold = sound_channels(HOLD)["tension"]
    write_channels(record / HOLD, {"tension": Channel("tension", hold.samples + 1e-9, hold.rate_hz)})
    digests = {campaign.digest, read_campaign(renamed).digest, read_campaign(record).digest}
    assert len(digests) == 3
    assert all(len(digest) == 64 for digest in digests)
    copy = shutil.copytree(sound, tmp_path / "copy")
    assert read_campaign(copy).digest == campaign.digest


def test_faults_of_settings_and_records_are_told_together(edited: Callable[..., Path]) -> None:
    def spoil(data: dict[str, Any]) -> None:
        data["windows"]["final_s"] = [8.0, 2.0]
        data["bolt"]["link"] = "flexure_lo"
        data["record"][4]["file"] = "../free.csv"

    folder = edited(spoil)
    (folder / LOOSENING).unlink()
    with pytest.raises(CampaignError) as refusal:
        read_campaign(folder)
    places = [": ".join(line.split(": ")[:2]) for line in refusal.value.faults]
    assert places == [
        "campaign.toml: bolt.link",
        "campaign.toml: windows.final_s",
        "campaign.toml: record[4].file",
        f"{LOOSENING}: file",
    ]
    assert str(refusal.value).count("\n") == 3
    assert pickle.loads(pickle.dumps(refusal.value)).faults == refusal.value.faults


def _without_optional_keys(data: dict[str, Any]) -> None:
    for table in (*data["body"], *data["link"], *data["record"]):
        for key in ("mass_kg", "damping_ns_per_m", "preload_n", "hold_out"):
            table.pop(key, None)
    del data["record"][0]["bodies"]  # an uncoupled test: told by the one body whose motion was measured


def _one_body_no_bolt(data: dict[str, Any]) -> None:
    data["link"] = data["link"][:1]
    del data["bolt"], data["body"][1]
    data["record"] = data["record"][:1]


@pytest.mark.parametrize(
    "change",
    [
        _without_optional_keys,
        _one_body_no_bolt,
        lambda data: data["sampling"].update(pretrigger_s=0),
        lambda data: data["record"][1].update(mass_kg={"lo": 9.1}, stiffness_n_per_m={"flexure_lo": 12e3}),
        lambda data: data["record"][2].update(preload_n=0, bodies=["so", "lo"]),
        lambda data: data["body"].append({"name": "third body é"}),
        lambda data: data["link"].append({"name": "joint 2", "between": ["so", "ground"], "law": "bolted"}),
        lambda data: data["windows"].update(initial_s=[0.0, 2.0], final_s=[2.0, 2.1]),
    ],
    ids=[
        "optional keys",
        "one body",
        "no pretrigger",
        "values of a record",
        "no preload",
        "a body at rest",
        "two bolts",
        "windows touch",
    ],
)
def test_what_the_contract_allows_is_read(
    change: Callable[[dict[str, Any]], None], edited: Callable[..., Path]
) -> None:
    def and_name_bodies(data: dict[str, Any]) -> None:
        change(data)
        for record in data["record"]:
            if len(data["body"]) > 2 and record["test"] not in ("cycled", "hold"):
                record.setdefault("bodies", ["lo", "so"])

    assert read_campaign(edited(and_name_bodies)).settings.record[0].file == UNCOUPLED


def test_uncoupled_without_bodies_moves_the_one_that_was_measured(edited: Callable[..., Path]) -> None:
    campaign = read_campaign(edited(_without_optional_keys))
    assert campaign.load(campaign.settings.record[0]).bodies == ("lo",)


def test_tension_channels_need_no_calibration(edited: Callable[..., Path]) -> None:
    def change(data: dict[str, Any]) -> None:
        del data["bolt"]["calibration"]
        data["record"] = [record for record in data["record"] if record["file"] in (HOLD, FREE)]

    assert read_campaign(edited(change)).settings.bolt is not None


def test_a_record_spoilt_after_the_check_is_refused_when_loaded(sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "later")
    campaign = read_campaign(folder)
    (folder / LOOSENING).write_bytes(b"nothing")
    with pytest.raises(RecordError, match="unreadable"):
        campaign.load(campaign.select("loosening")[0])


class TestWriting:
    settings = CampaignSettings.model_validate(sound_settings())

    def test_settings_survive(self, campaign: Campaign) -> None:
        assert campaign.settings == self.settings

    def test_an_existing_folder_is_refused_and_kept(self, tmp_path: Path) -> None:
        (tmp_path / "mine.txt").write_text("keep")
        with pytest.raises(CampaignError, match="new folder"):
            write_campaign(tmp_path, self.settings, [])
        assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]

    @pytest.mark.parametrize("files", [FILES[:-1], (*FILES, FILES[0]), (*FILES[:-1], "other.h5")])
    def test_other_records_than_the_settings_name_leave_nothing(
        self, files: tuple[str, ...], tmp_path: Path
    ) -> None:
        with pytest.raises(CampaignError, match="expected"):
            write_campaign(
                tmp_path / "new", self.settings, ((file, sound_channels(FILES[0])) for file in files)
            )
        assert list(tmp_path.iterdir()) == []

    def test_contradicting_settings_leave_nothing(self, tmp_path: Path) -> None:
        bolt = self.settings.model_copy(update={"bolt": None})
        with pytest.raises(CampaignError, match="bolt"):
            write_campaign(tmp_path / "new", bolt, [])
        assert list(tmp_path.iterdir()) == []

    def test_single_precision_halves_a_record(self, sound: Path, tmp_path: Path) -> None:
        records = ((file, sound_channels(file)) for file in FILES)
        write_campaign(tmp_path / "new", self.settings, records, precision="float32")
        sizes = [(folder / LOOSENING).stat().st_size for folder in (tmp_path / "new", sound)]
        assert sizes[0] < 0.7 * sizes[1]
        read_campaign(tmp_path / "new")


def test_what_every_training_record_gives_stands_for_the_campaign(
    edited: Callable[..., Path], tmp_path: Path
) -> None:
    def give(data: dict[str, Any]) -> None:
        for place, record in enumerate(data["record"]):
            if record["test"] not in ("cycled", "hold") and record.get("bodies") != ["lo"]:
                record["mass_kg"] = {"so": 1.0 + place}

    campaign = read_campaign(edited(give))
    assert [body.mass_kg for body in campaign.settings.body] == [
        8.625,
        2.0,
    ]  # of the first record that moves so
    assert campaign.settings.link[0].stiffness_n_per_m is None
    assert campaign.settings.record[1].given == {"body.so.mass": 2.0}
    assert hash(campaign.settings.record[1])
    records = ((one.file, campaign.load(one).channels) for one in campaign.settings.record)
    write_campaign(tmp_path / "again", campaign.settings, records)
    assert read_campaign(tmp_path / "again").settings == campaign.settings


def test_without_a_bolt_the_windows_and_the_rate_of_the_tension_may_be_left_out() -> None:
    bare = {
        "format": "boltlaw-campaign/1",
        "name": "carriage",
        "body": [{"name": "carriage"}],
        "link": [{"name": "guide", "between": ["carriage", "ground"], "law": "dashpot"}],
        "sampling": {"motion_rate_hz": 1000, "pretrigger_s": 0},
        "record": [{"file": "run.h5", "test": "driven"}],
    }
    without = CampaignSettings.model_validate(bare)
    assert without.windows.final_s == (2.0, 8.0)
    assert without.sampling.tension_rate_hz == 1000
    with pytest.raises(ValidationError, match="tension_rate_hz"):
        CampaignSettings.model_validate(bare | {"bolt": {"link": "guide"}})


def test_workers_started_in_another_folder_find_the_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_sound_campaign(tmp_path / "there" / "campaign")
    joblib.Parallel(n_jobs=2)(joblib.delayed(abs)(number) for number in range(4))  # these stay where they are
    monkeypatch.chdir(tmp_path / "there")
    campaign = read_campaign("campaign", jobs=2)
    assert campaign.path == tmp_path / "there" / "campaign"
