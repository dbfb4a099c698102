"""How final tensions answer to the parameters of a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rom.model import Model

FloatArray = npt.NDArray[np.float64]
STEP = 1e-4
TOLERANCE = 1e-9  # so that the difference of two runs keeps five digits


def final_tension_sensitivity(
    model: Model,
    forces: npt.ArrayLike,
    rate_hz: float,
    initial_tension: npt.ArrayLike,
    paths: Sequence[str],
    window_s: tuple[float, float] | None = None,
) -> FloatArray:
    """Derivatives ``p dT/dp`` of final tensions with respect to the logarithms of parameters.

    Central differences of two runs a parameter, on tight tolerance; nothing is compiled or copied again, so
    that a derivative costs a few milliseconds a case.

    Parameters
    ----------
    model : Model
        A model with one bolted link.
    forces, rate_hz, initial_tension, window_s
        As for ``Model.final_tension``.
    paths : sequence of str
        Parameters, not zero.

    Returns
    -------
    ndarray, shape (cases, paths)
        Change of tension [N] per relative change of the parameter.

    Raises
    ------
    ValueError
        If a path is unknown or its value is zero.
    """
    columns = []
    for path in paths:
        value = model.parameter(path).value
        if value == 0.0:
            raise ValueError(f"a relative change needs a value other than zero, {path} is 0")
        above, below = (
            model.final_tension(
                forces, rate_hz, initial_tension, {path: value * factor}, window_s, tolerance=TOLERANCE
            )
            for factor in (1.0 + STEP, 1.0 - STEP)
        )
        columns.append((above - below) / (2.0 * STEP))
    return np.stack(columns, axis=-1)
