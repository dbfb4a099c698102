"""Laws of links from what a linear fit, the curves over tension and cycled records tell of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rom.campaign.campaign import LinkSettings
from rom.criteria.identification import RULES
from rom.identification.curve_fits import LawFit
from rom.identification.output_error import OutputErrorFit
from rom.identification.record_spectra import UNCOUPLED, LinearNames
from rom.model.description import LinkLaws
from rom.model.laws import Z95, Law, constant_damping, constant_stiffness, no_loosening


def bolted_laws(
    link: LinkSettings, joint: tuple[LawFit | None, LawFit | None], cycled: Sequence[tuple[str, float, float]]
) -> LinkLaws | None:
    """Return the curves; constants of cycled records or given values without; None where none tells.

    Parameters
    ----------
    link : LinkSettings
        Settings of the link.
    joint : tuple of LawFit or None
        Curves of stiffness and damping.
    cycled : sequence of (str, float, float)
        File, stiffness [N/m] and damping [N s/m] of each cycled record.

    Returns
    -------
    LinkLaws or None
        Laws of the link.
    """
    stiffness, damping = joint
    if stiffness is None or damping is None:
        own = [(k, c) for name, k, c in cycled if name == link.name]
        if own:
            k_mean, c_mean = np.mean(own, axis=0)
            return LinkLaws(
                constant_stiffness(float(k_mean)), constant_damping(float(c_mean)), no_loosening()
            )
        if link.stiffness_n_per_m is None and link.damping_ns_per_m is None:
            return None
        k, c = (
            constant_stiffness(link.stiffness_n_per_m or 0.0),
            constant_damping(link.damping_ns_per_m or 0.0),
        )
        return LinkLaws(k, c, no_loosening())
    return LinkLaws(stiffness.law, damping.law, no_loosening())


def mean_laws(link: str, linear: OutputErrorFit | None) -> LinkLaws | None:
    """Return constants, the geometric means over the records; None where no record tells them."""
    values = []
    for name in (LinearNames.stiffness(link), LinearNames.damping(link)):
        own = [linear.value(x) for x in linear.names if x.startswith(f"{name}@")] if linear else []
        values.append(float(np.exp(np.mean(np.log(own)))) if own else 0.0)
    if not any(values):
        return None
    return LinkLaws(constant_stiffness(values[0]), constant_damping(values[1]), no_loosening())


def linear_laws(
    settings: LinkSettings,
    linear: OutputErrorFit | None,
    cycled: Sequence[tuple[str, float, float]],
    *,
    bolted_in: bool,
) -> LinkLaws | None:
    """Return constant laws, None where no record tells them; the dynamic fit goes before cycled records.

    Parameters
    ----------
    settings : LinkSettings
        Settings of the link.
    linear : OutputErrorFit
        The fit of the shared terms.
    cycled : sequence of (str, float, float)
        File, stiffness [N/m] and damping [N s/m] of each cycled record.
    bolted_in : bool
        Whether the bolt is in: flexures stiffen with it.

    Returns
    -------
    LinkLaws or None
        Laws of the link.
    """
    link, dashpot = settings.name, settings.law == "dashpot"
    stiffness, damping = LinearNames.stiffness(link, bolted_in=bolted_in), LinearNames.damping(link)
    identified = (
        stiffness in linear.names or (dashpot and bolted_in and damping in linear.names) if linear else False
    )
    if linear is not None and not dashpot and bolted_in and not identified and damping in linear.names:
        told = f"{stiffness}.{UNCOUPLED}" in linear.names  # else every record gives its own stiffness
        if not told:
            k = constant_stiffness(settings.stiffness_n_per_m or 0.0)
            return LinkLaws(k, _constant(constant_damping, "c", linear, damping))
    if linear is not None and identified:
        k = _constant(constant_stiffness, "k", linear, stiffness)
        return LinkLaws(k, _constant(constant_damping, "c", linear, damping))
    own = [(k, c) for name, k, c in cycled if name == link]
    if not (own and bolted_in):
        return None
    k_mean, c_mean = np.mean(own, axis=0)
    return LinkLaws(constant_stiffness(float(k_mean)), constant_damping(float(c_mean)))


def _constant(law: Callable[[float], Law], parameter: str, linear: OutputErrorFit, name: str) -> Law:
    """Return a constant law with the fit's value and limits; zero where the structure has no such term."""
    if name not in linear.names:
        return law(0.0)
    value, error = linear.value(name), linear.relative_error(name)
    made = law(value)
    if error > RULES.undetermined:
        return made
    error = float(np.hypot(error, RULES.discretised_link))
    limited = replace(
        made.parameters[parameter],
        low=value * np.exp(-Z95 * error),
        high=value * np.exp(Z95 * error),
        source="identified",
    )
    return replace(made, parameters={parameter: limited})
