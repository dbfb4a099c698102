"""A first campaign.toml from a folder of records, and what was read of a campaign."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

import rom
from experiments.text.records import checked
from rom.campaign.record import Channel, write_channels
from tests.experiments.test_cli import listing, one_line
from tests.rom.sound_campaign import write_sound_campaign

Boltlaw = Callable[..., Any]
BOTH = ("force_lo", "acceleration_lo", "acceleration_so", "tension")


def noise(name: str, rate_hz: float = 400.0, samples: int = 1200) -> Channel:
    """Return a channel of noise."""
    return Channel(name, np.random.default_rng(len(name)).standard_normal(samples), rate_hz)


def write(path: Path, *names: str) -> None:
    """Write a record of noise, the bolt's channels at a quarter of the rate."""
    path.parent.mkdir(parents=True, exist_ok=True)
    slow = ("strain", "tension")
    write_channels(path, {name: noise(name, 100.0, 300) if name in slow else noise(name) for name in names})


def test_a_draft_is_a_campaign(boltlaw: Boltlaw, tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    write(folder / "loosening" / "M152.7N_1.h5", *BOTH)
    write(folder / "coupled_20N.csv", *BOTH)
    write(folder / "hammer_lo.mat", "force_lo", "acceleration_lo")
    write(folder / "validation" / "loose_40N.h5", *BOTH)
    ran = boltlaw("init", folder)
    assert (ran.code, ran.err) == (0, "")
    assert "CHECK" in (folder / "campaign.toml").read_text()
    campaign = rom.read_campaign(folder)
    told = {r.file: (r.test, r.preload_n, r.hold_out, r.bodies) for r in campaign.settings.record}
    assert told == {
        "loosening/M152.7N_1.h5": ("loosening", 152.7, False, None),
        "coupled_20N.csv": ("coupled", 20.0, False, None),
        "hammer_lo.mat": ("uncoupled", None, False, ("lo",)),
        "validation/loose_40N.h5": ("loosening", 40.0, True, None),
    }
    sampling = campaign.settings.sampling
    assert (sampling.motion_rate_hz, sampling.tension_rate_hz) == (400, 100)
    ran = boltlaw("check", folder, "--out", tmp_path / "out", "--jobs", 1, figures=True)
    assert (ran.code, ran.err) == (0, "")
    found = json.loads((tmp_path / "out" / "check.json").read_text())
    assert (found["format"], len(found["records"])) == ("boltlaw-check/1", 4)
    (row,) = (row for row in found["records"] if row["file"] == "coupled_20N.csv")
    force = row["channels"]["force_lo"]
    assert (force["rate_hz"], force["samples"]) == (pytest.approx(400), 1200)
    assert force["maximum"] == pytest.approx(noise("force_lo").samples.max())
    figures = {path.name for path in (tmp_path / "out").glob("*.svg")}
    assert figures == {"check-loosening.svg", "check-coupled.svg", "check-uncoupled.svg"}
    assert "4 records (1 coupled, 1 uncoupled, 2 loosening), 1 held out" in ran.out
    low, high = (f"{end(noise('tension', 100.0, 300).samples):.3g}" for end in (np.min, np.max))
    (line,) = (line for line in ran.out.splitlines() if line.startswith("coupled_20N.csv"))
    assert line.startswith("coupled_20N.csv (coupled, 3 s, 20 N): ")
    assert f"tension {low} to {high} N at 100 Hz" in line


@pytest.mark.parametrize(
    ("names", "test"),
    [
        (("tension",), "hold"),
        (("displacement_m",), "free"),
        (("force_m", "velocity_m"), "driven"),
        (("link_displacement_contact", "link_force_contact"), "cycled"),
        (("force_m", "acceleration_m", "tension"), "loosening"),
    ],
)
def test_the_kind_of_test_follows_from_the_channels(
    names: tuple[str, ...], test: str, boltlaw: Boltlaw, tmp_path: Path
) -> None:
    write(tmp_path / "lab" / "a.h5", *names)
    ran = boltlaw("init", tmp_path / "lab")
    assert ran.code == 0, ran.err
    campaign = rom.read_campaign(tmp_path / "lab")
    assert [record.test for record in campaign.settings.record] == [test]


def test_what_no_file_tells_is_asked_for_not_made_up(boltlaw: Boltlaw, tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    names = ("force_m", "acceleration_m", "strain")
    savemat(tmp_path / "lab" / "a.mat", {name: noise(name).samples for name in names})
    assert boltlaw("init", tmp_path / "lab").code == 0
    settings = tomllib.loads((tmp_path / "lab" / "campaign.toml").read_text())
    assert "calibration" not in settings["bolt"]
    assert "motion_rate_hz" not in settings["sampling"]
    ran = boltlaw("check", tmp_path / "lab")
    assert ran.code == 2
    assert "sampling.motion_rate_hz" in ran.err


def test_a_draft_may_lie_elsewhere(boltlaw: Boltlaw, tmp_path: Path) -> None:
    write(tmp_path / "lab" / "a.h5", *BOTH)
    before = listing(tmp_path / "lab")
    assert boltlaw("init", tmp_path / "lab", "--out", tmp_path / "new").code == 0
    assert (tmp_path / "new" / "campaign.toml").is_file()
    assert listing(tmp_path / "lab") == before


def with_a_name_that_is_no_text(folder: Path) -> None:
    """Write a record one of whose channels has bytes for a name."""
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset(b"force\xff_lo", data=np.zeros(8))


def with_a_campaign(folder: Path) -> None:
    """Write a record and settings."""
    write(folder / "a.h5", "tension")
    (folder / "campaign.toml").write_text("")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda f: write(f / "a.h5", "Force hammer", "Bolt"), ("Bolt", "Force hammer", "boltlaw import")),
        (lambda f: (f / "a.tdms").write_bytes(b""), ("no records", ".h5", "boltlaw import")),
        (lambda f: (f / "a.csv").write_bytes(b"no such thing"), ("a.csv", "time_s")),
        (lambda f: (f / "a.csv").write_bytes("Prüfstand;3".encode("cp1252")), ("a.csv", "boltlaw import")),
        (with_a_name_that_is_no_text, ("force\\xff_lo", "boltlaw import")),
        (with_a_campaign, ("campaign.toml", "existing")),
    ],
)
def test_a_folder_of_something_else_is_refused_in_one_line(
    make: Callable[[Path], Any], words: tuple[str, ...], boltlaw: Boltlaw, tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    make(tmp_path / "lab")
    before = listing(tmp_path)
    ran = boltlaw("init", tmp_path / "lab")
    assert ran.code == 2
    line = one_line(ran.err)
    assert all(word in line for word in words), line
    assert listing(tmp_path) == before


def test_check_of_every_kind_of_test(boltlaw: Boltlaw, tmp_path: Path) -> None:
    write_sound_campaign(tmp_path / "campaign")
    ran = boltlaw("check", tmp_path / "campaign", "--jobs", 1, figures=True)
    assert ran.code == 0, ran.err
    assert len(list((tmp_path / "campaign-results").glob("check-*.svg"))) == 7
    shutil.rmtree(tmp_path / "campaign" / "records")
    before = listing(tmp_path)
    ran = boltlaw("check", tmp_path / "campaign", "--jobs", 1)
    assert (ran.code, ran.out) == (2, "")
    assert "Traceback" not in ran.err
    assert listing(tmp_path) == before


BARE = {
    "": ["format", "name", "body", "link", "sampling", "record"],
    'format = "boltlaw-campaign/1"': ["name", "body", "link", "sampling", "record"],
    'format = "boltlaw-campaign/1"\nname = "x"\n[[body]]\n[[link]]\n[sampling]\n[[record]]': [
        "body[0].name", "link[0].name", "link[0].between", "link[0].law", "sampling.motion_rate_hz",
        "sampling.tension_rate_hz", "sampling.pretrigger_s", "record[0].file", "record[0].test",
    ],
}  # fmt: skip


@pytest.mark.parametrize("text", BARE)
def test_a_bare_campaign_is_told_key_by_key(text: str, boltlaw: Boltlaw, tmp_path: Path) -> None:
    """No line is about a table that is there, and of several campaigns each line names its own."""
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "campaign.toml").write_text(text)
    for command in (["check", tmp_path / "one"], ["discover", tmp_path / "one", tmp_path / "other"]):
        ran = boltlaw(*command, "--jobs", 1)
        assert (ran.code, ran.out) == (2, "")
        of = "" if command[0] == "check" else "one: "
        told = [line.partition(": found nothing, expected ")[::2] for line in ran.err.splitlines()]
        assert [key for key, _ in told] == [f"{of}campaign.toml: {key}" for key in BARE[text]]
        assert all(expected for _, expected in told)


def test_check_tells_what_does_not_fit(rig_campaign: Path, boltlaw: Boltlaw, tmp_path: Path) -> None:
    shutil.copytree(rig_campaign, tmp_path / "campaign")
    campaign = rom.read_campaign(rig_campaign)
    for record in campaign.select("coupled"):
        channels = dict(campaign.load(record).channels)
        inner = channels["acceleration_so"]
        channels["acceleration_so"] = Channel(inner.name, inner.samples / 9.80665, inner.rate_hz)
        write_channels(tmp_path / "campaign" / record.file, channels)
    ran = boltlaw("check", tmp_path / "campaign", "--jobs", 1)
    assert ran.code == 0, ran.err
    found = json.loads((tmp_path / "campaign-results" / "check.json").read_text())
    assert {one["likely"] for one in found["suspicions"]} == {"acceleration in g"}
    assert "acceleration in g" in ran.out
    (row, *_) = (row for row in found["records"] if "strain" in row["channels"])
    low, high = row["calibrated_n"]
    assert abs(0.5 * (low + high) - row["preload_n"]) < 0.2 * row["preload_n"] + 2.0
    assert f", by its calibration {low:.2g}"[:-1] in ran.out


def test_a_range_shows_what_moves_and_the_end_says_that_all_is_well() -> None:
    of_tension = {"minimum": 2199.78, "maximum": 2200.1, "rate_hz": 1000.0}
    row = {
        "file": "a.h5",
        "test": "hold",
        "duration_s": 2.0,
        "preload_n": None,
        "hold_out": False,
        "doubts": [],
    }
    found = {"campaign": "bolt", "suspicions": []}
    lines = list(checked({**found, "records": [{**row, "channels": {"tension": of_tension}}]}))
    assert lines[1] == "a.h5 (hold, 2 s): tension 2199.78 to 2200.1 N at 1000 Hz"
    assert lines[-1] == "no record is doubtful, and none contradicts campaign.toml"
    of_tension["minimum"] = 2077.6
    doubted = {**row, "doubts": ["clipped"], "channels": {"tension": of_tension}}
    assert list(checked({**found, "records": [doubted]}))[1:] == [
        "a.h5 (hold, 2 s): tension 2078 to 2200 N at 1000 Hz",
        "  doubtful: clipped",
    ]
