"""Where an effect can enter a structure, by kind of effect."""

from __future__ import annotations

from collections.abc import Iterable

from rom.campaign.channels import BOLT_CHANNELS, channel_names
from rom.model.effect import ModelCorrection
from rom.model.structure import Structure


def places_of(effect: ModelCorrection, structure: Structure) -> tuple[str, ...]:
    """Every place of a structure where an effect of this kind can enter."""
    bolted = bool(structure.bolted_links)
    if effect.kind == "sensor fault":
        channels = channel_names(structure.body_names, structure.link_names)
        known = (name for name in channels if name not in BOLT_CHANNELS)
        return (*(f"sensor:{name}" for name in known), *(["sensor:tension"] if bolted else []))
    tension = ("tension",) if bolted else ()
    if effect.kind == "force":
        return (*structure.link_names, *(f"body:{name}" for name in structure.body_names), *tension)
    return tension


def check_effects(effects: Iterable[ModelCorrection], structure: Structure) -> None:
    """Refuse effects that enter where they cannot, or twice.

    Raises
    ------
    ValueError
        If an effect enters where there is nothing or where its kind cannot, or two effects of one name enter
        at one place.
    """
    seen: set[str] = set()
    for effect in effects:
        places = places_of(effect, structure)
        if effect.enters not in places:
            known = ", ".join(places) or "a bolted link, which the model lacks"
            raise ValueError(f"effect {effect.name!r} must enter at {known}, got {effect.enters!r}")
        if effect.path in seen:
            raise ValueError(
                f"a model must hold one effect of a name at a place, got two {effect.name!r} at "
                f"{effect.enters!r}: join them in one"
            )
        seen.add(effect.path)
