"""What a model's tension law leaves over of the measured tension: histories and fast parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from discovery.options import Options
from discovery.residual.base import Kind
from discovery.residual.collapse import collapses
from discovery.residual.course_fit import CourseFit, CourseFits, Misfit
from discovery.residual.tension_data import TensionData
from discovery.residual.tension_records import TensionObservation, drifted, frozen_of, noises, read_tensions
from rom.campaign.campaign import Campaign
from rom.identification.identify import Identification
from rom.model.model import Model
from rom.signals.per_record_parameters import per_record_names


@dataclass(frozen=True, eq=False)
class TensionResidual:
    """The tension of a campaign's records, and what a model's own law leaves over of it.

    Attributes
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    identification : Identification
        For the names of the law's numbers that were identified.
    model : Model
        The current model, effects that were accepted in it.
    options : Options
        Processes that read the records, threads of the fits, criteria.
    """

    kind: ClassVar[Kind] = "tension"
    campaign: Campaign
    identification: Identification
    model: Model
    options: Options = field(default_factory=Options)

    def _collapses(self, one: TensionObservation) -> bool:
        least, course = self.options.criteria.motion.kept_stiffness, one.course
        if one.settings.test != "loosening":
            return False
        return collapses(self.identification.model, course.initial, course.final, least)

    @cached_property
    def data(self) -> TensionData | None:
        """The records; None where the model has not one bolted link, or too few have a tension and a hit."""
        if len(self.model.structure.bolted_links) != 1:
            return None
        criteria = self.options.criteria.tension
        found = read_tensions(self.campaign, self.model, self.options.jobs, criteria)
        found = tuple(one for one in found if not self._collapses(one))
        records = tuple(sorted(found, key=lambda one: one.settings.hold_out))
        struck = np.array([one.settings.test == "loosening" for one in records])
        training = sum(not one.settings.hold_out for one in records)
        if struck[:training].sum() < criteria.loosening_tests:
            return None
        noise_of = noises(records, criteria)
        if noise_of is None:
            return None
        steady, drifting, drift = noise_of
        drifts = any(per_record_names(e) for e in self.model.effects_of("reading"))
        noise = drifting if drifts else steady
        frozen = frozen_of(records, noise, self.model, self.options.criteria)
        return TensionData(
            self.model, records, frozen, training, struck, self.identification.law_numbers, drift,
            drifted(frozen, records, noise, drifting, drift.mean), criteria,
        )  # fmt: skip

    @cached_property
    def baseline(self) -> CourseFit | None:
        """The model's own law fitted to the training records; None where these tell nothing."""
        return None if self.data is None else CourseFits(self.data).law_alone()

    @property
    def misfit(self) -> Misfit:
        """What the law leaves over of the training records' histories; of no number where there are none."""
        return Misfit(1.0, 0.0) if self.baseline is None else self.baseline.misfit
