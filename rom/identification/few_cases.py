"""What a curve over tension rests on where its cases cannot contradict it, a line each.

A curve with as many free numbers as cases passes through them whatever its form: their scatter is not known,
and errors on these very cases say nothing.
"""

from __future__ import annotations

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.identification.curve_fits import LawFit
from rom.identification.joint import tension_levels


def few_cases(
    curve: str, fit: LawFit | None, tension: FloatArray, *, declared: bool = False
) -> tuple[str, ...]:
    """Return a line for a curve of as many numbers as cases or levels, or for a constant in its place.

    Parameters
    ----------
    curve : str
        What people call it, such as "k_C(T)".
    fit : LawFit or None
        The fitted curve.
    tension : ndarray, shape (cases,)
        Tensions of its cases [N].
    declared : bool
        Whether its form is declared: then it stands as it is.
    """
    if fit is None:
        return ()
    numbers, cases, levels = len(fit.free), len(fit.records), tension_levels(tension)
    positive = tension[tension > 0]
    if not levels and not declared and cases > 1 and positive.size:
        return (f"{curve}: {_of_near(fit, positive)}",)
    bends = levels == RULES.curve_levels and not declared
    assumed = ", and where between them it bends is assumed" if bends else ""
    if cases <= numbers:
        text = f"{curve}: {_count(numbers, 'number')} from {_count(cases, 'record')}{assumed}"
        return (f"{text}: it meets them whatever its form; no limits, and its errors on them say nothing",)
    if 0 < levels <= numbers:
        text = f"{curve}: {numbers} numbers from {levels} levels of tension{assumed}"
        return (f"{text}: no level is left to test its form; its limits hold for this form alone",)
    return ()


def _of_near(fit: LawFit, tension: FloatArray) -> str:
    if tension.size == 1:
        return "found one tension above zero, too few for a curve: a constant stands for it"
    low, high = f"{tension.min():.4g}", f"{tension.max():.4g}"
    span = f"{f'at {low}' if low == high else f'from {low} to {high}'} N the records tell"
    if len(fit.free) == 1:
        return f"{span} no change: a constant stands for it"
    return f"{span} {len(fit.free)} numbers ({fit.law.name}); beyond these tensions it is extrapolated"


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
