"""In which records and how slow what a model leaves over of a tension at rest is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import stats

from discovery.localisation.localise import PRELOADS_N, Localisation, Profile, class_label
from discovery.residual.at_rest import RestResidual
from rom.criteria.number import Numerical

_CYCLES: Numerical[tuple[float, ...]] = (1.0, 2.0, 4.0)  # in a record


def localise_rest(residual: RestResidual) -> Localisation:
    """Return where the residual of the training records lives.

    ``by_frequency`` is by cycles in a record: slow lines are half-waves over its length. ``whiteness_p`` is
    the chance of so large a residual where the gauge's noise alone is left.
    """
    squares = residual.residual[residual.training] ** 2
    owner = residual.owner[residual.training]
    half_waves = np.concatenate([np.arange(1, r.slow + 1) for r in residual.records])[residual.training]
    cycles = np.searchsorted(_CYCLES, 0.5 * half_waves)
    preload = np.searchsorted(PRELOADS_N, [record.tension for record in residual.records])[owner]
    files = [record.settings.file for record in residual.records]

    def by(labels: list[str]) -> Profile:
        named = np.array(labels)
        return tuple((name, float(squares[named == name].mean())) for name in dict.fromkeys(labels))

    return Localisation(
        by_channel=by(["tension"] * len(squares)),
        by_test=by([files[place] for place in owner]),
        by_frequency=by([class_label(place, _CYCLES, "cycles a record") for place in cycles]),
        by_preload=by([class_label(place, PRELOADS_N, "N") for place in preload]),
        by_amplitude=(),
        whiteness_p=float(stats.chi2.sf(squares.sum(), squares.size)),
        total=float(squares.mean()),
        numbers=tuple(_errors(residual)),
    )


def _errors(residual: RestResidual) -> Iterator[tuple[str, float]]:
    """RMS of what is left of the slow tension [N], by kind of record."""
    for kind, value in residual.slow_errors().items():
        if value is not None:
            yield f"slow_tension_n_{kind}", value
