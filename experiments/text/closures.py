"""A closed loop in plain words, equations and tables; every number comes from closure.json."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from discovery.criteria.criteria import percent, used_in
from discovery.views.closure_plot import class_words, forces, sides
from discovery.views.closure_summary import place_words, view_words
from experiments.text import equations
from experiments.text.answers import Answer, Headline
from experiments.text.bootstrap_table import bootstrap_table
from experiments.text.closure_labels import CORRELATED, LEGEND, OF_FORCE, SINGLE
from experiments.text.noise_floors import beside
from experiments.text.tables import MEASURES, Table, error_rows, parameter_rows, unit_shown
from experiments.text.wording import NONE, label, mapping, mappings, number, trimmed, with_limits

Data = Mapping[str, Any]

_QUESTION = "Is anything missing from the model, and what?"
_GOOD = {"closed": True, "no-effect": True, "unexplained": False}
_SETS = {"hold_out": "hold-out", "training": "training"}
_HEADLINES = ("motion_nrmse", "relative_motion_nrmse", "tension_loss_error_percent_median")
_HYPHEN = "\u2011"  # at which no line breaks
_SHOWN_BELOW = ("numbers", "links")
_OF_LIMIT = (("value", 1.0), ("worst_value", 1.0), ("share_of_default", 100.0), ("felt_percent", 1.0))


@dataclass(frozen=True)
class Block:
    """A part of the page on a closed loop: heading, text, typeset equations and their legend, tables."""

    title: str
    text: str = ""
    shown: tuple[Markup, ...] = ()
    legend: str = ""
    tables: tuple[Table, ...] = ()


def answer(data: Data) -> Answer:
    """Return what was missing, how one knows, what changed and what remains."""
    verdict = str(data.get("verdict"))
    return Answer(
        _QUESTION,
        _verdict(verdict, effects_of(data), _remaining(data), used_in(data).acceptance.noise_level),
        tuple(_sentences(data)),
        tuple(_headlines(data)),
        _GOOD.get(verdict),
    )


def effects_of(data: Data) -> list[Data]:
    """Return the effects that a closure names, in the order in which they were found."""
    return mappings(data.get("effects"))


def _remaining(data: Data) -> str:
    """Return what a closed loop leaves, in words: noise alone, or a share of the residual's mean square."""
    before, after = (side.get("total") for side in sides(data))
    if not (isinstance(before, float) and isinstance(after, float)):
        return "how much is left is not known"
    if after <= used_in(data).acceptance.noise_level:
        p = sides(data)[1].get("whiteness_p")
        regular = isinstance(p, float) and p < used_in(data).localisation.regular
        size = "what is left is as small as noise"
        return f"{size}, but more regular than noise" if regular else size
    share = number(100 * after / before, 2)
    return f"{share} % of the residual's mean square is left, {number(after, 3)} times noise"


def _verdict(verdict: str, effects: Sequence[Data], left: str, worst: float) -> str:
    named = " and ".join(_placed(effect) for effect in effects)
    if verdict == "closed" and named:
        alike = sum(_as_good(effect, worst) for effect in effects)
        others = f", or one of {alike} look-alikes" if alike > 1 else ", or its look-alike" if alike else ""
        return f"The loop closes. The model lacked {named}{others}; with that, {left}."
    if verdict == "unexplained" and named:
        return f"Something is still missing: {named} helped, but significant residual is left."
    known = {
        "closed": f"The loop closes: {left}.",
        "no-effect": "Nothing is missing that these records show: no effect beats chance.",
        "unexplained": "Something is missing that no effect explains.",
    }
    return known.get(verdict, f"Verdict: {verdict}.")


def _as_good(effect: Data, worst: float) -> int:
    """Return how many look-alikes hold-out records do not exclude, as far as their cost is known."""
    costs = [like.get("hold_out_cost") for like in mappings(effect.get("look_alikes"))]
    return sum(cost is None or float(cost) <= worst for cost in costs)


def _placed(effect: Data) -> str:
    name = str(effect.get("name"))
    shown = "a term outside the catalogue" if name == "free-form" else name
    enters = place_words(effect.get("enters"))
    return f"{shown} ({enters})" if enters else shown


def correlations(data: Data) -> list[tuple[str, float, float, float]]:
    """Return what correlates in the residual: label, before, after, and the limit of noise."""
    before, after = sides(data)
    found = []
    for key, words in CORRELATED.items():
        old, new, chance = before.get(key), after.get(key), after.get(f"{key}_chance")
        if isinstance(old, float) and isinstance(new, float) and isinstance(chance, float):
            found.append((words, old, new, chance))
    return found


def _sentences(data: Data) -> Iterator[str]:
    said = data.get("summary")
    if isinstance(said, Mapping):
        told = (str(text) for key, text in said.items() if text and key not in _SHOWN_BELOW)
        yield from (line for text in told for line in text.splitlines())
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
            alone = beside(mapping(mapping(data.get("noise_floor")).get(str(kind))), key, unit, factor)
            yield Headline(f"{words[:1].lower()}{words[1:]}, {_SETS[str(kind)]}{alone}", shown, after)


def _errors(data: Data, kind: str, when: str) -> Data:
    return mapping(mapping(mapping(data.get("errors")).get(kind)).get(when))


def blocks(data: Data) -> list[Block]:
    """Return errors before and after, where the residual lived, then each effect: equation, numbers,
    look-alikes.
    """
    found = [Block("Errors before and after", tables=tuple(_error_tables(data)))]
    lived = tuple(table for table in (_most(data), force_table(data)) if table.rows)
    found += [Block("Where the residual lived", tables=lived)] if lived else []
    found += [_effect_block(effect) for effect in effects_of(data)]
    return [block for block in found if block.tables or block.shown]


def _error_tables(data: Data) -> Iterator[Table]:
    floors = mapping(data.get("noise_floor"))
    columns = [
        (f"{_SETS[kind]}, {when}", errors, mapping(floors.get(kind)))
        for kind in _SETS
        for when in ("before", "after")
        if (errors := _errors(data, kind, when)).get("records")
    ]
    rows = tuple(error_rows([errors for _, errors, _ in columns], [floor for *_, floor in columns]))
    if rows:
        heads = tuple(head[:1].upper() + head[1:] for head, *_ in columns)
        yield Table("", ("", *heads), rows, note=" ".join(_notes(rows, heads)))
    steps = mappings(data.get("steps"))
    if len(steps) > 2:  # of one effect the table above says it all
        yield _steps(steps)


def _notes(rows: Iterable[Sequence[object]], heads: Iterable[str]) -> Iterator[str]:
    """What to know of a table of errors, of what stands in it."""
    if any("NRMSE" in str(row[0]) for row in rows):
        yield (
            "NRMSE: root mean square of simulated minus measured over that of the measured, both through one "
            "filter chain."
        )
    if any(head.startswith("Hold-out") for head in heads):
        yield "No fit has seen a hold-out record."


def _steps(steps: Sequence[Data]) -> Table:
    of_step = [{kind: mapping(mapping(step.get("errors")).get(kind)) for kind in _SETS} for step in steps]
    kind = next((kind for kind in _SETS if of_step[0][kind].get("records")), "training")
    keys = [key for key in _HEADLINES if any(errors[kind].get(key) is not None for errors in of_step)]
    rows = tuple(
        (
            f"+\u00a0{str(step['added']).replace('-', _HYPHEN)}" if step.get("added") else "declared",
            *(_scaled(errors[kind].get(key), MEASURES[key][2]) for key in keys),
        )
        for step, errors in zip(steps, of_step, strict=True)
    )
    heads = tuple(f"{MEASURES[key][0]} [{MEASURES[key][1]}]" for key in keys)
    return Table(f"Step by step, {_SETS[kind]}", ("Model", *heads), rows)


def _most(data: Data) -> Table:
    """Return the class of every view in which most was left, before and after."""
    before, after = sides(data)
    rows = []
    for view, classes in before.items():
        sizes = {part: x for part, x in mapping(classes).items() if isinstance(x, int | float)}
        if sizes:
            part = max(sizes, key=lambda name: float(sizes[name]))
            left = mapping(after.get(view)).get(part)
            rows.append((view_words(view), class_words(part), _cell(sizes[part]), _cell(left)))
    if rows and before.get("total") is not None:
        rows.append(("All", "", _cell(before["total"]), _cell(after.get("total"))))
    note = "Mean square of the whitened residual, 1: noise alone. All classes are listed under details."
    return Table("", ("Along", "Most was left at", "Before", "After"), tuple(rows), note=note)


def force_table(data: Data) -> Table:
    """Return how much of the unbalanced force is a function of motion, what it does, and what is left."""
    both = forces(data)
    if both is None:
        return Table("", (), ())
    rows = tuple(
        (words.format(**_rare(data)), *(_scaled(one.get(key), factor) for one in both))
        for key, words, factor in OF_FORCE
        if both[0].get(key) is not None
    )
    note = "Equation error of the training records, in the band of their spectra, back in time."
    return Table(
        f"The force left at {class_words(both[0]['place'])}", ("", "Before", "After"), rows, note=note
    )


def _effect_block(effect: Data) -> Block:
    name, enters = str(effect.get("name")), str(effect.get("enters") or "")
    tables = [table for table in (_parameters(effect), _look_alikes(effect)) if table.rows]
    equation = str(effect.get("equation") or "")
    names = set(re.findall(r"[A-Za-z_]\w*", equation))
    return Block(
        f"{name}, {place_words(enters)}" if enters else name,
        " ".join(_evidence(effect)),
        tuple(equations.effect_equations(equation, enters)) if equation else (),
        "; ".join(
            [*_of_force(equation, enters), *(text for known, text in LEGEND.items() if known in names)]
        ),
        tuple(tables),
    )


def _of_force(equation: str, enters: str) -> Iterator[str]:
    """Say what F is where it is the left side: in a changed law of loosening it is the force of the joint."""
    if enters == "tension" and re.search(r"\bF = ", equation):
        yield "F: what is added to the reading of the tension"
    elif enters != "tension" and not enters.startswith("sensor:"):
        yield "F: force that pulls the first body back"


def _evidence(effect: Data) -> Iterator[str]:
    share, p, wins = (effect.get(key) for key in ("share", "p_value", "wins"))
    if effect.get("source") == "free-form":
        yield "Found without the catalogue, by sparse regression."
    if isinstance(share, float):
        yield f"Share of {effect.get('share_of') or 'the residual'} that it explains: {_share(share)}."
    if isinstance(wins, Sequence) and len(wins) == 2 and wins[1]:
        yield f"Hold-out records that it improves: {wins[0]} of {wins[1]}."
    if isinstance(p, float):
        chance = f"= {trimmed(number(p, 2))}" if p >= 1e-4 else "below 10⁻⁴"
        how = "" if effect.get("p_value_from") in (None, "drawn") else " (rows independent)"
        yield f"Chance of that where nothing is missing{how}: p {chance}."


def _parameters(effect: Data) -> Table:
    rows = tuple((cells[0], *cells[2:5]) for cells in parameter_rows("", mapping(effect.get("parameters"))))
    return Table("", ("", "Value", "95 % limits", "Unit"), rows)


def _look_alikes(effect: Data) -> Table:
    rows = tuple(
        (
            str(like.get("name")),
            place_words(like.get("enters")) or NONE,
            trimmed(number(like.get("hold_out_cost"), 3)),
            str(like.get("test") or NONE),
        )
        for like in mappings(effect.get("look_alikes"))
    )
    note = (
        "Effects within chance of the one named, or that explain nearly all that it does. Hold-out cost: "
        "sum of squared whitened residuals on hold-out records, over its own; 1 is as good, and what is far "
        "above it is excluded by these records."
    )
    heads = ("Look-alike", "Where", "Hold-out cost", "What would separate them")
    return Table("Look-alikes", heads, rows, note=note)


def details(data: Data, model_shown: bool = False) -> list[Table]:
    """Return where the residual lives, and what was screened: tables for those who look closer.

    The numbers that were fitted again are those of the refined model, where that is shown.
    """
    found = (
        () if model_shown else (_refitted(data),),
        (_residual(data), _screened(data), _limits(data), bootstrap_table(data)),
    )
    return [table for part in found for table in part if table.rows]


def _refitted(data: Data) -> Table:
    """Return the numbers of links and bodies as the loop fitted them."""
    rows = tuple(
        (
            str(row.get("name")),
            *with_limits(row.get("value"), row.get("low"), row.get("high")),
            unit_shown(str(row.get("unit"))),
        )
        for row in mappings(data.get("refitted"))
    )
    return Table("Numbers of links and masses, fitted again", ("", "Value", "95 % limits", "Unit"), rows)


def _limits(data: Data) -> Table:
    """Return from which strength on every effect would have been found."""
    rows = tuple(
        (
            str(row.get("name")),
            place_words(row.get("enters")),
            str(row.get("parameter")),
            *(_scaled(row.get(key), factor) for key, factor in _OF_LIMIT),
            unit_shown(str(row.get("unit"))),
            ", ".join(f"{n} = {number(value, 3)}" for n, value in mapping(row.get("shape")).items()),
            str(row.get("reason") or ""),
        )
        for row in mappings(data.get("detection_limits"))
    )
    shown = percent(used_in(data).detection.probability)
    note = (
        f"Smallest strength that these records would have shown with a probability of {shown}, its other "
        "numbers being the catalogue's; at worst: those of the catalogue's grid that show least."
    )
    heads = (
        *("Effect", "Where", "Strength", "Limit", "At worst", "Over the usual one [%]", "Felt by [%]"),
        *("Unit", "At", "No limit, since"),
    )
    return Table("What is excluded", heads, rows, note=note, folded=True)


def _residual(data: Data) -> Table:
    before, after = sides(data)
    rows: list[tuple[str | Markup, ...]] = []
    for view in dict.fromkeys((*before, *after)):
        old, new = before.get(view), after.get(view)
        if view == "forces":
            continue
        if isinstance(old, Mapping) or isinstance(new, Mapping):
            name = view_words(view)
            parts = dict.fromkeys((*mapping(old), *mapping(new)))
            rows += [(name, class_words(part), _cell(mapping(old).get(part)), _cell(mapping(new).get(part)))
                     for part in parts]  # fmt: skip
        else:
            rows.append((_single_words(view, _rare(data)), "", _cell(old), _cell(new)))
    note = "Mean square of the whitened residual; 1 is what noise alone leaves."
    return Table("Where the residual lives", ("View", "", "Before", "After"), tuple(rows), note=note)


def _rare(data: Data) -> dict[str, str]:
    """Return of how many cases noise exceeds what is printed as chance in one."""
    criteria = used_in(data)
    shares = {"rare": 1 - criteria.chance.level, "white": criteria.localisation.chance}
    return {name: f"{1 / share:.3g}" for name, share in shares.items()}


def _single_words(view: str, rare: Mapping[str, str]) -> str:
    """Return what a number of the residual is, in words."""
    head, of_sensor, body = view.partition("repeatability_noise_")
    if of_sensor and not head:
        return f"The same, sensor of {body} [1]"
    return SINGLE.get(view, label(view)).format(**rare)


def _screened(data: Data) -> Table:
    rows = tuple(
        (
            str(row.get("name")),
            place_words(row.get("enters")),
            _share(row.get("share")),
            trimmed(number(row.get("strength"), 3)),
        )
        for row in mappings(data.get("screened"))
    )
    note = "What each effect alone could explain of the first residual beyond the declared model."
    heads = ("Effect", "Where", "Share of the residual", "Strength")
    return Table("What was screened", heads, rows, note=note)


def _cell(value: object) -> str:
    return trimmed(number(value, 3)) if isinstance(value, float) else label(str(value or NONE))


def _share(value: object) -> str:
    return f"{trimmed(number(100.0 * value, 3))} %" if isinstance(value, int | float) else NONE


def _scaled(value: object, factor: float) -> str:
    return number(value * factor if isinstance(value, float) else value, 3)
