"""Lumped structures: bodies, the links between them, and the matrices that follow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

GROUND = "ground"
LinkKind = Literal["linear", "dashpot", "bolted"]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A lumped mass that moves along one line.

    Parameters
    ----------
    name : str
        Any name but ``"ground"``.
    mass : float
        Mass [kg], positive.

    Raises
    ------
    ValueError
        If the name is empty or ``"ground"``, or the mass is not a positive number.
    """

    name: str
    mass: float

    def __post_init__(self) -> None:
        if not self.name or self.name == GROUND:
            raise ValueError(f"body name must be non-empty and not {GROUND!r}, got {self.name!r}")
        if not (math.isfinite(self.mass) and self.mass > 0):
            raise ValueError(f"body {self.name!r}: mass must be a positive number of kg, got {self.mass!r}")


@dataclass(frozen=True)
class Link:
    """What ties two bodies, or a body and the ground, together.

    The relative motion of a link is that of ``first`` minus that of ``second``.

    Parameters
    ----------
    name : str
        Name of the link.
    first, second : str
        Names of two different bodies; one of them may be ``"ground"``.
    law : {"linear", "dashpot", "bolted"}
        ``k x + c v``, ``c v``, or ``k_C(T) x + c_C(T) v`` with a tension T of its own.

    Raises
    ------
    ValueError
        If both ends are the same or the law is unknown.
    """

    name: str
    first: str
    second: str
    law: LinkKind = "linear"

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("link name must be non-empty")
        if self.first == self.second:
            raise ValueError(f"link {self.name!r} must join two different bodies, got {self.first!r} twice")
        if self.law not in get_args(LinkKind):
            raise ValueError(f"link {self.name!r}: law must be one of {get_args(LinkKind)}, got {self.law!r}")


@dataclass(frozen=True)
class Structure:
    """Bodies and links: ``M x'' + B^T f(B x, B x', T) = F``.

    Parameters
    ----------
    bodies : tuple of Body
        In the order of the columns of the matrices.
    links : tuple of Link
        In the order of the rows of the incidence matrix B.

    Raises
    ------
    ValueError
        If a name is used twice or a link ends at an unknown body.
    """

    bodies: tuple[Body, ...]
    links: tuple[Link, ...]

    def __post_init__(self) -> None:
        if not self.bodies:
            raise ValueError("a structure needs at least one body, got none")
        for kind, names in (("body", self.body_names), ("link", self.link_names)):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"{kind} names must be unique, got {', '.join(twice)} more than once")
        known = {GROUND, *self.body_names}
        for link in self.links:
            for end in (link.first, link.second):
                if end not in known:
                    raise ValueError(
                        f"link {link.name!r} must end at one of {', '.join(sorted(known))}, got {end!r}"
                    )

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies, in order."""
        return tuple(body.name for body in self.bodies)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links, in order."""
        return tuple(link.name for link in self.links)

    @property
    def bolted_links(self) -> tuple[str, ...]:
        """Names of the links that have a tension, in order."""
        return tuple(link.name for link in self.links if link.law == "bolted")

    @property
    def masses(self) -> FloatArray:
        """Masses of the bodies [kg], shape (bodies,)."""
        return np.array([body.mass for body in self.bodies], dtype=np.float64)

    @property
    def mass_matrix(self) -> FloatArray:
        """Diagonal mass matrix M [kg], shape (bodies, bodies)."""
        return np.diag(self.masses)

    @property
    def ends(self) -> npt.NDArray[np.int64]:
        """Body indices of both ends of every link, -1 for ground, shape (links, 2)."""
        index = {name: place for place, name in enumerate(self.body_names)} | {GROUND: -1}
        pairs = [(index[link.first], index[link.second]) for link in self.links]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    @property
    def incidence(self) -> FloatArray:
        """Incidence matrix B: +1 at a link's first body, -1 at its second, shape (links, bodies)."""
        matrix = np.zeros((len(self.links), len(self.bodies)))
        for row, (first, second) in enumerate(self.ends):
            if first >= 0:
                matrix[row, first] = 1.0
            if second >= 0:
                matrix[row, second] = -1.0
        return matrix
