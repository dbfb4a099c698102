"""What noise alone would give, beside each error: about what the truth itself would score."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import NormalDist, median
from typing import Any

from experiments.text.wording import mapping, mappings, number
from rom.evaluation.noise_floor import share_of_rate

Data = Mapping[str, Any]

WITH_VARIABILITY = "tension_loss_error_percent_median_with_variability"


def loss_floor(floor: Data) -> str:
    """Return what noise, and how tests differ, would make of the error of a loss: "; noise alone: 1.2 %"."""
    noise, both = floor.get("tension_loss_error_percent_median"), floor.get(WITH_VARIABILITY)
    text = "" if noise is None else f"; noise alone: {number(noise, 3)} %"
    return text if both is None else f"{text}, with the variability between tests: {number(both, 3)} %"


def floor_of(floor: Data, key: str, unit: str, factor: float = 1.0) -> str:
    """Return what noise would make of an error, as a clause; nothing where not known.

    Parameters
    ----------
    floor : mapping
        What noise alone would make of the errors.
    key : str
        Which of them.
    unit : str
        As shown.
    factor : float
        From the file's unit to that.
    """
    noise = floor.get(key)
    return "" if noise is None else f", where noise alone would give {number(factor * noise, 3)} {unit}"


def beside(floor: Data, key: str, unit: str, factor: float = 1.0) -> str:
    """Return what the right model would score, for a headline: "; noise and variability: 36.3 %".

    Parameters
    ----------
    floor : mapping
        What noise, and how tests differ, would make of the errors.
    key : str
        Which of them.
    unit : str
        As shown.
    factor : float
        From the file's unit to that.
    """
    both, noise = floor.get(f"{key}_with_variability"), floor.get(key)
    known, words = (noise, "noise alone") if both is None else (both, "noise and variability")
    return "" if known is None else f"; {words}: {number(factor * known, 3)}\u00a0{unit}"


def loss_of_right_law(data: Data) -> float | None:
    """Return the median error of the loss [%] that noise and the variability between tests make of a law that
    is right in the mean of all tests: of a ranking's cases, None where they or the variability are not known.
    """
    scatter = mapping(data.get("scatter"))
    known = [
        (case["loss_n"], case["loss_error_n"], case["initial_tension_n"])
        for case in mappings(data.get("cases"))
        if case.get("loss_n") and case.get("loss_error_n") is not None and case["initial_tension_n"] > 0
    ]
    if not known or scatter.get("a") is None or scatter.get("b") is None:
        return None
    shares = [
        math.hypot(
            error / loss,
            share_of_rate(tension, tension - loss)
            * math.exp(scatter["a"] + scatter["b"] * math.log(tension / 100.0)),
        )
        for loss, error, tension in known
    ]
    return 100 * NormalDist().inv_cdf(0.75) * median(shares)
