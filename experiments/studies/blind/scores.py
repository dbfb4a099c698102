"""Closures set against the truth: scores of a blind test's results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from rom.effects import CATALOGUE

Result = Mapping[str, Any]
"""What the file of one campaign says."""

Found = Mapping[str, Any]
"""An effect as ``closure.json`` has it."""

MEASURES = (
    "motion_nrmse",
    "relative_motion_nrmse",
    "tension_loss_error_percent_median",
    "tension_rmse_n",
)


@dataclass(frozen=True)
class Score:
    """How the effect named first compares with the only one that was hidden.

    Attributes
    ----------
    name, class_ : bool
        The truth is named; or an effect that shares a class with it.
    listed : bool
        The truth is named, or is among the look-alikes of what is.
    unwarned : bool
        An effect of the catalogue is named that is not the truth, which is not among its look-alikes either.
    kind_of_place, place : bool
        Link, body, tension or sensor is right; the place itself is.
    """

    name: bool
    class_: bool
    listed: bool
    unwarned: bool
    kind_of_place: bool
    place: bool


def score(result: Result) -> Score:
    """Score the effect that a closure names first against the first that was hidden; of none all is false."""
    truth, effects = result["truth"][0], result["closure"]["effects"]
    if not effects:
        return Score(False, False, False, False, False, False)
    first = effects[0]
    listed = _is_listed(truth, first)
    return Score(
        name=first["name"] == truth["name"],
        class_=same_class(first["name"], truth["name"]),
        listed=listed,
        unwarned=first["source"] == "catalogue" and not listed,
        kind_of_place=kind_of_place(first["enters"]) == kind_of_place(truth["enters"]),
        place=first["enters"] == truth["enters"],
    )


def _is_listed(truth: Found, found: Found, *, placed: bool = False) -> bool:
    """Whether an effect is named or listed; ``placed``: at its very place."""
    return any(
        one["name"] == truth["name"] and (not placed or one["enters"] == truth["enters"])
        for one in (found, *found["look_alikes"])
    )


def same_class(one: str, other: str) -> bool:
    """Whether two effects are the same or share a class of the catalogue."""
    if one == other:
        return True
    if one not in CATALOGUE or other not in CATALOGUE:
        return False
    return bool({*CATALOGUE[one].classes} & {*CATALOGUE[other].classes})


def kind_of_place(enters: str) -> str:
    """Link, body, tension or sensor."""
    head = enters.partition(":")[0]
    return head if head in ("body", "tension", "sensor") else "link"


def how_many_found(result: Result, *, placed: bool = False) -> int:
    """Return how many of the hidden effects are named or listed, each by another effect of the closure.

    ``placed``: at their very places.
    """
    truths, effects = result["truth"], result["closure"]["effects"]
    padded = [*effects, *([None] * len(truths))]
    return max(
        sum(
            one is not None and _is_listed(truth, one, placed=placed)
            for truth, one in zip(truths, order, strict=True)
        )
        for order in permutations(padded, len(truths))
    )


def has_needless(result: Result) -> bool:
    """Whether an effect after the first is neither the first that was hidden nor lists it."""
    truth = result["truth"][0]
    return not all(_is_listed(truth, one) for one in result["closure"]["effects"][1:])


def is_confident(result: Result) -> bool:
    """Whether a closure calls itself closed by effects of the catalogue, one or more."""
    closure = result["closure"]
    return closure["verdict"] == "closed" and any(e["source"] == "catalogue" for e in closure["effects"])


def is_nearest(result: Result) -> bool:
    """Whether the effect named first is the one of the catalogue that nearly does what was hidden."""
    nearest, effects = result["truth"][0]["nearest"], result["closure"]["effects"]
    return bool(nearest and effects and (_is_listed({"name": nearest}, effects[0])))


def answer(result: Result) -> str:
    """Return the verdict, and of a closed one where the form came from: "closed, free-form"."""
    closure = result["closure"]
    if closure["verdict"] != "closed":
        return str(closure["verdict"])
    return "closed, catalogue" if is_confident(result) else "closed, free-form"


def error(result: Result, of: str, measure: str) -> float:
    """Return a held-out error "before", "after", of the "oracle" or at "true values"; nan for none.

    Parameters
    ----------
    result : mapping
        Of one trial.
    of : str
        Which model.
    measure : str
        Key of an error measure.

    Returns
    -------
    float
        In the unit of the measure.
    """
    kind = result["closure"]["errors"]["hold_out"].get(of)
    if of == "oracle":
        kind = result["oracle"]["hold_out"]
    elif of == "true values":  # an oracle of forces alone, or of no effect, has no others
        kind = result["oracle"].get("true_values", result["oracle"]["hold_out"])
    value = (kind or {}).get(measure)
    return np.nan if value is None else float(value)


def ratio(result: Result, over: str, measure: str = "") -> float:
    """Return the held-out error after over another that `error` knows; by default the worst at stake.

    Parameters
    ----------
    result : mapping
        Of one trial.
    over : str
        Which model the errors are divided by.
    measure : str
        Key of an error measure; all at stake if empty.

    Returns
    -------
    float
        [1]; nan where the other is zero or unknown.
    """
    ratios = []
    for one in (measure,) if measure else at_stake(result):
        below = error(result, over, one)
        ratios.append(error(result, "after", one) / below if below > 0.0 else np.nan)
    return float(np.max(ratios))


def at_stake(result: Result) -> tuple[str, ...]:
    """Return the measures of what the hidden effects act on: the tension, or else the motion."""
    places = [truth["enters"] for truth in result["truth"]] or [""]
    measures = ["tension_rmse_n" if p in ("tension", "sensor:tension") else "motion_nrmse" for p in places]
    return tuple(dict.fromkeys(measures))


def motion_influence(result: Result) -> float:
    """Return by how much the first hidden effect changes the motion [%]."""
    return float(result["truth"][0]["influence_percent"]["motion"])


def influence(result: Result) -> float:
    """Return the influence of the first hidden effect on what it acts on, motion, loss or reading [%]."""
    return float(result["truth"][0]["influence_percent"]["percent"])
