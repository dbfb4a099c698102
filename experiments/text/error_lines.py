"""The errors of a set of records in a line, beside what noise alone and no loosening would give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from experiments.text.noise_floors import loss_floor
from experiments.text.wording import number

Data = Mapping[str, Any]


def error_line(errors: Data, rival: Data, floor: Data) -> str:
    """Return the errors of a set of records, in words.

    Parameters
    ----------
    errors : mapping
        Of the model.
    rival : mapping
        Of the model without loosening.
    floor : mapping
        What noise alone would make of them.
    """
    return "; ".join(_parts(errors, rival, floor)) or "nothing measured to compare with"


def _parts(errors: Data, rival: Data, floor: Data) -> Iterator[str]:
    for words, key in (("motion", "motion_nrmse"), ("link force", "link_force_nrmse")):
        if errors[key] is not None:
            noise = floor.get(key)
            alone = "" if noise is None else f" (noise alone: {100 * noise:.2f} %)"
            yield f"{words} {100 * errors[key]:.2f} %{alone}"
    if errors["final_tension_error_percent_mean"] is not None:
        yield from _of_loosening(errors, rival, floor)
    elif errors["tension_rmse_n"] is not None:
        noise = floor.get("tension_rmse_n")
        alone = "" if noise is None else f" (noise alone: {number(noise, 3)} N)"
        yield f"tension at rest {number(errors['tension_rmse_n'], 3)} N RMS{alone}"


def _of_loosening(errors: Data, rival: Data, floor: Data) -> Iterator[str]:
    final = [f"final_tension_error_percent_{which}" for which in ("mean", "median")]
    mean, median = (_percent(errors, key, 2) for key in final)
    yield (
        f"final tension mean {mean}, median {median} "
        f"(no loosening: {', '.join(_percent(rival, key, 2) for key in final)})"
    )
    loss = "tension_loss_error_percent_median"
    yield (
        f"loss median {_percent(errors, loss, 1)} "
        f"(no loosening: {_percent(rival, loss, 1)}{loss_floor(floor)})"
    )
    if (within := errors.get("tension_course_within_band")) is not None:
        yield f"tension within its 95 % limits for {100 * within:.1f} % of the time"


def _percent(errors: Data, key: str, decimals: int) -> str:
    """A share of what was measured; of a loss of nothing there is none."""
    value = errors.get(key)
    return "undefined" if value is None else f"{value:.{decimals}f} %"
