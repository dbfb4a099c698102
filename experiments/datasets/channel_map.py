"""The map from a laboratory's files to a campaign: `import.toml`.

It is a `campaign.toml` with a table [channels], and patterns of source files in place of the records' files.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import ValidationError

from experiments.datasets.collected import SourceError
from experiments.datasets.times import SHOWN, factor_of
from rom.campaign.campaign import FORMAT as CAMPAIGN_FORMAT
from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import channel_names, one_of
from rom.campaign.settings_faults import parsing_faults, record_faults, structure_faults

FORMAT = "boltlaw-import/1"
FILE = "import.toml"
TIME = "time"
_RULE = {"channel": str, "unit": str, "scale": float, "rate_hz": float}
_PRELOAD = "{preload_n}"


@dataclass(frozen=True)
class Rule:
    """Which channel of the campaign a signal becomes; `scale` gives SI, else `unit` or the file's unit.

    The channel "time" is no channel of the campaign: it gives others their rate and start.
    """

    signal: str
    channel: str
    scale: float | None = None
    unit: str | None = None
    rate_hz: float | None = None


@dataclass(frozen=True, eq=False)
class Entry:
    """One [[record]] of the map: the pattern of its source files, its settings, its rules."""

    pattern: re.Pattern[str]
    text: str
    settings: Mapping[str, Any]
    rules: Mapping[str, Rule]


@dataclass(frozen=True, eq=False)
class ChannelMap:
    """A checked map; `campaign` holds the settings but for the records."""

    path: Path
    campaign: Mapping[str, Any]
    entries: tuple[Entry, ...]

    def settings(self, records: list[dict[str, Any]]) -> CampaignSettings:
        """Return the campaign's settings with these records."""
        return CampaignSettings.model_validate({**self.campaign, "record": records})


def read_map(path: Path) -> ChannelMap:
    """Read and check a map; the keys that it shares with a campaign are checked as those of one.

    Raises
    ------
    SourceError
        A line for each fault, naming the key.
    """
    data = _parsed(path)
    if data.get("format") != FORMAT:
        raise SourceError(
            f'{path.name}: format: found "{data.get("format", "nothing")}", expected "{FORMAT}"'
        )
    tables = data.pop("channels", {})
    records = data.get("record")
    if not isinstance(records, list) or not all(isinstance(record, dict) for record in records):
        raise SourceError(f"{path.name}: record: found none, expected one [[record]] or more")
    # a campaign of one record per entry: what is wrong with it is wrong with the map
    stand_in = [
        {**{key: value for key, value in record.items() if key != "channels"}, "file": f"records/{index}.h5"}
        for index, record in enumerate(records)
    ]
    settings = _checked(path, {**data, "format": CAMPAIGN_FORMAT, "record": stand_in})
    known = (*channel_names(settings.body_names, settings.link_names), TIME)
    common, faults = _rules("channels", tables, known)
    entries = []
    for index, record in enumerate(records):
        own, more = _rules(f"record[{index}].channels", record.get("channels", {}), known)
        text = record.get("file")
        faults += more
        if not isinstance(text, str) or not text or text.count(_PRELOAD) > 1:
            faults.append(
                f'record[{index}].file: found {text!r}, expected a pattern such as "loosening_*.mat"'
            )
            continue
        kept = {key: value for key, value in record.items() if key not in ("channels", "file")}
        entries.append(Entry(pattern_of(text), text, kept, own or common))
    if not faults and not all(entry.rules for entry in entries):
        faults.append('channels: found nothing, expected a line for each channel: "Hammer" = "force_lo"')
    if faults:
        raise SourceError(*(f"{path.name}: {fault}" for fault in faults))
    campaign = {key: value for key, value in data.items() if key != "record"} | {"format": CAMPAIGN_FORMAT}
    return ChannelMap(path, campaign, tuple(entries))


def _parsed(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as cause:
        raise SourceError(f"{path.name}: found {cause}, expected TOML in UTF-8") from None


def _checked(path: Path, data: dict[str, Any]) -> CampaignSettings:
    try:
        settings = CampaignSettings.model_validate(data)
    except ValidationError as error:
        raise SourceError(*(f"{path.name}: {line}" for line in parsing_faults(error))) from None
    if faults := (*structure_faults(settings), *record_faults(settings)):
        raise SourceError(*(f"{path.name}: {line}" for line in faults))
    return settings


def _rules(key: str, table: Any, known: tuple[str, ...]) -> tuple[dict[str, Rule], list[str]]:
    """Return the rules of a table of channels by signal, and a line for each that cannot be."""
    if not isinstance(table, dict):
        return {}, [f"{key}: found {table!r}, expected a table of channels"]
    rules, faults = {}, []
    for signal, value in table.items():
        rule = {"channel": value} if isinstance(value, str) else value
        own = list(_rule_faults(f'{key}."{signal}"', rule, known))
        faults += own
        if not own:
            rules[signal] = Rule(signal, **rule)
    return rules, faults


def _rule_faults(key: str, rule: Any, known: tuple[str, ...]) -> Iterator[str]:
    if not isinstance(rule, dict) or "channel" not in rule:
        yield f'{key}: found {rule!r}, expected {{channel = "force_lo", unit = "N"}} or "force_lo"'
        return
    for name, value in rule.items():
        if name not in _RULE:
            yield f"{key}.{name}: found an unknown key, expected {one_of(name, _RULE)}"
        elif _RULE[name] is str and not isinstance(value, str):
            yield f"{key}.{name}: found {value!r}, expected text"
        elif _RULE[name] is float and not _is_factor(value, negative=name == "scale"):
            sign = "other than 0" if name == "scale" else "above 0"
            yield f"{key}.{name}: found {value!r}, expected a number {sign}"
    if isinstance(rule["channel"], str) and rule["channel"] not in known:
        yield f'{key}.channel: found "{rule["channel"]}", expected {one_of(rule["channel"], known)}'
    if rule["channel"] == TIME:
        yield from _time_faults(key, rule)
    if "scale" in rule and "unit" in rule:
        yield f"{key}: found scale and unit, expected one of them: scale alone gives SI"


def _time_faults(key: str, rule: Mapping[str, Any]) -> Iterator[str]:
    if "rate_hz" in rule:
        yield f"{key}: found rate_hz of a time, expected it of a channel; give unit or scale of the time"
    if isinstance(rule.get("unit", "s"), str) and factor_of(rule.get("unit", "s")) is None:
        yield f'{key}.unit: found "{rule["unit"]}", expected a unit of time: {SHOWN}'


def _is_factor(value: Any, *, negative: bool) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return False
    return value != 0 if negative else value > 0


def pattern_of(text: str) -> re.Pattern[str]:
    """Return what matches a pattern of files: *, ?, [...] within one name, {preload_n} for a number."""
    parts = re.split(r"(\{preload_n\}|\*|\?|\[[^\]]+\])", text)
    special = {"*": "[^/]*", "?": "[^/]", _PRELOAD: r"(?<![\d.])(?P<preload_n>\d+(?:\.\d+)?)(?![\d])"}
    return re.compile("".join(special.get(part) or _literal_or_class(part) for part in parts))


def _literal_or_class(part: str) -> str:
    if part.startswith("[") and part.endswith("]") and len(part) > 2:
        inner = part[1:-1].replace("\\", r"\\")
        return f"[^{inner[1:]}]" if inner.startswith("!") else f"[{inner}]"
    return re.escape(part)


def record_of(entry: Entry, source: str) -> dict[str, Any] | None:
    """Return the record that a source file becomes by an entry of the map, None where it does not match."""
    match = entry.pattern.fullmatch(source)
    if match is None:
        return None
    file = str(PurePosixPath("records") / PurePosixPath(source).with_suffix(".h5"))
    named = match.groupdict().get("preload_n")
    return {**entry.settings, "file": file} | ({"preload_n": float(named)} if named else {})
