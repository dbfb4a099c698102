"""The whitened residual of the motion: noise, priors, what is aligned with the model's numbers."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Motion(Group):
    """The whitened residual of the motion: noise, priors, what is aligned with the model's numbers."""
