"""What records leave open of the numbers that were identified from them, a line each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rom.campaign.campaign import CampaignSettings
from rom.criteria.identification import RULES
from rom.identification.curve_fits import LawFit
from rom.identification.few_cases import few_cases
from rom.identification.joint import JointEstimate
from rom.identification.output_error import OutputErrorFit
from rom.identification.record_spectra import UNCOUPLED
from rom.identification.reduce import ReducedRecord
from rom.identification.spectral_model import CORNER
from rom.identification.starting_values import far_starts
from rom.identification.uncoupled_priors import of_stiffness
from rom.model.description import LinkLaws
from rom.model.laws import Law
from rom.model.model import Model


def vanished(model: Model, settings: CampaignSettings) -> tuple[str, ...]:
    """Return a line for every mass that was identified next to nothing beside that of the heaviest body."""
    masses = {body.name: body.mass for body in model.structure.bodies}
    heaviest = max(masses.values())
    return tuple(
        f"body {body.name}: its mass came out as {masses[body.name]:.2g} kg beside {heaviest:.3g} kg of the "
        "heaviest body: the records do not tell it; give mass_kg, or leave the body out"
        for body in settings.body
        if body.mass_kg is None and masses[body.name] < RULES.vanished_mass * heaviest
    )


def of_links(linear: OutputErrorFit | None, settings: CampaignSettings) -> tuple[str, ...]:
    """Return a line for every shared value that the records leave open, every resonance without a mode and
    every start far off, and for a fit that did not end.
    """
    if linear is None:
        return ()
    shared = [name for name in linear.names if "@" not in name and not name.startswith(CORNER)]
    lines = [
        f"{name}: these records do not separate it from the links beside it, so its value has no limits"
        f"{_without_bolt(name, linear)}"
        for name in shared
        if linear.relative_error(name) > RULES.undetermined
    ]
    if not linear.converged:
        lines.append(
            "the fit of the linear links had not settled when it ended: what the declared model lacks may "
            "keep it from that (`boltlaw close`)"
        )
    return (*lines, *far_starts(settings, linear), *(one.line for one in linear.unexplained))


def _without_bolt(name: str, linear: OutputErrorFit) -> str:
    """Say what the uncoupled tests know of a stiffness that is open with the bolt in."""
    alone = f"{name}.{UNCOUPLED}"
    if alone not in linear.names or linear.relative_error(alone) > RULES.undetermined:
        return ""
    return f"; without the bolt it is {linear.value(alone):.6g} N/m"


def without_conditional_limits(
    model: Model, linear: OutputErrorFit | None, far_off: bool
) -> tuple[Model, tuple[str, ...]]:
    """Return the model without limits of its links where they hold for wrong numbers alone, and a line on it.

    A term that a fit drove to zero, or where it stopped, makes others look well known, which then may be off
    by factors: of a ringing with one mode the bodies' springs change places. Uncoupled tests rule that out.

    Parameters
    ----------
    model : Model
        As identified.
    linear : OutputErrorFit or None
        The fit behind it.
    far_off : bool
        Whether its numbers are doubted anyway.
    """
    if linear is None or of_stiffness(linear.ties) or len(model.link_laws) < 2:
        return model, ()
    untold = [x for x in linear.names if CORNER not in x and linear.relative_error(x) > RULES.undetermined]
    joints = {name for name in linear.names if "@" in name}
    is_open = any("@" not in name for name in untold) or (joints and joints <= {*untold})
    if linear.converged and not far_off and not is_open:
        return model, ()
    laws = {link: _unlimited(law) for link, law in model.link_laws.items()}
    text = (
        "no uncoupled test tells the links by themselves, and the records leave some of them open: no limits"
    )
    return replace(model, link_laws=laws), (text,)


def _unlimited(laws: LinkLaws) -> LinkLaws:
    def law(one: Law) -> Law:
        return replace(
            one, parameters={n: replace(p, low=None, high=None) for n, p in one.parameters.items()}
        )

    return replace(laws, stiffness=law(laws.stiffness), damping=law(laws.damping))


def untensioned(records: Sequence[ReducedRecord], settings: CampaignSettings) -> tuple[str, ...]:
    """Return a line for every record whose joint has no place on the curves."""
    return tuple(
        f"{r.settings.file}: no strain, tension or preload_n places its joint on the curves over tension"
        for r in records
        if settings.bolt is not None
        and r.spectra
        and r.settings.test != UNCOUPLED
        and r.tensions is None
        and r.settings.preload_n is None
    )


def few_joints(
    joint: Sequence[JointEstimate], curves: tuple[LawFit | None, LawFit | None]
) -> tuple[str, ...]:
    """Return a line for every curve of the joint that its records cannot contradict."""
    tension = np.array([estimate.tension for estimate in joint])
    pairs = zip(("k_C(T)", "c_C(T)"), curves, strict=True)
    return tuple(line for name, fit in pairs for line in few_cases(name, fit, tension))
