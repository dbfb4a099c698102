"""A closed loop in plain words, from what closure.json holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from discovery.criteria.criteria import used_in
from discovery.criteria.localisation import Localising
from discovery.detection.limit import NEVER, UNSEEN
from discovery.localisation.localise import COURSES
from discovery.views.digits import digits_apart
from discovery.views.force_plot import explained_level
from rom.criteria.number import Numerical

Data = Mapping[str, Any]


class Measure(NamedTuple):
    """An error measure: in a sentence, as the title of a panel, its unit, and the factor to that from SI."""

    words: str
    title: str
    unit: str
    factor: float


MEASURES = {
    "motion_nrmse": Measure("the displacement", "Displacement", "%", 100.0),
    "relative_motion_nrmse": Measure("the relative displacement of the joint", "Relative motion", "%", 100.0),
    "tension_loss_error_percent_median": Measure("the loss of tension (median)", "Loss of tension", "%", 1.0),
    "tension_rmse_n": Measure("the tension", "Tension", "N", 1.0),
    "link_force_nrmse": Measure("the link force", "Link force", "%", 100.0),
}
_VIEWS = {  # others are said as they are named
    "by_test": "Kind of test",
    "by_time": "Time since the impact",
    "by_place": "As a force",
    "by_sign": "Displacement",
    "tension_by_preload": "Tension's courses by preload",
    "tension_by_velocity": "Tension's courses by velocity",
    "tension_by_time": "Tension's courses by time",
}
_PLACED = {  # what is said before a label where it stands out
    "by_time": "after the impact",
    "by_harmonic": "",
    "by_place": "as a force,",
    "by_sign": "displacement",
    "tension_by_preload": "courses of the tension at",
    "tension_by_velocity": "courses of the tension at",
    "tension_by_time": "courses of the tension after",
}
_CHANCES = {
    "drawn": "the chance that the best of the whole catalogue does as well where nothing is missing",
    "likelihood ratio": "the chance of that were noise alone left, independent from row to row, times the "
    "number of effects tried",
}
_NAMED: Numerical[int] = 3
_SAME: Numerical[float] = 0.02
_UNCHANGED: Numerical[float] = 0.005  # of an error: what three digits show


def sections(data: Data) -> dict[str, str]:
    """Return what was ``missing``, its ``numbers``, those of the ``links`` beside it, the ``evidence``, what
    ``changed``, what ``remains``, what is ``excluded`` and what a ``bootstrap`` says.

    Of several effects each has a line in its section; one about which there is nothing to say is left out.
    """
    parts: dict[str, tuple[str, Callable[[Data], Iterator[str]]]] = {
        "missing": (_head(data), _missing),
        "numbers": ("", _numbers),
        "links": ("Refitted: ", _links),
        "evidence": ("How one knows: ", _evidence),
        "changed": ("What changed: ", _changed),
        "remains": ("What remains: ", _remains),
        "excluded": ("What is excluded: ", _excluded),
        "bootstrap": ("Bootstrap: ", _bootstrap),
    }
    said = {key: (head, "\n".join(say(data))) for key, (head, say) in parts.items()}
    return {key: head + text for key, (head, text) in said.items() if text}


def _head(data: Data) -> str:
    """Effects that leave more than noise helped; whether they were what was missing is not known."""
    helped = data["effects"] and data["verdict"] == "unexplained"
    return "What helped: " if helped else "What was missing: "


def place_words(enters: object) -> str:
    """Return where an effect enters, in words: ``"link joint"``, ``"body so"``; nothing where not known."""
    kind, _, name = str(enters or "").partition(":")
    if name:
        return f"{kind} {name}"
    return kind if kind in ("", "tension") else f"link {kind}"


def view_words(view: str) -> str:
    """Return what a view of the residual goes along: ``"by_preload"`` is ``"Preload"``."""
    words = view.removeprefix("by_").replace("_", " ")
    return _VIEWS.get(view, words[:1].upper() + words[1:])


def _with_place(item: Data) -> str:
    of_bolt = " of the bolt" if item["enters"] == "tension" else ""
    return f"{item['name']} in the {place_words(item['enters'])}{of_bolt}"


def _missing(data: Data) -> Iterator[str]:
    effects = data["effects"]
    if effects:
        faults = any(effect["enters"].startswith("sensor:") for effect in effects)
        more = " A sensor's fault is taken out of the records; it is no force." if faults else ""
        shares = [float(effect["share"]) for effect in effects]
        named = [
            f"{_named(effect)} ({_percent(share)} of what was left)"
            if data["verdict"] == "unexplained"
            else _named(effect)
            for effect, share in zip(effects, shares, strict=True)
        ]
        it = "it" if len(effects) == 1 else "they"
        doubt = f" More than noise is left: {it} may stand for something else."
        yield f"{' and '.join(named)}.{doubt if data['verdict'] == 'unexplained' else ''}{more}"
    elif data["verdict"] == "unexplained":
        yield "something that no effect of the catalogue explains."
    else:
        yield "nothing that these records show; no effect of the catalogue beats chance."


def _numbers(data: Data) -> Iterator[str]:
    for effect in data["effects"]:
        numbers = [_with_limits(name, parameter) for name, parameter in effect["parameters"].items()]
        yield f"{effect['name']}: {effect['equation']}{', with ' if numbers else ''}{', '.join(numbers)}."


def _links(data: Data) -> Iterator[str]:
    rows = [_with_limits(row["name"], row) for row in data.get("refitted") or ()]
    if rows:
        yield f"{'; '.join(rows)}."


def _named(effect: Data) -> str:
    outside = {"name": "a term outside the catalogue"} if effect["source"] == "free-form" else {}
    return _with_place({**effect, **outside})


def _with_limits(name: str, parameter: Data) -> str:
    unit = "" if parameter["unit"] == "1" else f" {parameter['unit']}"
    low, high = parameter["low"], parameter["high"]
    digits = digits_apart(low, high)
    shown = f"{name} = {_number(parameter['value'], digits)}{unit}"
    if low is None and high is None:
        return shown
    if low is None or high is None:
        side = f"at most {_number(high)}" if low is None else f"at least {_number(low)}"
        return f"{shown} (at the end of its range; 95 %: {side})"
    of = "95 % of records" if parameter.get("of_records") else "95 %"
    return f"{shown} ({of}: {_number(low, digits)} to {_number(high, digits)})"


def _evidence(data: Data) -> Iterator[str]:
    several = len(data["effects"]) > 1
    for effect in data["effects"]:
        won, records = effect["wins"]
        what = effect["name"] if several else "it"
        text = f"{what} explains {_percent(effect['share'])} of {effect['share_of']} on training records"
        if records:
            text += f", and improves {won} of {records} hold-out records"
        if _known(effect["p_value"]):
            text += f"; {_CHANCES[effect['p_value_from']]}: p {_chance(effect['p_value'])}"
        yield " ".join([f"{text}.", *_on_look_alikes(effect)])
    yield from _on_the_rest(data)


def _on_look_alikes(effect: Data) -> Iterator[str]:
    alike = effect["look_alikes"]
    if not alike:
        return
    named = ", ".join(f"{_with_place(one)} ({_number(one['hold_out_cost'], 3)})" for one in alike[:_NAMED])
    more = f" and {len(alike) - _NAMED} more" if len(alike) > _NAMED else ""
    yield f"Look-alikes, with their hold-out cost over that of {effect['name']}: {named}{more}."
    tests: dict[str, list[str]] = {}
    for like in alike:
        if like["test"]:
            tests.setdefault(like["test"].rstrip("."), []).append(_with_place(like))
    for test, separated in list(tests.items())[:_NAMED]:
        which = "them" if len(tests) == 1 else f"it from {' and '.join(separated)}"
        yield f"What would separate {which}: {test}."


def _on_the_rest(data: Data) -> Iterator[str]:
    """Say what the best candidate was that is neither an effect found nor a look-alike of one."""
    named = [item for effect in data["effects"] for item in (effect, *effect["look_alikes"])]
    said = {(item["name"], item["enters"]) for item in named}
    rest = [item for item in data["screened"] if (item["name"], item["enters"]) not in said]
    if rest:
        best = max(rest, key=lambda item: float(item["share"]))
        which = "Of the other candidates" if data["effects"] else "of all candidates"
        yield (
            f"{which} {_with_place(best)} alone could explain most, "
            f"{_percent(best['share'])} of the residual of the declared model."
        )


def _changed(data: Data) -> Iterator[str]:
    if not data["effects"]:
        return
    unseen = bool(data["errors"]["hold_out"]["after"]["records"])
    where = "records that no fit has seen" if unseen else "training records (none was held out)"
    kind = "hold_out" if unseen else "training"
    errors, whens = data["errors"][kind], ("before", "after")
    balance = [data["residual"][when].get(f"force_error_{kind}") for when in whens]
    floors = (data.get("noise_floor") or {}).get(kind) or {}
    rows = [("the balance of forces", balance, 100.0, "%", "")] + [
        (one.words, [errors[when].get(key) for when in whens], one.factor, one.unit, _floor(one, key, floors))
        for key, one in MEASURES.items()
    ]
    known = [row for row in rows if all(map(_known, row[1]))]
    same = [row for row in known if len({_number(row[2] * end, 3) for end in row[1]}) == 1
            or abs(row[1][1] - row[1][0]) <= _UNCHANGED * abs(row[1][0])]  # fmt: skip
    changes = [_from_to(*row) for row in known if row not in same]
    if changes:
        yield f"on {where} the errors go: {'; '.join(changes)}."
    if same:
        kept = "; ".join(
            f"{words}, {_number(factor * new, 3)} {unit}{floor}"
            for words, (_, new), factor, unit, floor in same
        )
        yield f"{'Unchanged' if changes else f'on {where} no error changes'}: {kept}."


def _from_to(words: str, ends: Sequence[float], factor: float, unit: str, floor: str) -> str:
    old, new = (_number(factor * end, 3) for end in ends)
    return f"{words} from {old} to {new} {unit}{floor}"


def _floor(measure: Measure, key: str, floors: Data) -> str:
    """Say what noise alone would make of an error, and what it would with tests that differ."""
    causes = {"noise alone": key, "with the variability between tests": f"{key}_with_variability"}
    known = [
        f"{cause}: {_number(measure.factor * floors[name], 3)} {measure.unit}"
        for cause, name in causes.items()
        if floors.get(name) is not None
    ]
    return f" ({', '.join(known)})" if known else ""


def _remains(data: Data) -> Iterator[str]:
    before, after = data["residual"]["before"], data["residual"]["after"]
    start = f"was {_number(before['total'])} and " if data["effects"] else ""
    size = f"the mean square of the residual {start}is {_number(after['total'])} times that of noise."
    say = _remaining if data["verdict"] == "unexplained" else _like_noise
    rest = say(after, used_in(data).localisation)
    yield " ".join([size, *rest, *_on_courses(before, after)])


def _excluded(data: Data) -> Iterator[str]:
    """Say which effects would have been found at the catalogue's strengths, and which may be there."""
    rows = data.get("detection_limits") or ()
    if data["verdict"] == "unexplained" or not rows:
        return
    known = sorted((row for row in rows if row["value"] is not None), key=lambda row: row["share_of_default"])
    seen = [row for row in known if row["share_of_default"] <= 1]
    hidden = [row for row in known if row["share_of_default"] > 1]
    hidden += [row for row in rows if row["value"] is None and row["reason"] in (NEVER, UNSEEN)]
    untold = len(rows) - len(seen) - len(hidden)
    if seen:
        chance = _number(used_in(data).detection.probability)
        yield f"with probability {chance} these records would have shown {_from_limits(seen)}."
    else:
        yield "nothing at the strengths that the catalogue takes as usual."
    if hidden:
        yield f"Not excluded at the strengths that the catalogue takes as usual: {_from_limits(hidden)}."
    if untold:
        yield f"Strengths of which no limit is known: {untold}; closure.json says why of each."


def _bootstrap(data: Data) -> Iterator[str]:
    """Say how often campaigns simulated with the refined model name its effects, and what limits follow."""
    found = data.get("bootstrap")
    if not found:
        return
    count, failed = found["replicates"], found["failed"]
    of = f"of {count} campaigns simulated with the refined model and closed anew"
    if not found["effects"]:
        yield f"{of}, {found['named_any']} name an effect where none is (false alarms)."
    for effect in found["effects"]:
        yield f"{of}, {effect['named']} name {_with_place(effect)}, {effect['first']} of them first."
        for name, row in effect["parameters"].items():
            if row["low"] is None:
                yield f"Too few of them have limits of {name} ({row['replicates']})."
            else:
                unit = "" if row["unit"] == "1" else f" {row['unit']}"
                yield f"{_with_limits(name, row)}, a bias of {_number(row['bias'], 2)}{unit} taken out."
    if failed:
        yield f"Not closed: {failed}."


def _from_limits(rows: Sequence[Data]) -> str:
    """Effects of different names with the strengths from which they show, and how many there are beside."""
    first = list({row["name"]: place for place, row in reversed(list(enumerate(rows)))}.values())
    named = [rows[place] for place in sorted(first)[:_NAMED]]
    more = len(rows) - len(named)
    return "; ".join(map(_from_limit, named)) + (f"; and {more} more" if more else "")


def _from_limit(row: Data) -> str:
    if row["value"] is None:
        return _with_place(row)
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    return f"{_with_place(row)} from {row['parameter']} = {_number(row['value'], 2)}{unit}"


def _on_courses(before: Data, after: Data) -> Iterator[str]:
    old, new = (one.get(COURSES) for one in (before, after))
    if old is not None and new is not None:
        was = f"{_number(old, 3)} before and " if abs(old - new) > _SAME * new else ""
        yield (
            f"Courses of the tension after the hits: mean square {was}{_number(new, 3)} times that of noise, "
            "each test's own rate allowed for."
        )


def _like_noise(after: Data, rules: Localising) -> Iterator[str]:
    p = after["whiteness_p"]
    if not _known(p):
        return
    if p >= rules.regular:
        yield f"What is left shows no more dependence than noise would (p = {_number(p, 2)})."
    else:
        yield f"What is left is small, but shows more dependence than noise would (p {_chance(p)})."


def _remaining(after: Data, rules: Localising) -> Iterator[str]:
    places = list(lives_in(after, rules))
    where = f"It is largest at: {'; '.join(places)}" if places else "It stands out in no view"
    yield f"What is left is more than noise. {where}."
    yield from _as_force(after, rules)
    if "repeatability" in after:
        alike, chance = (_number(after[key], 2) for key in ("repeatability", "repeatability_chance"))
        yield f"Tests that repeat each other leave residuals that correlate by {alike} (noise: {chance})."


def _as_force(after: Data, rules: Localising) -> Iterator[str]:
    """Say how much of the force that is left is a function of the motion, where it is most."""
    one = max(after.get("forces", ()), key=explained_level, default=None)
    if one is None or not _known(one["explained_p"]) or one["explained"] < rules.function_of_motion:
        return
    if one["explained_p"] > rules.regular:
        return
    kind = "even" if one["elastic"] >= 0.5 else "odd"
    share = _percent(max(one["elastic"], 1 - one["elastic"]))
    place = one["place"] if one["place"].startswith("body ") else f"link {one['place']}"
    yield (
        f"As a force on the {place} {_percent(one['explained'])} of it is one function of displacement "
        f"and velocity, {kind} in velocity by {share}; {_percent(one['rest'])} is memory, or differs from "
        "record to record."
    )


def lives_in(residual: Data, rules: Localising) -> Iterator[str]:
    """Yield where a residual stands out, a phrase for each view in which it does."""
    least = rules.stands_out
    for view, profile in residual.items():
        if not isinstance(profile, Mapping):
            continue
        known = {label: value for label, value in profile.items() if _known(value)}
        if len(known) < 2:
            continue
        label = max(known, key=lambda name: float(known[name]))
        if known[label] > 1.0 and known[label] > least * min(known.values()):
            along = view_words(view)
            words = f"{_PLACED.get(view, along[:1].lower() + along[1:])} {label}".strip()
            yield f"{words} ({_number(known[label])} times noise)"


def _known(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _number(value: float, digits: int = 4) -> str:
    """Return a number of some digits, without a power of ten where it can be helped."""
    short = float(f"{value:.{digits}g}")
    return f"{short:.10g}" if 1e-4 < abs(short) < 1e6 else f"{short:.{digits}g}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %" if share >= 1e-3 else "less than 0.1 %"


def _chance(p: float) -> str:
    return f"= {_number(p, 2)}" if p >= 1e-4 else "below 0.0001"
