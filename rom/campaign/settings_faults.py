"""What cannot be in a campaign's settings: a line for each key, with what was found and what was expected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from rom.campaign.channels import nearest, one_of
from rom.campaign.settings import (
    GROUND,
    MODAL_TESTS,
    POSITIVE,
    RECORD_ENDINGS,
    BandSettings,
    BodySettings,
    BoltSettings,
    CampaignSettings,
    LinkLaw,
    LinkSettings,
    ModesSettings,
    RecordSettings,
    SamplingSettings,
    Test,
    WindowSettings,
    modal_structure,
)

_PRINTED_BITS = 192

_TABLES: dict[str, type[BaseModel]] = {
    "body": BodySettings,
    "link": LinkSettings,
    "bolt": BoltSettings,
    "sampling": SamplingSettings,
    "windows": WindowSettings,
    "band": BandSettings,
    "modes": ModesSettings,
    "record": RecordSettings,
}


def parsing_faults(error: ValidationError) -> tuple[str, ...]:
    """Say in one line per key what was found and what was expected; a misspelt key is not missed as well."""
    errors = error.errors(include_url=False)
    missing = {tuple(e["loc"]) for e in errors if e["type"] == "missing"}
    lines: dict[str, str] = {}
    excused: set[str] = set()
    for e in errors:
        inside = (o for o in errors if o is not e and o["loc"][: len(e["loc"])] == e["loc"])
        if e["type"] == "too_short" and e["input"] and any(inside):
            continue  # what is in it is at fault
        if e["type"] == "extra_forbidden":
            *parent, key = e["loc"]
            known = (_TABLES[str(parent[0])] if parent else CampaignSettings).model_fields
            absent = [name for name in known if (*parent, name) in missing]
            guess = nearest(str(key), absent)
            excused |= {_key((*parent, guess))} if guess else set()
            expected = one_of(str(key), [guess] if guess else known)
            lines[_key(e["loc"])] = f"{_key(e['loc'])}: found an unknown key, expected {expected}"
        else:
            loc, found = _place(e)
            lines.setdefault(
                _key(loc[:3]), f"{_key(loc)}: found {found}, expected {_expected(loc, e['input'])}"
            )
    return tuple(line for key, line in lines.items() if key not in excused)


def _place(error: Any) -> tuple[tuple[str | int, ...], str]:
    """Return the faulty key and what stands there; a list that is too short is itself the fault."""
    loc = tuple(error["loc"])
    if error["type"] != "missing":
        return loc, _shown(error["input"])
    if isinstance(loc[-1], int):
        return loc[:-1], _shown(error["input"])
    return loc, "nothing"


def _expected(loc: tuple[str | int, ...], found: Any) -> str:
    model: type[BaseModel] = CampaignSettings
    expected = ""
    for name in (str(part) for part in loc if not isinstance(part, int)):
        field = model.model_fields.get(name)
        expected = POSITIVE if field is None else field.description or ""
        model = _TABLES.get(name, model)
    choices = {"test": get_args(Test), "law": get_args(LinkLaw)}.get(str(loc[-1]), ())
    guess = nearest(found, choices) if isinstance(found, str) else None
    return f'{expected} (nearest: "{guess}")' if guess else expected


def _key(loc: Iterable[str | int]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).removeprefix(".")


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and value.bit_length() > _PRINTED_BITS:
        return f"a whole number of {value.bit_length()} bits"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_shown(item) for item in value[:6])}{', ...' if len(value) > 6 else ''}]"
    shown = f'"{value}"' if isinstance(value, str) else str(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."


def structure_faults(settings: CampaignSettings) -> tuple[str, ...]:
    """Name each body and link that cannot be beside the others; no record makes sense without them."""
    if settings.modes is not None:
        return tuple(_modes_faults(settings))
    return (*_body_faults(settings), *_link_faults(settings))


def record_faults(settings: CampaignSettings) -> tuple[str, ...]:
    """Name each key of bolt, windows and records that is sound by itself but cannot be beside the others."""
    return (
        *_bolt_faults(settings),
        *_window_faults(settings.windows),
        *_band_faults(settings),
        *_file_faults(settings),
    )


def _repeated(key: str, names: Iterable[str]) -> Iterator[str]:
    names = tuple(names)
    for index, name in enumerate(names):
        if name in names[:index]:
            first = names.index(name)
            yield f'{key.format(index)}: found "{name}" again, expected a name other than {key.format(first)}'


def _modes_faults(settings: CampaignSettings) -> Iterator[str]:
    """Say what cannot stand beside modes, or in a record of theirs."""
    assert settings.modes is not None
    made = modal_structure(settings.modes.count)
    written = settings.model_dump(include={"body", "link"}, exclude_none=True) | {"bolt": settings.bolt}
    beside = [key for key in ("body", "link") if list(written[key]) != made[key]]
    beside += ["bolt"] if settings.bolt is not None else []
    if beside:
        shown = " and ".join(f"[{key}]" if key == "bolt" else f"[[{key}]]" for key in beside)
        yield f"modes: found {shown} beside it, expected either: modes stand in place of bodies and links"
    for index, record in enumerate(settings.record):
        key = f"record[{index}]"
        if record.test not in MODAL_TESTS:
            yield (
                f'{key}.test: found "{record.test}" beside [modes], expected "free" or "driven" '
                "(a hit with a measured force is driven)"
            )
        for name in ("bodies", "mass_kg", "stiffness_n_per_m"):
            if getattr(record, name) is not None:
                yield f"{key}.{name}: found it beside [modes], expected none: there are no bodies to name"


def _body_faults(settings: CampaignSettings) -> Iterator[str]:
    yield from _repeated("body[{}].name", settings.body_names)
    for index, name in enumerate(settings.body_names):
        if name == GROUND:
            yield f'body[{index}].name: found "{GROUND}", expected another name: the ground always exists'


def _link_faults(settings: CampaignSettings) -> Iterator[str]:
    yield from _repeated("link[{}].name", settings.link_names)
    ends = tuple(dict.fromkeys((*settings.body_names, GROUND)))
    for index, link in enumerate(settings.link):
        unknown = [(i, end) for i, end in enumerate(link.between) if end not in ends]
        for i, end in unknown:
            yield f'link[{index}].between[{i}]: found "{end}", expected {one_of(end, ends)}'
        if not unknown and link.between[0] == link.between[1]:
            yield f'link[{index}].between: found "{link.between[0]}" twice, expected two different bodies'
        if link.law == "dashpot" and link.stiffness_n_per_m:
            found = f"found {link.stiffness_n_per_m:g} on a dashpot"
            yield f"link[{index}].stiffness_n_per_m: {found}, expected none: a dashpot has damping only"


def _bolt_faults(settings: CampaignSettings) -> Iterator[str]:
    bolted = [link.name for link in settings.link if link.law == "bolted"]
    bolt = settings.bolt
    if bolt is None:
        if bolted:
            yield f'bolt: found nothing, expected a table [bolt] for the bolted link "{bolted[0]}"'
        return
    if bolt.link not in settings.link_names:
        yield f'bolt.link: found "{bolt.link}", expected {one_of(bolt.link, bolted or settings.link_names)}'
    elif bolt.link not in bolted:
        yield f'bolt.link: found "{bolt.link}", which is not bolted, expected a link with law = "bolted"'
    if bolt.calibration is not None and bolt.calibration[0] <= 0:
        yield (
            f"bolt.calibration[0]: found {bolt.calibration[0]:g}, expected a number above 0: "
            "tension rises with strain"
        )


def _window_faults(windows: WindowSettings) -> Iterator[str]:
    for key, (start, end) in (("initial_s", windows.initial_s), ("final_s", windows.final_s)):
        if start >= end:
            yield f"windows.{key}: found [{start:g}, {end:g}], expected the start before the end"
    start, end = windows.final_s[0], windows.initial_s[1]
    if windows.initial_s[0] < end and start < min(end, windows.final_s[1]):
        yield f"windows.final_s: found a start of {start:g}, expected {end:g} (the end of initial_s) or later"


def _band_faults(settings: CampaignSettings) -> Iterator[str]:
    band, half = settings.band, settings.sampling.motion_rate_hz / 2
    if band is None:
        return
    if band.low_hz >= band.high_hz:
        yield f"band.high_hz: found {band.high_hz:g}, expected more than low_hz, {band.low_hz:g}"
    if band.high_hz >= half:
        yield f"band.high_hz: found {band.high_hz:g}, expected less than half of motion_rate_hz, {half:g}"


def _file_faults(settings: CampaignSettings) -> Iterator[str]:
    paths = [str(PurePosixPath(record.file)) for record in settings.record]
    counts = Counter(paths)
    for index, record in enumerate(settings.record):
        key = f"record[{index}]"
        if fault := file_fault(record.file):
            yield f"{key}.file: {fault}"
        elif counts[paths[index]] > 1 and (first := paths.index(paths[index])) < index:
            yield f'{key}.file: found "{record.file}" again, expected a file other than record[{first}].file'
        yield from (f"{key}.{line}" for line in moving_faults(record, settings.body_names))
        yield from (f"{key}.{line}" for line in _given_faults(record, settings))
        if record.test in ("loosening", "hold") and settings.bolt is None and not _has_bolted(settings):
            yield f'{key}.test: found "{record.test}", expected a link with law = "bolted" and a table [bolt]'


def _given_faults(record: RecordSettings, settings: CampaignSettings) -> Iterator[str]:
    """Say why a record cannot have values of its own for these bodies or links."""
    for body in record.mass_kg or ():
        if body not in settings.body_names:
            yield f'mass_kg.{body}: found "{body}", expected {one_of(body, settings.body_names)}'
    laws = {link.name: link.law for link in settings.link}
    linear = [name for name, law in laws.items() if law == "linear"]
    why = {"bolted": "whose stiffness depends on the tension", "dashpot": "which has damping only"}
    for link in record.stiffness_n_per_m or ():
        found = f'stiffness_n_per_m.{link}: found "{link}"'
        if link not in laws:
            yield f"{found}, expected {one_of(link, linear)}"
        elif link not in linear:
            yield f'{found}, {why[laws[link]]}, expected a link with law = "linear"'


def _has_bolted(settings: CampaignSettings) -> bool:
    return any(link.law == "bolted" for link in settings.link)


def moving_faults(record: RecordSettings, known: tuple[str, ...]) -> Iterator[str]:
    """Say why a record's `bodies` cannot be those that move in it."""
    bodies = record.bodies
    if bodies is None:
        return
    yield from _repeated("bodies[{}]", bodies)
    for index, body in enumerate(bodies):
        if body not in known:
            yield f'bodies[{index}]: found "{body}", expected {one_of(body, known)}'
    if not bodies and record.test not in ("cycled", "hold"):
        yield "bodies: found an empty list, expected the bodies that move"
    if record.test == "uncoupled" and len(set(bodies)) > 1:
        yield f"bodies: found {len(bodies)} names, expected one: an uncoupled test moves one body"


def file_fault(file: str) -> str | None:
    """Say why a record's path cannot be one inside the campaign folder, or None."""
    windows = PureWindowsPath(file)
    if file.startswith(("/", "\\")) or windows.drive or "\0" in file:
        return f'found "{file}", expected a path relative to the campaign folder'.replace("\0", "")
    if ".." in windows.parts:
        return f'found "{file}", expected a path that stays inside the campaign folder'
    if PurePosixPath(file).suffix.lower() not in RECORD_ENDINGS:
        return f'found "{file}", expected a file ending in {", ".join(RECORD_ENDINGS)}'
    return None
