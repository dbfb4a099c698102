"""Starting values of a fit: those declared, unless they are far from what the records show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rom.campaign.campaign import CampaignSettings
from rom.criteria.identification import RULES
from rom.identification.output_error import OutputErrorFit, start_cost
from rom.identification.record_spectra import LinearNames, with_starts
from rom.identification.spectral_model import SpectralRecord


def best_starts(
    records: Sequence[tuple[SpectralRecord, ...]], settings: CampaignSettings
) -> tuple[SpectralRecord, ...]:
    """Return all parts of all records with starting values.

    A fit that starts from a mode far off may never find that of the records: where a declared start is far
    from what equation errors tell, that of the two is taken which leaves less over.
    """
    declared = with_starts(records, settings)
    if not any(link.stiffness_n_per_m or link.damping_ns_per_m for link in settings.link):
        return declared
    own = with_starts(records, settings, declared=False)
    pairs = (
        (a.value, b.value)
        for x, y in zip(declared, own, strict=True)
        for a, b in zip(x.terms, y.terms, strict=True)
    )
    far = any(a > 0 and b > 0 and abs(np.log(a / b)) > np.log(RULES.far_start) for a, b in pairs)
    return own if far and start_cost(own) < start_cost(declared) else declared


def far_starts(settings: CampaignSettings, linear: OutputErrorFit | None) -> Iterator[str]:
    """Yield a line for every declared starting stiffness that is far from what was identified."""
    if linear is None:
        return
    for link in settings.link:
        name, start = LinearNames.stiffness(link.name), link.stiffness_n_per_m
        values = [linear.value(x) for x in linear.names if x == name or x.startswith(f"{name}@")]
        nearest = float(np.clip(start or 0.0, min(values, default=0.0), max(values, default=0.0)))
        if start and nearest and abs(np.log(start / nearest)) > np.log(RULES.far_start):
            factor = start / nearest
            yield (
                f"link {link.name}: stiffness_n_per_m = {start:.4g} is {factor:.3g} times what the records "
                "show: the mode that it gives is not theirs"
            )
