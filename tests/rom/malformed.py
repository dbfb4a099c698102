"""Every way a campaign can be malformed: for the tests of the reader and of the commands.

`MALFORMED` holds (name, spoil): `spoil(folder)` writes a campaign with one fault to a new folder and returns
the words that the one line about it must hold, the faulty file first.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomli_w
from scipy.io import savemat

from tests.rom.sound_campaign import (
    COUPLED,
    CYCLED,
    DRIVEN,
    HOLD,
    LOOSENING,
    UNCOUPLED,
    sound_channels,
    write_sound_campaign,
)

TOML = "campaign.toml"
Words = tuple[str, ...]
Spoil = Callable[[Path], Words]


def _spoiled(change: Callable[[Path], None], *words: str) -> Spoil:
    def spoil(folder: Path) -> Words:
        write_sound_campaign(folder)
        change(folder)
        return words

    return spoil


def _settings(change: Callable[[dict[str, Any]], object], *words: str) -> Spoil:
    def rewrite(folder: Path) -> None:
        data = tomllib.loads((folder / TOML).read_text())
        change(data)
        (folder / TOML).write_text(tomli_w.dumps(data))

    return _spoiled(rewrite, TOML, *words)


def _text(old: str, new: str, *words: str) -> Spoil:
    def rewrite(folder: Path) -> None:
        text = (folder / TOML).read_text()
        assert old in text
        (folder / TOML).write_text(text.replace(old, new, 1))

    return _spoiled(rewrite, TOML, *words)


def _h5(change: Callable[[h5py.File], object], *words: str, file: str = LOOSENING) -> Spoil:
    def edit(folder: Path) -> None:
        with h5py.File(folder / file, "r+") as record:
            change(record)

    return _spoiled(edit, file, *words)


def _mat(change: dict[str, Any], *words: str) -> Spoil:
    def edit(folder: Path) -> None:
        variables = {name: channel.samples for name, channel in sound_channels(COUPLED).items()} | change
        (folder / COUPLED).unlink()
        savemat(folder / COUPLED, {name: value for name, value in variables.items() if value is not None})

    return _spoiled(edit, COUPLED, *words)


def _csv(change: Callable[[list[list[str]]], object], *words: str) -> Spoil:
    def edit(folder: Path) -> None:
        rows = [line.split(",") for line in (folder / DRIVEN).read_text().splitlines()]
        change(rows)
        (folder / DRIVEN).write_text("\n".join(",".join(row) for row in rows) + "\n")

    return _spoiled(edit, DRIVEN, *words)


def _bytes(change: Callable[[Path], object], file: str, *words: str) -> Spoil:
    return _spoiled(lambda folder: (change(folder / file), None)[1], file, *words)


def _replaced(name: str, value: Any) -> Callable[[h5py.File], None]:
    def change(record: h5py.File) -> None:
        del record[name]
        record[name] = value

    return change


def _set(table: str, index: int | None, key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        (data[table] if index is None else data[table][index])[key] = value

    return change


def _renamed(old: str, new: str) -> Callable[[dict[str, Any]], None]:
    return lambda data: data.update({new: data.pop(old)})


def _not_a_number(record: h5py.File) -> None:
    record["acceleration_so"][123] = np.nan


def _cut(seconds: float) -> Callable[[h5py.File], None]:
    def change(record: h5py.File) -> None:
        for name in list(record):
            rate = record[name].attrs["rate_hz"]
            samples = record[name][: round(seconds * rate)]
            _replaced(name, samples)(record)
            record[name].attrs["rate_hz"] = rate

    return change


def _escape(folder: Path) -> None:
    outside = folder.parent / f"{folder.name}-outside.h5"
    (folder / LOOSENING).rename(outside)
    (folder / LOOSENING).symlink_to(outside)


def _linked(folder: Path) -> None:
    outside = folder.parent / f"{folder.name}-outside.h5"
    with h5py.File(outside, "w") as other:
        other["strain"] = np.zeros(300)
    with h5py.File(folder / LOOSENING, "r+") as record:
        _replaced("strain", h5py.ExternalLink(str(outside), "strain"))(record)


def _second_time_again(rows: list[list[str]]) -> None:
    rows[100][0] = rows[99][0]


def _lost_row(rows: list[list[str]]) -> None:
    del rows[500]


def _cell(row: int, column: int, text: str) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        rows[row][column] = text

    return change


def _rate(name: str, rate: Any) -> Callable[[h5py.File], None]:
    return lambda record: record[name].attrs.__setitem__("rate_hz", rate)


def _band(low_hz: float, **end: float) -> Callable[[dict[str, Any]], None]:
    return lambda data: data.update(band={"low_hz": low_hz, **end})


def _own(key: str, name: str, value: float) -> Callable[[dict[str, Any]], None]:
    return _set("record", 1, key, {name: value})


_K = "stiffness_n_per_m"
_OF_BAND_AND_VALUES: list[tuple[str, Spoil]] = [
    ("a band that falls", _settings(_band(50, high_hz=20), "band.high_hz:", "20", "50")),
    ("a band above half the rate", _settings(_band(5, high_hz=200), "band.high_hz:", "200", "half")),
    ("a band without an end", _settings(_band(5), "band.high_hz:", "nothing", "above 0")),
    ("a record's mass of no body", _settings(_own("mass_kg", "l0", 9.1), "record[1].mass_kg.l0:", '"lo"')),
    (
        "a record's mass of 0",
        _settings(_own("mass_kg", "lo", 0.0), "record[1].mass_kg.lo:", "0.0", "above 0"),
    ),
    ("one mass for a record", _settings(_set("record", 1, "mass_kg", 9.1), "record[1].mass_kg:", "a table")),
    ("a record's spring of no link", _settings(_own(_K, "flexure", 1.0), f"{_K}.flexure:", '"flexure_lo"')),
    ("a record's bolted spring", _settings(_own(_K, "joint", 1.0), f"{_K}.joint:", "depends on the tension")),
    (
        "a record's dashpot spring",
        _settings(_own(_K, "flexure_so", 1.0), f"{_K}.flexure_so:", "damping only"),
    ),
]

MALFORMED: list[tuple[str, Spoil]] = [
    # campaign.toml: the file, its keys, their values
    ("no settings file", _spoiled(lambda folder: (folder / TOML).unlink(), TOML, "no such file")),
    ("settings are not TOML", _text('name = "two', 'name = two"', "TOML", "line 2")),
    ("a key given twice", _text('name = "two oscillators"', 'name = "a"\nname = "b"', "TOML")),
    ("another format", _settings(lambda data: data.update(format="boltlaw-campaign/2"), "format:", "/1")),
    ("no format", _settings(lambda data: data.pop("format"), "format:", "nothing")),
    ("no name", _settings(lambda data: data.pop("name"), "name:", "nothing")),
    ("no sampling", _settings(lambda data: data.pop("sampling"), "sampling:", "[sampling]")),
    ("no windows", _settings(lambda data: data.pop("windows"), "windows:", "[windows]")),
    ("no record", _settings(lambda data: data.pop("record"), "record:", "[[record]]")),
    ("no body", _settings(lambda data: data.update(body=[]), "body:", "[[body]]")),
    ("a table for a list", _settings(lambda data: data.update(body={"name": "lo"}), "body:", "[[body]]")),
    ("a misspelt table", _settings(_renamed("windows", "window"), "window:", '"windows"')),
    ("a misspelt key", _text("motion_rate_hz", "motion_rate", "sampling.motion_rate:", '"motion_rate_hz"')),
    ("a misspelt optional key", _text("mass_kg", "mass", "body[0].mass:", '"mass_kg"')),
    ("text for a mass", _settings(_set("body", 0, "mass_kg", "8.6"), "body[0].mass_kg:", '"8.6"', "above 0")),
    ("a mass of zero", _settings(_set("body", 0, "mass_kg", 0), "body[0].mass_kg:", "found 0,", "above 0")),
    ("an infinite mass", _settings(_set("body", 0, "mass_kg", np.inf), "body[0].mass_kg:", "inf", "above 0")),
    (
        "a body called ground",
        _settings(lambda data: data["body"].append({"name": "ground"}), "body[2].name:", "ground"),
    ),
    ("a body without a name", _settings(_set("body", 0, "name", ""), "body[0].name:", "a name")),
    ("a body twice", _settings(lambda data: data["body"].append({"name": "lo"}), "body[2].name:", "again")),
    ("a link twice", _settings(_set("link", 1, "name", "flexure_lo"), "link[1].name:", "again")),
    (
        "a link to nowhere",
        _settings(_set("link", 0, "between", ["lo", "grund"]), "link[0].between[1]:", "ground"),
    ),
    ("a link to itself", _settings(_set("link", 0, "between", ["lo", "lo"]), "link[0].between:", "twice")),
    ("a link with one end", _settings(_set("link", 0, "between", ["lo"]), "link[0].between:", "two names")),
    ("an unknown link law", _settings(_set("link", 0, "law", "liner"), "link[0].law:", '"linear"')),
    (
        "a stiff dashpot",
        _settings(_set("link", 1, "stiffness_n_per_m", 5), "link[1].stiffness_n_per_m:", "5"),
    ),
    (
        "a negative damping",
        _settings(_set("link", 1, "damping_ns_per_m", -1), "link[1].damping_ns_per_m:", "-1"),
    ),
    ("no bolt for a bolted link", _settings(lambda data: data.pop("bolt"), "bolt:", '"joint"')),
    ("a bolt on no link", _settings(_set("bolt", None, "link", "jont"), "bolt.link:", '"jont"', '"joint"')),
    ("a bolt on a spring", _settings(_set("bolt", None, "link", "flexure_lo"), "bolt.link:", "not bolted")),
    (
        "a falling calibration",
        _settings(_set("bolt", None, "calibration", [-1.0]), "bolt.calibration[0]:", "-1"),
    ),
    (
        "a calibration of nan",
        _settings(_set("bolt", None, "calibration", [1.0, np.nan]), "bolt.calibration[1]:"),
    ),
    ("an empty calibration", _settings(_set("bolt", None, "calibration", []), "bolt.calibration:", "[]")),
    (
        "strain uncalibrated",
        _settings(lambda data: data["bolt"].pop("calibration"), "bolt.calibration:", COUPLED),
    ),
    (
        "a rate of zero",
        _settings(_set("sampling", None, "motion_rate_hz", 0), "sampling.motion_rate_hz:", "0"),
    ),
    (
        "a negative rate",
        _settings(_set("sampling", None, "tension_rate_hz", -5), "sampling.tension_rate_hz:", "-5"),
    ),
    (
        "a negative pretrigger",
        _settings(_set("sampling", None, "pretrigger_s", -0.5), "sampling.pretrigger_s:", "-0.5"),
    ),
    (
        "true for a number",
        _settings(_set("sampling", None, "pretrigger_s", True), "sampling.pretrigger_s:", "true"),
    ),
    (
        "a window backwards",
        _settings(_set("windows", None, "final_s", [8, 2]), "windows.final_s:", "[8, 2]", "start"),
    ),
    (
        "a window before time 0",
        _settings(_set("windows", None, "initial_s", [-1, 2]), "windows.initial_s[0]:", "-1"),
    ),
    (
        "windows that overlap",
        _settings(_set("windows", None, "initial_s", [0, 2.5]), "windows.final_s:", "2.5"),
    ),
    (
        "a window of one number",
        _settings(_set("windows", None, "initial_s", [0]), "windows.initial_s:", "[0]", "end"),
    ),
    (
        "an unknown test",
        _settings(_set("record", 2, "test", "losening"), "record[2].test:", 'nearest: "loosening"'),
    ),
    (
        "an unknown body in a record",
        _settings(_set("record", 2, "bodies", ["lo", "os"]), "record[2].bodies[1]:", "os"),
    ),
    ("no body that moves", _settings(_set("record", 2, "bodies", []), "record[2].bodies:", "empty")),
    (
        "a negative preload",
        _settings(_set("record", 1, "preload_n", -3), "record[1].preload_n:", "-3", "0 or more"),
    ),
    *_OF_BAND_AND_VALUES,
    (
        "a word for hold_out",
        _settings(_set("record", 1, "hold_out", "no"), "record[1].hold_out:", '"no"', "false"),
    ),
    (
        "a record twice",
        _settings(_set("record", 3, "file", "records/./loosening.h5"), "record[3].file:", "again"),
    ),
    (
        "a record by absolute path",
        _settings(_set("record", 2, "file", "/tmp/a.h5"), "record[2].file:", "relative"),
    ),
    (
        "a record outside",
        _settings(_set("record", 2, "file", "records/../../a.h5"), "record[2].file:", "inside"),
    ),
    (
        "a record of another kind",
        _settings(_set("record", 2, "file", "a.tdms"), "record[2].file:", "a.tdms", ".mat"),
    ),
    # record files
    ("a missing record", _bytes(Path.unlink, LOOSENING, "file:", "no such file")),
    ("a link out of the folder", _spoiled(_escape, LOOSENING, "file:", "elsewhere")),
    ("a data set outside", _spoiled(_linked, LOOSENING, "strain:", "link")),
    ("no HDF5 file", _bytes(lambda path: path.write_bytes(b"no HDF5"), LOOSENING, "file:", "unreadable")),
    (
        "half an HDF5 file",
        _bytes(lambda path: path.write_bytes(path.read_bytes()[:9000]), LOOSENING, "file:"),
    ),
    ("half a MAT file", _bytes(lambda path: path.write_bytes(path.read_bytes()[:9000]), COUPLED, "file:")),
    ("an empty MAT file", _bytes(lambda path: path.write_bytes(b""), COUPLED, "file:", "unreadable")),
    ("an empty CSV file", _bytes(lambda path: path.write_text(""), DRIVEN, "header:", "time_s")),
    (
        "a CSV file of bytes",
        _bytes(lambda path: path.write_bytes(bytes(range(256))), DRIVEN, "file:", "unreadable"),
    ),
    ("no channel", _h5(lambda record: record.clear(), "file:", "no channel")),
    # channels: names, types, shapes, rates
    ("an unknown channel", _h5(lambda record: record.move("strain", "strian"), "strian:", '"strain"')),
    (
        "a channel of no known body",
        _h5(lambda record: record.move("force_lo", "force_xy"), "force_xy:", "unknown"),
    ),
    (
        "a group",
        _h5(lambda record: (record.pop("strain"), record.create_group("strain")), "strain:", "group"),
    ),
    ("no samples", _h5(_replaced("strain", np.empty(0)), "strain:", "no samples")),
    ("complex samples", _h5(_replaced("strain", np.ones(300, dtype=complex)), "strain:", "complex")),
    ("text for samples", _h5(_replaced("strain", [b"a"] * 300), "strain:", "text")),
    ("a table of samples", _h5(_replaced("strain", np.ones((150, 2))), "strain:", "(150, 2)")),
    ("a rate attribute of 0", _h5(_rate("strain", 0), "strain:", "rate_hz", "above 0")),
    ("a rate attribute of nan", _h5(_rate("strain", np.nan), "strain:", "rate_hz", "above 0")),
    ("a rate attribute of text", _h5(_rate("strain", "fast"), "strain:", "rate_hz", "number")),
    ("a MATLAB text", _mat({"strain": "a word"}, "strain:", "char")),
    ("a MATLAB struct", _mat({"strain": {"data": np.ones(3)}}, "strain:", "struct")),
    ("MATLAB cells", _mat({"strain": np.array([1, "a"], dtype=object)}, "strain:", "cell")),
    ("complex MATLAB samples", _mat({"strain": np.ones(300) * 1j}, "strain:", "complex")),
    ("a MATLAB variable too many", _mat({"operator": np.ones(3)}, "operator:", "unknown")),
    ("a MATLAB rate of nothing", _mat({"rate_hz_foo": 3.0}, "rate_hz_foo:", "unknown")),
    ("a negative MATLAB rate", _mat({"rate_hz_strain": -500.0}, "strain:", "rate_hz", "-500")),
    # samples: finite, as many as the others, enough
    ("NaN", _h5(_not_a_number, "acceleration_so:", "nan", "sample 123", "0.3075 s")),
    ("infinity", _mat({"force_lo": np.r_[np.zeros(1199), np.inf]}, "force_lo:", "inf", "sample 1199")),
    ("unequal lengths", _h5(_replaced("force_lo", np.ones(1190)), "force_lo:", "1190", "1200")),
    ("a tension that ends early", _h5(_replaced("strain", np.ones(280)), "strain:", "280", "300")),
    ("shorter than the pretrigger", _h5(_cut(0.4), "duration:", "0.4 s", "pretrigger", file=UNCOUPLED)),
    ("over before the final window", _h5(_cut(1.5), "duration:", "1.5 s", "windows.final_s")),
    ("a handful of samples", _h5(_cut(0.1), "duration:", "16 samples", file=HOLD)),
    # comma-separated values
    ("CSV without a header", _csv(lambda rows: rows.pop(0), "header:", "time_s")),
    ("CSV without time", _csv(_cell(0, 0, "time"), "header:", "time_s")),
    ("a CSV column twice", _csv(_cell(0, 3, "force_lo"), "force_lo:", "more than once")),
    ("CSV cells too many", _csv(lambda rows: rows[50].extend(["1", "2"]), "file:", "unreadable")),
    ("CSV time that stands still", _csv(_second_time_again, "time_s:", "data row 100", "rise")),
    ("a CSV row lost", _csv(_lost_row, "time_s:", "even steps")),
    ("CSV time of NaN", _csv(_cell(70, 0, "nan"), "time_s:", "data row 70")),
    ("a CSV word", _csv(_cell(70, 1, "abc"), "force_lo:", '"abc"', "data row 70")),
    ("a CSV gap", _csv(_cell(70, 1, ""), "force_lo:", "empty", "0.17 s")),
    ("a CSV NaN", _csv(_cell(70, 1, "NaN"), "force_lo:", "empty", "0.17 s")),
    ("a CSV infinity", _csv(_cell(70, 1, "inf"), "force_lo:", "inf", "sample 69")),
    # what a kind of test needs
    (
        "no motion of a moving body",
        _h5(lambda record: record.pop("acceleration_so"), "acceleration_so:", "record[2]"),
    ),
    ("no force", _h5(lambda record: record.pop("force_lo"), "force_lo:", "no force")),
    (
        "a force on a body at rest",
        _h5(lambda record: record.move("force_lo", "force_so"), "force_lo:", "moving", file=UNCOUPLED),
    ),
    ("loosening without tension", _h5(lambda record: record.pop("strain"), "tension:", "loosening")),
    (
        "uncoupled with two bodies",
        _settings(_set("record", 0, "bodies", ["lo", "so"]), "record[0].bodies:", "one"),
    ),
    (
        "cycled without force",
        _bytes(
            lambda path: savemat(path, {"link_displacement_joint": np.ones(50)}), CYCLED, "link_force_joint:"
        ),
    ),
    (
        "hold without tension",
        _h5(lambda record: record.move("tension", "force_lo"), "tension:", "hold", file=HOLD),
    ),
]
