"""Inputs for ``benchmarks.fuzz``: sound ones of every kind, and what damages them."""

from __future__ import annotations

import json
import os
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import tomli_w

import rom
from benchmarks.fuzz_records import spoil_record
from experiments.cli import run
from experiments.studies import rig
from tests.discovery import driven_twins
from tests.discovery.loop.test_at_rest import held
from tests.discovery.ring_down_twins import free
from tests.experiments.datasets import damaged_files
from tests.experiments.datasets.lab_case import CHANNELS, map_of
from tests.experiments.source_files import write_emps, write_silverbox, write_tribometer
from tests.experiments.studies.experiment_files import SMALL
from tests.rom import beams
from tests.rom.random_records import random_bytes, random_cells, random_content
from tests.rom.random_settings import random_tables, random_text
from tests.rom.sound_campaign import write_sound_campaign

JUNK: tuple[Any, ...] = (
    None, True, False, "", "x", "nan", "1e5", -1, 0, 1, 2, 0.5, 1e308, -1e308, 1e300, 1e-300, 5e-324, 2**63,
    float("nan"), float("inf"), [], {}, [[]], [{}], ["x"], [1, 2, 3], {"value": 1}, "x" * 5000, "\x1b[31m",
    "<b>", "\ud800", "a\nb", "ground", 10**400,
)  # fmt: skip
LAWS = """format = "boltlaw-laws/1"
[[law]]
name = "slip work"
rate = "-a * abs(D * v) * max(T, 0)"
parameters = { a = { value = 1.0, unit = "1/J", low = 0.0 } }
[[law]]
name = "power"
rate = "-b * abs(v)**n * T"
parameters = { b = { value = 1e9, unit = "s3/m4" }, n = { value = 4.0, unit = "1", fixed = true } }
"""
EXPERIMENT = """[search]
max_terms = [1, 2]
[criteria.ranking]
folds = [4, 8]
[[rig]]
cases = 2
duration_s = 2.5
"""


@dataclass(frozen=True)
class Input:
    """Arguments of the program, the kind of what is damaged, and how it was."""

    kind: str
    arguments: tuple[str, ...]
    damage: str = ""


def sound_inputs(folder: Path) -> Path:
    """Write sound campaigns, what the commands make of two, and public sets; return the folder."""
    folder.mkdir(parents=True)
    campaigns = folder / "campaigns"
    campaigns.mkdir()
    write_sound_campaign(campaigns / "every")
    driven_twins.driven(campaigns / "driven", seconds=2.0)
    driven_twins.cycled(campaigns / "cycled", 0.2, seconds=8.0)
    free(campaigns / "free")
    held(campaigns / "hold", "clean")
    beams.campaign(campaigns / "modes")
    rig.run(campaigns / "rig", cases=4, jobs=1, duration_s=2.5, hold_out_every=0)
    for command in ("check", "identify", "close"):
        _made(command, campaigns / "driven", folder / "results" / "driven")
        _made(command, campaigns / "rig", folder / "results" / "rig")
    _made(
        "discover", campaigns / "rig", folder / "results" / "rig", "--library", "velocity", "--max-terms", "1"
    )
    for name in ("driven", "rig"):
        model = folder / "results" / name / "model.json"
        run(
            [
                "predict",
                str(model),
                str(campaigns / name),
                "--out",
                str(model.parent),
                "--jobs",
                "1",
                "--quiet",
            ]
        )
    (folder / "sets").mkdir()
    write_emps(folder / "sets" / "emps")
    write_silverbox(folder / "sets" / "silverbox", [400] * 10, [100] * 11)
    write_tribometer(folder / "sets" / "tribometer")
    return folder


def imported() -> None:
    """Import what the commands import where they need it, so that every process has it from the start."""
    for name in (
        "apread", "nptdms", "openpyxl", "pandas", "pymatreader", "pyuff", "matplotlib.pyplot",
        "discovery.ranking.discover", "discovery.loop.close_loop", "experiments.figures.records",
        "experiments.report.document", "experiments.studies.check", "experiments.studies.close",
        "experiments.studies.discover", "experiments.studies.experiment.run", "experiments.studies.identify",
        "experiments.studies.import_campaign", "experiments.studies.init", "experiments.studies.predict",
        "experiments.studies.rig", "experiments.studies.bootstrap",
    ):  # fmt: skip
        import_module(name)


def _made(command: str, campaign: Path, out: Path, *options: str) -> None:
    arguments = [command, str(campaign), "--out", str(out), "--jobs", "1", "--quiet", *options]
    code = run(arguments)
    if code:
        raise RuntimeError(f"boltlaw {' '.join(arguments)}: expected code 0 on sound records, got {code}")


def input_of(sound: Path, folder: Path, seed: int, number: int, kind: str = "") -> Input:
    """Put a damaged input into a folder; kind, damage and command follow from seed and number.

    Parameters
    ----------
    sound : Path
        What `sound_inputs` wrote.
    folder : Path
        Empty folder, where the program is to run.
    seed, number : int
        Of the input.
    kind : str
        Beginning of the kinds that are wanted; all if empty.
    """
    random = Random(1_000_003 * seed + number)
    wanted = {name: (share, make) for name, (share, make) in MAKERS.items() if name.startswith(kind)}
    (name,) = random.choices(list(wanted), [share for share, _ in wanted.values()])
    return wanted[name][1](name, sound, folder, random)


def _generator(random: Random) -> np.random.Generator:
    return np.random.default_rng(random.randrange(2**62))


def spoilt(value: Any, random: Random) -> tuple[Any, str]:
    """Return a value of lists and mappings with one part lost, renamed, doubled, exchanged or replaced."""
    if isinstance(value, dict | list) and value and random.random() < 0.93:
        return _part_spoilt(value, random)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and abs(value) < 1e308 and random.random() < 0.4:
        new = value * 10.0 ** random.choice((-300, -12, -6, -3, 3, 6, 12, 300)) * random.choice((1, -1))
    else:
        new = random.choice(JUNK)
    return new, f"= {new!r:.40}"


def _part_spoilt(value: dict[str, Any] | list[Any], random: Random) -> tuple[Any, str]:
    keys: list[Any] = sorted(value) if isinstance(value, dict) else list(range(len(value)))
    whole: Any = dict(value) if isinstance(value, dict) else list(value)
    key, other = random.choice(keys), random.choice(keys)
    match random.choice(("lost", "again", "exchanged", *["inside"] * 12)):
        case "lost":
            del whole[key]
            return whole, f"{key} lost"
        case "again" if isinstance(whole, list):
            return [*whole, whole[key]], f"{key} again"
        case "again":
            whole[f"{key}x"] = whole.pop(key)
            return whole, f"{key} renamed"
        case "exchanged":
            whole[key], whole[other] = whole[other], whole[key]
            return whole, f"{key} and {other} exchanged"
    whole[key], said = spoilt(whole[key], random)
    return whole, f"{key}.{said}"


def _spoilt_several(value: Any, random: Random) -> tuple[Any, str]:
    said = []
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        value, one = spoilt(value, random)
        said.append(one)
    return value, ", ".join(said)


def _json_text(value: Any, random: Random) -> bytes:
    text = json.dumps(value).encode()
    return damaged_files.damaged(text, _generator(random)) if random.random() < 0.15 else text


def _toml_text(value: Any, random: Random) -> bytes:
    try:
        text = tomli_w.dumps(value).encode("utf-8", "surrogatepass")
    except (TypeError, ValueError, AttributeError):  # what TOML cannot hold
        text = repr(value).encode("utf-8", "surrogatepass")
    return damaged_files.damaged(text, _generator(random)) if random.random() < 0.15 else text


def _lab(kind: str, _sound: Path, folder: Path, random: Random) -> Input:
    of = kind.removeprefix("file ")
    form, ending, _ = damaged_files.KINDS[of]
    lab = folder / "lab"
    lab.mkdir()
    (lab / f"a{ending}").write_bytes(damaged_files.damaged(damaged_files.sound(of), _generator(random)))
    if random.random() < 0.2:
        return Input(kind, ("import", form, "lab"), "drafts a map")
    (lab / "import.toml").write_text(map_of(ending[1:], CHANNELS))
    return Input(kind, ("import", form, "lab", "new", "--jobs", "1"))


def _map(kind: str, _sound: Path, folder: Path, random: Random) -> Input:
    lab = folder / "lab"
    lab.mkdir()
    (lab / "a.csv").write_bytes(damaged_files.sound("csv"))
    text = map_of("csv", {**CHANNELS, "time": '{channel = "time", unit = "s"}'})
    content, said = _spoilt_several(tomllib.loads(text), random)
    (lab / "import.toml").write_bytes(_toml_text(content, random))
    return Input(kind, ("import", "csv", "lab", "new", "--jobs", "1"), said)


def _public(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    name = kind.removeprefix("set ")
    shutil.copytree(sound / "sets" / name, folder / "set")
    path = random.choice(sorted((folder / "set").iterdir()))
    path.write_bytes(damaged_files.damaged(path.read_bytes(), _generator(random)))
    return Input(kind, ("import", name, "set", "new", "--jobs", "1"), path.name)


def _copied(campaign: Path, folder: Path) -> None:
    shutil.copytree(campaign, folder, copy_function=os.link)


def _replace(path: Path, content: bytes) -> None:
    path.unlink(missing_ok=True)  # it may be one file with the sound one
    path.write_bytes(content)


def _settings_text(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    _copied(sound / "campaigns" / "every", folder / "campaign")
    make = random.choice((random_tables, random_tables, random_text))
    _replace(folder / "campaign" / "campaign.toml", make(random))
    return Input(
        kind, (random.choice(("check", "identify", "close")), "campaign", "--jobs", "1"), make.__name__
    )


def _record_bytes(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    make = random.choice((random_bytes, random_bytes, random_cells, random_content))
    name, content = make(random)
    _copied(sound / "campaigns" / "every", folder / "campaign")
    _replace(folder / "campaign" / name, content)
    data = tomllib.loads((folder / "campaign" / "campaign.toml").read_text())
    data["record"].append({"file": name, "test": "loosening"})
    _replace(folder / "campaign" / "campaign.toml", tomli_w.dumps(data).encode())
    if random.random() < 0.3:
        return Input(kind, ("init", "campaign", "--out", "drafted"), make.__name__)
    return Input(kind, (random.choice(("check", "identify")), "campaign", "--jobs", "1"), make.__name__)


def _campaign(sound: Path, random: Random) -> Path:
    names = ("every", "driven", "cycled", "free", "hold", "modes", "rig")
    (name,) = random.choices(names, (3, 3, 3, 3, 3, 2, 1))  # the last two cost most
    return sound / "campaigns" / name


def _command(campaign: str, random: Random, costly: float = 0.06) -> tuple[str, ...]:
    """Return a command on a campaign; those that search are fewer, as they cost most."""
    how = random.random()
    if how < costly:
        return (random.choice(("close", "close", "discover")), campaign, "--jobs", "1")
    return ("check" if how < 0.3 else "identify", campaign, "--jobs", "1")


def _settings(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    """Settings of other structures, read where they may and used."""
    source = _campaign(sound, random)
    _copied(source, folder / "campaign")
    data, said = _spoilt_several(tomllib.loads((source / "campaign.toml").read_text()), random)
    _replace(folder / "campaign" / "campaign.toml", _toml_text(data, random))
    return Input(kind, _command("campaign", random), f"{source.name}: {said}")


def _samples(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    """Records that can be read, whose samples are not what they should be."""
    source = _campaign(sound, random)
    _copied(source, folder / "campaign")
    records = rom.read_campaign(source).settings.record
    chosen = records if random.random() < 0.3 else random.sample(records, random.randint(1, len(records)))
    again = random.randrange(2**62)
    said = {spoil_record(folder / "campaign" / record.file, Random(again)) for record in chosen}
    arguments = _command("campaign", random)
    if source.name in ("driven", "rig") and random.random() < 0.3:
        model = sound / "results" / source.name / "model.json"
        shutil.copy(model, folder / "model.json")
        arguments = ("predict", "model.json", "campaign", "--jobs", "1")
    return Input(kind, arguments, f"{source.name}, {len(chosen)} records: {sorted(said)[0]}")


def _model(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    name = random.choice(("driven", "rig"))
    _copied(sound / "campaigns" / name, folder / "campaign")
    text = (sound / "results" / name / "model.json").read_text()
    content, said = _spoilt_several(json.loads(text), random)
    (folder / "model.json").write_bytes(_json_text(content, random))
    if random.random() < 0.05:
        return Input(kind, ("close", "campaign", "--model", "model.json", "--jobs", "1"), said)
    return Input(kind, ("predict", "model.json", "campaign", "--jobs", "1"), f"{name}: {said}")


def _results(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    source = sound / "results" / random.choice(("driven", "rig"))
    shutil.copytree(source, folder / "results", ignore=shutil.ignore_patterns("*.svg", "*.pdf", "*.png"))
    path = random.choice(sorted((folder / "results").glob("*.json")))
    content, said = _spoilt_several(json.loads(path.read_text()), random)
    path.write_bytes(_json_text(content, random))
    for other in sorted((folder / "results").glob("*.json")):
        if other != path and random.random() < 0.7:
            other.unlink()
    return Input(kind, ("report", "results"), f"{source.name} {path.name}: {said}")


def _laws(kind: str, sound: Path, folder: Path, random: Random) -> Input:
    content, said = _spoilt_several(tomllib.loads(LAWS), random)
    (folder / "laws.toml").write_bytes(_toml_text(content, random))
    _copied(sound / "campaigns" / "every", folder / "campaign")
    return Input(kind, ("compare", "campaign", "laws.toml", "--jobs", "1"), said)


def _experiment(kind: str, _sound: Path, folder: Path, random: Random) -> Input:
    content, said = _spoilt_several(tomllib.loads(SMALL + EXPERIMENT), random)
    (folder / "experiment.toml").write_bytes(_toml_text(content, random))
    return Input(kind, ("run", "experiment.toml", "--jobs", "1"), said)


_CALLS = tuple(
    tuple(line.split())
    for line in """
    rig new --cases ? --duration-s ?
    rig new --cases 2 --undeclared ?
    rig new --strengths ? --cases 2
    rig new --law ? --noise ? --cases 2
    identify ? --jobs ?
    discover ? --library ? --max-terms ?
    compare ? ?
    close ? --bootstrap ? --seed ?
    predict ? ? --out ?
    import ? ? ?
    init ? --out ?
    check ? --seed ?
    report ? --out ?
    run ? --out ?
    ? ?""".strip().splitlines()
)
_WORDS = (
    "", "x", "-1", "0", "1e999", "nan", "inf", "-inf", "1,2", ",", "1,nan", "9" * 400, "a\nb", "\x1b[31m",
    "/dev/null", "a" * 300, "hum:A=nan", "hum:A=1e999", "hum:=", "cubic-stiffness@:k3=1",
    "coulomb-friction:F_c=", "coulomb-friction@so:F_c=-1", "power-3", "campaign", "file.txt", "--", "-h",
    "csv", "0.5", "2.5", "1.0", "\u202e", "é",
)  # fmt: skip


def _call(kind: str, _sound: Path, folder: Path, random: Random) -> Input:
    """A wrong call: words where numbers, paths, names are expected."""
    (folder / "file.txt").write_text("no result\n")
    (folder / "campaign").mkdir()
    parts = random.choice(_CALLS)
    words = (random.choice(_WORDS) if part == "?" else part for part in parts)
    return Input(kind, tuple(words))


Maker = Callable[[str, Path, Path, Random], Input]
MAKERS: dict[str, tuple[float, Maker]] = {
    **{
        f"file {name}": (0.5 if "matlab" in name else 2.5, _lab)  # the former start a process
        for name in damaged_files.KINDS
    },
    **{f"set {name}": (1.5, _public) for name in ("emps", "silverbox", "tribometer")},
    "map": (6.0, _map),
    "settings of every test": (6.0, _settings_text),
    "settings": (8.0, _settings),
    "record": (8.0, _record_bytes),
    "samples": (7.0, _samples),
    "model": (7.0, _model),
    "results": (8.0, _results),
    "laws": (4.0, _laws),
    "experiment": (4.0, _experiment),
    "call": (4.0, _call),
}  # kind: its share, in arbitrary units, and what makes one
