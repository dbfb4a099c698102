"""A first `campaign.toml` for a folder of records: what the files tell, and comments for what they do not."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.results import writable
from rom.campaign.channels import (
    BODY_QUANTITIES,
    BOLT_CHANNELS,
    LINK_QUANTITIES,
    MOST_CHOICES,
    MOTIONS,
    Channel,
    FloatArray,
)
from rom.campaign.record import inspect_channels, replacing
from rom.campaign.settings import FORMAT, RECORD_ENDINGS

FILE = "campaign.toml"
_UNTOLD_HZ = 1.0  # given for rates that a file does not tell
_RISE = 0.05  # of a force's largest value: its impact has begun
_WORDS = {
    "uncoupled": "uncoupled|single|alone|separate",
    "coupled": "coupled|small|low",
    "loosening": "loosening|loosen|loose|large",
    "free": "free|release|decay|ringdown",
    "driven": "driven|shaker|sweep|sine|random|forced",
    "cycled": "cycled|cyclic|hysteresis|friction",
    "hold": "hold|rest|creep|relaxation|static",
}


class InitError(ValueError):
    """A folder from which no campaign can be drafted; one line a fault."""


@dataclass(frozen=True)
class _File:
    """A record's file and what it holds."""

    name: str
    channels: Mapping[str, Channel]

    def of(self, quantity: str) -> tuple[str, ...]:
        """Return the bodies or links of which a quantity was measured."""
        start = f"{quantity}_"
        return tuple(name.removeprefix(start) for name in self.channels if name.startswith(start))

    @property
    def moving(self) -> tuple[str, ...]:
        """Bodies whose motion was measured."""
        return tuple(dict.fromkeys(body for motion in MOTIONS for body in self.of(motion)))

    @property
    def has_bolt(self) -> bool:
        """Whether tension or strain was measured."""
        return not self.channels.keys().isdisjoint(BOLT_CHANNELS)


def run(folder: Path, out: Path | None = None) -> Path:
    """Write ``campaign.toml`` and return its path; what is there already stays.

    Raises
    ------
    ValueError
        If there is one already, the folder holds no records, or their channels have other names.
    """
    path = (folder if out is None else writable(out)) / FILE
    if path.exists():
        raise InitError(f"{path}: found an existing file, expected none: remove it or name another --out")
    if not folder.is_dir():
        raise InitError(f"{folder}: found a file, expected a folder of records")
    text = draft(folder.resolve().name, _files(folder))
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _files(folder: Path) -> list[_File]:
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in RECORD_ENDINGS and p.is_file())
    if not paths:
        raise InitError(
            f"{folder}: found no records, expected files ending in {', '.join(RECORD_ENDINGS)}; "
            "`boltlaw import` (docs/import.md) reads other formats"
        )
    known = re.compile(rf"({'|'.join((*BODY_QUANTITIES, *LINK_QUANTITIES))})_.+|{'|'.join(BOLT_CHANNELS)}")
    found, other = [], set[str]()
    for path in paths:
        inspected = inspect_channels(path, _UNTOLD_HZ, _UNTOLD_HZ)
        names = {name for name in inspected.names if known.fullmatch(name)}
        other |= inspected.names - names
        if names:
            channels = {name: channel for name, channel in inspected.channels.items() if name in names}
            found.append(_File(path.relative_to(folder).as_posix(), channels))
        elif not inspected.names and inspected.faults:
            raise InitError(
                f"{path.name}: {inspected.faults[0]}; `boltlaw import` (docs/import.md) reads "
                "other tables and formats"
            )
    if not found:
        held = ", ".join(f'"{name}"' for name in sorted(other)[:MOST_CHOICES])
        raise InitError(
            f"{folder}: found the channels {held}, expected names such as force_BODY or strain; "
            "`boltlaw import` with a map (docs/import.md) renames them"
        )
    return found


def draft(name: str, files: list[_File]) -> str:
    """Return the text of a ``campaign.toml`` for some records."""
    bodies = tuple(dict.fromkeys(body for file in files for q in BODY_QUANTITIES for body in file.of(q)))
    links = tuple(dict.fromkeys(link for file in files for q in LINK_QUANTITIES for link in file.of(q)))
    bodies = tuple(body for body in bodies if body != "ground")
    bolted = any(file.has_bolt for file in files)
    joint = next(iter(links), "joint") if bolted else None
    lines = [
        "# A draft from the files of this folder. Lines with CHECK hold a guess; see docs/own-data.md.",
        f'format = "{FORMAT}"',
        f"name = {json.dumps(name, ensure_ascii=False)}",
        *_structure(bodies or (("slider",) if links else ()), links, joint),
        *_bolt(files, joint),
        *_sampling(files),
        *_windows(files, bolted),
        *(line for file in files for line in _record(file, bolted)),
    ]
    return "\n".join(lines) + "\n"


def _structure(bodies: tuple[str, ...], links: tuple[str, ...], joint: str | None) -> Iterator[str]:
    if len(bodies) > 1 and not (links or joint):
        yield from (
            "",
            "# [modes]   # in place of all [[body]] and [[link]]: modes of a beam, a wing, a frame",
        )
        yield from ("# count = 2   # no more than there are sensors",)
    for body in bodies:
        yield from ("", "[[body]]", f'name = "{body}"', "# mass_kg = 1.0   # identified if it is not given")
    for body in bodies if len(bodies) > 1 or not (links or joint) else ():
        yield from ("", "[[link]]   # CHECK: what holds the body", f'name = "flexure_{body}"')
        yield from (f'between = ["{body}", "ground"]', 'law = "linear"   # or "dashpot"')
    first = bodies[0] if bodies else ""
    second = bodies[1] if len(bodies) > 1 else "ground"
    for link in dict.fromkeys((*links, *([joint] if joint and bodies else []))):
        law = "bolted" if link == joint else "linear"
        yield from ("", "[[link]]   # CHECK: relative motion is the first body minus the second")
        yield from (f'name = "{link}"', f'between = ["{first}", "{second}"]', f'law = "{law}"')


def _bolt(files: list[_File], joint: str | None) -> Iterator[str]:
    if joint is None:
        return
    yield from ("", "[bolt]")
    if any(file.moving or file.of("link_force") for file in files):
        yield f'link = "{joint}"'
    if any("strain" in file.channels and "tension" not in file.channels for file in files):
        yield "# calibration = [c1, c2, c3]   # NEEDED: tension [N] is c1 e + c2 e^2 + c3 e^3 of the strain e"


def _sampling(files: list[_File]) -> Iterator[str]:
    yield from ("", "[sampling]   # of channels whose file tells no rate")
    channels = [(name, channel) for file in files for name, channel in file.channels.items()]
    for key, of_bolt in (("motion_rate_hz", False), ("tension_rate_hz", True)):
        own = [channel.rate_hz for name, channel in channels if (name in BOLT_CHANNELS) is of_bolt]
        told = [rate for rate in own if rate != _UNTOLD_HZ]
        if told:
            yield f"{key} = {max(set(told), key=told.count):.9g}   # as most files tell"
        elif own:
            yield f"# {key} = 19200   # NEEDED: no file tells it"
    if any(not name.startswith(BOLT_CHANNELS) for name, _ in channels):
        yield f"pretrigger_s = {_pretrigger(files):.6g}   # CHECK: before the earliest impact"


def _pretrigger(files: list[_File]) -> float:
    """Return nine tenths of the time before the earliest rise of a force [s], 0 where a rate is not told."""
    starts = [
        int(np.argmax(_size(channel.samples) > _RISE * _size(channel.samples).max())) / channel.rate_hz
        for file in files
        for name, channel in file.channels.items()
        if name.startswith("force_") and channel.rate_hz != _UNTOLD_HZ and np.ptp(channel.samples) > 0
    ]
    return float(np.floor(900 * min(starts, default=0.0)) / 1000)


def _size(samples: FloatArray) -> FloatArray:
    return np.abs(samples - np.median(samples))


def _windows(files: list[_File], bolted: bool) -> Iterator[str]:
    if not bolted:
        return
    channels = [channel for file in files if file.has_bolt for channel in file.channels.values()]
    told = [channel.duration_s for channel in channels if channel.rate_hz != _UNTOLD_HZ]
    duration = min(told, default=8.0)
    before = _pretrigger(files) or 0.05 * duration
    start = min(2.0, max(0.4 * duration, before))
    yield from ("", "[windows]   # CHECK: where initial and final tension are averaged [s]")
    yield f"initial_s = [0.0, {min(0.4, 0.8 * before):.4g}]"
    yield f"final_s = [{start:.4g}, {max(min(8.0, duration), 1.1 * start):.4g}]"


def _record(file: _File, bolted: bool) -> Iterator[str]:
    yield from ("", "[[record]]", f"file = {json.dumps(file.name, ensure_ascii=False)}")
    test, why = _test(file, bolted)
    yield f'test = "{test}"   # {why}'
    if test == "uncoupled" and len(file.moving) == 1:
        yield f'bodies = ["{file.moving[0]}"]'
    if preload := re.search(r"(?<![\d.])(\d+(?:\.\d+)?) ?N(?![A-Za-z])", file.name):
        yield f"preload_n = {float(preload[1]):g}   # from the name"
    if re.search(r"hold.?out|validation|valid", file.name, re.IGNORECASE):
        yield "hold_out = true   # from the name"


def _test(file: _File, bolted: bool) -> tuple[str, str]:
    """Return the kind of test and how it is known."""
    for test, words in _WORDS.items():
        if re.search(rf"(?<![a-z])({words})(?![a-z])", file.name.lower().replace("hold_out", "")):
            return test, "from the name"
    guesses = (
        (bool(file.of("link_force")), "cycled", "the force of a link was measured"),
        (file.has_bolt and not file.moving, "hold", "nothing moves"),
        (not file.of("force"), "free", "no force"),
        (file.has_bolt, "loosening", '"coupled" if the tension stays'),
        (bolted and len(file.moving) == 1, "uncoupled", "one body moves, no tension"),
        (True, "driven", '"uncoupled", "coupled" or "loosening" if it is an impact'),
    )
    return next((test, f"CHECK: {why}") for holds, test, why in guesses if holds)
