"""A ranking of tension laws in plain words and as tables; every number comes from ranking.json."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from discovery.criteria.criteria import percent, used_in
from discovery.criteria.ranking import RankingRules
from discovery.laws.candidate import BASELINE, NO_LOOSENING
from discovery.views.ranking_plot import evidence_words, is_law, law_name, ranked, row_name
from experiments.text import equations
from experiments.text.answers import Answer, Headline
from experiments.text.noise_floors import loss_of_right_law
from experiments.text.ranking_verdict import ranking_verdict
from experiments.text.tables import Table, parameter_rows
from experiments.text.wording import NONE, mapping, mappings, number, set_words, trimmed

Data = Mapping[str, Any]

_QUESTION = "Which law of loosening do the records support, and how sure is that?"
_ERROR = "cross_validated_loss_error_percent_median"
_NAMED = 4
_WITH_PARAMETERS = 3


def answer(data: Data) -> Answer | None:
    """Return which law a ranking supports, how sure that is, and what would settle it."""
    laws = ranked(data)
    if not laws:
        return None
    best = laws[0]
    verdict, good = ranking_verdict(data, laws, _equals(data))
    return Answer(
        _QUESTION, verdict, tuple(_sentences(data, best, laws)), tuple(_headlines(best, laws)), good
    )


def _equals(data: Data) -> list[str]:
    """Return the laws that the records cannot tell from the first one."""
    return [str(name) for name in data.get("indistinguishable") or []]


def _sentences(data: Data, best: Data, laws: Sequence[Data]) -> Iterator[str]:
    yield from _on_errors(best, laws, "bolts" if data.get("population") else "preloads")
    yield from _on_variability(data)
    yield from _on_motion(best, used_in(data).ranking.motion_off)
    yield from _on_population(data.get("population"), best)
    yield from _on_numbers(best, mappings(data.get("cases")))
    yield from _on_wins(best, laws)
    equals = _equals(data)
    if equals:
        named = ", ".join(f"“{law_name(name)}”" for name in equals[:_NAMED])
        more = f" and {len(equals) - _NAMED} more" if len(equals) > _NAMED else ""
        yield f"Not distinguished from it: {named}{more}."
    yield from _on_profiles(data)
    yield from _on_proposals(data.get("proposals"))
    if data.get("considered"):
        yield _on_number(int(data["considered"]), laws)


def _on_variability(data: Data) -> Iterator[str]:
    share = loss_of_right_law(data)
    if share is not None:
        yield (
            f"Since tests that are alike differ, a law that is right in their mean would be off by "
            f"{number(share, 3)} %."
        )


def _on_motion(best: Data, most: float) -> Iterator[str]:
    """Say where the motion is off: rates are powers of its velocities."""
    errors, floors = (mapping(best.get(key)) for key in ("errors", "noise_floor"))
    off, noise = (mapping(one.get("training")).get("motion_nrmse") for one in (errors, floors))
    if off is not None and noise is not None and off**2 - noise**2 > most**2:
        yield (
            f"The simulated displacement is off by {number(100 * off, 3)} % (noise alone: "
            f"{number(100 * noise, 3)} %), and laws rest on it: `boltlaw close` says what the model lacks."
        )


def _on_numbers(best: Data, cases: Sequence[Data]) -> Iterator[str]:
    free, fitted = best.get("free_numbers"), sum(not case.get("hold_out") for case in cases)
    if free and fitted:
        each = trimmed(number(fitted / free, 2))
        numbers = "one free number was" if free == 1 else f"{free} free numbers were"
        tests = "one test" if fitted == 1 else f"{fitted} tests"
        share = "" if free == 1 else f", {each} for each number"
        yield f"The first law's {numbers} fitted to {tests}{share}."


def _on_wins(best: Data, laws: Sequence[Data]) -> Iterator[str]:
    wins = best.get("wins_against_baseline")
    if is_law(best, BASELINE) or not isinstance(wins, Sequence) or len(wins) != 2:
        return
    text = f"It is nearer than the paper's law on {wins[0]} of {wins[1]} records"
    rise = next((law.get("delta_bic") for law in laws if is_law(law, BASELINE)), None)
    if isinstance(rise, float):
        text += f"; for {'it' if rise > 0 else 'that law'}: {evidence_words(rise)}"
    yield f"{text}."


def _on_number(considered: int, laws: Sequence[Data]) -> str:
    given = sum(law.get("source") == "given" for law in laws)
    if given and considered <= given:
        same, standing = sum(bool(law.get("same_as")) for law in laws), len(laws) - given
        if not same:
            return f"Laws given: {considered}, beside {standing} standing ones."
        known = "is a standing one" if same == 1 else "are standing ones"
        return f"Laws given: {considered}, {same} of which {known}, beside {standing} other standing ones."
    return f"{considered} candidate laws were considered; {len(laws)} are ranked."


def _on_population(population: object, best: Data) -> Iterator[str]:
    if not isinstance(population, Mapping):
        return
    shown = [
        [trimmed(number(row[key], 2)) for key in ("value", "low", "high")]
        for row in (population["between_bolts"], population["between_tests"])
    ]
    between, within = (f"{value} ({low} to {high})" for value, low, high in shown)
    known = best.get("known_bolt_loss_error_percent_median")
    yield (
        f"Between {len(population['bolts'])} bolts ln(rate) has a standard deviation of {between}, between "
        f"tests of one bolt of {within}; with a bolt's other tests known its loss is off by "
        f"{number(known, 3)} %."
    )


def _on_errors(best: Data, laws: Sequence[Data], left_out: str) -> Iterator[str]:
    own = best.get(_ERROR)
    if own is None:
        return
    text = (
        f"On {left_out} that its fit has not seen, its loss of tension is off by {number(own, 3)} % (median)"
    )
    words = {BASELINE: "that of the paper's law by", NO_LOOSENING: "no loosening by"}
    known = {
        say: law[_ERROR]
        for name, say in words.items()
        for law in laws[1:]
        if is_law(law, name) and law.get(_ERROR) is not None
    }
    against = [f"{say} {number(error, 3)} %" for say, error in known.items()]
    yield "; ".join([text, ", ".join(against)] if against else [text]) + "."


_UNTOLD = ("not identifiable", "no loss above noise")
_DRIVERS = {
    "velocity": "Velocity drives the loosening; displacement is not needed beside it.",
    "displacement": "Displacement drives the loosening; velocity is not needed beside it.",
    "both": "Velocity and displacement both act.",
    "undecided": "Whether velocity or displacement drives the loosening is open with these records.",
    "neither": "No product of powers of velocity and displacement alone explains the courses.",
}


def _on_profiles(data: Data) -> Iterator[str]:
    profile, motion = data.get("exponent_profile"), data.get("motion_profile")
    if isinstance(profile, Mapping) and profile.get("best") is not None:
        level = percent(used_in(data).ranking.confidence)
        value, words = trimmed(number(profile["best"], 3)), f"{level} set: {set_words(profile)}"
        told = f"loosening goes with exponent {value} ({words})"
        if profile.get("reach") in _UNTOLD:
            told = f"these records leave the exponent of loosening open ({words})"
        if profile.get("explains_the_courses") is False:
            told += ", but none explains the courses to within noise and scatter"
        yield f"As a power of the relative velocity, {told}."
    if isinstance(motion, Mapping) and motion.get("driver") in _DRIVERS:
        why = [] if motion["driver"] == "neither" else list(_open(motion, used_in(data).ranking))
        yield f"{_DRIVERS['undecided'][:-1]}: {'; '.join(why)}." if why else _DRIVERS[motion["driver"]]


def _open(motion: Data, rules: RankingRules) -> Iterator[str]:
    """Yield why what drives is open: few tests, or sets that end where a statement on it would change."""
    tests, numbers = motion.get("tests"), motion.get("numbers")
    if tests is not None and numbers and tests < rules.tests_per_number * numbers:
        yield f"{tests} tests for the {numbers} free numbers of a law with both are few"
    for name in ("velocity", "displacement"):
        profile = mapping(motion.get(name))
        low, high, values = (profile.get(key) for key in ("low", "high", "values"))
        if not values or low is None or high is None:
            continue
        edge = rules.edge_of(low, high, values[-1])
        if edge is not None:
            limit = f"{edge:g}, the end of the range searched" if edge else "0"
            level, ends = percent(rules.confidence), (trimmed(number(end, 3)) for end in (low, high))
            yield f"the {level} set of the exponent of the {name}, {' to '.join(ends)}, ends next to {limit}"


def _on_proposals(proposals: object) -> Iterator[str]:
    tests = mappings(proposals)
    if not tests:
        return
    listed = [
        f"{_times(test.get('hits'))} {_rounded(test.get('peak_force_n'))} N for "
        f"{_milliseconds(test.get('pulse_s'))} ms at a preload of {_rounded(test.get('preload_n'))} N"
        for test in tests
    ]
    bolt = f" on the bolt {tests[0]['bolt']}" if tests[0].get("bolt") else ""
    yield f"Tests{bolt} that would separate the first laws: {'; then '.join(listed)}."


def _times(hits: object) -> str:
    return f"{hits} hits of" if isinstance(hits, int) and hits > 1 else "a hit of"


def _headlines(best: Data, laws: Sequence[Data]) -> Iterator[Headline]:
    listed = [("first law", best)]
    listed += [("the paper's law", law) for law in laws[1:] if is_law(law, BASELINE)]
    for words, law in listed:
        if isinstance(law.get(_ERROR), float):
            shown = f"{number(law[_ERROR], 3)} %"
            yield Headline(f"median error of the loss, cross-validated, {words}", shown, law[_ERROR])


def tables(data: Data) -> list[Table]:
    """Return leader board, equations, the first laws' parameters, and tests that would separate them."""
    found = (_leader_board(data), _equations(data), _parameters(data), _proposals(data))
    return [table for table in found if table.rows]


def of_losses(data: Data) -> Iterator[str]:
    """Say which laws were fitted to losses alone: of these no number is that of a history."""
    ranks = [f"{law['rank']}" for law in ranked(data) if law.get("fitted_to") == "losses"]
    if ranks:
        them = "rank" if len(ranks) == 1 else "ranks"
        why = "since their tension histories are not those measured"
        yield f"Fitted to the losses alone, {why}: {them} {', '.join(ranks)}."


def _leader_board(data: Data) -> Table:
    rows = tuple(_row(law) for law in ranked(data))
    heads = ("Rank", "Law", "Error of loss, cross-validated [%]", "Error of loss, hold-out [%]",
             "Error of final tension, mean [%]", "ΔBIC", "Probability", "Nearer than the paper's law",
             "p against it", "Free numbers")  # fmt: skip
    note = (
        "Order: log density of whole courses of tension at preloads that the fit has not seen; of laws that "
        "it does not tell from the best the one of most evidence goes first. Error of loss: 100 |simulated − "
        "measured loss| / |measured loss|, median over records; cross-validated: with numbers fitted to the "
        "other preloads. Error of final tension: the paper's measure, on the records fitted. "
        "ΔBIC: difference of the Bayesian information criterion to the first law. Probability: that the law "
        "has the form that made the records, were it one of those listed; its share of the evidence, mean "
        "over resamples of the preloads. p: chance that "
        "the best of so many laws would look as much better than the paper's if none were better."
    )
    note = " ".join([note, *of_losses(data)])
    kept = [place for place in range(len(heads)) if any(str(row[place]) != NONE for row in rows)]
    cells = tuple(tuple(row[place] for place in kept) for row in rows)
    return Table(
        "Laws of loosening, ranked by re-simulation", tuple(heads[i] for i in kept), cells, note=note
    )


def _row(law: Data) -> tuple[str | Markup, ...]:
    return (
        number(law.get("rank")),
        _tied(row_name(law)),
        _share(law.get(_ERROR)),
        _share(_error(law, "hold_out", "tension_loss_error_percent_median")),
        _share(_error(law, "training", "final_tension_error_percent_mean")),
        trimmed(number(law.get("delta_bic"), 3)),
        trimmed(number(law.get("probability"), 2)),
        _wins(law),
        trimmed(number(law.get("p_value_against_baseline"), 2)),
        number(law.get("free_numbers")),
    )


def _equations(data: Data) -> Table:
    rows = [
        (number(law.get("rank")), rate(law.get("equation")), _source(str(law.get("source") or "")))
        for law in ranked(data)
    ]
    return Table("Their equations, and what proposed them", ("Rank", "dT/dt", "Source"), tuple(rows))


def _tied(name: str) -> str:
    """Return a name that breaks between its terms only."""
    return " + ".join(term.replace(" ", "\u00a0") for term in name.split(" + "))


def _error(law: Data, records: str, key: str) -> object:
    errors = law.get("errors")
    found = errors.get(records) if isinstance(errors, Mapping) else None
    return found.get(key) if isinstance(found, Mapping) else None


def _share(value: object) -> str:
    return trimmed(number(value, 3))


def _wins(law: Data) -> str:
    wins = law.get("wins_against_baseline")
    if is_law(law, BASELINE) or not isinstance(wins, Sequence) or len(wins) != 2:
        return NONE
    return f"{wins[0]} of {wins[1]}"


def _source(text: str) -> str:
    """Return where a law came from, without its libraries: "pysindy: STLSQ, SR3"."""
    parts = [part.partition(":") for part in text.split("; ")]
    if not all(kind == "pysindy" for kind, _, _ in parts):
        return text
    named = ", ".join(dict.fromkeys(rest.rpartition("/")[2] for _, _, rest in parts))
    return _tied(f"pysindy: {named}")


def rate(text: object) -> str | Markup:
    """Return a tension rate typeset within a line; as it is where it is no expression."""
    shown = equations.expression(str(text)) if text else None
    return equations.math(shown) if shown is not None else str(text or NONE)


def _parameters(data: Data) -> Table:
    laws = ranked(data)
    chosen = laws[:_WITH_PARAMETERS]
    chosen += [law for law in laws[_WITH_PARAMETERS:] if is_law(law, BASELINE)]
    rows = [
        ("" if place else law_name(str(law.get("name"))), *cells[:1], *cells[2:5])
        for law in chosen
        for place, cells in enumerate(parameter_rows("", law.get("parameters")))
    ]
    heads = ("Law", "", "Value", f"{used_in(data).level_of_limits} limits", "Unit")
    note = "A number without limits is held: it belongs to the law's form."
    return Table("Parameters of the first laws", heads, tuple(rows), note=note)


def _proposals(data: Data) -> Table:
    tests = mappings(data.get("proposals"))
    rows = tuple(
        (
            number(test.get("hits")),
            _rounded(test.get("peak_force_n")),
            _milliseconds(test.get("pulse_s")),
            _rounded(test.get("preload_n")),
            trimmed(number(test.get("expected_gain"), 2)),
            _odds(test.get("odds")),
            " | ".join(law_name(str(name)) for name in test.get("separates") or ()),
        )
        for test in tests
    )
    heads = ("Hits", "Peak force [N]", "Pulse [ms]", "Preload [N]", "Expected gain of a hit", "Odds after it",
             "Separates")  # fmt: skip
    bolt = next((f" On the bolt {t['bolt']}, where they tell most." for t in tests if t.get("bolt")), "")
    note = (
        "Chosen by simulation, one after the other. Expected gain: 2 ln of the likelihood ratio between "
        "the two laws that one such hit adds. Odds: between the laws that are hardest to separate, of "
        f"those that can be.{bolt}"
    )
    return Table("Tests that would separate the first laws most, for the fewest hits", heads, rows, note=note)


def _odds(value: object) -> str:
    if not isinstance(value, int | float):
        return NONE
    return "over a million to 1" if value >= 1e6 else f"{trimmed(number(float(value), 2))} to 1"


def _rounded(value: object) -> str:
    return trimmed(number(value, 3))


def _milliseconds(value: object) -> str:
    return trimmed(number(1e3 * value, 3)) if isinstance(value, int | float) else NONE


def equation_text(text: str) -> str:
    """Return an equation for a terminal: ``max(T, 0)`` as T, powers with ^, no signs of multiplication."""
    shown = text.replace("max(T, 0)", "T").replace(" ** ", "^").replace(" * ", " ")
    return re.sub(r"abs\(([^()]*)\)", r"|\1|", shown)
