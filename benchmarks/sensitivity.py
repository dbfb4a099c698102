"""How tensions answer to the parameters of a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rom.model.model import Model

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

    def run(vary: Mapping[str, float]) -> FloatArray:
        return model.final_tension(forces, rate_hz, initial_tension, vary, window_s, tolerance=TOLERANCE)

    return _differences(model, paths, run)


def mean_tensions_sensitivity(
    model: Model,
    forces: npt.ArrayLike,
    rate_hz: float,
    initial_tension: npt.ArrayLike,
    edges_s: npt.ArrayLike,
    paths: Sequence[str],
    tension_rate_hz: float | None = None,
) -> FloatArray:
    """Derivatives ``p dT/dp`` of mean tensions over bins, as ``final_tension_sensitivity``.

    Parameters
    ----------
    model, forces, rate_hz, initial_tension, edges_s, tension_rate_hz
        As for ``Model.mean_tensions``.
    paths : sequence of str
        Parameters, not zero.

    Returns
    -------
    ndarray, shape (cases, bins, paths)
        Change of tension [N] per relative change of the parameter.

    Raises
    ------
    ValueError
        If a path is unknown or its value is zero.
    """

    def run(vary: Mapping[str, float]) -> FloatArray:
        return model.mean_tensions(
            forces, rate_hz, initial_tension, edges_s, vary, None, TOLERANCE, tension_rate_hz
        )

    return _differences(model, paths, run)


def motion_sensitivity(
    model: Model,
    force: Mapping[str, npt.ArrayLike],
    rate_hz: float,
    initial_tension: float,
    paths: Sequence[str],
) -> Mapping[str, FloatArray]:
    """Derivatives ``p dx/dp`` of the displacement of every body, by body, shape (samples, paths) [m].

    Parameters
    ----------
    model, force, rate_hz, initial_tension
        As for ``Model.simulate``.
    paths : sequence of str
        Parameters, not zero.

    Raises
    ------
    ValueError
        If a path is unknown or its value is zero.
    """

    def run(vary: Mapping[str, float]) -> FloatArray:
        changed = model.with_values(vary)
        response = changed.simulate(force, rate_hz, initial_tension, tolerance=TOLERANCE)
        return np.stack(list(response.displacement.values()))

    found = _differences(model, paths, run)
    return dict(zip(model.structure.body_names, found, strict=True))


def _differences(
    model: Model, paths: Sequence[str], run: Callable[[Mapping[str, float]], FloatArray]
) -> FloatArray:
    """Central differences of ``run`` over the logarithm of every parameter, on a last axis."""
    columns = []
    for path in paths:
        value = model.parameter(path).value
        if value == 0.0:
            raise ValueError(f"a relative change needs a value other than zero, {path} is 0")
        above, below = (run({path: value * factor}) for factor in (1.0 + STEP, 1.0 - STEP))
        columns.append((above - below) / (2.0 * STEP))
    return np.stack(columns, axis=-1)
