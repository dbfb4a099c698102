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
    yield (
        f"final tension mean {errors['final_tension_error_percent_mean']:.2f} %, "
        f"median {errors['final_tension_error_percent_median']:.2f} % "
        f"(no loosening: {rival['final_tension_error_percent_mean']:.2f} %, "
        f"{rival['final_tension_error_percent_median']:.2f} %)"
    )
    yield (
        f"loss median {errors['tension_loss_error_percent_median']:.1f} % "
        f"(no loosening: {rival['tension_loss_error_percent_median']:.1f} %{loss_floor(floor)})"
    )
    if (within := errors.get("tension_course_within_band")) is not None:
        yield f"tension within its 95 % limits for {100 * within:.1f} % of the time"
