"""Effects that free simulations of driven bodies show, once their balances of forces tell no more.

Balances weigh every instant alone, and quick forces that no model has, such as a drive's ripple, hide what is
small but lasts. A simulation adds it up. So where balances leave more than noise the search goes on in
`discovery.residual.simulation`, with the numbers that simulate the records best, and by the same rules. What
it finds counts where the motion of held-out records is met better than with the numbers of the balances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from discovery.explain.driven_fit import driven_residual
from discovery.explain.simulation import in_other_shapes
from discovery.explain.simulation_fit import together
from discovery.loop.free_refits import FreeRefits
from discovery.loop.history import LoopHistory
from discovery.loop.motion_stage import in_motion
from discovery.loop.refits import Probes
from discovery.options import Options
from discovery.residual.base import Residual, cost
from discovery.residual.simulation import SimulationResidual
from rom.campaign.campaign import Campaign
from rom.effects import ModelCorrection
from rom.model.model import Model
from rom.signals.processing import Measurement


@dataclass(frozen=True, eq=False)
class DrivenRefits(FreeRefits):
    """Fits of driven bodies by simulation, beside faults of force sensors that balances have told."""

    faults: tuple[ModelCorrection, ...] = ()

    def settled(self, residual: Residual) -> Residual:
        """Where least is left of fits from every shape of the last effect: they end in many places.

        Friction turns within a sample, and what is left is no smooth function of where it turns.
        """
        own = self.own(residual)
        fits = (together(replace(own, model=model)) for model in in_other_shapes(own))
        return min((own, *fits), key=cost)

    def screen(self, residual: Residual) -> Probes:
        """Probes of all but masses of their own, which balances show too: what drifts would pass for one."""
        return [probes for probes in super().screen(residual) if not probes[0].member.starts]

    def _model_of(self, residual: SimulationResidual) -> tuple[Model, tuple[str, ...]]:
        return replace(residual.model, effects=(*residual.model.effects, *self.faults)), ()


def searched(
    campaign: Campaign,
    measured: Sequence[Measurement],
    model: Model,
    names: Sequence[str],
    row_rates_hz: Mapping[str, float],
    options: Options,
) -> LoopHistory | None:
    """Search for forces that free simulations show beside those of a model, which stay.

    Parameters
    ----------
    campaign : Campaign
        Whose records they are.
    measured : sequence of Measurement
        Records of driven bodies, held-out ones too.
    model : Model
        With its effects so far.
    names, row_rates_hz
        As for `discovery.explain.driven_fit.driven_residual`.
    options : Options
        How the loop is run.

    Returns
    -------
    LoopHistory or None
        From the model with all its numbers fitted by simulation to the last one; None where a record is not
        driven, or cannot be simulated with the model.
    """
    residual = driven_residual(model, names, measured, options.criteria, row_rates_hz)
    if residual is None or residual.record_count < len(measured):
        return None
    residual = together(replace(residual, thorough=True))
    refits = DrivenRefits(
        campaign, residual.rings, residual.model, residual.names, (), (), options,
        faults=model.effects_of("sensor fault"),
    )  # fmt: skip
    return in_motion(refits, LoopHistory((refits.evaluated(residual),), criteria=options.criteria))
