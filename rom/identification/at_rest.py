"""The declared model of bolts that were watched at rest: nothing moves, and the tension stays as it is."""

from __future__ import annotations

from rom.campaign.campaign import Campaign
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness, no_loosening
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure

STILL = (
    "nothing moves in these records: they tell no mass, stiffness or damping, and what was not given stands "
    "as 1 kg and zero; the tension stays as it is"
)


def model_at_rest(campaign: Campaign) -> Model:
    """Return the model of a campaign in which nothing moves: dT/dt = 0 in every bolted link.

    Raises
    ------
    ValueError
        If no record is for training.
    """
    settings = campaign.settings
    if not campaign.select(hold_out=False):
        raise ValueError(f"{campaign.path}: found no training record of a bolt at rest, expected one")
    laws = {
        link.name: LinkLaws(
            constant_stiffness(link.stiffness_n_per_m or 0.0),
            constant_damping(link.damping_ns_per_m or 0.0),
            no_loosening() if link.law == "bolted" else None,
        )
        for link in settings.link
    }
    return Model(
        structure=Structure(
            tuple(Body(body.name, body.mass_kg or 1.0) for body in settings.body),
            tuple(Link(link.name, *link.between, link.law) for link in settings.link),
        ),
        link_laws=laws,
        calibration=(settings.bolt.calibration or ()) if settings.bolt else (),
        windows=dict(settings.windows),
        sampling=dict(settings.sampling),
    )
