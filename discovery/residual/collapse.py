"""Tests that loosen a joint so far that no model can follow them."""

from __future__ import annotations

from typing import NamedTuple

from discovery.residual.trajectory import Measurements
from rom.model.model import Model


def collapses(model: Model, initial_n: float, final_n: float, least: float) -> bool:
    """Whether a test loosens a joint so far that its course within the hit decides.

    No gauge tells a tension from sample to sample while a joint rings, and a simulation that ends at the
    measured one may fall a millisecond early. Where that is most of a joint's stiffness, what the simulated
    motion leaves is a thousand times the noise.

    Parameters
    ----------
    model : Model
        With the joint's stiffness over tension.
    initial_n, final_n : float
        Tensions before and after the test [N].
    least : float
        Share of the stiffness that the joint must keep.
    """
    bolted = model.structure.bolted_links
    if len(bolted) != 1:
        return False
    stiffness = model.link_laws[bolted[0]].stiffness
    return bool(stiffness(max(final_n, 0.0)) < least * stiffness(max(initial_n, 0.0)))


class Followed(NamedTuple):
    """Records as measured that a model can follow, and the files of those that none can."""

    records: Measurements
    aside: tuple[str, ...]

    @classmethod
    def among(cls, model: Model, measurements: Measurements, least: float) -> Followed:
        """Sort out the loosening records whose joint `collapses`.

        Parameters
        ----------
        model : Model
            With the joint's stiffness over tension.
        measurements : sequence
            The records, as `discovery.residual.trajectory.read_measurements` has them.
        least : float
            Share of the stiffness that the joint must keep.
        """
        aside = tuple(
            settings.file
            for settings, seen in measurements
            if seen.test == "loosening"
            and seen.tension is not None
            and collapses(model, seen.tension.initial, seen.tension.final, least)
        )
        return cls([one for one in measurements if one[0].file not in aside], aside)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Say which records are left out, and why."""
        why = "the joint loses so much of its stiffness within the hit that no model can follow"
        return (f"{', '.join(self.aside)}: {why}",) if self.aside else ()
