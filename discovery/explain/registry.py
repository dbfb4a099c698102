"""Every explainer by name: what it takes, and where it is.

An explainer is a function ``explain(residual, options)`` that returns an `Explanation` of every effect that
it knows. A new one is a module of this folder, a line here, and its place in the loop: what shows before the
hits is called by name in `discovery.loop.rest_stage`; of the others the refits of each kind of record
(`discovery.loop.impact_refits` and its fellows) take the steps, screen and fits, one by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Any, Literal

from discovery.decide.explanation import Explanation
from discovery.options import Options

Takes = Literal["output error", "tension", "force balance", "simulation", "tension at rest"]


@dataclass(frozen=True)
class Explainer:
    """A function that explains residuals of one kind, imported when it is called.

    Attributes
    ----------
    module : str
        With a function ``explain``.
    takes : {"output error", "tension", "force balance", "simulation", "tension at rest"}
        The residual: `discovery.residual.output_error.WhitenedResidual`,
        `discovery.residual.tension.TensionResidual`,
        `discovery.residual.force_balance.ForceBalanceResidual`,
        `discovery.residual.simulation.SimulationResidual` or
        `discovery.residual.at_rest.RestResidual`.
    """

    module: str
    takes: Takes

    def __call__(self, residual: Any, options: Options) -> Sequence[Explanation]:
        """Return what every effect explains; nothing of a residual of another kind."""
        if residual.kind != self.takes:
            return ()
        found: Sequence[Explanation] = import_module(self.module).explain(residual, options)
        return found


EXPLAINERS: Mapping[str, Explainer] = MappingProxyType(
    {
        "calibration": Explainer("discovery.explain.calibration", "output error"),
        "at rest": Explainer("discovery.explain.at_rest", "output error"),
        "ground motion": Explainer("discovery.explain.ground_motion", "output error"),
        "free form": Explainer("discovery.explain.free_form", "output error"),
        "motion": Explainer("discovery.explain.motion", "output error"),
        "force balance": Explainer("discovery.explain.force_balance", "force balance"),
        "free force": Explainer("discovery.explain.free_force", "force balance"),
        "simulation": Explainer("discovery.explain.simulation", "simulation"),
        "tension": Explainer("discovery.explain.tension", "tension"),
        "tension at rest": Explainer("discovery.explain.tension_at_rest", "tension at rest"),
        "free rate": Explainer("discovery.explain.free_rate", "tension"),
    }
)
