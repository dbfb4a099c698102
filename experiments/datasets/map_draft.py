"""A first `import.toml` for a laboratory's files: their signals and names, and what a person has to add."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from experiments.datasets.channel_map import FORMAT
from experiments.datasets.laboratory import files_of, signals_of
from experiments.datasets.signals import Signal, labelled
from experiments.datasets.times import says_time
from experiments.datasets.units import si_factor
from rom.campaign.channels import BODY_QUANTITIES, BOLT_CHANNELS

_BOLT = re.compile(r"bolt|tension|preload|clamp|strain|gauge|schraub|vorspann|dehnung|dms", re.IGNORECASE)
_NAMED = {"acceleration": r"acc|beschl", "force": r"force|hammer|kraft", "displacement": r"disp|laser|weg"}
_TESTS = "uncoupled|coupled|loosening|free|driven|cycled|hold"
_BODY = "BODY"


def draft(source: Path, form: str) -> str:
    """Return the text of a map for files of one format.

    Raises
    ------
    SourceError
        If there is no file, or the first cannot be read.
    """
    files = files_of(source, form)
    folder = source if source.is_dir() else source.parent
    held = [labelled(one) for one in signals_of(files[0], form, []) if not one.derived]
    signals = [one for one in held if not one.fault and not says_time(one.name)]
    bolted = any(quantity in BOLT_CHANNELS for quantity in map(_quantity, signals))
    lines = [
        f"# A draft from {files[0].name}. Complete the lines with NEEDED; docs/import.md shows a whole map.",
        f'format = "{FORMAT}"',
        f"name = {_text(folder.resolve().name)}",
        *("", "[[body]]   # NEEDED: one for each mass that moves"),
        *(f'name = "{_BODY}"', "# mass_kg = 1.0   # identified if it is not given"),
        *("", "[[link]]   # NEEDED: one for each spring; a joint with its bolt has law = \"bolted\""),
        *('name = "flexure"', f'between = ["{_BODY}", "ground"]', 'law = "linear"'),
        *(("", "[bolt]", "# link = \"joint\"   # NEEDED") if bolted else ()),
        *_sampling(signals, _clock(held)),
        *(("", "[windows]   # NEEDED: where initial and final tension are averaged [s]",
           "initial_s = [0.0, 0.4]", "final_s = [2.0, 8.0]") if bolted else ()),
        *("", '[channels]   # "name in the file" = channel of the campaign'),
        *map(_channel, signals),
        *(line for file in files for line in _record(file.relative_to(folder).as_posix())),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _sampling(signals: Sequence[Signal], clock: float | None) -> Iterator[str]:
    yield from ("", "[sampling]   # for signals whose file tells no rate")
    told = [(one.rate_hz or clock, _quantity(one) in BOLT_CHANNELS) for one in signals]
    for key, of_bolt in (("motion_rate_hz", False), ("tension_rate_hz", True)):
        rates = [rate for rate, own in told if rate and own is of_bolt] or [rate for rate, _ in told if rate]
        yield f"{key} = {max(rates):.9g}" if rates else f"# {key} = 19200   # NEEDED"
    yield "pretrigger_s = 0.5   # NEEDED: time before the impact; 0 where there is none"


def _clock(signals: Sequence[Signal]) -> float | None:
    """Return the rate [Hz] of a time in seconds among the signals of a file."""
    for one in signals:
        if says_time(one.name) and one.unit == "s" and not one.fault and len(one.samples) > 1:
            lasts = float(one.samples[-1]) - float(one.samples[0])
            return float(f"{(len(one.samples) - 1) / lasts:.6g}") if lasts > 0 else None
    return None


def _quantity(signal: Signal) -> str | None:
    """Return what a signal measures, by its unit, else by its name; None where neither tells."""
    by_unit = [one for one in BODY_QUANTITIES if signal.unit and si_factor(f"{one}_{_BODY}", signal.unit)]
    if _BOLT.search(signal.name) and by_unit in ([], ["force"]):
        return "tension" if by_unit else "strain"
    by_name = (one for one, words in _NAMED.items() if re.search(words, signal.name, re.IGNORECASE))
    return next(iter((*by_unit, *(() if signal.unit else by_name))), None)


def _channel(signal: Signal) -> str:
    quantity, name = _quantity(signal), _text(signal.name)
    about = signal.described().removeprefix(f'"{signal.name}" ')
    if quantity is None:
        return f'# {name} = ""   # NEEDED, or leave it out: {about}'
    if quantity in BOLT_CHANNELS:
        return f'{name} = "{quantity}"   # {about}'
    return f'{name} = "{quantity}_{_BODY}"   # NEEDED: of which body; {about}'


def _record(name: str) -> Iterator[str]:
    yield from ("", "[[record]]", f"file = {_text(name)}")
    found = re.search(rf"(?<![a-z])({_TESTS})(?![a-z])", name.lower().replace("hold_out", ""))
    yield f'test = "{found[1]}"' if found else f'# test = "loosening"   # NEEDED: {_TESTS.replace("|", ", ")}'


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
