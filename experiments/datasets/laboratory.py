"""A laboratory's files and one map become a campaign, a file at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets import catman, matlab, tdms, universal
from experiments.datasets.channel_map import FILE, ChannelMap, Rule, read_map, record_of
from experiments.datasets.collected import Collected, SourceError, unreadable
from experiments.datasets.signals import Signal, timed
from experiments.datasets.units import known_units, quantity, si_factor
from rom.campaign.campaign import SamplingSettings
from rom.campaign.channels import MOST_CHOICES, Channel, default_rate, one_of

Read = Callable[[Path], list[Signal]]
Sources = Mapping[str, tuple[Path, Mapping[str, Rule]]]
FORMATS: dict[str, tuple[str, tuple[str, ...], Read]] = {
    "catman": ("catman file", catman.ENDINGS, catman.read),
    "matlab": ("MATLAB file", matlab.ENDINGS, matlab.read),
    "uff": ("universal file", universal.ENDINGS, universal.read),
    "tdms": ("TDMS file", tdms.ENDINGS, tdms.read),
}
MOST_CUT = 0.01  # of a record: the tail in which the slower amplifier has stopped already


@dataclass
class _Told:
    """What was seen on the way, for the notes."""

    used: set[str] = field(default_factory=set)
    names: set[str] = field(default_factory=set)
    cut: list[str] = field(default_factory=list)
    unmatched: list[str] = field(default_factory=list)

    def notes(self) -> tuple[str, ...]:
        """Return a line for each kind of thing that people should know."""
        lines = [
            ("files that no [[record]] of the map matches", self.unmatched),
            ("records cut to their shortest channel", self.cut),
        ]
        return tuple(f"{len(names)} {what}: {_some(names)}" for what, names in lines if names)


def collect(source: Path, form: str, map_path: Path | None) -> Collected:
    """Return the campaign of a file, or of all files of one format below a folder.

    Parameters
    ----------
    source : Path
        A file or a folder.
    form : str
        A format of files.
    map_path : Path or None
        Which column is which channel; beside the files if not given.

    Returns
    -------
    Collected
        Settings, records and notes.

    Raises
    ------
    SourceError
        If the map or a file is not what it should be, or no file matches.
    """
    kind, endings, _ = FORMATS[form]
    folder = source if source.is_dir() else source.parent
    files = sorted(folder.rglob("*")) if source.is_dir() else [source]
    files = [file for file in files if file.is_file() and file.suffix.lower() in endings]
    if not files:
        raise SourceError(f"{source}: found no {kind}, expected one or more ending in {', '.join(endings)}")
    path = map_path or folder / FILE
    if not path.is_file():
        raise SourceError(_without_map(path, files[0], form))
    channel_map, told = read_map(path), _Told()
    records, sources = _matched(files, folder, channel_map, told)
    settings = channel_map.settings(records)
    channels = _records(sources, form, channel_map, settings.sampling, told)
    return Collected(settings, channels, told.notes)


def _matched(
    files: list[Path], folder: Path, channel_map: ChannelMap, told: _Told
) -> tuple[list[dict[str, Any]], Sources]:
    """Return the records, and file and rules of each: the first [[record]] that matches a file takes it."""
    sources: dict[str, tuple[Path, Mapping[str, Rule]]] = {}
    records: list[dict[str, Any]] = []
    for file in files:
        name = file.relative_to(folder).as_posix()
        found = ((entry, record_of(entry, name)) for entry in channel_map.entries)
        entry, record = next(((e, r) for e, r in found if r is not None), (None, None))
        if entry is None or record is None:
            told.unmatched.append(name)
        elif record["file"] in sources:
            other = sources[record["file"]][0].name
            raise SourceError(
                f"{name}: found a second source of {record['file']} beside {other}, expected one"
            )
        else:
            sources[record["file"]] = file, entry.rules
            records.append(record)
    if not records:
        patterns = ", ".join(f'"{entry.text}"' for entry in channel_map.entries)
        raise SourceError(
            f"{channel_map.path.name}: record: found no file that matches {patterns}, expected such as {name}"
        )
    return records, sources


def _records(
    sources: Sources, form: str, channel_map: ChannelMap, sampling: SamplingSettings, told: _Told
) -> Iterator[tuple[str, dict[str, Channel]]]:
    for record, (path, rules) in sources.items():
        signals = signals_of(path, form)
        told.names |= {signal.name for signal in signals}
        yield record, _cut(path.name, _channels(path.name, signals, rules, sampling, told), told)
    if missing := {name for entry in channel_map.entries for name in entry.rules} - told.used:
        raise SourceError(
            *(
                f'{channel_map.path.name}: channels."{name}": found this signal in no file, '
                f"expected {one_of(name, sorted(told.names))}"
                for name in sorted(missing)
            )
        )


def signals_of(path: Path, form: str) -> list[Signal]:
    """Return the signals of a file with their rates, times left out.

    Raises
    ------
    SourceError
        If the file cannot be read.
    """
    kind, _, read = FORMATS[form]
    try:
        signals = read(path)
    except (SourceError, MemoryError):
        raise
    except Exception as cause:  # a parser of foreign bytes may fail in any way; each means an unreadable file
        raise unreadable(path, kind, cause) from None
    return timed(path.name, signals)


def _channels(
    file: str, signals: list[Signal], rules: Mapping[str, Rule], sampling: SamplingSettings, told: _Told
) -> dict[str, Channel]:
    channels: dict[str, Channel] = {}
    starts: dict[str, float] = {}
    for signal in signals:
        rule = rules.get(signal.name)
        if rule is None:
            continue
        told.used.add(signal.name)
        if rule.channel in channels:
            raise SourceError(
                f'{file}: {rule.channel}: found "{signal.name}" and another signal, expected one'
            )
        usual = default_rate(rule.channel, sampling.motion_rate_hz, sampling.tension_rate_hz)
        rate_hz = rule.rate_hz or signal.rate_hz or usual
        samples = np.asarray(signal.samples, dtype=np.float64) * _factor(file, signal, rule)
        channels[rule.channel] = Channel(rule.channel, samples, float(rate_hz))
        starts[rule.channel] = signal.start_s
    if not channels:
        held = _some([signal.described() for signal in signals])
        raise SourceError(f"{file}: found no signal of [channels], expected one; the file holds {held}")
    late = max(starts.values()) - min(starts.values())
    if late > 0.5 / min(channel.rate_hz for channel in channels.values()):
        raise SourceError(f"{file}: found channels that start {late:g} s apart, expected one start for all")
    return channels


def _factor(file: str, signal: Signal, rule: Rule) -> float:
    if rule.scale is not None:
        return rule.scale
    unit = signal.unit if rule.unit is None else rule.unit
    factor = si_factor(rule.channel, unit)
    if factor is None:
        found = f'the unit "{unit}"' if unit else "no unit"
        raise SourceError(
            f"{file}: {signal.name}: found {found} for a {quantity(rule.channel)}, expected one of "
            f"{known_units(rule.channel)}; give unit or scale in [channels]"
        )
    return factor


def _cut(file: str, channels: dict[str, Channel], told: _Told) -> dict[str, Channel]:
    """Cut channels to the time that all of them cover where little is lost; else the reader tells of it."""
    shortest = min(channel.duration_s for channel in channels.values())
    longest = max(channel.duration_s for channel in channels.values())
    if longest - shortest > MOST_CUT * longest:
        return channels
    cut = {
        name: Channel(name, channel.samples[: round(shortest * channel.rate_hz)], channel.rate_hz)
        for name, channel in channels.items()
    }
    if any(len(cut[name].samples) < len(channel.samples) for name, channel in channels.items()):
        told.cut.append(f"{file} ({longest - shortest:.3g} s)")
    return cut


def _without_map(path: Path, file: Path, form: str) -> str:
    held = _some([signal.described() for signal in signals_of(file, form)])
    return (
        f"{path}: found no map of channels, expected one there or with --map (docs/import.md shows one); "
        f"{file.name} holds {held}"
    )


def _some(names: list[str]) -> str:
    return ", ".join(names[:MOST_CHOICES]) + (", ..." if len(names) > MOST_CHOICES else "")
