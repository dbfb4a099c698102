"""A laboratory's files and one map become a campaign, a file at a time."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets import catman, json_signals, matlab, spreadsheet, tables, tdms, uff
from experiments.datasets.channel_map import FILE, TIME, ChannelMap, Rule, read_map, record_of
from experiments.datasets.code_pages import in_code_page
from experiments.datasets.collected import Collected, SourceError, unreadable
from experiments.datasets.signals import NOT_UNDERSTOOD, Clocks, Signal, TimeRule, labelled
from experiments.datasets.times import ABSOLUTE_S
from experiments.datasets.units import known_units, quantity, si_factor
from rom.campaign.campaign import SamplingSettings
from rom.campaign.channels import MOST_CHOICES, Channel, default_rate, one_of

Read = Callable[[Path], list[Signal]]
Sources = Mapping[str, tuple[Path, Mapping[str, Rule]]]
FORMATS: dict[str, tuple[str, tuple[str, ...], Read]] = {
    "catman": ("catman file", catman.ENDINGS, catman.read),
    "matlab": ("MATLAB file", matlab.ENDINGS, matlab.read),
    "uff": ("universal file", uff.ENDINGS, uff.read),
    "tdms": ("TDMS file", tdms.ENDINGS, tdms.read),
    "csv": ("table in text", tables.ENDINGS, tables.read),
    "xlsx": ("spreadsheet", spreadsheet.ENDINGS, spreadsheet.read),
    "json": ("JSON file", json_signals.ENDINGS, json_signals.read),
}
_AGREE = 0.01  # relative: a time that is in s, by the rate of the map
_PRINTED = 5e-6  # relative: what a step loses that is printed with six digits, as in universal files
_SAME = 1e-3  # relative: a rate that is that of [sampling]
_ONE_RATE = 0.004  # decades: rates that are one but for the unit of time, within 1 %
_FAR = 2.5  # decades: no rate is so far from [sampling] without a word in the map
MOST_CUT = 0.01  # of a record: the tail in which the slower amplifier has stopped already


@dataclass
class _Notes:
    """What was seen on the way, for the notes."""

    used: set[str] = field(default_factory=set)
    names: set[str] = field(default_factory=set)
    cut: list[str] = field(default_factory=list)
    unmatched: list[str] = field(default_factory=list)
    clocks: list[str] = field(default_factory=list)
    apart: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    other_rates: set[str] = field(default_factory=set)
    pages: set[str] = field(default_factory=set)

    def rates(self, channel: str, rate_hz: float, usual_hz: float) -> None:
        """Keep a rate that is not that of [sampling]."""
        if abs(rate_hz / usual_hz - 1) > _SAME:
            self.other_rates.add(f"{channel} {rate_hz:.6g} Hz (not {usual_hz:g})")

    def lines(self) -> tuple[str, ...]:
        """Return a line for each kind of thing that people should know."""
        lines = [
            ("files that no [[record]] of the map matches", self.unmatched),
            ("warnings of a file's reader", self.said),
            ("code pages of texts, as the names of the map tell", sorted(self.pages)),
            ("records cut to their shortest channel", self.cut),
            ("rates other than in [sampling], as files or map tell", sorted(self.other_rates)),
            ("records whose channels state starts on different clocks, not compared", self.clocks),
            (
                "records with times that start apart, not compared, since no channel tells which is its own",
                self.apart,
            ),
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
    files, folder = files_of(source, form), source if source.is_dir() else source.parent
    path = map_path or folder / FILE
    if not path.is_file():
        raise SourceError(_without_map(path, files[0], form))
    channel_map, notes = read_map(path), _Notes()
    records, sources = _matched(files, folder, channel_map, notes)
    settings = channel_map.settings(records)
    channels = _records(sources, form, channel_map, settings.sampling, notes)
    return Collected(settings, channels, notes.lines)


def files_of(source: Path, form: str) -> list[Path]:
    """Return a file, or all files of one format below a folder.

    Raises
    ------
    SourceError
        If there is none.
    """
    kind, endings, _ = FORMATS[form]
    files = sorted(source.rglob("*")) if source.is_dir() else [source]
    files = [file for file in files if file.is_file() and file.suffix.lower() in endings]
    if not files:
        raise SourceError(f"{source}: found no {kind}, expected one or more ending in {', '.join(endings)}")
    return files


def _matched(
    files: list[Path], folder: Path, channel_map: ChannelMap, notes: _Notes
) -> tuple[list[dict[str, Any]], Sources]:
    """Return the records, and file and rules of each: the first [[record]] that matches a file takes it."""
    sources: dict[str, tuple[Path, Mapping[str, Rule]]] = {}
    records: list[dict[str, Any]] = []
    for file in files:
        name = file.relative_to(folder).as_posix()
        found = ((entry, record_of(entry, name)) for entry in channel_map.entries)
        entry, record = next(((e, r) for e, r in found if r is not None), (None, None))
        if entry is None or record is None:
            notes.unmatched.append(name)
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
    sources: Sources, form: str, channel_map: ChannelMap, sampling: SamplingSettings, notes: _Notes
) -> Iterator[tuple[str, dict[str, Channel]]]:
    for record, (path, rules) in sources.items():
        signals, page = in_code_page(signals_of(path, form, notes.said), rules.keys())
        notes.names |= {signal.name for signal in signals}
        notes.pages |= {page} - {""}
        yield record, _cut(path.name, _channels(path.name, signals, rules, sampling, notes), notes)
    if missing := {name for entry in channel_map.entries for name in entry.rules} - notes.used:
        raise SourceError(
            *(
                f'{channel_map.path.name}: channels."{name}": found this signal in no file, '
                f"expected {one_of(name, sorted(notes.names))}"
                for name in sorted(missing)
            )
        )


def signals_of(path: Path, form: str, said: list[str]) -> list[Signal]:
    """Return the signals of a file, times among them.

    Parameters
    ----------
    path : Path
        The file.
    form : str
        A format of files.
    said : list of str
        Takes what the file's reader warns of.

    Returns
    -------
    list of Signal
        In the file's order.

    Raises
    ------
    SourceError
        If the file cannot be read.
    """
    kind, _, read = FORMATS[form]
    try:
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            signals = read(path)
    except SourceError:
        raise
    except Exception as cause:  # a parser of foreign bytes may fail in any way, or ask for all memory
        raise unreadable(path, kind, cause) from None
    said += [f"{path.name} ({' '.join(str(warning.message).split())})" for warning in heard]
    return [labelled(signal) for signal in signals]


def _channels(
    file: str,
    signals: list[Signal],
    rules: Mapping[str, Rule],
    sampling: SamplingSettings,
    notes: _Notes,
) -> dict[str, Channel]:
    given = {name: TimeRule(rule.unit, rule.scale) for name, rule in rules.items() if rule.channel == TIME}
    clocks = Clocks(file, signals, given, rules)
    notes.used |= {time.name for time in clocks.times} & given.keys()
    channels: dict[str, Channel] = {}
    starts: dict[str, float | None] = {}
    for signal in clocks.signals:
        rule = rules.get(signal.name)
        if rule is None:
            continue
        notes.used.add(signal.name)
        if rule.channel in channels:
            raise SourceError(
                f'{file}: {rule.channel}: found "{signal.name}" and another signal, expected one'
            )
        usual_hz = default_rate(rule.channel, sampling.motion_rate_hz, sampling.tension_rate_hz)
        rate_hz, starts[rule.channel] = _rate_and_start(file, signal, rule, clocks, usual_hz)
        notes.rates(rule.channel, rate_hz, usual_hz)
        if signal.samples.dtype.kind in "Mm":
            raise SourceError(f"{file}: {signal.name}: found dates, expected the numbers of a {rule.channel}")
        with np.errstate(all="ignore"):  # what is not finite is told by the check of the campaign
            samples = np.asarray(signal.samples, dtype=np.float64) * _factor(file, signal, rule)
        channels[rule.channel] = Channel(rule.channel, samples, rate_hz)
    notes.apart += [f"{file} ({names})" for names in sorted(clocks.apart)]
    if faulty := next(
        (s for s in signals if s.fault and _asked(s.name, rules, {t.name for t in signals})), None
    ):
        raise SourceError(f"{file}: {faulty.name}: {faulty.fault}")
    if not channels:
        held = _held(signals)
        raise SourceError(f"{file}: found no signal of [channels], expected one; the file holds {held}")
    _require_one_start(file, channels, starts, notes)
    return channels


def _asked(faulty: str, rules: Mapping[str, Rule], names: set[str]) -> bool:
    """Return whether the map asks for a signal, or for a part of it: "T.force" of the table T."""
    if faulty == "*":
        return any(name not in names and re.search(r"[.({]", name) for name in rules)
    part = re.compile(rf"{re.escape(faulty)}[.({{]")
    return any(name == faulty or (name not in names and part.match(name)) for name in rules)


def _rate_and_start(
    file: str, signal: Signal, rule: Rule, clocks: Clocks, usual_hz: float
) -> tuple[float, float | None]:
    """Return the rate by the map, by the file or by [sampling], in this order, and the start if stated."""
    if rule.rate_hz is not None:
        return rule.rate_hz, _start_beside(signal, rule.rate_hz, clocks)
    clock = clocks.of(signal, usual_hz)
    remedy = (
        f"expected a rate near {usual_hz:g} Hz of [sampling]; give rate_hz in [channels], "
        'the time\'s unit ("NAME" = {channel = "time", unit = "ms"}), or another [sampling]'
    )
    if clock is None:
        if signal.readings and all(abs(rate / usual_hz - 1) > _SAME for rate in signal.readings):
            told = ", ".join(f"{rate:g}" for rate in sorted(set(signal.readings)) if rate != NOT_UNDERSTOOD)
            what = f"one of {told} Hz stated" if told else "a rate stated that is no number"
            raise SourceError(f"{file}: {signal.name}: found {what}, {remedy}")
        return usual_hz, signal.start_s
    if not (math.isfinite(clock.rate_hz) and clock.rate_hz > 0):
        raise SourceError(f"{file}: {signal.name}: found {clock.rate_hz:g} Hz from {clock.told_by}, {remedy}")
    nearest = min((clock.rate_hz, *clock.readings), key=lambda rate: abs(math.log(rate / usual_hz)))
    decades = math.log10(clock.rate_hz / usual_hz)
    tenfold = round(decades) != 0 and abs(decades - round(decades)) < _ONE_RATE
    if nearest != clock.rate_hz or tenfold or abs(decades) > _FAR:
        unit = f", {nearest:g} Hz in another unit" if nearest != clock.rate_hz else ""
        found = f"found {clock.rate_hz:g} Hz from {clock.told_by}{unit}"
        raise SourceError(f"{file}: {signal.name}: {found}, {remedy}")
    rate_hz = usual_hz if abs(clock.rate_hz / usual_hz - 1) <= _PRINTED else clock.rate_hz
    return rate_hz, clock.start_s


def _start_beside(signal: Signal, rate_hz: float, clocks: Clocks) -> float | None:
    """Return the start beside a rate of the map, which overrules a time that cannot be used."""
    dated = signal.start_s is not None and signal.start_s >= ABSOLUTE_S
    try:
        clock = clocks.of(signal, rate_hz)
    except SourceError:
        return signal.start_s if dated else None
    if clock is None:
        return signal.start_s
    sure = not clock.readings or abs(clock.rate_hz / rate_hz - 1) < _AGREE  # else its unit is not known
    return clock.start_s if sure else signal.start_s if dated else None


def _require_one_start(
    file: str, channels: Mapping[str, Channel], starts: Mapping[str, float | None], notes: _Notes
) -> None:
    """Compare starts that are stated on one clock: of the day, or of the record."""
    stated = {name: start for name, start in starts.items() if start is not None}
    tolerance = 0.5 / min(channel.rate_hz for channel in channels.values())
    kinds = [[s for s in stated.values() if (s >= ABSOLUTE_S) is absolute] for absolute in (True, False)]
    for own in filter(None, kinds):
        late = max(own) - min(own)
        if late > tolerance:
            first, last = (min(stated, key=stated.__getitem__), max(stated, key=stated.__getitem__))
            raise SourceError(
                f"{file}: found {last} to start {late:g} s after {first}, expected one start for all channels"
            )
    if all(kinds):
        notes.clocks.append(file)


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


def _cut(file: str, channels: dict[str, Channel], notes: _Notes) -> dict[str, Channel]:
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
        notes.cut.append(f"{file} ({longest - shortest:.3g} s)")
    return cut


def _without_map(path: Path, file: Path, form: str) -> str:
    held = _held(signals_of(file, form, []))
    return (
        f"{path}: found no map of channels, expected one there or with --map: `boltlaw import {form} "
        f"{path.parent}` without NEW_DIR drafts it; {file.name} holds {held}"
    )


def _held(signals: list[Signal]) -> str:
    return _some([signal.described() for signal in signals if not signal.derived])


def _some(names: list[str]) -> str:
    return ", ".join(names[:MOST_CHOICES]) + (", ..." if len(names) > MOST_CHOICES else "")
