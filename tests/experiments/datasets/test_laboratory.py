"""A laboratory's files and one map: the same campaign from every format, and one line for what cannot be."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

import rom
from experiments.datasets.catman import read as read_catman
from tests.experiments.source_files import (
    Signals,
    catman_bytes,
    write_catman,
    write_matlab,
    write_matlab_73,
    write_matlab_export,
    write_tdms,
    write_uff,
    write_uff_binary,
)
from tests.experiments.test_cli import listing, one_line

Boltlaw = Callable[..., Any]
Write = Callable[[Path, Signals], None]
MOTION_HZ, STRAIN_HZ, DURATION_S = 19200, 4800, 0.2
FORMATS: dict[str, tuple[str, str, Write]] = {
    "catman": ("catman", ".bin", write_catman),
    "matlab variables": ("matlab", ".mat", write_matlab),
    "matlab export": ("matlab", ".mat", write_matlab_export),
    "matlab 7.3": ("matlab", ".MAT", write_matlab_73),
    "uff": ("uff", ".uff", write_uff),
    "uff, binary": ("uff", ".unv", write_uff_binary),
    "tdms": ("tdms", ".tdms", write_tdms),
}
UNITLESS = ("matlab variables", "matlab 7.3")
_CART = """
body = [{name = "m"}]
link = [{name = "spring", between = ["m", "ground"], law = "linear"}]
"""
MAP = """
format = "boltlaw-import/1"
name = "two oscillators"
body = [{name = "lo", mass_kg = 8.625}, {name = "so"}]
[[link]]
name = "flexure_lo"
between = ["lo", "ground"]
law = "linear"
[[link]]
name = "joint"
between = ["lo", "so"]
law = "bolted"
[bolt]
link = "joint"
calibration = [2718.7, 2363.7, -575.63]
[sampling]
motion_rate_hz = 19200
tension_rate_hz = 4800
pretrigger_s = 0.01
[windows]
initial_s = [0.0, 0.01]
final_s = [0.1, 0.2]
[channels]
Hammer = {channel = "force_lo", UNIT_KN}
A_lo = {channel = "acceleration_lo", scale = -9.81}
A_so = {channel = "acceleration_so", UNIT_G}
Bolt = "strain"
[[record]]
file = "loose/*_3.*"
test = "loosening"
hold_out = true
[[record]]
file = "loose/M{preload_n}N_*.*"
test = "loosening"
[[record]]
file = "coupled_[0-9].*"
test = "coupled"
preload_n = 10
"""


def map_text(named: bool) -> str:
    """Return the map; files without units have them named in it."""
    kilonewton, gravity = ('unit = "kN"', 'unit = "g"') if named else ("", "")
    return MAP.replace(", UNIT_KN", f", {kilonewton}" if named else "").replace(
        ", UNIT_G", f", {gravity}" if named else ""
    )


def known_signals(seed: int) -> Signals:
    """Return four signals of two rates, as an amplifier delivers them; one is not wanted."""
    random = np.random.default_rng(seed)
    motion, strain = round(MOTION_HZ * DURATION_S), round(STRAIN_HZ * DURATION_S)
    return {
        "Hammer": (random.standard_normal(motion), "kN", MOTION_HZ),
        "A_lo": (random.standard_normal(motion), "g", MOTION_HZ),
        "A_so": (random.standard_normal(motion), "g", MOTION_HZ),
        "Bolt": (random.standard_normal(strain), "mm/m", STRAIN_HZ),
        "Room": (random.standard_normal(strain), "degC", STRAIN_HZ),
    }


def write_folder(folder: Path, form: str, names: tuple[str, ...]) -> dict[str, Signals]:
    """Write one file per name, and the map beside them."""
    _, ending, write = FORMATS[form]
    written = {}
    for seed, name in enumerate(names):
        path = folder / f"{name}{ending}"
        path.parent.mkdir(parents=True, exist_ok=True)
        written[name] = known_signals(seed)
        write(path, written[name])
    (folder / "import.toml").write_text(map_text(form in UNITLESS))
    return written


NAMES = ("loose/M152.7N_1", "loose/M300N_2", "loose/M300N_3", "coupled_1", "notes")


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_gives_the_same_campaign(form: str, boltlaw: Boltlaw, tmp_path: Path) -> None:
    written = write_folder(tmp_path / "lab", form, NAMES)
    ran = boltlaw("import", FORMATS[form][0], tmp_path / "lab", tmp_path / "new", "--jobs", 1)
    assert (ran.code, ran.err) == (0, "")
    assert f"1 files that no [[record]] of the map matches: notes{FORMATS[form][1]}" in ran.out
    campaign = rom.read_campaign(tmp_path / "new")
    told = {r.file: (r.test, r.preload_n, r.hold_out) for r in campaign.settings.record}
    assert told == {
        "records/coupled_1.h5": ("coupled", 10.0, False),
        "records/loose/M152.7N_1.h5": ("loosening", 152.7, False),
        "records/loose/M300N_2.h5": ("loosening", 300.0, False),
        "records/loose/M300N_3.h5": ("loosening", None, True),
    }
    factors = {"force_lo": ("Hammer", 1e3), "acceleration_lo": ("A_lo", -9.81),
               "acceleration_so": ("A_so", 9.80665), "strain": ("Bolt", 1.0)}  # fmt: skip
    for record in campaign.settings.record:
        channels = campaign.load(record).channels
        assert set(channels) == set(factors)
        for name, (signal, factor) in factors.items():
            samples, _, rate = written[record.file[8:-3]][signal]
            assert channels[name].rate_hz == rate
            np.testing.assert_allclose(channels[name].samples, factor * samples, rtol=1e-9, atol=1e-9)


def test_the_map_of_the_docs_does_what_they_say(boltlaw: Boltlaw, tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "docs" / "import.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    folder = tmp_path / "lab"
    (folder / "loosening").mkdir(parents=True)
    (folder / "import.toml").write_text(shown)
    random = np.random.default_rng(4)
    motion, strain = random.standard_normal((2, 2100 * 4)), 0.1 * random.standard_normal(2100)
    signals: Signals = {
        "Force hammer": (motion[0], "kN", 4000),
        "Acc LO": (motion[1], "", 4000),
        "Acc SO": (motion[0], "", 4000),
        "Bolt": (np.repeat(strain, 5)[: 4800 * 21 // 10], "", 4800),
    }
    for name in ("loosening/M152N_1", "loosening/M152N_5", "coupled_1", "hammer_so"):
        write_matlab_export(folder / f"{name}.mat", signals)
    ran = boltlaw("import", "matlab", folder, tmp_path / "new", "--jobs", 1)
    assert ran.code == 0, ran.err
    campaign = rom.read_campaign(tmp_path / "new")
    told = {r.file: (r.test, r.bodies, r.preload_n, r.hold_out) for r in campaign.settings.record}
    assert told["records/loosening/M152N_1.h5"] == ("loosening", None, 152.0, False)
    assert told["records/loosening/M152N_5.h5"] == ("loosening", None, None, True)
    assert told["records/hammer_so.h5"] == ("uncoupled", ("so",), None, False)
    by_file = {record.file: campaign.load(record).channels for record in campaign.settings.record}
    assert set(by_file["records/hammer_so.h5"]) == {"force_so", "acceleration_so"}
    channels = by_file["records/coupled_1.h5"]
    np.testing.assert_allclose(channels["force_lo"].samples, 1e3 * motion[0])
    np.testing.assert_allclose(channels["acceleration_so"].samples, -9.80665 * motion[0])
    assert (channels["strain"].rate_hz, channels["force_lo"].rate_hz) == (4800, pytest.approx(4000))


@pytest.mark.parametrize(
    ("test", "channel", "sampling", "body"),
    [
        ("hold", "tension", "{tension_rate_hz = 4800}", ""),
        ("free", "displacement_m", "{motion_rate_hz = 4800, pretrigger_s = 0}", _CART),
    ],
)
def test_what_a_campaign_need_not_tell_a_map_need_not_either(
    test: str, channel: str, sampling: str, body: str, boltlaw: Boltlaw, tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    savemat(tmp_path / "lab" / "one.mat", {"shown": np.linspace(1.0, 2.0, 400)})
    unit = "N" if test == "hold" else "m"
    (tmp_path / "lab" / "import.toml").write_text(
        f'format = "boltlaw-import/1"\nname = "plain"\nsampling = {sampling}\n{body}'
        f'channels = {{shown = {{channel = "{channel}", unit = "{unit}"}}}}\n'
        f'record = [{{file = "*.mat", test = "{test}"}}]\n'
    )
    ran = boltlaw("import", "matlab", tmp_path / "lab", tmp_path / "new", "--jobs", 1)
    assert (ran.code, ran.err) == (0, "")
    campaign = rom.read_campaign(tmp_path / "new")
    (record,) = campaign.settings.record
    assert campaign.load(record).channels[channel].rate_hz == 4800


@pytest.mark.parametrize(("precision", "error"), [(8, 0.0), (4, 1e-6), (2, 5e-4)])
def test_catman_of_every_precision(precision: int, error: float, tmp_path: Path) -> None:
    signals = known_signals(3)
    (tmp_path / "a.bin").write_bytes(catman_bytes(signals, precision))
    found = {signal.name: signal for signal in read_catman(tmp_path / "a.bin")}
    for name, (samples, unit, rate) in signals.items():
        np.testing.assert_allclose(found[name].samples, samples, atol=error)
        assert (found[name].unit, found[name].rate_hz) == (unit, pytest.approx(rate))


def test_structures_and_columns_of_matlab_have_the_names_that_matlab_gives(tmp_path: Path) -> None:
    from scipy.io import savemat

    from experiments.datasets.matlab import read

    table = np.arange(12.0).reshape(6, 2)
    savemat(
        tmp_path / "a.mat",
        {"run": {"force": table[:, 0], "note": "soft tip"}, "data": table, "wide": table.T},
    )
    found = {signal.name: signal.samples for signal in read(tmp_path / "a.mat")}
    assert set(found) == {"run.force", "data(:,1)", "data(:,2)", "wide(1,:)", "wide(2,:)"}
    np.testing.assert_array_equal(found["data(:,2)"], table[:, 1])
    np.testing.assert_array_equal(found["wide(2,:)"], table[:, 1])


def test_names_that_are_shared_are_told_apart(tmp_path: Path) -> None:
    import nptdms

    from experiments.datasets import tdms, uff

    samples = np.ones(20)
    write_uff(tmp_path / "a.uff", {"x": (samples, "N", 100.0)})
    write_uff(tmp_path / "a.uff", {"x": (samples, "N", 100.0), "y": (samples, "N", 100.0)})
    assert [signal.name for signal in uff.read(tmp_path / "a.uff")] == ["1:+Z", "1:+Z", "y"]
    with nptdms.TdmsWriter(str(tmp_path / "a.tdms")) as writer:
        writer.write_segment([nptdms.ChannelObject(group, "x", samples) for group in ("one", "two")])
    assert [signal.name for signal in tdms.read(tmp_path / "a.tdms")] == ["one/x", "two/x"]


def test_a_tail_that_one_amplifier_lacks_is_cut(boltlaw: Boltlaw, tmp_path: Path) -> None:
    signals = dict(known_signals(1))
    samples, unit, rate = signals["Bolt"]
    signals["Bolt"] = (samples[:-4], unit, rate)
    del signals["Room"]
    (tmp_path / "lab").mkdir()
    write_catman(tmp_path / "lab" / "coupled_1.bin", signals)
    (tmp_path / "lab" / "import.toml").write_text(map_text(False))
    ran = boltlaw("import", "catman", tmp_path / "lab", tmp_path / "new", "--jobs", 1)
    assert ran.code == 0, ran.err
    assert "1 records cut to their shortest channel: coupled_1.bin (0.000833 s)" in ran.out
    campaign = rom.read_campaign(tmp_path / "new")
    channels = campaign.load(campaign.settings.record[0]).channels
    assert len(channels["strain"].samples) == len(samples) - 4
    assert len(channels["force_lo"].samples) == 4 * (len(samples) - 4)


def changed(old: str, new: str) -> Callable[[Path], None]:
    """Return what replaces text in the map."""

    def spoil(folder: Path) -> None:
        text = (folder / "import.toml").read_text()
        assert old in text
        (folder / "import.toml").write_text(text.replace(old, new))

    return spoil


def bytes_of(content: bytes) -> Callable[[Path], None]:
    """Return what puts other bytes into the file."""
    return lambda folder: (folder / "coupled_1.bin").write_bytes(content) and None


def truncated(folder: Path) -> None:
    """Cut a file in its data."""
    path = folder / "coupled_1.bin"
    path.write_bytes(path.read_bytes()[:-40_000])


BAD: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "no map": (lambda f: (f / "import.toml").unlink(),
               ("import.toml", '"Hammer" [kN] 19200 Hz', '"Bolt" [mm/m] 4800 Hz')),
    "no TOML": (changed("[channels]", "[channels"), ("import.toml", "expected TOML")),
    "format": (changed("boltlaw-import/1", "boltlaw-campaign/1"), ("format", "boltlaw-import/1")),
    "campaign key": (changed("pretrigger_s", "pretriger_s"),
                     ("import.toml", "sampling.pretriger_s", "pretrigger_s")),
    "campaign value": (changed('"coupled"\n', '"copled"\n'), ("record[2].test", "coupled")),
    "structure": (changed('["lo", "so"]', '["lo", "os"]'), ("link[1].between", "os")),
    "channel name": (changed('"force_lo"', '"forc_lo"'),
                     ('channels."Hammer".channel', "forc_lo", "force_lo")),
    "rule key": (changed("scale =", "scael ="), ('channels."A_lo".scael', "scale")),
    "scale": (changed("-9.81", '"-9.81"'), ('channels."A_lo".scale', "a number other than 0")),
    "zero scale": (changed("-9.81", "0"), ('channels."A_lo".scale', "a number other than 0")),
    "scale and unit": (changed("scale = -9.81", 'scale = 1.0, unit = "g"'), ("A_lo", "scale and unit")),
    "rule": (changed('Bolt = "strain"', "Bolt = 3"), ('channels."Bolt"', "3")),
    "no channels": (lambda f: changed("[channels]", "[chanels]")(f), ("chanels", "unknown key")),
    "pattern": (changed('"coupled_[0-9].*"', "3"), ("record[2].file", "pattern")),
    "no match": (changed("coupled_[0-9]", "copled_*"), ("coupled_1.bin", "copled_")),
    "signal name": (changed("A_so", "A_os"), ('channels."A_os"', "no file", "A_so")),
    "unit of another quantity": (changed('Hammer = {channel = "force_lo"', 'Room = {channel = "force_lo"'),
                                 ("coupled_1.bin: Room", "degC", "kN")),
    "two signals for one channel": (changed('"acceleration_so"', '"acceleration_lo"'),
                                    ("acceleration_lo", "another signal")),
    "no force": (changed("Hammer = ", "# "), ("records/coupled_1.h5", "force_lo")),
    "empty file": (bytes_of(b""), ("coupled_1.bin", "catman file")),
    "noise": (bytes_of(np.random.default_rng(0).bytes(4000)), ("coupled_1.bin", "catman file")),
    "truncated": (truncated, ("coupled_1.bin", "expected", "header")),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_source_is_refused_in_one_line(case: str, boltlaw: Boltlaw, tmp_path: Path) -> None:
    write_folder(tmp_path / "lab", "catman", ("coupled_1",))
    spoil, words = BAD[case]
    spoil(tmp_path / "lab")
    before = listing(tmp_path)
    ran = boltlaw("import", "catman", tmp_path / "lab", tmp_path / "deep" / "new", "--jobs", 1)
    assert ran.code == 2, ran.err
    assert ran.out == ""
    line = one_line(ran.err)
    assert all(word in line for word in words), line
    assert listing(tmp_path) == before


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("content", [b"", b"\0" * 600, b"no such thing\n" * 40])
def test_bytes_of_something_else_are_refused_in_one_line(
    form: str, content: bytes, boltlaw: Boltlaw, tmp_path: Path
) -> None:
    write_folder(tmp_path / "lab", form, ("coupled_1",))
    path = tmp_path / "lab" / f"coupled_1{FORMATS[form][1]}"
    path.write_bytes(content)
    before = listing(tmp_path)
    ran = boltlaw("import", FORMATS[form][0], tmp_path / "lab", tmp_path / "new", "--jobs", 1)
    assert ran.code == 2, ran.err
    assert path.name in one_line(ran.err)
    assert listing(tmp_path) == before


@pytest.mark.parametrize("form", FORMATS)
def test_a_file_cut_short_is_no_shorter_record(form: str, boltlaw: Boltlaw, tmp_path: Path) -> None:
    write_folder(tmp_path / "lab", form, ("coupled_1",))
    path = tmp_path / "lab" / f"coupled_1{FORMATS[form][1]}"
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 8])
    ran = boltlaw("import", FORMATS[form][0], tmp_path / "lab", tmp_path / "new", "--jobs", 1)
    assert ran.code == 2, ran.err
    assert "coupled_1" in one_line(ran.err)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("form", "package"),
    [("catman", "apread"), ("matlab", "pymatreader"), ("uff", "pyuff"), ("tdms", "nptdms")],
)
def test_a_missing_package_is_told_with_its_extra(
    form: str, package: str, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw, tmp_path: Path
) -> None:
    written = next(name for name, (own, _, _) in FORMATS.items() if own == form)
    write_folder(tmp_path / "lab", written, ("coupled_1",))
    monkeypatch.setitem(sys.modules, package, None)
    ran = boltlaw("import", form, tmp_path / "lab", tmp_path / "new", "--jobs", 1)
    assert ran.code == 2
    assert f"pip install '.[{form}]'" in one_line(ran.err)
    assert not (tmp_path / "new").exists()
