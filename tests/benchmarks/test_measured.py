"""The field's benchmarks: regenerated records obey their equation, splits are official, tables say so."""

from __future__ import annotations

import sys
import types
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

import rom
from benchmarks import bouc_wen, measured, one_body
from benchmarks.measured_sets import (
    BENCHMARKS,
    CHAMPNEYS,
    SAMPLES_OF_SILVERBOX_MULTISINES,
    SOURCES,
    Published,
    Scored,
)
from experiments.datasets.collected import SourceError
from rom.campaign.campaign import write_campaign
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from tests.experiments.source_files import write_emps, write_silverbox

STEP_S = 1 / (bouc_wen.RATE_HZ * bouc_wen.FINER)
WEAK = replace(bouc_wen.OSCILLATOR, alpha=0.0, beta=0.0)  # without hysteresis: a linear oscillator


def test_a_regenerated_response_obeys_the_published_equation() -> None:
    force = bouc_wen.multisine(np.random.default_rng(1))[:12_000]
    x, v, z = bouc_wen.response(force, STEP_S).T
    rate = {name: np.gradient(course, STEP_S)[1:-1] for name, course in {"x": x, "v": v, "z": z}.items()}
    x, v, z, u = x[1:-1], v[1:-1], z[1:-1], force[2:-2:2]
    hysteresis = 5e4 * v - 1e3 * (0.8 * np.abs(v) * z - 1.1 * v * np.abs(z))
    for left, size in (
        (2 * rate["v"] + 10 * v + 5e4 * x + z - u, u),
        (rate["z"] - hysteresis, hysteresis),
        (rate["x"] - v, v),
    ):
        assert np.sqrt(np.mean(left**2)) < 2e-3 * np.std(size)
    assert np.std(z) > 0.2 * np.std(5e4 * x)


def test_regenerated_signals_are_as_published() -> None:
    force = bouc_wen.multisine(np.random.default_rng(2))[:: 2 * bouc_wen.FINER]
    lines = np.abs(np.fft.rfft(force))
    inside = (np.fft.rfftfreq(len(force), 1 / 750) >= 5) & (np.fft.rfftfreq(len(force), 1 / 750) <= 150)
    assert len(force) == 8192
    assert np.sqrt(np.mean(force**2)) == pytest.approx(50.0)
    assert lines[inside] == pytest.approx(lines[inside].max())
    assert lines[~inside].max() < 1e-9 * lines.max()
    swept = bouc_wen.sweep()
    assert len(swept) == 180 * 750 * 2 * bouc_wen.FINER
    assert np.abs(swept).max() == pytest.approx(40.0, rel=1e-3)


def test_official_test_records_are_taken_where_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = {"uval_multisine": 100, "yval_multisine": 100, "uval_sinesweep": 150, "yval_sinesweep": 150}
    for k, (name, count) in enumerate(shown.items()):
        savemat(tmp_path / f"{name}.mat", {name: k + np.arange(count)[None] / 1000.0})
    benchmark = BENCHMARKS["bouc-wen"]
    assert benchmark.source([tmp_path / "none", tmp_path]) == tmp_path
    monkeypatch.setattr(bouc_wen, "PERIOD", 64)
    found = benchmark.collect(tmp_path, 0)
    assert found.settings.name == bouc_wen.OFFICIAL
    records = {file: {name: c.samples for name, c in channels.items()} for file, channels in found.records}
    assert [record.hold_out for record in found.settings.record] == [False] * 4 + [True] * 2
    period = np.arange(100) / 1000.0
    np.testing.assert_array_equal(
        records[bouc_wen.TESTS["multisine"]]["displacement_mass"], 1 + np.tile(period, 2)
    )
    np.testing.assert_array_equal(
        records[bouc_wen.TESTS["sinesweep"]]["force_mass"], 2 + np.arange(150) / 1000.0
    )
    again = dict(benchmark.collect(None, 0).records)
    assert benchmark.collect(None, 0).settings.name.startswith("Bouc-Wen, REGENERATED")
    for file in ("records/multisine_1.h5", "records/multisine_4.h5"):
        np.testing.assert_array_equal(again[file]["force_mass"].samples, records[file]["force_mass"])


def test_silverbox_is_split_as_by_its_official_loader(tmp_path: Path) -> None:
    rests = [100, 96, 97, 98, 99, 100, 101, 102, 103, 104, 700]
    _, starts = write_silverbox(tmp_path, [8650] * 10, rests)
    benchmark = BENCHMARKS["silverbox"]
    multisines, arrow, without = benchmark.tests(tmp_path)
    first, last = SAMPLES_OF_SILVERBOX_MULTISINES
    begin = int(first + 0.75 * (last - first)) + 50
    found = [
        (starts[int(file[-5:-3]) - 1] + part.start, starts[int(file[-5:-3]) - 1] + part.stop)
        for file, part in multisines.parts
    ]
    assert found[0][0] == begin
    assert [start for start, _ in found[1:]] == starts[-2:]
    assert {stop for _, stop in found} == {last}
    assert (arrow.parts[0][1].start, without.parts[0][1]) == (150, slice(150, 32_100))
    held = {record.file for record in benchmark.collect(tmp_path, 0).settings.record if record.hold_out}
    assert held == {"records/arrow.h5", *(f"records/multisine_{k:02d}.h5" for k in (8, 9, 10))}


def test_the_error_is_that_of_the_samples_that_count(tmp_path: Path) -> None:
    """A model with the true numbers, against a displacement that is 1 mm off in some samples."""
    force = bouc_wen.multisine(np.random.default_rng(4))[:60_000]
    x = bouc_wen.response(force, STEP_S, WEAK)[:: bouc_wen.FINER, 0]
    u = force[:: 2 * bouc_wen.FINER]
    x[1000:1200] += 1e-3
    settings = one_body.settings("linear", "mass", "spring", bouc_wen.RATE_HZ, ("a.h5",), ("a.h5",))
    shown = one_body.channels("mass", u, x, bouc_wen.RATE_HZ)
    write_campaign(tmp_path / "c", settings, [("a.h5", shown)])
    structure = Structure((Body("mass", 2.0),), (Link("spring", "mass", "ground"),))
    model = Model(structure, {"spring": LinkLaws(constant_stiffness(5e4), constant_damping(10.0))})
    campaign = rom.read_campaign(tmp_path / "c")
    sound, off = (
        measured.error_of(model, campaign, Scored("", (("a.h5", part),)))
        for part in (slice(0, 1000), slice(1000, 1200))
    )
    assert sound < 5e-7
    assert off == pytest.approx(1e-3, rel=1e-3)


def outcome() -> measured.Outcome:
    model: Any = SimpleNamespace(summary=lambda: "bodies: carriage 95 kg")
    closure: Any = SimpleNamespace(verdict="unexplained", model=model)
    best = Published(5.17, "polynomial NARX", CHAMPNEYS)
    errors = ((Scored("pulses", (), best), 17.3e-3, 8.6e-3), (Scored("others", ()), 1e-3, np.inf))
    return measured.Outcome("emps", "EMPS twin", closure, errors, 61.4, 59.6)


def test_the_table_has_a_row_for_each_test_and_the_equation_below() -> None:
    head, line, first, second = measured.table([outcome()])
    assert head.count("|") == line.count("|") == first.count("|") == second.count("|")
    assert "| emps | pulses | mm | 17.3 | 8.6 | 5.17 | polynomial NARX, in Champneys et al. 2024 |" in first
    assert first.endswith(" | unexplained | 61 | 60 |")
    assert "| emps | others | mm | 1 | inf | – | – |  |  |  |" in second
    assert measured.cited([outcome()]) == [f"{CHAMPNEYS}: {SOURCES[CHAMPNEYS]}."]
    assert measured.equation(outcome()).splitlines()[1] == "campaign: EMPS twin"
    assert measured.equation(outcome()).endswith("bodies: carriage 95 kg")


class TestFiles:
    """What is found, fetched, skipped with a line; no test goes to the network."""

    def test_sets_without_files_are_skipped_with_a_line(self, tmp_path: Path) -> None:
        write_emps(tmp_path / "deep" / "below")
        found, lines = measured.sources(tuple(BENCHMARKS), [tmp_path], None)
        assert found == {"emps": tmp_path, "bouc-wen": None}
        said = dict(line.split(": ", 1) for line in lines)
        assert said.pop("bouc-wen").startswith("regenerated from its published equation: found no uval_")
        assert set(said) == {"silverbox", "cascaded-tanks", "f-16"}
        assert all("skipped: found no " in line and "--download" in line for line in said.values())

    def test_they_are_fetched_by_their_loader(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def tanks(*, data_file_locations: bool, dir_placement: str) -> None:
            assert data_file_locations
            folder = Path(dir_placement) / "Cascaded_Tanks"
            folder.mkdir(parents=True)
            levels = {
                f"{letter}{kind}": np.arange(40.0)[:, None] for letter in "uy" for kind in ("Est", "Val")
            }
            savemat(folder / "dataBenchmark.mat", {**levels, "Ts": [[4.0]]})

        def offline(**_: object) -> None:
            raise ConnectionError("no route to host")

        loader: Any = types.ModuleType("nonlinear_benchmarks")
        loader.Cascaded_Tanks, loader.Silverbox = tanks, offline
        others: Any = types.ModuleType("nonlinear_benchmarks.not_splitted_benchmarks")
        others.BoucWen = lambda **_: None
        for module in (loader, others):
            monkeypatch.setitem(sys.modules, module.__name__, module)
        found, lines = measured.sources(("silverbox", "bouc-wen", "cascaded-tanks"), [], tmp_path)
        assert "no route to host" in lines[0]
        assert "its loader left no uval_multisine.mat" in lines[1]
        assert found["bouc-wen"] is None
        made = BENCHMARKS["cascaded-tanks"].collect(found["cascaded-tanks"], 0)
        shown = dict(made.records)
        assert [(r.file, r.hold_out) for r in made.settings.record] == [
            ("records/estimation.h5", False), ("records/validation.h5", True),
        ]  # fmt: skip
        assert shown["records/validation.h5"]["displacement_level"].rate_hz == 0.25

    def test_an_aircraft_is_a_campaign_of_modes(self, tmp_path: Path) -> None:
        benchmark = BENCHMARKS["f-16"]
        for k, name in enumerate(benchmark.files):
            motion = k + np.arange(60.0).reshape(3, 20)
            savemat(tmp_path / name, {"Force": motion[:1], "Acceleration": motion, "Fs": [[400.0]]})
        made = benchmark.collect(benchmark.source([tmp_path]), 0)
        assert [record.hold_out for record in made.settings.record] == [False, True] * 3 + [False]
        assert {file for test in benchmark.tests(tmp_path) for file, _ in test.parts} == {
            record.file for record in made.settings.record if record.hold_out
        }
        shown = dict(made.records)["records/level_2.h5"]
        np.testing.assert_array_equal(shown["acceleration_payload"].samples, 1 + np.arange(40.0, 60.0))
        savemat(
            tmp_path / benchmark.files[0], {"Force": motion[:1], "Acceleration": motion[:2], "Fs": [[400.0]]}
        )
        with pytest.raises(SourceError, match=r"Level1.mat: Acceleration: found \(2, 20\)"):
            list(benchmark.collect(tmp_path, 0).records)

    def test_files_of_something_else_are_skipped_with_a_line(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "dataBenchmark.mat").write_bytes(b"no such thing")
        measured.main(["--only", "cascaded-tanks", "emps", "--data", str(tmp_path)])
        shown = capsys.readouterr()
        skipped = {line.partition(":")[0]: line for line in shown.err.splitlines() if "skipped" in line}
        assert "dataBenchmark.mat" in skipped["cascaded-tanks"]
        assert "found no DATA_EMPS.mat" in skipped["emps"]
        assert len([line for line in shown.out.splitlines() if line.startswith("|")]) == 2  # the head alone

    def test_a_folder_that_is_none_ends_the_command(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        with pytest.raises(SystemExit) as ended:
            measured.main(["--data", str(tmp_path / "none")])
        assert ended.value.code == 2
        assert "found no folder" in capsys.readouterr().err
