"""Tables of a report: numbers for people, errors, parameters, and anything else that a result file holds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from experiments.text import equations
from experiments.text.wording import NONE, label, mapping, mappings, number, plain, with_limits
from rom.model.laws import Z95

Data = Mapping[str, Any]

_MOST_ROWS = 400
_LONG = 12
_DEEPEST = 4
_SYMBOL = re.compile(r"(1|[A-Za-zµ%°]+)(?:\^?(-?\d+(?:\.\d+)?))?")
_LAST = {"m": (1,), "s": (2,)}  # units of force, mass and energy come first

MEASURES = {
    "motion_nrmse": ("Displacement, NRMSE", "%", 100.0),
    "relative_motion_nrmse": ("Relative displacement of the joint, NRMSE", "%", 100.0),
    "final_tension_error_percent_median": ("Final tension, median error (the paper's measure)", "%", 1.0),
    "final_tension_error_percent_mean": ("Final tension, mean error (the paper's measure)", "%", 1.0),
    "final_tension_error_percent_max": ("Final tension, largest error (the paper's measure)", "%", 1.0),
    "tension_loss_error_percent_median": ("Loss of tension, median error", "%", 1.0),
    "tension_rmse_n": ("Tension after the impact, RMS error", "N", 1.0),
    "tension_course_within_band": ("Time in which tensions lie within their 95 % limits", "%", 100.0),
    "link_force_nrmse": ("Link force, NRMSE", "%", 100.0),
    "records": ("Records compared", "", 1.0),
    "failed": ("Simulations that did not finish", "", 1.0),
}
_FINAL = "final_tension_error_percent_median"
_FLOORS = (
    ("", "– noise alone would give"),
    ("_with_variability", "– noise and the variability between tests would give"),
)
_IN_ROWS = {
    "motion_nrmse": "Error of the displacement",
    "tension_loss_error_percent_median": "Error of the loss",
}
_SETS = {
    "training": "training",
    "hold_out": "hold-out",
    "no_loosening": "no loosening",
    "before": "before",
    "after": "after",
}


@dataclass(frozen=True)
class Table:
    """A table: caption, column heads, rows of text or markup; a folded one opens on a click."""

    caption: str
    columns: tuple[str | Markup, ...]
    rows: tuple[tuple[str | Markup, ...], ...]
    folded: bool = False
    note: str = ""


def error_columns(data: object, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Data]]:
    """Yield every object of error measures below `data` with the keys that lead to it."""
    if isinstance(data, Mapping):
        if "motion_nrmse" in data:
            yield path, data
        else:
            for key, value in data.items():
                yield from error_columns(value, (*path, str(key)))


def errors_table(data: object, caption: str, floors: object = None) -> Table | None:
    """Return a table of error measures, a column for every set of records; None where there is none.

    Parameters
    ----------
    data : object
        Holds objects of error measures.
    caption : str
        Of the table.
    floors : object
        What noise alone would give: of the only set, or by name of the set.
    """
    columns = [(path, errors) for path, errors in error_columns(data) if _says_something(path, errors)]
    if not columns:
        return None
    heads = tuple(
        ", ".join(_SETS.get(key, label(key)) for key in path) or "all records" for path, _ in columns
    )
    of_sets = [mapping(mapping(floors).get(path[-1])) if path else mapping(floors) for path, _ in columns]
    rows = tuple(error_rows([errors for _, errors in columns], of_sets))
    return Table(caption, ("", *(head[:1].upper() + head[1:] for head in heads)), rows)


def _says_something(path: tuple[str, ...], errors: Data) -> bool:
    """Whether records were compared; no loosening is a rival only where a bolt loosens."""
    loosens = errors.get(_FINAL) is not None
    return bool(errors.get("records")) and ("no_loosening" not in path or loosens)


def error_rows(columns: Sequence[Data], floors: Sequence[Data] = ()) -> Iterator[tuple[str | Markup, ...]]:
    """Yield a row for every error measure that one of the columns has, and what noise alone would give.

    Parameters
    ----------
    columns : sequence of mapping
        Error measures of each set.
    floors : sequence of mapping
        What noise alone would give of each set.
    """
    for key, (text, unit, factor) in MEASURES.items():
        values = [errors.get(key) for errors in columns]
        if key == "tension_rmse_n" and all(errors.get(_FINAL) is None for errors in columns):
            text = "Tension at rest, RMS error"
        if any(value is not None for value in values) and (key != "failed" or any(values)):
            yield f"{text} [{unit}]" if unit else text, *(_scaled(value, factor) for value in values)
            for ending, words in _FLOORS:
                noise = [floor.get(f"{key}{ending}") for floor in floors]
                if any(value is not None for value in noise):
                    yield f"{words} [{unit}]", *(_scaled(value, factor) for value in noise)


def _scaled(value: object, factor: float) -> str:
    scaled = value * factor if isinstance(value, float) else value
    return number(scaled, 3)


def parameter_rows(place: str, parameters: object) -> Iterator[tuple[str | Markup, ...]]:
    """Yield (symbol, place, value, 95 % limits, unit, source) of the parameters of a law or an effect.

    What has limits was identified: the catalogue's source is that of an equation, not of such a value.
    """
    if not isinstance(parameters, Mapping):
        return
    for name, parameter in parameters.items():
        if isinstance(parameter, Mapping):
            value, limits = with_limits(parameter.get("value"), parameter.get("low"), parameter.get("high"))
            shown = equations.math(equations.symbol(str(name)))
            fitted = parameter.get("low") is not None or parameter.get("high") is not None
            source = "identified" if fitted else str(parameter.get("source") or "")
            yield shown, place, value, limits, unit_shown(str(parameter.get("unit", ""))), source


def unit_shown(unit: str) -> Markup:
    """Return a unit with its powers raised, alike for "s3/m4" and "m^-4 s^3"; nothing for 1.

    What is not of the grammar of units (`rom.model.units`) is shown as it is.
    """
    above, *below = re.sub(r"\*\*", "^", unit).replace("·", " ").replace("*", " ").split("/")
    found: dict[str, float] = {}
    for part, sign in ((above, 1.0), *((one, -1.0) for one in below)):
        for token in part.split():
            match = _SYMBOL.fullmatch(token)
            if match is None:
                return Markup("{}").format(unit)
            if match[1] != "1":
                found[match[1]] = found.get(match[1], 0.0) + sign * float(match[2] or 1)
    places = sorted(found, key=lambda name: (*_LAST.get(name, (0,)), name))
    powers = [(name, f"{found[name]:g}".replace("-", "−")) for name in places if found[name]]
    return Markup(" ").join(
        Markup("{}<sup>{}</sup>").format(name, power) if power != "1" else name for name, power in powers
    )


def parameters_table(model: Data, name: str = "model", refitted: Sequence[Data] = ()) -> Table | None:
    """Return all parameters of a model.json with limits and units; None where it holds none.

    Parameters
    ----------
    model : mapping
        Content of ``model.json``.
    name : str
        What the caption calls it.
    refitted : sequence of mapping
        Numbers that a closed loop fitted again: the file of the model has no limits of masses.

    Returns
    -------
    Table or None
        A row for each parameter.
    """
    rows: list[tuple[str | Markup, ...]] = []
    masses = {**_identified_masses(model), **{str(row.get("name")): row for row in refitted}}
    for body in mappings(model.get("bodies")):
        mass = masses.get(f"body.{body.get('name')}.mass", body.get("mass"))
        rows += parameter_rows(f"body {body.get('name')}", {"m": mass})
    for key, suffix in (("links", ""), ("uncoupled_links", ", bolt out")):
        for link in mappings(model.get(key)):
            for place in ("stiffness", "damping", "tension_rate"):
                law = link.get(place)
                if isinstance(law, Mapping):
                    where = f"{link.get('name')}: {place.replace('_', ' ')}{suffix}"
                    rows += parameter_rows(where, law.get("parameters"))
    for effect in mappings(model.get("effects")):
        rows += parameter_rows(f"{effect.get('name')} at {effect.get('enters')}", effect.get("parameters"))
    heads = ("", "Where", "Value", "95 % limits", "Unit", "Source")
    again = "Numbers of links were fitted again beside the effects. " if refitted else ""
    note = f"{again}A dash: no limits are known." if any(row[3] == NONE for row in rows) else again.strip()
    return Table(f"Parameters of the {name}", heads, tuple(rows), note=note) if rows else None


def _identified_masses(model: Data) -> dict[str, Data]:
    """Return the masses that spectra told, with 95 % limits, by path."""
    found: dict[str, Data] = {}
    for row in mappings(mapping(model.get("identification")).get("linear")):
        value, error = row.get("value"), row.get("error_percent")
        if str(row.get("name")).endswith(".mass") and value is not None and error is not None:
            half = Z95 * error / 100 * value
            found[str(row["name"])] = {
                "value": value,
                "low": value - half,
                "high": value + half,
                "unit": "kg",
            }
    return found


def tables_of(value: object, caption: str, depth: int = 0) -> Iterator[Table]:
    """Yield tables of any part of a result file: rows for a list of objects, a line for every plain value.

    Parameters
    ----------
    value : object
        A part of a result file.
    caption : str
        Of the first table.
    depth : int
        Levels above it.

    Returns
    -------
    iterator of Table
        One for each part.
    """
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        yield _rows_table(value, caption)
    elif isinstance(value, Mapping):
        yield from _tables_of_object(value, caption, depth)
    elif value is not None and value != []:
        yield Table(caption, (), ((plain(value),),))


def _tables_of_object(value: Data, caption: str, depth: int) -> Iterator[Table]:
    if "motion_nrmse" in value:
        yield from _present(errors_table(value, caption))
        return
    scored = {key: item for key, item in value.items() if any(error_columns(item))}
    yield from _present(errors_table(scored, caption))
    rest = {key: item for key, item in value.items() if key not in scored}
    if len(rest) > 1 and all(
        isinstance(item, Mapping) and all(map(_is_flat, item.values())) for item in rest.values()
    ):
        yield _rows_table([{"": key, **item} for key, item in rest.items()], caption)
        return
    flat = {key: item for key, item in rest.items() if _is_flat(item) or depth >= _DEEPEST}
    if any(item is not None for item in flat.values()):
        yield Table(caption, (), tuple((label(key), plain(item)) for key, item in flat.items()))
    for key, item in rest.items():
        if key not in flat:
            yield from tables_of(item, f"{caption}: {label(key).lower()}", depth + 1)


def _present(table: Table | None) -> Iterator[Table]:
    if table is not None:
        yield table


def _rows_table(rows: Sequence[Data], caption: str) -> Table:
    flat = [_flattened(row) for row in rows[:_MOST_ROWS]]
    columns = list(dict.fromkeys(head for row in flat for head in row))
    columns = [head for head in columns if any(row.get(head, NONE) != NONE for row in flat)]
    shown = tuple(tuple(row.get(head, NONE) for head in columns) for row in flat)
    short = len(rows) <= _MOST_ROWS
    note = "" if short else f"The first {_MOST_ROWS} of {len(rows)} rows; the file holds them all."
    return Table(caption, tuple(columns), shown, folded=len(rows) > _LONG, note=note)


def _flattened(row: Data) -> dict[str, str]:
    """Return cells by column head; an object within a row gets a column for each of its values."""
    cells: dict[str, str] = {}
    for key, value in row.items():
        if any(error_columns(value)):
            cells |= _error_cells(value)
        elif isinstance(value, Mapping) and "value" not in value:
            cells |= {
                f"{label(key)}, {str(inner).replace('_', ' ')}": plain(item) for inner, item in value.items()
            }
        else:
            cells[label(key)] = plain(value)
    return cells


def _error_cells(value: object) -> dict[str, str]:
    """Return the two errors that tell most of every set of records, by column head."""
    cells = {}
    for path, errors in error_columns(value):
        where = ", ".join(_SETS.get(key, label(key)) for key in path)
        for key, words in _IN_ROWS.items():
            cells[f"{words}, {where} [%]"] = _scaled(errors.get(key), MEASURES[key][2])
    return cells


def _is_flat(value: object) -> bool:
    return not isinstance(value, Mapping | list) or (
        isinstance(value, list) and not any(isinstance(item, Mapping | list) for item in value)
    )
