"""What the result files answer, in plain words; every number comes from a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from experiments.text import closures, experiments, rankings
from experiments.text.answers import Answer, Headline
from experiments.text.noise_floors import beside, floor_of, loss_floor
from experiments.text.suspicions import LARGEST_ERROR, describes
from experiments.text.wording import mapping, mappings, number

Data = Mapping[str, Any]


def answer(kind: str, data: Data) -> Answer | None:
    """Return what a result file of a kind ("model", "reproduction", ...) answers; None if unknown."""
    make = _ANSWERS.get(kind)
    found = make(data) if make else None
    unfit = data.get("unfit")
    if not unfit:
        return found
    said = str(unfit)
    if kind == "ranking":  # a page may show that of a closed loop as well
        said = said.replace("the model", "the identified model", 1)
    headline = f"{said[0].upper()}{said[1:]}."
    question = found.question if found else "Do these records fit what is declared?"
    return Answer(
        question, headline, found.sentences if found else (), found.headlines if found else (), False
    )


def _of_model(data: Data) -> Answer | None:
    found = data.get("identification")
    if not isinstance(found, Mapping):
        bodies, links = (len(data.get(key) or ()) for key in ("bodies", "links"))
        return Answer(
            "Which model is this?",
            f"A reduced-order model (masses: {bodies}, links: {links}); its file says nothing of errors.",
        )
    errors = mapping(found.get("errors"))
    chosen = "hold_out" if mapping(errors.get("hold_out")).get("records") else "training"
    own, rest = mapping(errors.get(chosen)), mapping(mapping(errors.get("no_loosening")).get(chosen))
    whose = (
        "records that no fit has seen"
        if chosen == "hold_out"
        else "the records it was fitted to (none was held out)"
    )
    floor = mapping(mapping(found.get("noise_floor")).get(chosen))
    sentences = [
        f"The model was identified from {_count(found.get('records'), 'record')} and checked on {whose}.",
        *_of_loss(floor, own),
    ]
    if own.get("final_tension_error_percent_median") is not None:
        sentences.append(_final_tension_sentence(own, rest))
    sentences += _coverage([own.get("tension_course_within_band")], "their 95 % limits")
    where = "hold-out" if chosen == "hold_out" else "training"
    clauses = _clauses(own, floor)
    if own.get("tension_loss_error_percent_median") is not None:
        question = (
            "Which reduced-order model do these records support, and does it predict how far a bolt loosens?"
        )
        verdict, good = _loss_verdict(own, rest)
    else:
        question = "Which reduced-order model do these records support, and how well does it describe them?"
        verdict, good = _without_loss(clauses, own)
        clauses = clauses[1:]
        if any(link.get("law") == "bolted" for link in mappings(data.get("links"))):
            sentences.append("No loosening record measures the tension of the bolt.")
    sentences += [f"The {clause}." for clause in clauses] + _reservations(found)
    return Answer(question, verdict, tuple(sentences), tuple(_headlines(own, floor, where)), good)


def _without_loss(clauses: Sequence[str], errors: Data) -> tuple[str, bool | None]:
    """Return the verdict on a model of which no loosening record tells anything."""
    if not clauses:
        return "The structure is identified; the records hold nothing to compare it with.", None
    return f"The {clauses[0]}.", None if describes(errors) and not _misses_force(errors) else False


def _of_loss(floor: Data, errors: Data) -> list[str]:
    """Say what noise and the variability between tests alone make of the error of the loss."""
    text = loss_floor(floor).removeprefix("; ")
    if not text or errors.get("tension_loss_error_percent_median") is None:
        return []
    return [f"Even the true tension law is not exact on such tests (median error of the loss; {text})."]


def _clauses(errors: Data, floor: Data) -> list[str]:
    """Return a clause on each error that needs no loosening, beside what noise alone would give."""
    said = []
    if errors.get("motion_nrmse") is not None:
        said.append(
            _share("displacements", "motion_nrmse", errors, floor, "" if describes(errors) else "motion")
        )
    if errors.get("link_force_nrmse") is not None:
        missed = "force" if _misses_force(errors) else ""
        said.append(_share("link force", "link_force_nrmse", errors, floor, missed))
    if errors.get("tension_rmse_n") is not None and errors.get("final_tension_error_percent_median") is None:
        noise = floor_of(floor, "tension_rmse_n", "N")
        said.append(f"error of the tension at rest is {number(errors['tension_rmse_n'], 3)} N (RMS){noise}")
    return said


def _share(words: str, key: str, errors: Data, floor: Data, missed: str) -> str:
    beyond = f": the model does not describe the {missed}" if missed else ""
    share = f"{number(100 * errors[key], 3)} % (NRMSE)"
    return f"error of the {words} is {share}{floor_of(floor, key, '%', 100.0)}{beyond}"


def _misses_force(errors: Data) -> bool:
    force = errors.get("link_force_nrmse")
    return isinstance(force, float) and force > LARGEST_ERROR


def _loss_verdict(own: Data, without: Data) -> tuple[str, bool | None]:
    """Return the verdict on the tension law, judged against a bolt that never loosens by both measures."""
    loss, rest = (
        own.get("tension_loss_error_percent_median"),
        without.get("tension_loss_error_percent_median"),
    )
    if rest is None:
        return f"The tension law is off by {number(loss, 3)} % of a record's loss of tension (median).", None
    final, rest_final = (errors.get("final_tension_error_percent_median") for errors in (own, without))
    own_share, rest_share = number(loss, 3), number(rest, 3)
    against = f"it is off by {own_share} % of a record's loss (median), no loosening by {rest_share} %"
    if loss >= rest:
        return f"The tension law does no better than a bolt that never loosens: {against}.", False
    if final is not None and rest_final is not None and final >= rest_final:
        return f"The tension law is better by the loss, worse by the final tension: {against}.", None
    return f"The tension law predicts more than a bolt that never loosens: {against}.", True


def _final_tension_sentence(own: Data, rest: Data) -> str:
    names = ("median", "mean", "max")
    median, mean, most = (number(own.get(f"final_tension_error_percent_{name}"), 3) for name in names)
    every = f" (median; mean {mean} %, largest {most} %)" if (mean, most) != (median, median) else ""
    text = f"The final tension is off by {median} %{every}"
    if rest.get("final_tension_error_percent_median") is not None:
        text += f", without loosening by {number(rest['final_tension_error_percent_median'], 3)} %"
    return f"{text}. Where a loss is a small share of the tension, this measure is small for any law."


def _headlines(errors: Data, floor: Data, where: str) -> list[Headline]:
    listed = (
        ("tension_loss_error_percent_median", "median error of the loss of tension", 1.0),
        ("final_tension_error_percent_median", "median error of the final tension", 1.0),
        ("motion_nrmse", "error of the displacement (NRMSE)", 100.0),
        ("link_force_nrmse", "error of the link force (NRMSE)", 100.0),
    )
    return [
        Headline(
            f"{words}, {where}{beside(floor, key, '%', factor)}",
            f"{number(errors[key] * factor, 3)} %",
            errors[key],
        )
        for key, words, factor in listed
        if isinstance(errors.get(key), float)
    ]


def _reservations(found: Data) -> list[str]:
    sentences = []
    aside, warnings = _lines(found.get("set_aside")), _lines(found.get("warnings"))
    if aside:
        sentences.append(f"{_count(len(aside), 'record')} of doubtful quality set aside, listed below.")
    if warnings:
        sentences.append(f"{_count(len(warnings), 'warning')}, listed below.")
    return sentences


def _of_reproduction(data: Data) -> Answer | None:
    rows = [row for row in data.get("rows") or [] if isinstance(row, Mapping)]
    judged = [row for row in rows if row.get("within") is not None]
    if not judged:
        return None
    met = sum(bool(row["within"]) for row in judged)
    missed = [str(row.get("quantity")) for row in judged if not row["within"]]
    sentences = [
        "Ours rest on the paper's printed parameters and the virtual rig; the paper's records are not public."
    ]
    if missed:
        sentences.insert(0, f"Outside: {'; '.join(missed)}.")
    share = f"All {met}" if met == len(judged) else f"{met} of {len(judged)}"
    return Answer(
        "Does the chain give the numbers that He et al. (2025) print?",
        f"{share} printed numbers are met within their stated tolerance.",
        tuple(sentences),
        good=met == len(judged),
    )


def _of_prediction(data: Data) -> Answer | None:
    errors = mapping(data.get("errors"))
    loss = errors.get("tension_loss_error_percent_median")
    compared, failed = errors.get("records") or 0, errors.get("failed") or 0
    floor, of_fit = mapping(data.get("noise_floor")), data.get("fitted_to_this_campaign")
    clauses = _clauses(errors, floor)
    the = _ON.get(of_fit, "The")
    if loss is not None:
        verdict = f"{the} model is off by {number(loss, 3)} % of a record's loss (median)."
    elif clauses:
        verdict, clauses = f"{the} {clauses[0]}.", clauses[1:]
    else:
        verdict = "The model was simulated; the records hold nothing to compare it with."
    unfinished = f"{_count(failed, 'simulation')} did not finish" if failed else "every simulation finished"
    sentences = [f"{_count(compared, 'record')} compared; {unfinished}."]
    sentences += _of_loss(floor, errors)
    sentences += [f"The {clause}." for clause in clauses]
    if errors.get("final_tension_error_percent_median") is not None:
        sentences.append(_final_tension_sentence(errors, {}))
    sentences += _bands(data.get("records"))
    sentences += _of_fit(of_fit, data.get("sets"))
    return Answer(
        _PREDICTED.get(of_fit, "Does the model predict this campaign?"),
        verdict,
        tuple(sentences),
        tuple(_headlines(errors, floor, "all records")),
    )


def _of_fit(of_fit: object, sets: object) -> list[str]:
    """Say what of its own campaign a fit has not seen, or that its campaign is not known."""
    if of_fit is None:
        return ["The model's file does not say which campaign it was fitted to."]
    if not of_fit:
        return []
    unseen, floor = (
        mapping(mapping(mapping(sets).get(key)).get("hold_out")) for key in ("errors", "noise_floor")
    )
    count = unseen.get("records")
    if not count:
        return ["The model was fitted to all of these records."]
    shown = [f"the {clause}" for clause in _clauses(unseen, floor)]
    if unseen.get("tension_loss_error_percent_median") is not None:
        loss = number(unseen["tension_loss_error_percent_median"], 3)
        shown.append(f"that of the loss of tension {loss} % (median{loss_floor(floor)})")
    off = f": {'; '.join(shown)}" if shown else ""
    return [f"{_count(count, 'record')} here {'was' if count == 1 else 'were'} not fitted{off}."]


def _bands(records: object) -> list[str]:
    """Say how many measured final tensions, and how much of the courses, lie within their band."""
    rows = list(mappings(records))
    tensions = [mapping(record.get("final_tension_n")) for record in rows]
    known = [t for t in tensions if None not in (t.get("low"), t.get("high"), t.get("measured"))]
    if not known:
        return []
    inside = sum(t["low"] <= t["measured"] <= t["high"] for t in known)
    said = [f"{inside} of {_count(len(known), 'measured final tension')} lie within their 95 % limits."]
    return said + _coverage([row.get("tension_course_within_band") for row in rows], "theirs")


def _coverage(shares: Sequence[float | None], limits: str) -> list[str]:
    """Say for how much of the time courses lie within their limits, where that is known."""
    known = [share for share in shares if share is not None]
    if not known:
        return []
    mean = number(100 * sum(known) / len(known), 3)
    return [f"The courses of the tension after the hits lie within {limits} for {mean} % of the time."]


_ON: Mapping[object, str] = {True: "On the campaign of its fit, the", False: "With nothing fitted, the"}
_PREDICTED: Mapping[object, str] = {
    True: "Does the model meet the campaign that it was fitted to?",
    False: "Does the model predict a campaign to which it was not fitted?",
}


def _lines(value: object) -> list[str]:
    return [str(item) for item in value] if isinstance(value, list) else []


def _count(n: object, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


_ANSWERS: Mapping[str, Callable[[Data], Answer | None]] = {
    "model": _of_model,
    "reproduction": _of_reproduction,
    "prediction": _of_prediction,
    "ranking": rankings.answer,
    "closure": closures.answer,
    "experiment": experiments.answer,
}
