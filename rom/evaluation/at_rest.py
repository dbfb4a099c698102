"""What a gauge shows of a bolt at rest: a tension that stays as it is, and the model's readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rom.campaign.channels import FloatArray
from rom.model.model import Model
from rom.signals.per_record_parameters import at_rest
from rom.signals.processing import Measurement, TensionRecord
from rom.signals.sensor_correction import corrected


def held_tension(model: Model, measurement: Measurement) -> tuple[FloatArray, TensionRecord]:
    """Return the tension [N] that a model shows of a record at rest, and what was measured, faults taken out.

        T(t) = T_0 + readings(t),   T_0 = mean of what was measured less the readings

    The tension T_0 belongs to the record, as the initial state of a free one does: it is estimated from the
    whole of it, on hold-out too.

    Raises
    ------
    ValueError
        If the record holds no tension.
    """
    gauge = replace(model, effects=model.effects_of("sensor fault"))
    tension = corrected(measurement, gauge).tension
    if tension is None:
        raise ValueError(f"{measurement.file}: found no strain or tension, expected one of a bolt at rest")
    rest = at_rest(len(tension.samples), tension.rate_hz, measurement)
    added = sum((reading.added(rest) for reading in model.effects_of("reading")), np.zeros(len(rest.time)))
    return float(np.mean(tension.samples - added)) + added, tension
