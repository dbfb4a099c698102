"""The records that tell something of the tension, together."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.courses.frozen_motion import FrozenMotion
from discovery.criteria.criteria import CRITERIA
from discovery.criteria.tension import Tension
from discovery.residual.tension_records import NO_DRIFT, Drift, TensionObservation
from rom.campaign.channels import FloatArray
from rom.model.model import Model


@dataclass(frozen=True, eq=False)
class TensionData:
    """All records of a campaign that tell something of the tension, training ones first.

    Attributes
    ----------
    model : Model
        The current model, effects that were accepted in it.
    records : tuple of TensionObservation
        Measured tension, corrected by what the model holds.
    frozen : FrozenMotion
        Motion and tension history of every record.
    training : int
        Number of training records.
    struck : ndarray of bool, shape (records,)
        Whether a record is a loosening one: coupled ones are not simulated again.
    free : tuple of str
        Numbers of the model's tension law that a fit may move.
    drift : Drift
        Drift of the gauge.
    drifting : FrozenMotion or None
        The same motion with that drift in the noise of the histories; None: without one.
    criteria : Tension
        The numbers that decide.
    """

    model: Model
    records: tuple[TensionObservation, ...]
    frozen: FrozenMotion
    training: int
    struck: FloatArray
    free: tuple[str, ...] = ()
    drift: Drift = NO_DRIFT
    drifting: FrozenMotion | None = None
    criteria: Tension = CRITERIA.tension

    def nodes(self, case: int) -> FloatArray:
        """Frozen motion of one record, (t x v F D T, nodes)."""
        return self.frozen.of_case(case)

    @property
    def files(self) -> list[str]:
        """Files in order."""
        return [record.settings.file for record in self.records]

    def part(self, *, hold_out: bool, of: FrozenMotion | None = None) -> FrozenMotion:
        """Training or held-out records."""
        whole = of or self.frozen
        ends = (self.training, len(self.records)) if hold_out else (0, self.training)
        return whole.subset(range(*ends))
