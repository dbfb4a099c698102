"""What the gauge's error of a record's tension changes of the motion.

A loose joint's stiffness follows the tension closely: with the joint of one block on a spring, 0.02 N at 10 N
are 0.2 rad of phase after 2 s. The error is one number of unit variance for each record, estimated beside its
end states.
"""

from __future__ import annotations

import numpy as np

from discovery.residual.free_parameters import FreeParameters
from discovery.residual.trajectory import MeasuredTrajectory
from rom.identification.spectral_model import Linearised


def beside_tension_error(
    linear: Linearised, trace: MeasuredTrajectory, baseline: FreeParameters
) -> Linearised:
    """Return the linear model of a record's first part with the error of its tension estimated too.

    The first part holds the joint's slow modes, whose phase the error shifts.

    Parameters
    ----------
    linear : Linearised
        Residual and slopes of the part.
    trace : MeasuredTrajectory
        The record; its tension is known to a standard error, of the end where a bolt loosened.
    baseline : FreeParameters
        The model, whose joint laws tell what a tension changes.
    """
    seen = trace.measurement.tension
    if seen is None or not any("@" in name for name in linear.columns):
        return linear
    error = seen.final_error if trace.measurement.test == "loosening" else seen.initial_error
    shares = [baseline.change_with_tension(name, trace.level, error) for name in linear.columns]
    return linear.beside(linear.jacobian @ np.array(shares))
