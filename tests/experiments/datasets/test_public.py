"""Public sets as campaigns: twins written here, and the data themselves where they are at hand."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.io import loadmat, savemat

import rom
from experiments.datasets.collected import SourceError
from experiments.datasets.silverbox import multisines
from tests.experiments.source_files import silverbox_drive, write_emps, write_silverbox, write_tribometer
from tests.experiments.test_cli import listing, one_line
from tests.shared import measured

Boltlaw = Callable[..., Any]
RESTS = [100, 96, 97, 98, 99, 100, 101, 102, 103, 104, 500]


def imported(boltlaw: Boltlaw, name: str, source: Path, new_dir: Path) -> rom.Campaign:
    """Import a set by the program and read what it wrote."""
    ran = boltlaw("import", name, source, new_dir, "--jobs", 1, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")
    return rom.read_campaign(new_dir)


def test_emps(boltlaw: Boltlaw, tmp_path: Path) -> None:
    files = write_emps(tmp_path / "source" / "below")
    campaign = imported(boltlaw, "emps", tmp_path / "source", tmp_path / "new")
    settings = campaign.settings
    assert [body.name for body in settings.body] == ["carriage"]
    assert settings.body[0].mass_kg is None
    assert [(link.name, link.between, link.law) for link in settings.link] == [
        ("guide", ("carriage", "ground"), "dashpot")
    ]
    assert (settings.sampling.motion_rate_hz, settings.sampling.pretrigger_s) == (1000, 0)
    assert settings.bolt is None
    for record, file, hold_out in zip(settings.record, files, (False, True), strict=True):
        assert (record.test, record.bodies, record.hold_out) == ("driven", ("carriage",), hold_out)
        channels = campaign.load(record).channels
        force = files[file]["gtau"] * files[file]["vir"]
        np.testing.assert_allclose(channels["force_carriage"].samples, force.ravel(), rtol=1e-14)
        np.testing.assert_array_equal(channels["displacement_carriage"].samples, files[file]["qm"].ravel())
    assert [record.file for record in settings.record] == ["records/emps.h5", "records/emps_pulses.h5"]


def test_silverbox(boltlaw: Boltlaw, tmp_path: Path) -> None:
    drive, starts = write_silverbox(tmp_path / "source", [2000] * 10, RESTS)
    campaign = imported(boltlaw, "silverbox", tmp_path / "source" / "SNLS80mV.mat", tmp_path / "new")
    assert "only ratios to the mass" in campaign.settings.name
    arrow, *rest = campaign.settings.record
    assert (arrow.file, arrow.hold_out) == ("records/arrow.h5", True)
    assert [record.hold_out for record in rest] == [False] * 9 + [True]
    channels = campaign.load(arrow).channels
    assert channels["force_oscillator"].rate_hz == 1e7 / 2**14
    np.testing.assert_array_equal(channels["force_oscillator"].samples, drive[:40_000])
    np.testing.assert_array_equal(channels["displacement_oscillator"].samples, 2 * drive[:40_000])
    for record, start in zip(rest, starts, strict=True):
        samples = campaign.load(record).channels["force_oscillator"].samples
        np.testing.assert_array_equal(samples[:1900], drive[start : start + 1900])


@settings(max_examples=20, deadline=None)
@given(
    length=st.integers(1500, 4000),
    rests=st.lists(st.integers(80, 110), min_size=10, max_size=10),
    seed=st.integers(0, 10_000),
)
def test_multisines_start_where_the_drive_does(length: int, rests: list[int], seed: int) -> None:
    length += 110 - max(rests)
    drive, starts = silverbox_drive([length + 110 - rest for rest in [*rests[1:], 110]], [*rests, 500], seed)
    found = multisines("twin", drive)
    assert [part.start for part in found] == starts


def test_a_sample_whose_square_is_no_number_leaves_no_multisine() -> None:
    drive = np.random.default_rng(0).normal(size=100_000)
    drive[70_000] = 1e300
    with pytest.raises(SourceError, match="found 0 multisines"):
        multisines("twin", drive)


def test_silverbox_with_other_multisines_is_refused(boltlaw: Boltlaw, tmp_path: Path) -> None:
    write_silverbox(tmp_path / "source", [2000] * 9, RESTS[:9] + RESTS[10:])
    ran = boltlaw("import", "silverbox", tmp_path / "source", tmp_path / "new")
    assert ran.code == 2
    assert "found 9 multisines" in one_line(ran.err)


def test_tribometer(boltlaw: Boltlaw, tmp_path: Path) -> None:
    table = write_tribometer(tmp_path / "source")
    ran = boltlaw("import", "tribometer", tmp_path / "source", tmp_path / "new", "--jobs", 1)
    assert (ran.code, ran.err) == (0, "")
    assert "note: test_data_2.txt: 7 rows" in ran.out
    campaign = rom.read_campaign(tmp_path / "new")
    assert [(r.test, r.hold_out) for r in campaign.settings.record] == [("cycled", False), ("cycled", True)]
    assert [(link.name, link.law) for link in campaign.settings.link] == [("contact", "linear")]
    parts = [campaign.load(record).channels for record in campaign.settings.record]
    assert [len(part["link_force_contact"].samples) for part in parts] == [1200, 800]
    assert {channel.rate_hz for part in parts for channel in part.values()} == {200.0}
    kept = table[-2000:]
    whole = {name: np.concatenate([part[name].samples for part in parts]) for name in parts[0]}
    np.testing.assert_allclose(whole["normal_force_contact"], 5.0)
    np.testing.assert_allclose(whole["link_force_contact"], -1e-6 * kept[:, 3], atol=1e-12)
    steps = np.diff(whole["link_displacement_contact"])
    np.testing.assert_allclose(steps, 1e-3 * np.diff(kept[:, 2]), atol=1e-9)  # as many digits as are printed
    training = parts[0]["link_displacement_contact"].samples
    assert training.max() == pytest.approx(-training.min())


class TestBadSources:
    """One line on standard error, exit code 2, nothing written."""

    @staticmethod
    def refused(boltlaw: Boltlaw, folder: Path, *arguments: object) -> str:
        before = listing(folder)
        ran = boltlaw("import", *arguments, "--jobs", 1)
        assert ran.code == 2
        assert ran.out == ""
        assert listing(folder) == before
        return one_line(ran.err)

    @pytest.mark.parametrize("name", ["emps", "silverbox", "tribometer", "catman", "matlab", "uff", "tdms"])
    def test_an_empty_folder(self, name: str, boltlaw: Boltlaw, tmp_path: Path) -> None:
        (tmp_path / "source").mkdir()
        assert "found no" in self.refused(boltlaw, tmp_path, name, tmp_path / "source", tmp_path / "a" / "b")

    @pytest.mark.parametrize(
        ("name", "file"),
        [("emps", "DATA_EMPS.mat"), ("silverbox", "SNLS80mV.mat"), ("tribometer", "test_data_2.txt")],
    )
    @pytest.mark.parametrize(
        "content", [b"", b"no such thing", b"MATLAB 5.0 MAT-file".ljust(128) + b"\1\2\3"]
    )
    def test_a_file_of_something_else(
        self, name: str, file: str, content: bytes, boltlaw: Boltlaw, tmp_path: Path
    ) -> None:
        write_emps(tmp_path / "source")
        (tmp_path / "source" / file).write_bytes(content)
        assert file in self.refused(boltlaw, tmp_path, name, tmp_path / "source", tmp_path / "a" / "b")

    @pytest.mark.parametrize(
        ("changed", "words"),
        [
            ({"qm": None}, "found no variable qm"),
            ({"qm": np.zeros(3)}, "found lengths that differ"),
            ({"vir": np.full(400, np.nan)}, "vir: found NaN"),
            ({"vir": np.full(400, 1j)}, "vir: found no vector of real numbers"),
            ({"t": np.arange(400) / 500}, "found 500 Hz, expected 1000 Hz"),
            ({"t": np.arange(400) ** 1.1 / 1000}, "t: found steps from"),
            ({"t": np.zeros(400)}, "t: found no rising times"),
            ({"gtau": 0.0}, "gtau: found"),
        ],
    )
    def test_emps(self, changed: dict[str, Any], words: str, boltlaw: Boltlaw, tmp_path: Path) -> None:
        files = write_emps(tmp_path / "source")
        content = {**files["DATA_EMPS_PULSES.mat"], **changed}
        savemat(
            tmp_path / "source" / "DATA_EMPS_PULSES.mat",
            {name: value for name, value in content.items() if value is not None},
        )
        line = self.refused(boltlaw, tmp_path, "emps", tmp_path / "source", tmp_path / "new")
        assert line.startswith("DATA_EMPS_PULSES.mat: ")
        assert words in line

    @pytest.mark.parametrize(
        ("spoil", "words"),
        [
            (lambda text: text.replace("[uN]", "[N]"), "found the columns"),
            (lambda text: text.replace("5000000", "5 N", 1), "found row 1 without four finite numbers"),
            (lambda text: text.replace("\n0.07\t", "\n0.09\t"), "rows evenly spaced"),
            (lambda text: "\n".join(text.splitlines()[:1] + text.splitlines()[1::2]), "rows evenly spaced"),
        ],
    )
    def test_tribometer(
        self, spoil: Callable[[str], str], words: str, boltlaw: Boltlaw, tmp_path: Path
    ) -> None:
        write_tribometer(tmp_path / "source", cycles=1, lost=0)
        path = tmp_path / "source" / "test_data_2.txt"
        path.write_text(spoil(path.read_text()))
        assert words in self.refused(boltlaw, tmp_path, "tribometer", path, tmp_path / "new")

    def test_a_wrong_call(self, boltlaw: Boltlaw, tmp_path: Path) -> None:
        write_emps(tmp_path / "source")
        source, new = tmp_path / "source", tmp_path / "new"
        refused = self.refused
        assert 'expected "emps" (nearest' in refused(boltlaw, tmp_path, "emsp", source, new)
        assert "expected SOURCE and NEW_DIR" in refused(boltlaw, tmp_path, "emps", source)
        assert "no such file" in refused(boltlaw, tmp_path, "emps", tmp_path / "nothing", new)
        assert "existing path" in refused(boltlaw, tmp_path, "emps", source, source)
        assert "--map" in refused(boltlaw, tmp_path, "emps", source, new, "--map", source / "DATA_EMPS.mat")
        assert "NEW_DIR alone" in refused(boltlaw, tmp_path, "emps", source, new, "--download")
        assert "one of emps" in refused(boltlaw, tmp_path, "tribometer", "--download", new)


class TestDownload:
    """Through a stand-in of the loader: no test goes to the network."""

    @staticmethod
    def stand_in(monkeypatch: pytest.MonkeyPatch, emps: Callable[..., Any]) -> None:
        loader = types.ModuleType("nonlinear_benchmarks")
        loader.EMPS = emps  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", loader)

    def test_the_campaign_is_that_of_the_files(
        self, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw, tmp_path: Path
    ) -> None:
        def emps(*, data_file_locations: bool, dir_placement: str) -> None:
            assert data_file_locations
            print("dataset not found, downloading")
            write_emps(Path(dir_placement) / "EMPS")

        self.stand_in(monkeypatch, emps)
        write_emps(tmp_path / "source")
        here = imported(boltlaw, "emps", tmp_path / "source", tmp_path / "here")
        ran = boltlaw("import", "emps", "--download", tmp_path / "fetched", "--jobs", 1)
        assert ran.code == 0
        assert ran.out.startswith(f"wrote {tmp_path / 'fetched'}: 2 records (2 driven)")
        assert rom.read_campaign(tmp_path / "fetched").settings == here.settings

    def test_without_network(self, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw, tmp_path: Path) -> None:
        def emps(**_: object) -> None:
            raise ConnectionError("no route to host")

        self.stand_in(monkeypatch, emps)
        ran = boltlaw("import", "emps", "--download", tmp_path / "new")
        assert ran.code == 2
        line = one_line(ran.err)
        assert all(word in line for word in ("no route to host", "nonlinearbenchmark.org", "SOURCE"))
        assert listing(tmp_path) == {}

    def test_without_the_loader(
        self, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw, tmp_path: Path
    ) -> None:
        monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)
        ran = boltlaw("import", "silverbox", "--download", tmp_path / "new")
        assert ran.code == 2
        assert "pip install '.[datasets]'" in one_line(ran.err)
        assert listing(tmp_path) == {}

    def test_the_loader_has_what_is_called(self) -> None:
        import inspect

        loader = pytest.importorskip("nonlinear_benchmarks", reason="the extra `datasets` is not installed")
        for name in ("EMPS", "Silverbox"):
            assert {"data_file_locations", "dir_placement"} <= set(
                inspect.signature(getattr(loader, name)).parameters
            )


class TestMeasured:
    """The data themselves."""

    def test_emps_gives_the_published_numbers(self, boltlaw: Boltlaw, tmp_path: Path) -> None:
        """M 95.11 kg, F_v 203.5 N s/m, F_c 20.39 N (Janot, Gautier, Brunot 2019), here by least squares."""
        campaign = imported(boltlaw, "emps", measured("emps"), tmp_path / "new")
        for record in campaign.settings.record:
            channels = campaign.load(record).channels
            low = signal.butter(4, 40, fs=1000, output="sos")
            force, position = (
                signal.sosfiltfilt(low, channels[name].samples)
                for name in ("force_carriage", "displacement_carriage")
            )
            velocity = np.gradient(position, 1e-3)
            columns = [np.gradient(velocity, 1e-3), velocity, np.sign(velocity), np.ones_like(velocity)]
            mass, viscous, coulomb, _ = np.linalg.lstsq(np.stack(columns, axis=1), force, rcond=None)[0]
            assert mass == pytest.approx(95.11, rel=0.02)
            assert viscous == pytest.approx(203.5, rel=0.1)
            assert coulomb == pytest.approx(20.39, rel=0.1)

    def test_silverbox_has_ten_multisines_of_one_strength(self, boltlaw: Boltlaw, tmp_path: Path) -> None:
        source = measured("silverbox")
        campaign = imported(boltlaw, "silverbox", source, tmp_path / "new")
        drive = loadmat(source / "SNLS80mV.mat")["V1"].ravel()
        arrow, *rest = (campaign.load(record).channels for record in campaign.settings.record)
        np.testing.assert_array_equal(arrow["force_oscillator"].samples, drive[:40_000])
        strengths = [float(np.std(channels["force_oscillator"].samples)) for channels in rest]
        assert len(rest) == 10
        assert max(strengths) < 1.02 * min(strengths)
        for channels in rest:
            assert abs(len(channels["force_oscillator"].samples) - 8692) <= 3  # 8192 and 500 of run-in
            response = channels["displacement_oscillator"].samples
            assert abs(response[:2]).max() < 0.5 * np.std(response)

    def test_tribometer_loses_energy(self, boltlaw: Boltlaw, tmp_path: Path) -> None:
        """The force that moves the contact does work; with the other sign it would feed the rig."""
        campaign = imported(boltlaw, "tribometer", measured("tribometer"), tmp_path / "new")
        training, hold_out = (campaign.load(record).channels for record in campaign.settings.record)
        assert len(training["link_force_contact"].samples) == 25_200
        assert len(hold_out["link_force_contact"].samples) == 16_800
        for channels in (training, hold_out):
            x, force = (channels[f"link_{name}_contact"].samples for name in ("displacement", "force"))
            assert np.ptp(x) == pytest.approx(0.24e-3, rel=0.01)
            work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x)))
            assert work > 0.1 * np.abs(force).max() * float(np.sum(np.abs(np.diff(x))))
            assert np.median(channels["normal_force_contact"].samples) == pytest.approx(5.0, rel=0.01)
