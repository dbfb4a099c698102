"""Whatever a campaign holds: it is read, or refused in lines that say why; nothing else is touched or run."""

from __future__ import annotations

import faulthandler
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from rom.campaign.campaign import CampaignError, read_campaign
from rom.campaign.record import inspect_channels, write_channels
from tests.rom.random_records import (
    H5_OPTIONS,
    PICKLED,
    random_bytes,
    random_cells,
    random_content,
    sound_records,
)
from tests.rom.random_settings import LEAVING, OUTSIDE, random_tables, random_text
from tests.rom.sound_campaign import LOOSENING, sound_channels, sound_settings, write_sound_campaign

ENDLESS_S = 300.0
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
MANY = settings(
    deadline=None,
    derandomize=True,
    database=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
RANDOM = st.integers(0, 2**62).map(Random)
Events = list[tuple[str, tuple[Any, ...]]]


class Watch:
    """What the interpreter opens and runs while it is asked to look."""

    def __init__(self) -> None:
        self.events: Events | None = None
        sys.addaudithook(self.hook)

    def hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.events is not None and event.partition(".")[0] in (
            "open",
            "pickle",
            "os",
            "subprocess",
            "socket",
        ):
            self.events.append((event, arguments))


@pytest.fixture(scope="module")
def watch() -> Watch:
    return Watch()  # a hook cannot be taken away again: one for all


@pytest.fixture(autouse=True)
def never_wait_for_ever() -> Iterator[None]:
    faulthandler.dump_traceback_later(ENDLESS_S, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound campaign among traps: links out of it, to themselves, a pipe that nobody writes to."""
    place = tmp_path_factory.mktemp("random") / "campaign"
    write_sound_campaign(place)
    write_channels(place.parent / OUTSIDE, sound_channels(LOOSENING))
    (place / LEAVING[0]).symlink_to(f"../{OUTSIDE}")
    (place / "links").symlink_to("..")
    (place / "loop.h5").symlink_to("loop.h5")
    (place / "folder.h5").mkdir()
    os.mkfifo(place / "pipe.h5")
    read_campaign(place)
    return place


def judged(folder: Path, watch: Watch) -> tuple[str, ...]:
    """The faults of a campaign, none where it is sound: then every record can be read."""
    watch.events = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            campaign = read_campaign(folder)
            for record in campaign.settings.record:
                campaign.load(record)
        faults: tuple[str, ...] = ()
    except CampaignError as refusal:
        faults = refusal.faults
        assert faults
    finally:
        events, watch.events = watch.events, None
    for line in faults:
        assert "found" in line, line
        assert "expected" in line, line
        assert line.isprintable()
        assert len(line) < 600
    for event, arguments in events or ():
        assert event in ("open", "os.listdir", "os.scandir"), (event, arguments)
        if event == "open":
            _require_harmless(folder, *arguments)
    return faults


def _require_harmless(folder: Path, path: object, mode: object, flags: int) -> None:
    assert not flags & WRITING, (path, mode)
    if isinstance(path, str | bytes):
        real = Path(os.path.realpath(os.fsdecode(path)))
        modules = (
            real.suffix in (".py", ".pyc", ".so") or "site-packages" in real.parts
        )  # loaded on first use
        assert modules or real.is_relative_to(folder.resolve()), real


@pytest.mark.slow
@pytest.mark.parametrize(("make", "count"), [(random_tables, 700), (random_text, 300)])
def test_any_settings_are_read_or_refused(
    make: Callable[[Random], bytes], count: int, folder: Path, watch: Watch
) -> None:
    refused = []

    @settings(MANY, max_examples=count)
    @given(RANDOM)
    def one(random: Random) -> None:
        (folder / "campaign.toml").write_bytes(make(random))
        refused.append(bool(judged(folder, watch)))

    one()
    assert len(refused) >= count
    assert 0.5 < np.mean(refused) < 1.0  # some changes are harmless


@pytest.mark.slow
@pytest.mark.parametrize(("make", "count"), [(random_bytes, 500), (random_cells, 250), (random_content, 250)])
def test_any_record_is_read_or_refused(
    make: Callable[[Random], tuple[str, bytes]], count: int, folder: Path, watch: Watch
) -> None:
    refused = []

    @settings(MANY, max_examples=count)
    @given(RANDOM)
    def one(random: Random) -> None:
        name, content = make(random)
        (folder / name).write_bytes(content)
        (folder / "campaign.toml").write_text(tomli_w.dumps(with_record(name)))
        refused.append(bool(judged(folder, watch)))

    one()
    assert len(refused) >= count
    assert 0.2 < np.mean(refused) < 1.0


def with_record(name: str) -> dict[str, Any]:
    return sound_settings() | {"record": [{"file": name, "test": "loosening"}]}


def refused(folder: Path, name: str, content: bytes, watch: Watch) -> str:
    """The only line about a record."""
    (folder / name).write_bytes(content)
    (folder / "campaign.toml").write_text(tomli_w.dumps(with_record(name)))
    (line,) = judged(folder, watch)
    return line


@pytest.mark.parametrize("name", sorted(sound_records()))
def test_the_record_in_every_layout_is_sound(name: str, folder: Path, watch: Watch) -> None:
    (folder / name).write_bytes(sound_records()[name])
    (folder / "campaign.toml").write_text(tomli_w.dumps(with_record(name)))
    assert judged(folder, watch) == ()


@pytest.mark.parametrize("file", [*LEAVING, f"../{OUTSIDE}", "loop.h5", "pipe.h5", "folder.h5"])
def test_a_path_that_leads_out_or_nowhere_is_refused(file: str, folder: Path, watch: Watch) -> None:
    (folder / "campaign.toml").write_text(tomli_w.dumps(with_record(file)))
    (line,) = judged(folder, watch)
    assert file.strip("./") in line


def test_settings_that_are_a_pipe_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "campaign.toml")
    with pytest.raises(CampaignError, match="device"):
        read_campaign(tmp_path)


@pytest.mark.parametrize("digits", [b"9" * 5000, b"0x" + b"f" * 5000], ids=["decimal", "hexadecimal"])
def test_numbers_of_thousands_of_digits_are_refused(digits: bytes, tmp_path: Path) -> None:
    text = tomli_w.dumps(sound_settings() | {"name": 0}).replace("name = 0", f"name = {digits.decode()}", 1)
    (tmp_path / "campaign.toml").write_text(text)
    with pytest.raises(CampaignError) as refusal:
        read_campaign(tmp_path)
    assert all(len(line) < 600 for line in refusal.value.faults)


def test_names_cannot_speak_to_the_terminal() -> None:
    (line,) = CampaignError(["a\x1b[31m\n\u202eb: found \x07, expected none"]).faults
    assert line == r"a\x1b[31m \u202eb: found \x07, expected none"


@pytest.mark.parametrize("ending", ["h5", "mat", "csv"])
def test_a_pickled_object_is_never_loaded(ending: str, folder: Path, watch: Watch) -> None:
    assert f"a.{ending}: " in refused(folder, f"a.{ending}", PICKLED, watch)


def test_what_would_crash_the_library_is_refused_by_name(tmp_path: Path, watch: Watch, folder: Path) -> None:
    arrays = {name: channel.samples for name, channel in sound_channels(LOOSENING).items()}
    with h5py.File(tmp_path / "scaled.h5", "w") as file:
        for name, samples in arrays.items():
            options = {"scaleoffset": 2, "chunks": (100,)} if name == "strain" else {}
            file.create_dataset(name, data=samples, **options)
    line = refused(folder, "scaled.h5", (tmp_path / "scaled.h5").read_bytes(), watch)
    assert "strain: found the filter number 6" in line
    assert set(H5_OPTIONS) <= set(sound_records())  # other filters are read


def test_samples_that_were_never_stored_are_refused(tmp_path: Path, watch: Watch, folder: Path) -> None:
    arrays = {name: channel.samples for name, channel in sound_channels(LOOSENING).items()}
    with h5py.File(tmp_path / "hollow.h5", "w") as file:
        for name, samples in arrays.items():
            if name == "strain":
                file.create_dataset(name, shape=(10**12,), dtype="f8", chunks=(1000,), compression="gzip")
            else:
                file[name] = samples
    line = refused(folder, "hollow.h5", (tmp_path / "hollow.h5").read_bytes(), watch)
    assert "strain: found 0 bytes stored for 1000000000000 samples" in line


def test_a_word_far_down_a_long_table_is_one_fault_without_a_warning(tmp_path: Path) -> None:
    rows = [f"{place / 400:.4f},0.5" for place in range(80_000)]
    rows[-5] = rows[-5].replace("0.5", "abc")
    (tmp_path / "long.csv").write_text("\n".join(["time_s,force_lo", *rows]))
    found = inspect_channels(tmp_path / "long.csv", 400.0, 100.0)
    assert found.faults == ('force_lo: found "abc" in data row 79996, expected a number',)


def test_a_chunk_shorter_than_its_checksum_is_refused(tmp_path: Path, watch: Watch, folder: Path) -> None:
    """To decode it ends the whole process."""
    with h5py.File(tmp_path / "summed.h5", "w") as file:
        for name, channel in sound_channels(LOOSENING).items():
            stored = file.create_dataset(name, data=channel.samples, fletcher32=True, chunks=(100,))
            if name == "strain":
                stored.id.write_direct_chunk((0,), b"\0\0")
    line = refused(folder, "short.h5", (tmp_path / "summed.h5").read_bytes(), watch)
    assert "strain: found a chunk without samples" in line
