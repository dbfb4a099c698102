"""Which law of loosening comes first and how sure that is, in one sentence or two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from discovery.criteria.criteria import used_in
from discovery.laws.candidate import BASELINE, NO_LOOSENING
from discovery.views.ranking_plot import is_law, row_name
from experiments.text.wording import mappings, number, trimmed

Data = Mapping[str, Any]


def ranking_verdict(data: Data, laws: Sequence[Data], equals: Sequence[str]) -> tuple[str, bool | None]:
    """Return the verdict in words, and whether it is good; None where there is nothing to judge.

    Parameters
    ----------
    data : mapping
        Content of ``ranking.json``.
    laws : sequence of mapping
        Its laws, the first one first.
    equals : sequence of str
        Names of the laws that the records do not distinguish from the first.

    Returns
    -------
    tuple of str and bool or None
        Verdict and judgement.
    """
    text, good = _verdict(laws[0], equals, laws, used_in(data).ranking.better)
    return text + _on_few_preloads(data, laws[0], laws), good


def _verdict(
    best: Data, equals: Sequence[str], laws: Sequence[Data], better: float
) -> tuple[str, bool | None]:
    if is_law(best, NO_LOOSENING):
        return "No law describes these records better than a bolt that never loosens.", False
    count = len(equals)
    told = f"these records do not distinguish it from {'another one' if count == 1 else f'{count} others'}"
    if not is_law(best, BASELINE):
        if any(is_law(law, BASELINE) and law.get("name") in equals for law in laws):
            first = f"“{row_name(best)}” ranks first"
            return f"{first}, but these records do not distinguish it from the paper's law.", None
        return _against_baseline(best, equals, told, better)
    if equals:
        return f"The paper's law ranks first; {told}.", None
    return "The paper's law ranks first, and no other law describes these records as well.", True


def _against_baseline(best: Data, equals: Sequence[str], told: str, better: float) -> tuple[str, bool | None]:
    first, p = f"“{row_name(best)}” ranks first", best.get("p_value_against_baseline")
    if p is None:
        return f"{first} by re-simulation.", None
    chance = trimmed(number(float(p), 2))
    if p >= better:
        return f"{first}; that it beats the paper's law may be chance (p = {chance}).", None
    sure = f"{first} and beats the paper's law beyond chance (p = {chance})"
    return (f"{sure}; {told}.", None) if equals else (f"{sure}.", True)


def _on_few_preloads(data: Data, best: Data, laws: Sequence[Data]) -> str:
    """Say where there are too few preloads for a small p: that of signs, one for each, times the laws."""
    rules, p = used_in(data).ranking, best.get("p_value_against_baseline")
    cases, levels, first = mappings(data.get("cases")), 0, 0.0
    for tension in sorted(float(case["initial_tension_n"]) for case in cases if not case.get("hold_out")):
        if tension > first * (1 + rules.same_preload):
            levels, first = levels + 1, tension
    if p is None or p < rules.better or data.get("population") or not levels:
        return ""
    if len(laws) * 0.5**levels < rules.better:
        return ""
    return f" With {levels} preloads, one sign each, p is hardly ever small."
