"""``laws.toml``: tension laws of one's own in a file.

    format = "boltlaw-laws/1"
    [[law]]
    name = "slip work"
    rate = "-a * abs(D * v) * max(T, 0)"
    parameters = { a = { value = 1.0, unit = "1/J", low = 0.0 } }

``low`` and ``high`` bound a parameter; one with ``fixed = true`` is not fitted.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from discovery.laws.candidate import Candidate
from discovery.laws.given import check_units, given_law
from rom.campaign.channels import one_of
from rom.model.dimensions import spaced
from rom.model.laws import Parameter, free_form_law
from rom.model.units import parse_unit

FORMAT = "boltlaw-laws/1"
_Number = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class _Parameter(_Table):
    value: _Number = Field(description="a number")
    unit: str = Field("1", description="a unit of N, m and s, such as 1/J or s3/m4")
    low: _Number | None = Field(None, description="a number")
    high: _Number | None = Field(None, description="a number")
    fixed: bool = Field(False, description="true or false")


class _Law(_Table):
    name: Annotated[str, Field(min_length=1)] = Field(description="text")
    rate: Annotated[str, Field(min_length=1)] = Field(description="an expression of dT/dt in T, x, v, F, D")
    parameters: dict[str, _Parameter] = Field({}, description="a table of parameters")


class _File(_Table):
    format: Literal["boltlaw-laws/1"] = Field(description=f'"{FORMAT}"')
    law: Annotated[list[_Law], Field(min_length=1)] = Field(description="one [[law]] or more")


def read_laws(path: Path | str) -> tuple[Candidate, ...]:
    """Read the laws of a file.

    Returns
    -------
    tuple of Candidate
        In the order of the file.

    Raises
    ------
    ValueError
        A line for every fault: what was found, what was expected.
    """
    return laws_from(read_tables(path), str(path))


def read_tables(path: Path | str) -> dict[str, Any]:
    """Read the tables of a file of laws.

    Raises
    ------
    ValueError
        If it cannot be read or is not TOML.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(
            f'{path}: cannot be read: found "{error.strerror}", expected a file of laws ({FORMAT})'
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(
            f"{path}: found text that is not TOML ({error}), expected laws ({FORMAT})"
        ) from error


def laws_from(content: Mapping[str, Any], where: str) -> tuple[Candidate, ...]:
    """Return the laws of the tables of a file.

    Parameters
    ----------
    content : mapping
        As `read_tables` returns it.
    where : str
        What the lines about faults start with.

    Returns
    -------
    tuple of Candidate
        In the order of the tables.

    Raises
    ------
    ValueError
        A line for every fault: what was found, what was expected.
    """
    try:
        tables = _File.model_validate(content).law
    except ValidationError as error:
        raise ValueError("\n".join(f"{where}: {line}" for line in _faults(error))) from error
    laws, faults = [], []
    for place, table in enumerate(tables):
        try:
            if table.name in [other.name for other in tables[:place]]:
                raise ValueError(f"found the name {table.name!r} again, expected another one")
            laws.append(_law(table))
        except ValueError as error:
            faults += [f"{where}: law[{place}]: {line}" for line in str(error).splitlines()]
    if faults:
        raise ValueError("\n".join(faults))
    return tuple(laws)


def _law(table: _Law) -> Candidate:
    parameters = {name: _parameter(name, given) for name, given in table.parameters.items()}
    law = free_form_law(table.name, spaced(table.rate), "tension rate", parameters)
    check_units(law)
    return given_law(law, [name for name, given in table.parameters.items() if given.fixed])


def _parameter(name: str, given: _Parameter) -> Parameter:
    """In SI: a unit such as kN or mm counts as so many of N or m."""
    factor = parse_unit(given.unit).factor
    if factor != 1.0:
        raise ValueError(
            f"parameter {name!r}: found the unit {given.unit!r}, expected one of N, m and s without prefix"
        )
    low = -math.inf if given.low is None else given.low
    high = math.inf if given.high is None else given.high
    if not low <= given.value <= high:
        raise ValueError(
            f"parameter {name!r}: found the value {given.value:g}, expected one from {low:g} to {high:g}"
        )
    return Parameter(given.value, given.unit, bounds=(low, high))


def _faults(error: ValidationError) -> list[str]:
    lines = []
    for fault in error.errors(include_url=False):
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"]).lstrip(
            "."
        )
        table: type[BaseModel] = _table(fault["loc"])
        key = str(fault["loc"][-1])
        if fault["type"] == "extra_forbidden":
            expected, found = one_of(key, tuple(table.model_fields)), "an unknown key"
        else:
            field = table.model_fields.get(key)
            expected = (field.description if field is not None else None) or "a table"
            found = "nothing" if fault["type"] == "missing" else _shown(fault["input"])
        lines.append(f"{place}: found {found}, expected {expected}")
    return lines


def _table(loc: tuple[Any, ...]) -> type[BaseModel]:
    if "parameters" in loc[:-1]:
        return _Parameter
    return _Law if loc[:1] == ("law",) and len(loc) > 1 else _File


def _shown(value: Any) -> str:
    text = "a table" if isinstance(value, dict) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
