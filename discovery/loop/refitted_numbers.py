"""Numbers of links and bodies that a closed loop fitted to impact tests, with 95 % limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from discovery.decide.explanation import limited_number
from discovery.residual.base import Residual, level
from discovery.residual.free_parameters import FreeParameters, size_of
from discovery.residual.output_error import WhitenedResidual
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.record_spectra import UNCOUPLED
from rom.model.laws import Law, Parameter
from rom.model.model import LinkLaws, Model

_UNTOLD: Numerical[float] = 1e-12  # of the largest eigenvalue: what no row tells has a huge variance


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

        sqrt(diag(A^-1) s^2 + diag(A^-1 B A^-1) n / (n - 1)),   A = S'S,   B = sum_i g_i g_i'

    s^2 is the mean square of the training rows, one at least, g_i = S_i' r_i sums over record i of n. The two
    are added: a fit to a dozen records takes up much of what each of them errs by as a whole, so that B alone
    is too small (docs/limits.md has what was measured).
    """
    slopes, rows = residual.jacobian[residual.training], residual.residual[residual.training]
    unit = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    slopes = slopes / unit
    size, direction = np.linalg.eigh(slopes.T @ slopes)
    inverse = (direction / np.maximum(size, _UNTOLD * size.max(initial=0.0))) @ direction.T
    owner = residual.owner[residual.training]
    scores = np.stack([slopes[owner == one].T @ rows[owner == one] for one in np.unique(owner)])
    by_record = inverse @ (scores.T @ scores) @ inverse * (len(scores) / max(len(scores) - 1, 1))
    noise = np.diag(inverse) * max(level(residual), 1.0)
    return np.asarray(np.sqrt(noise + np.diag(by_record)) / unit)
