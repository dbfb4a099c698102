"""A closed loop in plain words, equations and tables; every number comes from closure.json."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from experiments.report import equations
from experiments.report.answers import Answer, Headline
from experiments.report.tables import MEASURES, Table, error_rows, parameter_rows
from experiments.report.wording import NONE, label, number, trimmed

Data = Mapping[str, Any]

VIEWS = {
    "by_channel": "Channel",
    "by_test": "Kind of test",
    "by_frequency": "Frequency",
    "by_time": "Time since the impact",
    "by_preload": "Preload",
    "by_amplitude": "Amplitude",
}
_QUESTION = "Is anything missing from the model, and what?"
_GOOD = {"closed": True, "no-effect": True, "unexplained": False}
_SETS = {"hold_out": "hold-out", "training": "training"}
_HEADLINES = ("motion_nrmse", "relative_motion_nrmse", "tension_loss_error_percent_median")
_SINGLE = {
    "even_share": "Share of the residual joint force that is even in the displacement [%]",
    "rate_free_share": "Share of the residual joint force that is out of phase with the displacement [%]",
    "whiteness_p": "Chance of so much dependence if only noise were left [1]",
    "total": "All",
}


@dataclass(frozen=True)
class Block:
    """A part of the page on a closed loop: heading, typeset equations, tables."""

    title: str
    shown: tuple[Markup, ...] = ()
    tables: tuple[Table, ...] = ()
    text: str = ""


def answer(data: Data) -> Answer:
    """Return what was missing, how one knows, what changed and what remains."""
    verdict = str(data.get("verdict"))
    return Answer(
        _QUESTION,
        _verdict(verdict, effects_of(data)),
        tuple(_sentences(data)),
        tuple(_headlines(data)),
        _GOOD.get(verdict),
    )


def effects_of(data: Data) -> list[Data]:
    """Return the effects that a closure names, in the order in which they were found."""
    return _mappings(data.get("effects"))


def _verdict(verdict: str, effects: Sequence[Data]) -> str:
    named = " and ".join(_placed(effect) for effect in effects)
    if verdict == "closed" and named:
        return f"The loop closes. The model lacked {named}; with that, what is left looks like noise."
    if verdict == "unexplained" and named:
        return f"Something is still missing. {named} helped, but significant residual is left."
    known = {
        "closed": "The loop closes: what is left looks like noise.",
        "no-effect": "Nothing is missing that these records show: no effect beats chance.",
        "unexplained": "Something is missing that no effect explains.",
    }
    return known.get(verdict, f"Verdict: {verdict}.")


def _placed(effect: Data) -> str:
    name = str(effect.get("name"))
    shown = "a term outside the catalogue" if name == "free-form" else name
    enters = place_words(effect.get("enters"))
    return f"{shown} ({enters})" if enters else shown


def place_words(enters: object) -> str:
    """Return where an effect enters, in words; nothing where the file does not say."""
    kind, _, name = str(enters or "").partition(":")
    if name:
        return f"{kind} {name}"
    return kind if kind in ("", "tension") else f"link {kind}"


def _sentences(data: Data) -> Iterator[str]:
    said = data.get("summary")
    if isinstance(said, Mapping):
        yield from (str(text) for text in said.values() if text)
        return
    names = ", ".join(str(effect.get("name")) for effect in effects_of(data))
    yield f"Added: {names}." if names else "No effect was added."


def _headlines(data: Data) -> Iterator[Headline]:
    if not effects_of(data):
        return
    kind = next((kind for kind in _SETS if _errors(data, kind, "after").get("records")), None)
    for key in _HEADLINES:
        before, after = (_errors(data, str(kind), when).get(key) for when in ("before", "after"))
        if isinstance(before, float) and isinstance(after, float):
            words, unit, factor = MEASURES[key]
            shown = f"{number(factor * before, 3)} → {number(factor * after, 3)} {unit}"
            yield Headline(f"{words[:1].lower()}{words[1:]}, {_SETS[str(kind)]}", shown, after)


def _errors(data: Data, kind: str, when: str) -> Data:
    return _mapping(_mapping(_mapping(data.get("errors")).get(kind)).get(when))


def blocks(data: Data) -> list[Block]:
    """Return errors before and after, then each effect with equation, numbers and look-alikes."""
    found = [Block("Errors before and after", tables=tuple(_error_tables(data)))]
    found += [_effect_block(effect) for effect in effects_of(data)]
    return [block for block in found if block.tables or block.shown]


def _error_tables(data: Data) -> Iterator[Table]:
    columns = [
        (f"{_SETS[kind]}, {when}", errors)
        for kind in _SETS
        for when in ("before", "after")
        if (errors := _errors(data, kind, when)).get("records")
    ]
    rows = tuple(error_rows([errors for _, errors in columns]))
    if rows:
        heads = tuple(head[:1].upper() + head[1:] for head, _ in columns)
        note = (
            "NRMSE: root mean square of simulated minus measured over that of the measured, both through one "
            "filter chain. No fit has seen a hold-out record."
        )
        yield Table("", ("", *heads), rows, note=note)
    steps = _mappings(data.get("steps"))
    if len(steps) > 1:
        yield _steps(steps)


def _steps(steps: Sequence[Data]) -> Table:
    keys = [
        (kind, key)
        for kind in _SETS
        for key in _HEADLINES
        if any(_mapping(_mapping(step.get("errors")).get(kind)).get(key) is not None for step in steps)
    ]
    heads = tuple(f"{MEASURES[key][0]}, {_SETS[kind]} [{MEASURES[key][1]}]" for kind, key in keys)
    rows = tuple(
        (
            f"+ {step['added']}" if step.get("added") else "the declared model",
            *(
                _scaled(_mapping(_mapping(step.get("errors")).get(kind)).get(key), MEASURES[key][2])
                for kind, key in keys
            ),
        )
        for step in steps
    )
    return Table("Step by step", ("Model", *heads), rows)


def _effect_block(effect: Data) -> Block:
    name, enters = str(effect.get("name")), str(effect.get("enters") or "")
    tables = [table for table in (_parameters(effect), _look_alikes(effect)) if table.rows]
    text = " ".join(_evidence(effect))
    shown = equations.effect_equations(str(effect.get("equation") or ""), enters)
    return Block(
        f"{name}, {place_words(enters)}" if enters else name,
        tuple(shown) if effect.get("equation") else (),
        tuple(tables),
        text,
    )


def _evidence(effect: Data) -> Iterator[str]:
    share, p, wins = (effect.get(key) for key in ("share", "p_value", "wins"))
    if effect.get("source") == "free-form":
        yield "Found without the catalogue, by sparse regression."
    if isinstance(share, float):
        yield f"Share of the residual that it takes away: {_share(share)}."
    if isinstance(wins, Sequence) and len(wins) == 2 and wins[1]:
        yield f"Held-out records that it meets better: {wins[0]} of {wins[1]}."
    if isinstance(p, float):
        yield f"Chance of that where nothing is missing: p = {trimmed(number(p, 2))}."


def _parameters(effect: Data) -> Table:
    rows = tuple((cells[0], *cells[2:5]) for cells in parameter_rows("", _mapping(effect.get("parameters"))))
    return Table("", ("", "Value", "95 % limits", "Unit"), rows)


def _look_alikes(effect: Data) -> Table:
    rows = tuple(
        (
            str(like.get("name")),
            place_words(like.get("enters")) or NONE,
            trimmed(number(like.get("hold_out_cost"), 3)),
            str(like.get("test") or NONE),
        )
        for like in _mappings(effect.get("look_alikes"))
    )
    note = "Cost on held-out records over that of the effect named: 1 is as good."
    heads = ("Look-alike", "Where", "Held-out cost", "What would separate them")
    return Table("Not told apart from it by these records", heads, rows, note=note)


def details(data: Data) -> list[Table]:
    """Return where the residual lives, and what was screened: tables for those who look closer."""
    return [table for table in (_residual(data), _screened(data)) if table.rows]


def _residual(data: Data) -> Table:
    residual = _mapping(data.get("residual"))
    before, after = (_mapping(residual.get(when)) for when in ("before", "after"))
    rows: list[tuple[str | Markup, ...]] = []
    for view in dict.fromkeys((*before, *after)):
        old, new = before.get(view), after.get(view)
        if isinstance(old, Mapping) or isinstance(new, Mapping):
            name = VIEWS.get(view, label(view))
            parts = dict.fromkeys((*_mapping(old), *_mapping(new)))
            rows += [(name, part, _cell(_mapping(old).get(part)), _cell(_mapping(new).get(part)))
                     for part in parts]  # fmt: skip
        else:
            percent = 100.0 if view.endswith("_share") else 1.0
            rows.append((_SINGLE.get(view, label(view)), "", _cell(old, percent), _cell(new, percent)))
    note = "Mean square of the whitened residual; 1 is what noise alone leaves."
    return Table("Where the residual lives", ("View", "", "Before", "After"), tuple(rows), note=note)


def _screened(data: Data) -> Table:
    rows = tuple(
        (
            str(row.get("name")),
            place_words(row.get("enters")),
            _share(row.get("share")),
            _share(row.get("wins")),
            trimmed(number(row.get("strength"), 3)),
        )
        for row in _mappings(data.get("screened"))
    )
    note = "What each effect alone could explain of the first residual beyond the declared model."
    heads = ("Effect", "Where", "Share of the residual", "Share of records", "Strength")
    return Table("What was screened", heads, rows, note=note)


def _cell(value: object, factor: float = 1.0) -> str:
    return trimmed(_scaled(value, factor)) if isinstance(value, float) else label(str(value or NONE))


def _share(value: object) -> str:
    return f"{trimmed(number(100.0 * value, 3))} %" if isinstance(value, int | float) else NONE


def _scaled(value: object, factor: float) -> str:
    return number(value * factor if isinstance(value, float) else value, 3)


def _mapping(value: object) -> Data:
    return value if isinstance(value, Mapping) else {}


def _mappings(items: object) -> list[Data]:
    return [item for item in items if isinstance(item, Mapping)] if isinstance(items, list) else []
