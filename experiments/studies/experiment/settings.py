"""``experiment.toml``: what is done to which campaigns, with which laws, searches, criteria and seeds.

    format = "boltlaw-experiment/1"
    name = "which law, with how many terms"
    command = "discover"
    campaigns = ["bolt-a", "bolt-b"]
    laws = ["laws.toml"]
    seeds = [0, 1]

    [[rig]]
    cases = 12
    law = ["power-2", "power-3"]

    [search]
    max_terms = [1, 2]

A list where one value is expected makes a cell of each value, a list of lists where a list is one of each
list.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from rom.campaign.channels import nearest

FORMAT = "boltlaw-experiment/1"
Command = Literal["discover", "compare", "close"]
T = TypeVar("T")


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _nested(value: Any) -> Any:
    return value if isinstance(value, list) and any(isinstance(one, list) for one in value) else [value]


_Each: TypeAlias = Annotated[list[T], BeforeValidator(_listed), Field(min_length=1)]
_Lists: TypeAlias = Annotated[
    list[Annotated[list[T], Field(min_length=1)]], BeforeValidator(_nested), Field(min_length=1)
]
_Hidden: TypeAlias = Annotated[list[list[T]], BeforeValidator(_nested), Field(min_length=1)]
"""Lists that may be empty."""
_Bolts: TypeAlias = Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=2)]
_Number: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
_Text: TypeAlias = Annotated[str, Field(min_length=1)]
_Seed: TypeAlias = Annotated[int, Field(ge=0)]


def _key(description: str, default: Any = ...) -> Any:
    return Field(default, description=description)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class RigSettings(_Table):
    """Options of ``boltlaw rig``; what is not given is as there."""

    name: _Text = _key("text", "rig")
    cases: _Each[int] = _key("a number of preloads, 2 or more, or a list of such numbers", [])
    noise: _Each[_Number] = _key("a factor of 0 or more, or a list of factors", [])
    scatter: _Each[_Number] = _key("a factor of 0 or more, or a list of factors", [])
    strengths: _Lists[_Number] = _key("a list of shares of the full hit, or a list of such lists", [])
    law: _Each[_Text] = _key("the name of a tension law of the rig, or a list of names", [])
    undeclared: _Hidden[_Text] = _key(
        "a list of effects such as coulomb-friction:F_c=2, or a list of such lists", []
    )
    influence_percent: _Lists[_Number] = _key(
        "a smallest and a largest change [%] between which strengths are drawn, or a list of such pairs", []
    )
    bolts: _Each[int] = _key("a number of bolts, 2 or more, or a list of numbers", [])
    between_bolts: _Each[_Number] = _key(
        "a standard deviation of ln rate between bolts, 0 or more, or a list of these", []
    )
    duration_s: _Each[_Number] = _key("a length of 2.5 s or more, or a list of lengths", [])
    hold_out_every: _Each[int] = _key("a whole number, 0 for none, or a list of such numbers", [])
    seed: _Each[_Seed] = _key("a seed, or a list of seeds", [])


class SearchSettings(_Table):
    """Options of ``boltlaw discover``; what is not given is as there."""

    libraries: _Lists[_Text] = _key("a list of names of libraries, or a list of such lists", [])
    optimizers: _Lists[_Text] = _key("a list of names of optimizers, or a list of such lists", [])
    max_terms: _Each[Annotated[int, Field(ge=1)]] = _key("a number of terms, or a list of numbers", [])


class ExperimentSettings(_Table):
    """All of an experiment's file, under its own names; every axis is a list."""

    format: Literal["boltlaw-experiment/1"] = _key(f'"{FORMAT}"')
    name: _Text = _key("text")
    command: _Each[Command] = _key('"discover", "compare" or "close", or a list of these', ["discover"])
    campaigns: list[_Text | _Bolts] = _key(
        "a list of campaign folders, or of lists of the folders of several bolts", []
    )
    rig: _Each[RigSettings] = _key("one [[rig]] or more", [])
    keep_campaigns: bool = _key("true or false", False)
    own_process: bool = _key("true or false", False)
    figures: bool = _key("true or false", True)
    measure: _Text | None = _key('"MODULE:FUNCTION"', None)
    laws: _Lists[_Text] = _key("a list of files of laws, or a list of such lists", [])
    law: list[dict[str, Any]] = _key("one [[law]] or more, as in laws.toml", [])
    search: SearchSettings = _key("a table [search]", SearchSettings())
    criteria: dict[str, dict[str, _Each[int | float]]] = _key(
        "tables [criteria.GROUP] of numbers, or of lists of numbers", {}
    )
    seeds: _Each[_Seed] = _key("a list of seeds", [])


_TABLES: dict[str, type[_Table]] = {"rig": RigSettings, "search": SearchSettings}


def read_settings(path: Path) -> tuple[ExperimentSettings, dict[str, Any]]:
    """Read an experiment's file: its settings, and its content as it stands there.

    Raises
    ------
    ValueError
        A line for every fault: what was found, what was expected.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(
            f"{path}: found text that is not TOML ({error}), expected an experiment ({FORMAT})"
        ) from error
    try:
        return ExperimentSettings.model_validate(content), content
    except ValidationError as error:
        lines = dict.fromkeys(_line(one) for one in error.errors(include_url=False))
        raise ValueError("\n".join(f"{path}: {line}" for line in lines)) from error


def _line(fault: Any) -> str:
    """What was found and what is expected; the place is a key, whichever of its values is at fault."""
    head, *rest = fault["loc"]
    table = _TABLES.get(head, ExperimentSettings)
    place, key = str(head), str(head)
    if head in _TABLES:
        place += "".join(f"[{part}]" for part in rest[:1] if isinstance(part, int))
        key = next((part for part in rest if isinstance(part, str)), "")
        place += f".{key}" if key else ""
    elif head == "criteria":
        place = ".".join([place, *(part for part in rest[:2] if isinstance(part, str))])
    if fault["type"] == "extra_forbidden":
        guess = nearest(key, table.model_fields)
        expected = f'"{guess}" (nearest known name)' if guess else f"one of {', '.join(table.model_fields)}"
        return f"{place}: found an unknown key, expected {expected}"
    field = table.model_fields.get(key) or ExperimentSettings.model_fields[str(head)]
    found = "nothing" if fault["type"] == "missing" else _shown(fault["input"])
    return f"{place}: found {found}, expected {field.description}"


def _shown(value: Any) -> str:
    text = (
        "a table"
        if isinstance(value, dict)
        else str(value).lower()
        if value is True or value is False
        else repr(value)
    )
    return text if len(text) <= 60 else f"{text[:57]}..."
