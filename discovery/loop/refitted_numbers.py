"""Numbers of links and bodies that a closed loop fitted to impact tests, with 95 % limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from discovery.decide.explanation import limited, limited_number
from discovery.explain.motion_fit import with_effects
from discovery.residual.base import Residual, level
from discovery.residual.free_parameters import FreeParameters, effect_number, size_of
from discovery.residual.output_error import WhitenedResidual
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.effects import Effect, ModelCorrection
from rom.identification.record_spectra import UNCOUPLED
from rom.model.laws import Law, Parameter
from rom.model.model import LinkLaws, Model

_UNTOLD: Numerical[float] = 1e-12  # of the largest eigenvalue: what no row tells has a huge variance
_ALONE: Numerical[float] = 0.95  # of what is told of a direction; with 0.9 to 0.99 limits hold 96 to 98 %


def refitted_numbers(residual: Residual) -> dict[str, Parameter]:
    """Return the numbers of a model's links and bodies, by path: without limits where hardly told.

    ``flexure.stiffness.k``, ``flexure.stiffness.uncoupled.k`` without the bolt, ``body.lo.mass``. Of other
    than impact tests none: the fits of their models come with limits.

    Parameters
    ----------
    residual : Residual
        Of the model, refitted, with the slopes of all numbers that were fitted together.
    """
    found: dict[str, Parameter] = {}
    if not isinstance(residual, WhitenedResidual):
        return found
    for name, share in zip(residual.names, _standard_errors(residual).tolist(), strict=True):
        for path, number in _numbers(residual.baseline, name).items():
            error = share * size_of(number.value) if share < RULES.undetermined else 0.0
            found[path] = limited_number(number, error)
    return found


def effect_with_limits(effect: Effect, residual: WhitenedResidual) -> ModelCorrection:
    """Return an effect of a model with 95 % limits by slopes of what was fitted: none where hardly told.

    Parameters
    ----------
    effect : Effect
        As the model has it.
    residual : WhitenedResidual
        Of the model; the slopes of all numbers that were fitted together count.
    """
    beside = with_effects(residual)
    errors = dict(zip(beside.names, _standard_errors(beside).tolist(), strict=True))
    numbers = {name: effect_number(effect, name) for name in effect.parameters}
    shares = {name: errors[number] for name, number in numbers.items() if number in errors}
    return limited(
        effect,
        {
            name: share * size_of(effect.parameters[name].value) if share < RULES.undetermined else 0.0
            for name, share in shares.items()
        },
    )


def with_limits(model: Model, numbers: Mapping[str, Parameter]) -> Model:
    """Return the model whose links' numbers are those of `refitted_numbers`."""

    def limited(law: Law, path: str) -> Law:
        known = {name: numbers.get(f"{path}.{name}", p) for name, p in law.parameters.items()}
        return replace(law, parameters=known)

    def of(link: str, laws: LinkLaws, place: str) -> LinkLaws:
        stiffness = limited(laws.stiffness, f"{link}.{place}")
        return replace(laws, stiffness=stiffness, damping=limited(laws.damping, f"{link}.damping"))

    return replace(
        model,
        link_laws={link: of(link, laws, "stiffness") for link, laws in model.link_laws.items()},
        uncoupled_laws={
            link: of(link, laws, f"stiffness.{UNCOUPLED}") for link, laws in model.uncoupled_laws.items()
        },
    )


def _numbers(baseline: FreeParameters, name: str) -> dict[str, Parameter]:
    """The numbers behind a name of `FreeParameters.slopes`; none of sensors and effects."""
    path, _, parameter = name.partition(":")
    place = path.split(".")
    if place[0] == "body":
        mass = next(body.mass for body in baseline.model.structure.bodies if body.name == place[1])
        return {path: Parameter(mass, "kg", bounds=(0.0, np.inf))}
    if place[0] not in baseline.model.link_laws:
        return {}
    parameters = baseline.law(path).parameters
    return {f"{path}.{n}": p for n, p in parameters.items() if parameter in ("", n)}


def _standard_errors(residual: WhitenedResidual) -> FloatArray:
    """Standard errors of the numbers of a residual, in their units, (numbers,).

    The larger one of two for each: of rows that are independent, and of records that err as one. With slopes
    Q, orthonormal over all training rows, and the rows r, the second is the root of the diagonal of

        R (sum_i z_i z_i') R',   z_i = (1 - P_i)^-1 Q_i' r_i,   P_i = Q_i' Q_i,

    R the numbers by the columns of Q: what leaving out record i would change (J. MacKinnon and H. White, J.
    Econometrics 29, 305, 1985). Most of what a record errs by as a whole is taken up by the fit where few
    tell a number, so that sums over records of what is left are too small (docs/limits.md). What hangs on
    one record alone no other can tell: that has the first error only.
    """
    slopes, rows = residual.jacobian[residual.training], residual.residual[residual.training]
    unit = np.linalg.norm(slopes, axis=0)
    unit[unit == 0.0] = 1.0  # of what no row tells the eigenvalue is zero
    size, direction = np.linalg.eigh((slopes / unit).T @ (slopes / unit))
    by_column = direction / np.sqrt(np.maximum(size, _UNTOLD * size.max(initial=0.0))) / unit[:, None]
    orthonormal, owner = slopes @ by_column, residual.owner[residual.training]
    variance = np.sum(by_column**2, axis=1) * max(level(residual), 1.0)
    by_record = np.zeros_like(variance)
    for one in np.unique(owner):
        mine = orthonormal[owner == one]
        leverage, axes = np.linalg.eigh(mine.T @ mine)
        change = np.where(leverage < _ALONE, axes.T @ (mine.T @ rows[owner == one]), 0.0)
        by_record += (by_column @ axes @ (change / np.maximum(1 - leverage, 1 - _ALONE))) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, by_record)))
