"""What records show before the hits, and what declared preloads say of the gauge: added before all else."""

from __future__ import annotations

from discovery.explain.registry import EXPLAINERS
from discovery.loop.history import LoopHistory, best_explanation
from discovery.loop.refits import Refits
from rom.effects import SensorFault


def gauged(refits: Refits, history: LoopHistory) -> tuple[Refits, LoopHistory]:
    """Add a fault of the gauge that the declared preloads show, and identify the campaign anew beside it.

    All that follows rests on the tension: a bolt that a wrong zero shows slack is not even looked at.
    """
    options = refits.options
    explanations = EXPLAINERS["calibration"](history.last.residual, options)
    selection = best_explanation(explanations, options.criteria)
    if selection is None or not isinstance(selection.best.effect, SensorFault):
        return refits, history
    refits = refits.corrected(selection.best.effect)
    return refits, history.extended(selection, refits.start())


def before_hits(refits: Refits, history: LoopHistory) -> LoopHistory:
    """Add what shows before the hits, and would pass for noise: faults of sensors, then lasting forces."""
    options = refits.options
    while True:
        last = history.last
        for name in ("at rest", "ground motion"):
            explanations = EXPLAINERS[name](last.residual, options)
            selection = best_explanation(explanations, options.criteria)
            if selection is not None:
                break
        else:
            return history
        residual = refits.refit_with(last, selection.best, renew_noise=True)
        history = history.extended(selection, refits.evaluated(residual))
