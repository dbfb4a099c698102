"""Tables of a blind test's results: what is asked beside what is reached, and a row for every effect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from experiments.studies.blind.scores import (
    MEASURES,
    Found,
    Result,
    answer,
    at_stake,
    error,
    has_needless,
    how_many_found,
    influence,
    is_confident,
    is_nearest,
    motion_influence,
    ratio,
    score,
)
from rom.effects import CATALOGUE

_FELT = 3.0  # influence [%] that strengths are drawn to have at least, where the plausible range allows it
_TELLS = 3.0  # of a held-out error [%]: the declared model's own numbers make up for what lowers it by less
_STRONG = 10.0  # influence on the motion [%] from which after / before is asked for


def median(values: Iterable[float], form: str = ".2f") -> str:
    """Return the median and, of several, the smallest and largest: "1.02 (0.98-1.10)"."""
    known = [value for value in values if np.isfinite(value)]
    if not known:
        return "-"
    middle = format(float(np.median(known)), form)
    return middle if len(known) == 1 else f"{middle} ({min(known):{form}}-{max(known):{form}})"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def tables(results: Sequence[Result]) -> str:
    """Return all tables of a blind test in Markdown, a set for each level of noise."""
    levels = sorted({result["noise"] for result in results})
    return "\n\n".join(
        _of_level(noise, [one for one in results if one["noise"] == noise]) for noise in levels
    )


def _of_level(noise: float, results: Sequence[Result]) -> str:
    faults = [one for one in results if "fault" in one]
    sound = [one for one in results if "fault" not in one]
    groups = {name: [one for one in sound if one["group"] == name] for name in _GROUPS}
    parts = [f"## Noise x {noise:g}: {len(sound)} campaigns", summary(groups, len(faults))]
    parts += [f"### {title}\n\n{make(groups[name])}" for name, title, make in _PARTS if groups[name]]
    programs = Counter(one["program"] for one in results if "program" in one)
    if len(programs) > 1:
        told = ", ".join(f"{name}: {count}" for name, count in programs.most_common())
        parts.append(f"Results of {len(programs)} states of the program, by digest: {told}.")
    if faults:
        parts.append("### Faults\n\n" + "\n".join(f"- {one['label']}: {one['fault']}" for one in faults))
    return "\n\n".join(parts)


def summary(groups: Mapping[str, Sequence[Result]], faults: int = 0) -> str:
    """Return what is asked beside what is reached, where effects are felt as they are meant to and in all."""
    meant = {name: [r for r in results if is_felt(r)] for name, results in groups.items()}
    columns = [[*_reached(chosen), ("faults of the program", "0", str(faults))] for chosen in (meant, groups)]
    rows = [(what, asked, told, of_all) for (what, asked, told), (*_, of_all) in zip(*columns, strict=True)]
    return table(("what", "asked", f"reached, felt by {_FELT:g} % or more", "reached, all"), rows)


def is_felt(result: Result) -> bool:
    """Whether every hidden effect changes motion, loss or reading by as much as strengths are drawn for."""
    return all(truth["influence_percent"]["percent"] >= _FELT for truth in result["truth"])


def _reached(groups: Mapping[str, Sequence[Result]]) -> list[tuple[str, str, str]]:
    """What, what is asked of it, and what is reached."""
    clean, one, outside, two = (groups[name] for name in _GROUPS)
    scores = [score(result) for result in one]
    strong = [result for result in one if motion_influence(result) > _STRONG]
    formed = [r for r in outside if any(e["source"] == "free-form" for e in r["closure"]["effects"])]
    alone = [result for result in outside if not result["truth"][0]["nearest"]]
    honest, every = ("unexplained", "closed, free-form"), [*clean, *one, *outside, *two]
    return [
        ("no effect: verdict no-effect", ">= 95 %", _share(answer(r) == "no-effect" for r in clean)),
        ("one effect: class named first", ">= 85 %", _share(s.class_ for s in scores)),
        ("one effect: itself first or listed", ">= 95 %", _share(s.listed for s in scores)),
        ("one effect: itself first", "", _share(s.name for s in scores)),
        ("one effect: named or listed, first or later", "", _share(how_many_found(r) == 1 for r in one)),
        ("one effect: wrong name, truth not listed", "<= 3 %", _share(s.unwarned for s in scores)),
        ("the same, with verdict closed", "",
         _share(s.unwarned and is_confident(r) for s, r in zip(scores, one, strict=True))),
        ("one effect: a name after the first that is not its own", "",
         _share(has_needless(r) for r in one)),
        ("one effect: kind of place", ">= 95 %", _share(s.kind_of_place for s in scores)),
        ("the same, of those that were named", "",
         _share(s.kind_of_place for s, r in zip(scores, one, strict=True) if r["closure"]["effects"])),
        ("one effect: the very place", "", _share(s.place for s in scores)),
        ("one effect: missed, verdict no-effect", "", _share(answer(r) == "no-effect" for r in one)),
        (f"the same, though the true effect lowers the error by more than {_TELLS:g} %", "",
         _share(answer(r) == "no-effect" and _is_telling(r) for r in one)),
        ("one effect: after / oracle, held out", "<= 1.1", median(ratio(r, "oracle") for r in one)),
        ("the same, numbers of faults, readings and laws the true ones", "",
         median(ratio(r, "true values") for r in one)),
        ("after / oracle of those that were named", "",
         median(ratio(r, "oracle") for r in one if r["closure"]["effects"])),
        ("one effect: 95 % limits that hold the true number", "",
         _share(held for _, pairs in _numbers(one) for _, held in pairs)),
        (f"motion changed by > {_STRONG:g} %: after / before, motion", "<= 0.25",
         median(ratio(r, "before", "motion_nrmse") for r in strong)),
        ("outside: free-form or unexplained", ">= 90 %", _share(answer(r) in honest for r in outside)),
        ("the same where nothing in the catalogue comes near", "",
         _share(answer(r) in honest for r in alone)),
        ("outside: closed by the name that nearly does the same", "",
         _share(is_confident(r) and is_nearest(r) for r in outside)),
        ("outside: closed by another name", "",
         _share(is_confident(r) and not is_nearest(r) for r in outside)),
        ("outside: free-form within 2 x oracle", ">= 50 %",
         _share(ratio(r, "oracle") <= 2.0 for r in formed)),
        ("two effects: both found", ">= 60 %", _share(how_many_found(r) == 2 for r in two)),
        ("the same, each at its very place", "", _share(how_many_found(r, placed=True) == 2 for r in two)),
        ("two effects: one found", "", _share(how_many_found(r) == 1 for r in two)),
        ("two effects: after / oracle, held out", "<= 1.3", median(ratio(r, "oracle") for r in two)),
        ("the same, numbers of faults, readings and laws the true ones", "",
         median(ratio(r, "true values") for r in two)),
        ("CPU time of a closure [s]", "", median((r["closing_cpu_s"] for r in every), ".0f")),
        ("peak memory [MB]", "< 2000", median((r["peak_mb"] for r in every), ".0f")),
    ]  # fmt: skip


def _is_telling(result: Result) -> bool:
    """Whether the true effect, refitted or at its true values, lowers an error at stake."""
    return any(not ratio(result, of) <= 1 + _TELLS / 100 for of in ("oracle", "true values"))


def _share(hits: Iterable[bool]) -> str:
    every = list(hits)
    return f"{100 * sum(every) / len(every):.0f} % ({sum(every)} of {len(every)})" if every else "-"


def _count(hits: Iterable[bool]) -> str:
    every = list(hits)
    return f"{sum(every)} of {len(every)}"


def _grouped(results: Iterable[Result], key: Callable[[Result], str]) -> dict[str, list[Result]]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return dict(sorted(groups.items()))


def _percent(results: Iterable[Result]) -> str:
    return median((influence(r) for r in results), ".0f")


def clean_table(results: Sequence[Result]) -> str:
    """Return the verdicts without effect, and every effect that was named all the same."""
    named = Counter(f"{e['name']}@{e['enters']}" for r in results for e in r["closure"]["effects"])
    rows = [
        *Counter(answer(r) for r in results).most_common(),
        *((f"named: {n}", k) for n, k in named.items()),
    ]
    return table(("verdict", "campaigns"), rows)


def effect_table(results: Sequence[Result]) -> str:
    """Return a row for every core effect that was hidden alone."""
    header = (
        "effect", "seeds", "influence [%]", "name first", "class first", "listed", "wrong unwarned",
        "kind of place", "place", "verdicts", "before", "after", "oracle", "after/before", "after/oracle",
        "CPU [s]", "else named first", "look-alikes told",
    )  # fmt: skip
    grouped = _grouped(results, lambda r: str(r["truth"][0]["name"]))
    return table(header, (_effect_row(name, mine) for name, mine in grouped.items()))


def _effect_row(name: str, mine: Sequence[Result]) -> tuple[object, ...]:
    scores = [score(result) for result in mine]
    others = Counter(effect["name"] for effect in _firsts(mine) if effect["name"] != name)
    return (
        name,
        len(mine),
        _percent(mine),
        _count(s.name for s in scores),
        _count(s.class_ for s in scores),
        _count(s.listed for s in scores),
        _count(s.unwarned for s in scores),
        _count(s.kind_of_place for s in scores),
        _count(s.place for s in scores),
        _verdicts(mine),
        *_errors(mine),
        median(ratio(r, "before") for r in mine),
        median(ratio(r, "oracle") for r in mine),
        median((r["closing_cpu_s"] for r in mine), ".0f"),
        _counted(others),
        _counted(_alike(mine)),
    )


def _firsts(results: Iterable[Result]) -> list[Found]:
    return [effect for r in results for effect in r["closure"]["effects"][:1]]


def _alike(results: Iterable[Result]) -> Counter[str]:
    """Look-alikes of the effects that were named first."""
    return Counter(one["name"] for effect in _firsts(results) for one in effect["look_alikes"])


def _errors(results: Sequence[Result]) -> list[str]:
    """Medians before, after and of the oracle of what effects act on: the motion [1], or else the tension."""
    return [
        " and ".join(
            f"{np.median(known):.3g}{unit}"
            for measure, unit in (("motion_nrmse", ""), ("tension_rmse_n", " N"))
            if (known := [error(r, of, measure) for r in results if measure == at_stake(r)[0]])
        )
        for of in _STATES
    ]


def _counted(names: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in names.most_common()) or "-"


def kind_table(results: Sequence[Result]) -> str:
    """Return a row for every kind of effect, of those that are felt."""
    header = (
        "kind", "effects", "campaigns", "influence [%]", "class first", "listed", "kind of place", "before",
        "after", "oracle", "look-alikes told",
    )  # fmt: skip
    rows = []
    for kind, mine in _grouped(filter(is_felt, results), _kind).items():
        scores, names = [score(r) for r in mine], {r["truth"][0]["name"] for r in mine}
        told = (_count(getattr(s, what) for s in scores) for what in ("class_", "listed", "kind_of_place"))
        alike = sum(bool(effect["look_alikes"]) for effect in _firsts(mine))
        rows.append((kind, len(names), len(mine), _percent(mine), *told, *_errors(mine), f"in {alike}"))
    return table(header, rows)


def _kind(result: Result) -> str:
    truth = result["truth"][0]
    kind = CATALOGUE[truth["name"]].kind
    return f"{kind}, tension's" if truth["enters"] == "sensor:tension" else kind


def _verdicts(results: Iterable[Result]) -> str:
    return ", ".join(f"{name} {n}" for name, n in Counter(answer(r) for r in results).most_common())


def outside_table(results: Sequence[Result]) -> str:
    """Return a row for every effect outside the catalogue."""
    header = (
        "effect", "seeds", "influence [%]", "verdicts", "closed by nearest", "closed by another",
        "after/before", "after/oracle", "CPU [s]",
    )  # fmt: skip
    rows = [
        (
            name, len(mine), _percent(mine), _verdicts(mine),
            _count(is_confident(r) and is_nearest(r) for r in mine),
            _count(is_confident(r) and not is_nearest(r) for r in mine),
            median(ratio(r, "before") for r in mine), median(ratio(r, "oracle") for r in mine),
            median((r["closing_cpu_s"] for r in mine), ".0f"),
        )
        for name, mine in _grouped(results, lambda r: str(r["truth"][0]["name"])).items()
    ]  # fmt: skip
    return table(header, rows)


def two_table(results: Sequence[Result]) -> str:
    """Return a row for every campaign with two effects."""
    header = ("hidden", "influence [%]", "found", "of them", "verdict", "after/before", "after/oracle")
    rows = []
    for one in results:
        influence = ", ".join(f"{t['influence_percent']['percent']:.0f}" for t in one["truth"])
        named = ", ".join(f"{e['name']}@{e['enters']}" for e in one["closure"]["effects"]) or "nothing"
        rows.append(
            (one["label"], influence, named, how_many_found(one), answer(one),
             median([ratio(one, "before")]), median([ratio(one, "oracle")]))
        )  # fmt: skip
    return table(header, rows)


def error_table(results: Sequence[Result]) -> str:
    """Return held-out errors before, after and of the oracle, in every measure."""
    header = ("measure", "before", "after", "oracle", "after/before", "after/oracle")
    rows = [
        (
            measure, *(median((error(r, of, measure) for r in results), ".3g") for of in _STATES),
            median(ratio(r, "before", measure) for r in results),
            median(ratio(r, "oracle", measure) for r in results),
        )
        for measure in MEASURES
    ]  # fmt: skip
    return table(header, rows)


def number_table(results: Sequence[Result]) -> str:
    """Return, where the hidden effect was named at its place, its numbers over the true ones."""
    rows = [
        (effect, name, len(pairs), median((p for p, _ in pairs), ".3g"), _count(held for _, held in pairs))
        for (effect, name), pairs in _numbers(results)
    ]
    return table(("effect", "number", "campaigns", "found / true", "95 % limits hold it"), rows)


def _numbers(results: Iterable[Result]) -> list[tuple[tuple[str, str], list[tuple[float, bool]]]]:
    """By effect and number: found over true, and whether the limits hold the true one."""
    numbers: dict[tuple[str, str], list[tuple[float, bool]]] = {}
    for result in results:
        truth = result["truth"][0]
        for found in result["closure"]["effects"][:1]:
            if (found["name"], found["enters"]) == (truth["name"], truth["enters"]):
                for name, told in truth["parameters"].items():
                    _set_beside(numbers.setdefault((truth["name"], name), []), found, name, told["value"])
    return [(key, pairs) for key, pairs in sorted(numbers.items()) if pairs]


def _set_beside(pairs: list[tuple[float, bool]], found: Found, name: str, true: float) -> None:
    """Add a found number over the true one; nothing where it was not fitted or the truth is zero."""
    told = found["parameters"].get(name)
    if told is None or told["low"] is None or told["high"] is None or not true:
        return
    pairs.append((told["value"] / true, told["low"] <= true <= told["high"]))


_GROUPS = ("clean", "one", "outside", "two")
_STATES = ("before", "after", "oracle")
_PARTS: tuple[tuple[str, str, Callable[[Sequence[Result]], str]], ...] = (
    ("clean", "No effect", clean_table),
    ("one", "One effect of the catalogue, by kind", kind_table),
    ("one", "One effect of the catalogue", effect_table),
    ("one", "One effect: held-out errors", error_table),
    ("one", "One effect: its numbers", number_table),
    ("outside", "One effect outside the catalogue", outside_table),
    ("two", "Two effects", two_table),
)
