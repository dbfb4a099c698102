"""What installed packages add, by the entry point groups ``boltlaw.effects`` and ``boltlaw.laws``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

EFFECTS, LAWS = "boltlaw.effects", "boltlaw.laws"
T = TypeVar("T")


class PlugInWarning(UserWarning):
    """A plug-in that is left out; the message names its package and says what failed."""


def packages() -> dict[str, str]:
    """Return the versions of the packages that add effects or laws, by name."""
    found = (entry.dist for group in (EFFECTS, LAWS) for entry in entry_points(group=group))
    return dict(sorted((dist.name, dist.version) for dist in found if dist is not None))


def plug_ins(group: str, read: Callable[[object], Iterable[T]]) -> list[tuple[str, tuple[T, ...]]]:
    """Load what packages add to a group; what fails is left out with a warning.

    Parameters
    ----------
    group : str
        `EFFECTS` or `LAWS`.
    read : callable
        Takes what an entry point names and returns its members, or raises.

    Returns
    -------
    list of (str, tuple)
        Package and members, in the order of the packages' names.
    """
    found = []
    for entry in sorted(entry_points(group=group), key=lambda entry: (_package(entry), entry.name)):
        try:
            found.append((_package(entry), tuple(read(entry.load()))))
        except Exception as error:  # whatever another's code may raise
            warnings.warn(
                f"plug-in {_package(entry)!r} is left out: {group}, {entry.name} = {entry.value}: "
                f"{type(error).__name__}: {error}",
                PlugInWarning,
                stacklevel=2,
            )
    return found


def members_of(found: object, kind: type[T] | tuple[type[T], ...]) -> tuple[T, ...]:
    """Return an object of a kind, or those in a sequence, as a tuple.

    Raises
    ------
    TypeError
        If there is anything else.
    """
    members = tuple(found) if isinstance(found, list | tuple) else (found,)
    names = " or ".join(one.__name__ for one in (kind if isinstance(kind, tuple) else (kind,)))
    for member in members:
        if not isinstance(member, kind):
            raise TypeError(f"found {member!r}, expected {names}, or a list of these")
    return members


def _package(entry: EntryPoint) -> str:
    return entry.module if entry.dist is None else str(entry.dist.name)
